"""How far along a command is, with the time left: one line that rewrites itself on a terminal's
stderr, and is silent elsewhere."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from topdress.console.cli.plain_output import OVER_THE_LINE

T = TypeVar("T")
EVERY_S = 0.2


class ProgressLine:
    """`tell` puts a text over the one before, `end` takes it away. A text is cut to the
    terminal's width: one that goes on in the next row would leave its first row behind."""

    def __init__(self) -> None:
        self.shown = sys.stderr.isatty()
        self._stands = False

    def tell(self, text: str) -> None:
        if self.shown:
            self._write(text[: shutil.get_terminal_size().columns - 1])
            self._stands = True

    def end(self) -> None:
        if self._stands:
            self._write("")
            self._stands = False

    @staticmethod
    def _write(text: str) -> None:
        sys.stderr.write(f"{OVER_THE_LINE}{text}")
        sys.stderr.flush()


def progress(
    items: Iterable[T], count: int, label: str, clock: Callable[[], float] = time.monotonic
) -> Iterator[T]:
    """The items, telling before the first and then now and then how far along they are."""
    line = ProgressLine()
    if not line.shown:
        yield from items
        return
    started_s = said_s = clock()
    line.tell(f"{label} 0 % (Ctrl-C cancels)")
    try:
        for number, item in enumerate(items, start=1):
            yield item
            now_s = clock()
            if now_s - said_s >= EVERY_S:
                said_s = now_s
                left_s = (now_s - started_s) * max(0, count - number) / number
                line.tell(
                    f"{label} {100 * number // max(1, count)} %, {left_s:.0f} s left "
                    "(Ctrl-C cancels)"
                )
    finally:
        line.end()
