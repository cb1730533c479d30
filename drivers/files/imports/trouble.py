"""What goes wrong at an import, in plain lines."""
from __future__ import annotations

from collections.abc import Iterable

from drivers.plain_text import one_line


class ImportTrouble(ValueError):
    """The file cannot be brought in; `lines`: one sentence each, naming file, row or key, value and what is allowed."""

    def __init__(self, *lines: str) -> None:
        self.lines = tuple(map(one_line, lines))
        super().__init__("\n".join(self.lines))


def listed(names: Iterable[object], most: int = 12) -> str:
    """`a, b, c, ...`"""
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (", ..." if len(words) > most else "")
