"""What a reader noticed about a file and did about it, in plain words."""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """`id` is stable, `text` is one sentence for people; `rows` is how many rows it concerns
    (0: the file)."""

    id: str
    text: str
    column: str = ""
    rows: int = 0

    def __str__(self) -> str:
        return self.text


def many(count: int, what: str = "row") -> str:
    """`1 row`, `2 rows`."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
