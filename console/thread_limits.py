"""How many threads may numeric libraries use? They read the limit when they are loaded, so it must
be set before.
"""

from __future__ import annotations

import os

# Matrices are small here, and groups of channels are judged in parallel, so BLAS's own threads only
# wait for each other. A diagnosis of 24,000 rows on two busy cores takes 7.9 s of processor time
# with them, 3.0 s without.
MATRIX_VARIABLES = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
}
# On the computer of a working machine one core must stay free for the loop.
ONE_THREAD_VARIABLES = MATRIX_VARIABLES | {
    name: "1" for name in ("NUMBA_NUM_THREADS", "POLARS_MAX_THREADS")
}


def limit_matrix_threads() -> None:
    """Limits matrices to one thread in this process, unless the environment sets another number."""
    for name, count in MATRIX_VARIABLES.items():
        os.environ.setdefault(name, count)
