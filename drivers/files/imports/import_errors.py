"""Which errors may a table or a log have, in plain lines?"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from topdress.drivers.plain_text import RefusedInput, join_lines


class TableError(ValueError):
    """The table or the log cannot be used. `reasons`: a sentence each, naming row or key, value
    and what is allowed; `lines`: the same, each after the file's name."""

    def __init__(self, where: Path | str, *reasons: str) -> None:
        self.where, self.reasons = str(where), tuple(map(join_lines, reasons))
        self.lines = tuple(
            join_lines(f"{where}: {reason}" if self.where else reason) for reason in reasons
        )
        # A process that receives the error makes it again from these.
        super().__init__(self.where, *self.reasons)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    @classmethod
    def of(cls, error: RefusedInput) -> Self:
        """Returns another reader's refusal as an error of this class."""
        return cls(str(error.where), f"{error.reason}{error.hint}")


class LogImportError(TableError):
    """The file, with its import file, cannot be imported."""


class UnsureImportError(LogImportError):
    """The meaning of the columns is not sure. The reasons are the open questions, the last of
    them how to answer."""


def format_list(names: Iterable[object], most: int = 12) -> str:
    """Returns names as `a, b, c, ...`."""
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (", ..." if len(words) > most else "")
