"""The N-rich strip: mean NDVI between two key presses. Pure."""
from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from control.log_row import LogRow

LEAST_M = 20.0
MOST_STEP_S = 2.0           # a longer step between frames is a gap: nothing is counted in it


class Strip(NamedTuple):
    """What was driven so far; ndvi None before any. cv_percent: of the fused NDVI along the way."""

    length_m: float
    ndvi: float | None
    cv_percent: float | None

    @property
    def enough(self) -> bool:
        return self.length_m >= LEAST_M and self.ndvi is not None


class StripRun:
    """Fed with rows while the strip is driven. Every metre with an NDVI counts alike."""

    def __init__(self) -> None:
        self._before_s: float | None = None
        self._length_m = self._sum = self._sum2 = 0.0

    def add(self, row: LogRow) -> None:
        """A row of the run; rows without NDVI or speed add no length."""
        before_s, self._before_s = self._before_s, row.time_s
        if before_s is None or row.ndvi is None or row.speed_used_mps is None:
            return
        step_s = row.time_s - before_s
        if not 0.0 < step_s <= MOST_STEP_S:
            return
        step_m = max(0.0, row.speed_used_mps) * step_s
        self._length_m += step_m
        self._sum += step_m * row.ndvi
        self._sum2 += step_m * row.ndvi * row.ndvi

    @property
    def strip(self) -> Strip:
        if self._length_m <= 0.0:
            return Strip(0.0, None, None)
        mean = self._sum / self._length_m
        variance = max(0.0, self._sum2 / self._length_m - mean * mean)
        return Strip(self._length_m, mean, 100.0 * sqrt(variance) / mean if mean > 0.0 else None)
