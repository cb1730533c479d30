"""What goes wrong with a table or a log, in plain lines."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from topdress.drivers.plain_text import Refused, one_line


class TableError(ValueError):
    """The table or the log cannot be used; `reasons`: one sentence each, naming row or key,
    value and what is allowed; `lines`: the same, each with the file before it."""

    def __init__(self, where: Path | str, *reasons: str) -> None:
        self.where, self.reasons = str(where), tuple(map(one_line, reasons))
        self.lines = tuple(
            one_line(f"{where}: {reason}" if self.where else reason) for reason in reasons
        )
        # what it is made of again in another process
        super().__init__(self.where, *self.reasons)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    @classmethod
    def of(cls, error: Refused) -> Self:
        """Another reader's refusal as one of this kind."""
        return cls(str(error.where), f"{error.reason}{error.hint}")


class ImportTrouble(TableError):
    """The file, and what is said of it, cannot be brought in."""


class Unsure(ImportTrouble):
    """What the columns mean is not sure: the reasons are the open questions, the last one what
    to do about them."""


def listed(names: Iterable[object], most: int = 12) -> str:
    """`a, b, c, ...`"""
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (", ..." if len(words) > most else "")
