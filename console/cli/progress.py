"""How far along a command is, with the time left, on its line of progress."""
from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from console.cli.progress_line import ProgressLine

T = TypeVar("T")
EVERY_S = 0.2


def progress(items: Iterable[T], count: int, label: str, clock: Callable[[], float] = time.monotonic) -> Iterator[T]:
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
                line.tell(f"{label} {100 * number // max(1, count)} %, {left_s:.0f} s left (Ctrl-C cancels)")
    finally:
        line.end()
