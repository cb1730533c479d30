"""Estimates the noise of one measured column: its size, outliers among replicates, and settings
with more scatter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc
from topdress.control.diagnosis.judgement.prior import ROBUST_SD

from .table_series import Array, BoolArray, IntArray, MeasuredSeries, find_first_best

# Outliers are winsorised to this number of robust s.d. from the median of their replicates (3.5:
# Iglewicz and Hoaglin 1993).
MAX_ROBUST_SD = 3.5
# Minimum number of replicates at a setting: with fewer, the median is no better known than the row.
MIN_ROWS_TO_WINSORISE = 4

# P value of the Brown-Forsythe test (1974) of equal variances below which settings get their own
# weights.
MAX_UNEQUAL_VARIANCE_P_VALUE = 0.005
# Minimum number of replicates at a setting for its variance to be compared.
MIN_ROWS_PER_VARIANCE = 5
# Minimum s.d. of a setting, as a share of the common s.d.
MIN_SD_OF_COMMON_SD = 0.2

# Minimum degrees of freedom of the replicates for them alone to give the noise.
MIN_PURE_DOF = 5


# Replicates that differ by less than this share of their last digit, or of the farthest one, are
# the same reading.
SAME_READING_TOLERANCE = 1e-6


class TableNoise(NamedTuple):
    """The noise of a piece of n rows, in the unit of the piece."""

    # Observed values with limited outliers, (n,).
    winsorised: Array
    # Standard deviation of each row, (n,).
    sd: Array
    # Rows of the limited outliers.
    outliers: IntArray
    # Lower bound of the rows' variance as a share of sd**2.
    min_variance: float
    # Whether the noise comes from replicates; otherwise it comes from a smooth fit.
    by_replicates: bool
    # P value of the Brown-Forsythe test; None for too few replicates.
    unequal_p: float | None
    # Setting, number of rows, and s.d.
    setting_sd: tuple[tuple[int, int, float], ...]


def estimate_table_noise(piece: MeasuredSeries, setting: IntArray, nominal: Array) -> TableNoise:
    """Estimate the noise of the rows from replicates (pure error), or else from a smooth fit of the
    model's residual.

    Of the noise models that the piece allows (constant, or a share of the value) the most likely is
    chosen.
    """
    tried = [_try_noise_spread(piece, setting, nominal, spread) for spread in piece.spreads]
    return tried[find_first_best([likelihood for _, likelihood in tried])][0]


def _try_noise_spread(
    piece: MeasuredSeries, setting: IntArray, nominal: Array, spread: Array
) -> tuple[TableNoise, float]:
    """Return the noise for rows with the relative noise `spread`, and its log-likelihood."""
    relative = (piece.observed - nominal) / spread
    counts = np.bincount(setting)
    medians = np.array([np.median(relative[setting == k]) for k in range(len(counts))])
    rounding = find_quantum(piece.observed) / np.sqrt(12.0) / float(np.median(spread))
    none = SAME_READING_TOLERANCE * max(
        rounding, float(np.max(np.abs(relative - medians[setting])))
    )
    winsorised, outliers = _winsorise_rows(relative, medians, setting, counts, none)
    means = np.bincount(setting, winsorised) / counts
    inside = winsorised - means[setting]
    pure_dof = int(np.sum(counts - 1))
    if pure_dof >= MIN_PURE_DOF:
        repeated = counts[setting] > 1
        sd, dof = float(np.sqrt(np.sum(inside**2) / pure_dof)), pure_dof
        log_spread = float(
            np.sum((np.log(spread) * (counts[setting] - 1) / counts[setting])[repeated])
        )
    else:
        smooth, rank = smooth_by_settings(piece, winsorised)
        dof = len(winsorised)
        sd = float(np.sqrt(np.sum((winsorised - smooth) ** 2) / max(1, dof - rank)))
        log_spread = float(np.sum(np.log(spread)))
    sd = max(sd, rounding, 1e-9)
    min_variance = min(1.0, rounding / sd) ** 2
    by_setting = tuple(
        (k, int(counts[k]), float(np.std(inside[setting == k], ddof=1)) if counts[k] > 1 else 0.0)
        for k in range(len(counts))
    )
    unequal_p = _calc_brown_forsythe_p(relative, setting, counts, none)
    factor = np.ones(len(relative))
    if unequal_p is not None and unequal_p < MAX_UNEQUAL_VARIANCE_P_VALUE:
        factor = np.array(
            [np.sqrt(max(s, MIN_SD_OF_COMMON_SD * sd) / sd) for _, _, s in by_setting]
        )[setting]
    return (
        TableNoise(
            nominal + winsorised * spread,
            sd * spread * factor,
            outliers,
            min_variance,
            pure_dof >= MIN_PURE_DOF,
            unequal_p,
            by_setting,
        ),
        -dof * float(np.log(sd)) - log_spread,
    )


def _winsorise_rows(
    relative: Array, medians: Array, setting: IntArray, counts: IntArray, none: float
) -> tuple[Array, IntArray]:
    """Return the rows with limited outliers among their replicates, and the indices of the
    outliers. Scatter up to `none` counts as none."""
    away = relative - medians[setting]
    enough: BoolArray = counts[setting] >= MIN_ROWS_TO_WINSORISE
    if not enough.any():
        return relative, np.zeros(0, np.int64)
    shrink = np.sqrt(np.maximum(1, counts[setting] - 1) / counts[setting])
    common = ROBUST_SD * float(np.median(np.abs(away[enough]) / shrink[enough]))
    limit = np.full(len(relative), np.inf)
    for k in np.unique(setting[enough]):
        rows = setting == k
        limit[rows] = MAX_ROBUST_SD * max(common, ROBUST_SD * float(np.median(np.abs(away[rows]))))
    # Replicates without scatter do not define an outlier.
    limit[limit <= none] = np.inf
    outliers = np.flatnonzero(np.abs(away) > limit)
    winsorised = relative.copy()
    winsorised[outliers] = medians[setting[outliers]] + np.sign(away[outliers]) * limit[outliers]
    return winsorised, outliers


def smooth_by_settings(piece: MeasuredSeries, values: Array) -> tuple[Array, int]:
    """Smooth values (n,) by a low-order polynomial in the settings, separately by label, and return
    the number of fitted columns as well."""
    columns = [
        np.where(piece.group == text, 1.0, 0.0) for text in dict.fromkeys(piece.group.tolist())
    ]
    for power in (1, 2):
        columns += [((v - v.mean()) / np.std(v)) ** power for v in piece.variables.values()]
    design = np.column_stack(columns[: max(1, len(values) // 3)])
    fit, *_ = np.linalg.lstsq(design, values, rcond=None)
    return np.asarray(design @ fit), int(np.linalg.matrix_rank(design))


def find_resolution(values: Array) -> float:
    """Return the last printed digit."""
    return next(
        (10.0**-digits for digits in range(7) if _are_multiples_of(values, 10.0**-digits)), 0.0
    )


def find_quantum(values: Array) -> float:
    """Return the largest of 1, 2, 2.5, 5 times a power of ten of which all values are multiples; 0
    for none."""
    steps = [step * 10.0**-digits for digits in range(7) for step in (5.0, 2.5, 2.0, 1.0)]
    return next((step for step in steps if _are_multiples_of(values, step)), 0.0)


def _are_multiples_of(values: Array, step: float) -> bool:
    return bool(np.all(np.abs(values - np.round(values / step) * step) < 1e-8))


def _calc_brown_forsythe_p(
    values: Array, setting: IntArray, counts: IntArray, none: float
) -> float | None:
    """Return the p value of the Brown-Forsythe test: F test of absolute deviations from the
    medians.

    None means too few replicates, or no scatter among them beyond `none`.
    """
    kinds = [k for k in range(len(counts)) if counts[k] >= MIN_ROWS_PER_VARIANCE]
    if len(kinds) < 2:
        return None
    parts = [np.abs(values[setting == k] - np.median(values[setting == k])) for k in kinds]
    total = np.concatenate(parts)
    between = sum(len(p) * (p.mean() - total.mean()) ** 2 for p in parts) / (len(parts) - 1)
    within = sum(float(np.sum((p - p.mean()) ** 2)) for p in parts) / max(
        1, len(total) - len(parts)
    )
    return (
        float(fdtrc(len(parts) - 1, len(total) - len(parts), between / within))
        if within > none**2
        else None
    )
