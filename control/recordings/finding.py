"""What did a reader notice about a file and do about it?"""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """Holds one finding. `id` is stable, `text` is a sentence for people; `rows` counts the rows
    concerned (0: the file)."""

    id: str
    text: str
    column: str = ""
    rows: int = 0

    def __str__(self) -> str:
        return self.text


def many(count: int, what: str = "row") -> str:
    """Returns a count with its noun: `1 row`, `2 rows`."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
