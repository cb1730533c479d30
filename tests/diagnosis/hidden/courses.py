"""When an effect is there: from the first row to the last, or begun, growing, or gone again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
ONSET, GROWTH, TEMPORARY = "onset", "growth", "temporary"


class Course(NamedTuple):
    """Share of the final size over time: 0 before `from_s`; 0 again after `to_s` where that is
    told.

    `over_s`: how long it takes to come (and, of a temporary one, to go).
    """

    kind: str  # onset, growth, temporary
    from_s: float
    over_s: float
    to_s: float | None = None
    # of a growth: straight to the end, straight and level, levelling off, two speeds
    form: int = 0

    def at(self, time_s: Floats) -> Floats:
        """0 to 1 at each time (samples,)."""
        since = (time_s - self.from_s) / max(self.over_s, 1e-9)
        if self.kind == GROWTH:
            return np.asarray(_grown(np.maximum(since, 0.0), self.form))
        come = np.clip(since, 0.0, 1.0)
        if self.form % 3 == 2:
            come = 0.5 * (np.floor(1.999 * come) + (come > 0.0))  # in two steps
        come = np.where(time_s >= self.from_s, come, 0.0)
        if self.to_s is None:
            return np.asarray(come)
        return np.asarray(
            np.minimum(come, np.clip((self.to_s - time_s) / max(self.over_s, 1e-9), 0.0, 1.0))
        )


def _grown(since: Floats, form: int) -> Floats:
    """`since`: 0 at the begin, 1 at the end of the log."""
    if form % 4 == 0:
        return since
    if form % 4 == 1:
        return np.minimum(1.0, since / 0.6)
    if form % 4 == 2:
        return np.asarray(np.expm1(-3.0 * since) / np.expm1(-3.0))
    return np.where(since < 0.5, 0.6 * since, 0.3 + 1.4 * (since - 0.5))


def dealt(kind: str, time_s: Floats, rng: np.random.Generator) -> Course:
    """A course of one kind, its times and form drawn; begins late enough for a before, early
    enough for an after."""
    first, length = float(time_s[0]), float(time_s[-1] - time_s[0])
    form = int(rng.integers(12))
    if kind == GROWTH:
        start = first + rng.uniform(0.1, 0.6) * length
        return Course(kind, round(start, 1), round(first + length - start, 1), None, form)
    over = float(rng.choice([0.0, rng.uniform(1.0, 25.0)]))
    if kind == ONSET:
        return Course(
            kind, round(first + rng.uniform(0.12, 0.85) * length, 1), round(over, 1), None, form
        )
    start, lasts = first + rng.uniform(0.1, 0.6) * length, rng.uniform(0.08, 0.3) * length
    return Course(
        kind, round(start, 1), round(over, 1), round(start + max(lasts, 3.0 * over), 1), form
    )
