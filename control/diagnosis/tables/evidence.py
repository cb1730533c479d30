"""What the named effects gain on settings that their sizes were not fitted to."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from control.diagnosis.result import Gain

from .algebra import sizes_of
from .piece import Sized
from .problem import Problem

RESAMPLES = 400


def gains(problem: Problem, parts: Sequence[Sized], seed: int) -> tuple[Gain, ...]:
    """Leave one setting out at a time, refit the sizes, predict it; 90 % intervals by resampling settings."""
    kinds = np.unique(problem.setting)
    if not parts or len(kinds) < 2:
        return ()
    before = problem.observed - problem.nominal
    after = before.copy()               # a setting without which an effect has no size gains nothing
    for kind in kinds.tolist():
        out = problem.setting == kind
        held = problem._replace(sd=np.where(out, np.inf, problem.sd))
        fitted, sized = sizes_of(held, [part.choice for part in parts], rounds=2)
        if fitted is not None:
            after[out] = (problem.observed - problem.predicted(sized))[out]
    rng = np.random.default_rng(seed)
    found = []
    for channel in dict.fromkeys(piece.channel for piece in problem.pieces):
        inside = np.isin(problem.piece, [k for k, piece in enumerate(problem.pieces) if piece.channel == channel])
        rows = inside
        settings = np.unique(problem.setting[rows])
        drawn = [_rms(after, problem.setting, rng.choice(settings, len(settings)), rows) for _ in range(RESAMPLES)]
        unit = next(piece.unit for piece in problem.pieces if piece.channel == channel)
        found.append(Gain(channel, f"rmse, {unit}", float(np.sqrt(np.mean(before[rows] ** 2))),
                          float(np.sqrt(np.mean(after[rows] ** 2))), float(np.quantile(drawn, 0.05)),
                          float(np.quantile(drawn, 0.95)), f"each of {len(settings)} settings in turn"))
    return tuple(found)


def _rms(values: np.ndarray, setting: np.ndarray, drawn: np.ndarray, rows: np.ndarray) -> float:
    sums = np.bincount(setting[rows], values[rows] ** 2, minlength=int(setting.max()) + 1)
    counts = np.bincount(setting[rows], minlength=int(setting.max()) + 1)
    return float(np.sqrt(sums[drawn].sum() / counts[drawn].sum()))
