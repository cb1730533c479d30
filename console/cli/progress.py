"""How does a command show its progress and the remaining time? One line is rewritten on a
terminal's stderr; elsewhere nothing is shown.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from topdress.console.cli.plain_output import LINE_START

Item = TypeVar("Item")
SHOW_PERIOD_S = 0.2


class ProgressLine:
    """Shows a text in place of the previous one; `clear_line` removes it. A text is cut to the
    terminal's width, because a longer text would leave its first row behind."""

    def __init__(self) -> None:
        self.shown = sys.stderr.isatty()
        self._stands = False

    def show_text(self, text: str) -> None:
        """Shows a text in place of the previous one."""
        if self.shown:
            self._write_over_line(text[: shutil.get_terminal_size().columns - 1])
            self._stands = True

    def clear_line(self) -> None:
        """Removes the text."""
        if self._stands:
            self._write_over_line("")
            self._stands = False

    @staticmethod
    def _write_over_line(text: str) -> None:
        sys.stderr.write(f"{LINE_START}{text}")
        sys.stderr.flush()


def iterate_with_progress(
    items: Iterable[Item], count: int, label: str, clock: Callable[[], float] = time.monotonic
) -> Iterator[Item]:
    """Yields the items; shows their number before the first item and from time to time."""
    line = ProgressLine()
    if not line.shown:
        yield from items
        return
    started_s = said_s = clock()
    line.show_text(f"{label} 0 % (Ctrl-C cancels)")
    try:
        for number, item in enumerate(items, start=1):
            yield item
            now_s = clock()
            if now_s - said_s >= SHOW_PERIOD_S:
                said_s = now_s
                left_s = (now_s - started_s) * max(0, count - number) / number
                line.show_text(
                    f"{label} {100 * number // max(1, count)} %, {left_s:.0f} s left "
                    "(Ctrl-C cancels)"
                )
    finally:
        line.clear_line()
