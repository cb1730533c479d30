"""How often each kind of panel is looked at: numbers 5 Hz, plots 2 Hz, maps 1 Hz, on an
injected clock."""

from __future__ import annotations

NUMBERS_S, PLOTS_S, MAPS_S = 0.2, 0.5, 1.0


class Pace:
    """`due(now)` is true at most once in `every_s`, and at once the first time or after `hurry`."""

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self.last_s: float | None = None

    def due(self, now_s: float) -> bool:
        if self.last_s is not None and 0.0 <= now_s - self.last_s < self.every_s - 1e-3:
            return False
        self.last_s = now_s
        return True

    def hurry(self) -> None:
        self.last_s = None
