"""Determines the colours that the terminal can show, and whether it still accepts output."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Callable

from textual.app import App

# A terminal that accepts nothing for this time, s, has stopped; drawing never takes so long.
MAX_STALL_S = 0.5


def has_few_colours(app: App[object]) -> bool:
    """Return whether colours cannot represent a scale: NO_COLOR is set, or the terminal has at most
    16 colours."""
    return app.no_color or (
        not app.is_headless and app.console.color_system in (None, "standard", "windows")
    )


class TerminalPulse:
    """Checks whether the terminal accepts output.

    A stopped terminal (line cut, program stopped, Ctrl-S pressed) shows an old screen, and its keys
    may have no effect. The console then no longer reports that it lives.

    Parameters
    ----------
    handle
        File handle of the output; None means an output that cannot stop.
    clock
        Returns s, as `time.monotonic`.
    """

    def __init__(self, handle: int | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._handle, self._clock = handle, clock
        self._taken_s = clock()

    def __call__(self) -> bool:
        """Return whether the terminal accepts output. Frequent calls are needed, because the time
        without acceptance decides."""
        now_s = self._clock()
        # A select with zero timeout never blocks.
        if self._handle is None or select.select([], [self._handle], [], 0.0)[1]:
            self._taken_s = now_s
        return now_s - self._taken_s <= MAX_STALL_S


def find_terminal() -> int | None:
    """Return the handle on which Textual draws: stderr, if it is a terminal. Windows has no select
    for terminals, so None is returned there."""
    if os.name != "posix" or sys.__stderr__ is None or not sys.__stderr__.isatty():
        return None
    return sys.__stderr__.fileno()
