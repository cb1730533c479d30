"""Which errors can a table or a log have? Each error has plain lines."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from topdress.drivers.plain_text import RefusedInput, join_lines


class TableError(ValueError):
    """Reports that a table or log cannot be used. `reasons` are sentences with row or key, value
    and the permitted values; `lines` are the same sentences after the file's name."""

    def __init__(self, where: Path | str, *reasons: str) -> None:
        self.where, self.reasons = str(where), tuple(map(join_lines, reasons))
        self.lines = tuple(
            join_lines(f"{where}: {reason}" if self.where else reason) for reason in reasons
        )
        # A process that receives the error builds it again from these arguments.
        super().__init__(self.where, *self.reasons)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    @classmethod
    def from_error(cls, error: RefusedInput) -> Self:
        """Returns another reader's refusal as an error of this class."""
        return cls(str(error.where), f"{error.reason}{error.hint}")


class LogImportError(TableError):
    """Reports that a file cannot be imported with its import file."""


class UnsureImportError(LogImportError):
    """Reports that the meaning of the columns is unsure. The reasons are the open questions, and
    the last reason explains how to answer them."""


def format_list(names: Iterable[object], most: int = 12) -> str:
    """Returns names as `a, b, c, ...`."""
    words = [str(name) for name in names]
    return ", ".join(words[:most]) + (", ..." if len(words) > most else "")
