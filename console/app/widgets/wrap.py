"""Text broken into rows of at most so many cells: between words, and between any two Chinese characters."""
from __future__ import annotations

import re

from rich.cells import cell_len, chop_cells

_PIECES = re.compile(r"[ \t]+|[⺀-鿿　-〿＀-￯]|[^\s⺀-鿿　-〿＀-￯]+")
_NOT_FIRST = "，。；：、！？）」』】》"


def wrapped(text: str, width: int) -> list[str]:
    """Rows of `text`, each at most `width` cells; a word that is longer is cut. No row begins with a full stop."""
    if width < 2:
        return []
    rows, row = [], ""
    for piece in _PIECES.findall(text):
        if cell_len(row + piece.rstrip()) <= width or (piece in _NOT_FIRST and row):
            row += piece
            continue
        rows.append(row.rstrip())
        *whole, row = chop_cells(piece.strip(), width) or [""]
        rows += whole
    return [one for one in [*rows, row.rstrip()] if one]
