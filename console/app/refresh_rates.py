"""Decides how often each kind of panel is refreshed: numbers 5 Hz, plots 2 Hz, maps 1 Hz, on an
injected clock.
"""

from __future__ import annotations

# Default periods, s: drawing a map costs most, and its contents change least.
NUMBERS_PERIOD_S, PLOTS_PERIOD_S, MAPS_PERIOD_S = 0.2, 0.5, 1.0


class RefreshTimer:
    """Decides when a panel is refreshed: `is_due` is True at most once in `every_s`, and at once on
    the first call or after `make_due`."""

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self.last_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        """Return whether a refresh is due at `now_s`, s."""
        # The tolerance of 1 ms accepts a timer that fires slightly early; a clock that runs
        # backwards is due at once.
        if self.last_s is not None and 0.0 <= now_s - self.last_s < self.every_s - 1e-3:
            return False
        self.last_s = now_s
        return True

    def make_due(self) -> None:
        """Make the next refresh due."""
        self.last_s = None
