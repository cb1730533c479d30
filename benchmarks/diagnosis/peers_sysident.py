"""SysIdentPy's FROLS on the same problems. Runs in an environment of its own, where nothing else is installed:

    PYTHON_OF_ITS_ENVIRONMENT benchmarks/diagnosis/peers_sysident.py problems.npz picks.json

problems.npz: x0, y0, x1, y1, ... (samples, effects) and (samples,). picks.json: a list of columns for each problem.
"""
from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS

TERMS = 4                         # the constant may be one of them


def picks(x: np.ndarray, y: np.ndarray) -> list[int]:
    """Columns that FROLS takes by its error reduction ratio. Inputs act with a lag of one sample there: moved ahead."""
    norms = np.linalg.norm(x, axis=0)
    use = np.flatnonzero(norms > 1e-6)
    inputs = np.vstack([x[:, use] / norms[use], np.zeros((1, len(use)))])
    output = np.r_[0.0, y][:, None]
    model = FROLS(order_selection=False, n_terms=TERMS, ylag=1, xlag=[[1]] * len(use), model_type="NFIR",
                  basis_function=Polynomial(degree=1))
    model.fit(X=inputs, y=output)
    codes = [int(code) for code in np.ravel(model.final_model)]
    return [int(use[code // 1000 - 2]) for code in codes if code >= 2000]


def main() -> int:
    problems = np.load(sys.argv[1])
    warnings.simplefilter("ignore")
    count = len(problems.files) // 2
    found = [picks(problems[f"x{k}"], problems[f"y{k}"]) for k in range(count)]
    Path(sys.argv[2]).write_text(json.dumps(found), encoding="utf-8")
    return 0 if count else 1            # an environment of its own: nothing of this folder is imported


if __name__ == "__main__":
    sys.exit(main())
