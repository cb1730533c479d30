"""How are linear models fitted? Weighted least squares with 90 % intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit  # scipy.stats takes a second to load

from .bench_table import Array


class FittedInterval(NamedTuple):
    """Holds a fitted number and its 90 % interval."""

    value: float
    low: float
    high: float


class LinearFit(NamedTuple):
    """Holds a linear fit. `coefficients` and `se`: (p,), `residuals`: (n,) in the unit of y,
    `p_values`: (p,) two-sided, against 0."""

    coefficients: Array
    se: Array
    p_values: Array
    residuals: Array
    dof: int

    def calc_interval(self, k: int) -> FittedInterval:
        value, half = float(self.coefficients[k]), float(stdtrit(self.dof, 0.95) * self.se[k])
        return FittedInterval(value, value - half, value + half)


def fit_linear(design: Array, y: Array, sd: Array) -> LinearFit:
    """Fits y (n,) on design (n, p) with relative noise `sd` (n,).

    Raises
    ------
    ValueError : fewer rows than coefficients plus one, or columns that the rows cannot separate."""
    rows, count = design.shape
    if rows <= count:
        raise ValueError(f"{rows} usable rows: at least {count + 1} are needed")
    x = design / sd[:, None]
    scale = np.linalg.norm(x, axis=0)
    if np.any(scale == 0.0) or np.linalg.cond(x / scale) > 1e6:
        raise ValueError("the settings of the rows do not tell the coefficients apart: vary them")
    inverse = np.linalg.inv(x.T @ x)
    coefficients = inverse @ (x.T @ (y / sd))
    residuals = y - design @ coefficients
    dof = rows - count
    variance = float(np.sum((residuals / sd) ** 2) / dof)
    se = np.sqrt(np.maximum(np.diag(inverse) * variance, 1e-300))
    return LinearFit(coefficients, se, 2.0 * stdtr(dof, -np.abs(coefficients) / se), residuals, dof)
