"""How often each kind of panel is looked at: numbers 5 Hz, plots 2 Hz, maps 1 Hz, on an
injected clock."""

from __future__ import annotations

NUMBERS_S, PLOTS_S, MAPS_S = 0.2, 0.5, 1.0


class RefreshTimer:
    """Decides when a panel is refreshed: `is_due` is true at most once in `every_s`, and at once
    the first time or after `hurry_up`."""

    def __init__(self, every_s: float) -> None:
        self.every_s = every_s
        self.last_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        """Whether a refresh is due at `now_s`, s."""
        if self.last_s is not None and 0.0 <= now_s - self.last_s < self.every_s - 1e-3:
            return False
        self.last_s = now_s
        return True

    def hurry_up(self) -> None:
        """Make the next refresh due."""
        self.last_s = None
