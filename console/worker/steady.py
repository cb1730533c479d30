"""A yes that flickers is a no. Pure."""
from __future__ import annotations

from math import inf

SETTLED_S = 60.0            # a disk that fails twice within it is believed again after as long without


class Steady:
    """What is fed as it changes; what comes back goes to no at once, and to yes again at once where that was the first
    time for long, else after `SETTLED_S` of yes: flow that is switched off and on by itself lays stripes."""

    def __init__(self) -> None:
        self._good, self._flickers, self._bad_s = True, False, -inf     # bad_s: seen bad then the last time

    def take(self, now_s: float, good: bool) -> bool:
        lately = now_s - self._bad_s < SETTLED_S
        if not good:
            self._flickers = lately and (self._good or self._flickers)
            self._bad_s = now_s
        self._good = good
        return good and not (self._flickers and lately)
