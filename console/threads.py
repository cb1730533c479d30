"""How many threads may numeric libraries take for themselves? They read it when they are loaded:
set it before."""

from __future__ import annotations

import os

# Matrices here are small, and groups of channels are judged side by side: BLAS's own threads
# only wait for each other (a diagnosis of 24,000 rows on two busy cores: 7.9 s of processor
# with them, 3.0 without).
MATRIX_VARIABLES = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
}
# Next to a working machine a core stays for the loop.
ONE_THREAD_VARIABLES = MATRIX_VARIABLES | {
    name: "1" for name in ("NUMBA_NUM_THREADS", "POLARS_MAX_THREADS")
}


def limit_matrix_threads() -> None:
    """Allow one thread for matrices in this process, unless the environment says otherwise."""
    for name, count in MATRIX_VARIABLES.items():
        os.environ.setdefault(name, count)
