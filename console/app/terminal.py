"""What the terminal at hand can show, and whether it still does."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable

from textual.app import App

# a terminal that takes nothing for that long stands: no terminal that draws takes so long
STALLED_S = 0.5


def has_few_colours(app: App[object]) -> bool:
    """Whether colours cannot carry a scale: NO_COLOR, or a terminal of 16 colours or none."""
    return app.no_color or (
        not app.is_headless and app.console.color_system in (None, "standard", "windows")
    )


class TerminalPulse:
    """Checks whether the terminal takes what is drawn.

    A terminal that stands (its line is cut, its program stopped, Ctrl-S pressed) shows an old
    screen, and keys on it may lead nowhere: the console on it no longer says that it lives. handle:
    of the output; None: none that could stand.
    """

    def __init__(self, handle: int | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._handle, self._clock = handle, clock
        self._taken_s = clock()

    def __call__(self) -> bool:
        """Whether it takes output. Ask often: it is judged by how long nothing was taken."""
        now_s = self._clock()
        if self._handle is None or select.select([], [self._handle], [], 0.0)[1]:
            self._taken_s = now_s
        return now_s - self._taken_s <= STALLED_S


def find_terminal() -> int | None:
    """The handle that Textual draws on: stderr, where that is a terminal; on Windows it cannot be
    asked."""
    if os.name != "posix" or sys.__stderr__ is None or not sys.__stderr__.isatty():
        return None
    return sys.__stderr__.fileno()
