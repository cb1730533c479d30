"""What was changed last and can be taken back: one key, asked once."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

MOST = 20


class Change(NamedTuple):
    """what: in words, as it would be again: "strategy: opening first". back: does it."""

    what: str
    back: Callable[[], None]


class Undo:
    """The newest change first; those of another run are forgotten with it."""

    def __init__(self) -> None:
        self._changes: list[Change] = []

    def add(self, what: str, back: Callable[[], None]) -> None:
        self._changes = [*self._changes[1 - MOST:], Change(what, back)]

    @property
    def newest(self) -> Change | None:
        return self._changes[-1] if self._changes else None

    def take(self) -> Change | None:
        return self._changes.pop() if self._changes else None

    def forget(self) -> None:
        self._changes.clear()
