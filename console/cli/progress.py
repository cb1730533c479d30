"""A line of progress on a terminal's stderr, with the time left; silent where nobody looks."""
from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")
EVERY_S = 0.2


def progress(items: Iterable[T], count: int, label: str) -> Iterator[T]:
    """The items, telling now and then how far along they are."""
    show = sys.stderr.isatty()
    begun = told = time.monotonic()
    for number, item in enumerate(items):
        yield item
        if not show or number % 64:
            continue
        now = time.monotonic()
        if now - told >= EVERY_S and number:
            told = now
            left = (now - begun) * (count - number) / number
            sys.stderr.write(f"\r{label} {100 * number // max(1, count):3d} %, {left:.0f} s left (Ctrl-C cancels) ")
            sys.stderr.flush()
    if show:
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()
