"""The heads check: every canopy head against the median of all, over 30 s of driving."""
from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from statistics import fmean, median
from typing import Literal, NamedTuple

CHECK_S = 30.0
FOULED_SHARE = 0.04           # of the median: published fouling is 2 to 10 %, heads agree to 0.1 % when clean
UNSTEADY_NDVI = 0.05          # spread (1 s.d.) about the median; a good head has 0.01, the crop itself about as much
LEAST_HEADS = 3               # with two heads the median cannot tell which is wrong
LEAST_SAMPLES = 25
SILENT_SHARE = 0.5            # of the samples

Verdict = Literal["", "good", "fouled", "unsteady", "silent"]


class HeadFound(NamedTuple):
    """One head. offset, spread: NDVI against the median of all; None where it said too little."""

    number: int
    ndvi: float | None
    offset: float | None
    spread: float | None
    verdict: Verdict


class HeadsCheck:
    def __init__(self) -> None:
        self.started_s: float | None = None
        self.seconds = 0.0
        self._apart: list[list[float]] = []
        self._medians: list[float] = []
        self._last: tuple[float | None, ...] = ()

    @property
    def running(self) -> bool:
        return self.started_s is not None and self.seconds < CHECK_S

    @property
    def done(self) -> bool:
        return self.started_s is not None and self.seconds >= CHECK_S

    def start(self, time_s: float) -> None:
        self.started_s, self.seconds = time_s, 0.0
        self._apart, self._medians = [], []

    def see(self, time_s: float, ndvi: Sequence[float | None]) -> None:
        """One frame: NDVI of every head, left to right; None: silent."""
        self._last = tuple(ndvi)
        if not self.running or self.started_s is None:
            return
        self.seconds = max(0.0, time_s - self.started_s)
        while len(self._apart) < len(ndvi):
            self._apart.append([])
        known = [value for value in ndvi if value is not None]
        if len(known) < LEAST_HEADS:
            return
        middle = median(known)
        self._medians.append(middle)
        for apart, value in zip(self._apart, ndvi, strict=False):
            if value is not None:
                apart.append(value - middle)

    def found(self) -> tuple[HeadFound, ...]:
        """What is known of each head so far; verdicts only once the time is over."""
        return tuple(self._head(index) for index in range(len(self._last)))

    def _head(self, index: int) -> HeadFound:
        now = self._last[index]
        apart = self._apart[index] if index < len(self._apart) else []
        if len(apart) < 2:
            return HeadFound(index + 1, now, None, None, "silent" if self.done else "")
        offset = fmean(apart)
        spread = sqrt(fmean((value - offset) ** 2 for value in apart))
        return HeadFound(index + 1, now, offset, spread, self._verdict(len(apart), offset, spread))

    def _verdict(self, count: int, offset: float, spread: float) -> Verdict:
        if not self.done:
            return ""
        if count < max(LEAST_SAMPLES, SILENT_SHARE * len(self._medians)):
            return "silent"
        if spread > UNSTEADY_NDVI:
            return "unsteady"
        certain = 2.0 * spread / sqrt(count)
        return "fouled" if abs(offset) - certain > FOULED_SHARE * fmean(self._medians) else "good"
