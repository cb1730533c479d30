"""Quotes in text tables: one that is opened and never closed swallows the rows behind it."""
from __future__ import annotations

MOST_LINES = 5              # of one cell with line breaks, as headers of spreadsheets have them
_STARTS = b",;\t| "


def unclosed_quote(data: bytes) -> int | None:
    """The line (from 1) with a quote that is opened and not closed within a cell's few lines; None: there is none.

    A last line without its line end does not count: it was cut.
    """
    if b'"' not in data:
        return None
    opened = 0
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        if opened and number - opened > MOST_LINES:
            return opened
        if b'"' not in line:
            continue
        if opened:
            opened = 0 if line.count(b'"') % 2 else opened
        elif line.count(b'"') % 2 and _opens(line):
            opened = number
    return opened or None


def _opens(line: bytes) -> bool:
    """Whether a quote stands where a cell begins: one behind a number is the sign for inches."""
    return any(line[at:at + 1] == b'"' and (at == 0 or line[at - 1] in _STARTS) for at in range(len(line)))
