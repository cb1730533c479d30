"""A shaft speed that is read in steps, noise on top: found by the saw-tooth that rounding leaves over the true speed.

Without noise on top the steps are read off the readings themselves (`whole_steps`).
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.diagnosis import effects

from .hypothesis import Part
from .nuisances import Candidate
from .search import Group

Array = npt.NDArray[np.float64]

BIN_RPM = 0.02
STEPS = np.exp(np.arange(np.log(0.6), np.log(8.0), 5e-4))
LEAST = 40.0                # of the saw-tooth's squared score, over all steps tried


def encoder_steps(group: Group) -> list[Candidate]:
    """The step that fits best, where there is one; looked for among speeds above 5 r/min."""
    if "shaft" not in group.names or group.data.shaft is None or group.data.shaft.step > 0.0:
        return []
    predicted = group.predicted(())["shaft"]
    left = group.residual(())["shaft"]
    on = predicted > 5.0
    if on.sum() < 200:
        return []
    speed, wrong = predicted[on], left[on]
    wrong = np.clip(wrong, *np.percentile(wrong, (0.5, 99.5)))
    cell = np.round(speed / BIN_RPM).astype(np.int64)
    kinds, place, count = np.unique(cell, return_inverse=True, return_counts=True)
    total = np.bincount(place, weights=wrong - wrong.mean())
    centre = np.bincount(place, weights=speed) / count
    variance = float(np.var(wrong))
    best, best_score = 0.0, 0.0
    for part in np.array_split(STEPS, max(1, len(STEPS) * len(kinds) // 2_000_000)):
        saw = np.sin(2.0 * np.pi * centre / part[:, None])
        level = (saw * count).sum(axis=1, keepdims=True) / count.sum()
        saw = saw - level
        score = -(saw @ total) / np.sqrt(np.maximum(1e-9, variance * (saw ** 2 @ count)))
        k = int(np.argmax(score))
        if score[k] ** 2 > best_score and score[k] > 0.0:
            best, best_score = float(part[k]), float(score[k] ** 2)
    if best_score < LEAST:
        return []
    return [Candidate(Part(effects.SHAFT_COARSE_ENCODER.id, best), best, best)]
