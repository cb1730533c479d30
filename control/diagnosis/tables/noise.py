"""The scatter of one measured column: its size, rows far from their replicates, settings that scatter more."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from .piece import Array, Piece, Whole

FAR = 3.5                   # robust s.d. from the median of its replicates: drawn in to that
LEAST_TO_DRAW_IN = 4        # replicates
UNEQUAL_P = 0.005           # Brown-Forsythe
LEAST_TO_WEIGH = 5          # replicates a setting, below which scatter is not told apart
PURE_DOF = 5                # of replicates, from which on they alone give the noise


class Scatter(NamedTuple):
    tamed: Array                    # (n,) observed, far rows drawn in
    sd: Array                       # (n,) absolute noise
    far: Whole                      # rows drawn in
    least: float                    # share of sd**2 below which the rows' variance is not believed to be
    unequal_p: float | None         # None: too few replicates
    setting_sd: tuple[tuple[int, int, float], ...]      # setting, rows, s.d.


def scatter_of(piece: Piece, setting: Whole, nominal: Array) -> Scatter:
    """Noise of the rows from replicates, else about a smooth fit of what the model leaves."""
    tried = [_with(piece, setting, nominal, spread) for spread in piece.spreads]
    return max(tried, key=lambda one: one[1])[0]


def _with(piece: Piece, setting: Whole, nominal: Array, spread: Array) -> tuple[Scatter, float]:
    """Scatter if the rows' relative noise is `spread`, and the log-likelihood of that."""
    relative = (piece.observed - nominal) / spread
    counts = np.bincount(setting)
    medians = np.array([np.median(relative[setting == k]) for k in range(len(counts))])
    away = relative - medians[setting]
    tamed, far = _drawn_in(relative, away, medians, setting, counts, counts[setting] >= LEAST_TO_DRAW_IN)
    means = np.bincount(setting, tamed) / counts
    inside = tamed - means[setting]
    pure_dof = int(np.sum(counts - 1))
    if pure_dof >= PURE_DOF:
        repeated = counts[setting] > 1
        sd, dof = float(np.sqrt(np.sum(inside ** 2) / pure_dof)), pure_dof
        lengths = float(np.sum((np.log(spread) * (counts[setting] - 1) / counts[setting])[repeated]))
    else:
        sd, dof = _about_smooth(piece, tamed), len(tamed)
        lengths = float(np.sum(np.log(spread)))
    rounding = quantum_of(piece.observed) / np.sqrt(12.0) / float(np.median(spread))
    sd = max(sd, rounding, 1e-9)
    least = 1.0 if pure_dof >= PURE_DOF else min(1.0, rounding / sd) ** 2
    by_setting = tuple((k, int(counts[k]), float(np.std(inside[setting == k], ddof=1)) if counts[k] > 1 else 0.0)
                       for k in range(len(counts)))
    unequal = _brown_forsythe(relative, setting, counts)
    factor = np.ones(len(relative))
    if unequal is not None and unequal < UNEQUAL_P:
        factor = np.array([np.sqrt(max(s, 0.2 * sd) / sd) for _, _, s in by_setting])[setting]
    return (Scatter(nominal + tamed * spread, sd * spread * factor, far, least, unequal, by_setting),
            -dof * float(np.log(sd)) - lengths)


def _drawn_in(relative: Array, away: Array, medians: Array, setting: Whole, counts: Whole,
              enough: np.ndarray) -> tuple[Array, Whole]:
    if not enough.any():
        return relative, np.zeros(0, np.int64)
    shrink = np.sqrt(np.maximum(1, counts[setting] - 1) / counts[setting])
    common = 1.4826 * float(np.median(np.abs(away[enough]) / shrink[enough]))
    limit = np.full(len(relative), np.inf)
    for k in np.unique(setting[enough]):
        rows = setting == k
        limit[rows] = FAR * max(common, 1.4826 * float(np.median(np.abs(away[rows]))))
    limit[limit == 0.0] = np.inf            # replicates without scatter say nothing of what is far
    far = np.flatnonzero(np.abs(away) > limit)
    tamed = relative.copy()
    tamed[far] = medians[setting[far]] + np.sign(away[far]) * limit[far]
    return tamed, far


def _about_smooth(piece: Piece, relative: Array) -> float:
    """S.d. about a low polynomial in every varying setting, labels apart; at most a third of the rows are spent."""
    smooth, rank = smoothed(piece, relative)
    return float(np.sqrt(np.sum((relative - smooth) ** 2) / max(1, len(relative) - rank)))


def smoothed(piece: Piece, values: Array) -> tuple[Array, int]:
    """Values (n,) by a low polynomial in the settings, labels apart, and how many columns that took."""
    columns = [np.where(piece.group == text, 1.0, 0.0) for text in dict.fromkeys(piece.group.tolist())]
    for power in (1, 2):
        columns += [((v - v.mean()) / np.std(v)) ** power for v in piece.variables.values()]
    design = np.column_stack(columns[:max(1, len(values) // 3)])
    fit, *_ = np.linalg.lstsq(design, values, rcond=None)
    return np.asarray(design @ fit), int(np.linalg.matrix_rank(design))


def resolution_of(values: Array) -> float:
    """The last printed digit."""
    return next((10.0 ** -digits for digits in range(7) if _multiples(values, 10.0 ** -digits)), 0.0)


def quantum_of(values: Array) -> float:
    """The coarsest of 1, 2, 2.5, 5 times a power of ten that all values are multiples of; 0: none."""
    steps = [step * 10.0 ** -digits for digits in range(7) for step in (5.0, 2.5, 2.0, 1.0)]
    return next((step for step in steps if _multiples(values, step)), 0.0)


def _multiples(values: Array, step: float) -> bool:
    return bool(np.all(np.abs(values - np.round(values / step) * step) < 1e-8))


def _brown_forsythe(values: Array, setting: Whole, counts: Whole) -> float | None:
    kinds = [k for k in range(len(counts)) if counts[k] >= LEAST_TO_WEIGH]
    if len(kinds) < 2:
        return None
    parts = [np.abs(values[setting == k] - np.median(values[setting == k])) for k in kinds]
    total = np.concatenate(parts)
    between = sum(len(p) * (p.mean() - total.mean()) ** 2 for p in parts) / (len(parts) - 1)
    within = sum(float(np.sum((p - p.mean()) ** 2)) for p in parts) / max(1, len(total) - len(parts))
    return float(fisher.sf(between / within, len(parts) - 1, len(total) - len(parts))) if within > 0.0 else None
