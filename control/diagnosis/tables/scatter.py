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
    unequal_p: float | None         # None: too few replicates
    setting_sd: tuple[tuple[int, int, float], ...]      # setting, rows, s.d.


def scatter_of(piece: Piece, setting: Whole, nominal: Array) -> Scatter:
    """Noise of the rows from replicates, else about a smooth fit of what the model leaves."""
    relative = (piece.observed - nominal) / piece.spread
    counts = np.bincount(setting)
    medians = np.array([np.median(relative[setting == k]) for k in range(len(counts))])
    away = relative - medians[setting]
    enough = counts[setting] >= LEAST_TO_DRAW_IN
    tamed, far = _drawn_in(relative, away, medians, setting, counts, enough)
    means = np.bincount(setting, tamed) / counts
    inside = tamed - means[setting]
    pure_dof = int(np.sum(counts - 1))
    if pure_dof >= PURE_DOF:
        sd = float(np.sqrt(np.sum(inside ** 2) / pure_dof))
    else:
        sd = _about_smooth(piece, tamed)
    floor = resolution_of(piece.observed) / np.sqrt(12.0) / float(np.median(piece.spread))
    sd = max(sd, floor, 1e-9)
    by_setting = tuple((k, int(counts[k]), float(np.std(inside[setting == k], ddof=1)) if counts[k] > 1 else 0.0)
                       for k in range(len(counts)))
    unequal = _brown_forsythe(relative, setting, counts)
    weights = np.ones(len(relative))
    if unequal is not None and unequal < UNEQUAL_P:
        weights = np.array([np.sqrt(max(s, 0.2 * sd) / sd) for _, _, s in by_setting])[setting]
    return Scatter(nominal + tamed * piece.spread, sd * piece.spread * weights, far, unequal, by_setting)


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
    limit[limit == 0.0] = np.inf
    far = np.flatnonzero(np.abs(away) > limit)
    tamed = relative.copy()
    tamed[far] = medians[setting[far]] + np.sign(away[far]) * limit[far]
    return tamed, far


def _about_smooth(piece: Piece, relative: Array) -> float:
    """S.d. about a low polynomial in every varying setting, labels apart; at most a third of the rows are spent."""
    columns = [np.where(piece.group == text, 1.0, 0.0) for text in dict.fromkeys(piece.group.tolist())]
    for power in (1, 2):
        columns += [((v - v.mean()) / np.std(v)) ** power for v in piece.variables.values()]
    design = np.column_stack(columns[:max(1, len(relative) // 3)])
    fit, *_ = np.linalg.lstsq(design, relative, rcond=None)
    dof = len(relative) - int(np.linalg.matrix_rank(design))
    return float(np.sqrt(np.sum((relative - design @ fit) ** 2) / max(1, dof)))


def resolution_of(values: Array) -> float:
    """The last printed digit."""
    for digits in range(7):
        if np.allclose(values, np.round(values, digits), rtol=0.0, atol=1e-9):
            return float(10.0 ** -digits)
    return 0.0


def _brown_forsythe(values: Array, setting: Whole, counts: Whole) -> float | None:
    kinds = [k for k in range(len(counts)) if counts[k] >= LEAST_TO_WEIGH]
    if len(kinds) < 2:
        return None
    parts = [np.abs(values[setting == k] - np.median(values[setting == k])) for k in kinds]
    total = np.concatenate(parts)
    between = sum(len(p) * (p.mean() - total.mean()) ** 2 for p in parts) / (len(parts) - 1)
    within = sum(float(np.sum((p - p.mean()) ** 2)) for p in parts) / max(1, len(total) - len(parts))
    return float(fisher.sf(between / within, len(parts) - 1, len(total) - len(parts))) if within > 0.0 else None
