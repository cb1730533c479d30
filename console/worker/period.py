"""How punctual the loop is: a histogram of fixed size, so that eight hours cost no more than a second."""
from __future__ import annotations

import math

SMALLEST_S = 1e-6
BINS_PER_E = 40                       # bin edges 2.5 % apart
BINS = BINS_PER_E * 18 + 1            # up to SMALLEST_S x e^18, about 65 s


class Durations:
    """Counts of durations in bins 2.5 % wide, from 1 us to 65 s; the longest is kept as it is."""

    def __init__(self) -> None:
        self._counts = [0] * BINS
        self.n = 0
        self.longest_s = 0.0

    def add(self, duration_s: float) -> None:
        """Count one duration; a negative one counts by its size."""
        size_s = abs(duration_s)
        place = int(math.log(size_s / SMALLEST_S) * BINS_PER_E) if size_s > SMALLEST_S else 0
        self._counts[min(place, BINS - 1)] += 1
        self.n += 1
        self.longest_s = max(self.longest_s, size_s)

    def quantile_s(self, share: float) -> float:
        """The duration that `share` (0 to 1) of all do not exceed, to 2.5 %; 0 where nothing was counted."""
        wanted, seen = share * self.n, 0
        for place, count in enumerate(self._counts):
            seen += count
            if count and seen >= wanted:
                return min(SMALLEST_S * math.exp((place + 1) / BINS_PER_E), self.longest_s)
        return 0.0


class Punctuality:
    """Period errors |interval between ticks - period|, time spent in ticks, and ticks skipped."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.errors = Durations()
        self.busy = Durations()
        self.skipped = 0
        self._last_s: float | None = None

    def began(self, now_s: float) -> None:
        if self._last_s is not None:
            self.errors.add(now_s - self._last_s - self.period_s)
        self._last_s = now_s

    def ended(self, began_s: float, now_s: float) -> None:
        self.busy.add(now_s - began_s)

    def summary(self) -> dict[str, float]:
        """Milliseconds: p50, p99, p99.9 and largest period error; median and longest tick; ticks run and skipped."""
        ms = 1000.0
        return {
            "hz": 1.0 / self.period_s,
            "ticks": self.busy.n,
            "skipped": self.skipped,
            "p50_ms": self.errors.quantile_s(0.5) * ms,
            "p99_ms": self.errors.quantile_s(0.99) * ms,
            "p999_ms": self.errors.quantile_s(0.999) * ms,
            "max_ms": self.errors.longest_s * ms,
            "busy_p50_ms": self.busy.quantile_s(0.5) * ms,
            "busy_max_ms": self.busy.longest_s * ms,
        }
