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
    rows: list[list[str]] = [[]]
    for piece in _PIECES.findall(text):
        row = rows[-1]
        if cell_len("".join(row) + piece.rstrip()) <= width:
            row.append(piece)
            continue
        carried = [row.pop()] if piece in _NOT_FIRST and len(row) > 1 else []
        *whole, rest = chop_cells("".join(carried) + piece.strip(), width) or [""]
        rows += [*([one] for one in whole), [rest]]
    return [line for line in ("".join(row).strip() for row in rows) if line]
