"""Draws lines in braille characters (2 x 4 dots a cell) from values over time, each constant until
the next value. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

# Bits of a cell's dots, row by row, left dot first (Unicode block "Braille Patterns", U+2800).
CELL_DOT_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
# Code of the braille character without dots; a cell's character is this code plus its bits.
BLANK_BRAILLE_CODE = 0x2800
# Maps (column, row) of a cell to its dot bits.
CellDots = dict[tuple[int, int], int]


class PlotPiece(NamedTuple):
    """Describes a piece of a line.

    Attributes
    ----------
    at
        Position in the time span, 0 to 1.
    low, high
        Lowest and highest value, as a share of the axis, 0 to 1.
    joined
        True if a level line connects this piece to the piece before.
    """

    at: float
    low: float
    high: float
    joined: bool


def trace_cells(pieces: Sequence[PlotPiece], columns: int, rows: int) -> CellDots:
    """Return the cells that pieces of a line cover.

    Parameters
    ----------
    pieces
        Pieces in order of time; each spans from its lowest to its highest value.
    columns, rows
        Size of the plot in cells; nothing is drawn outside.
    """
    wide, high = 2 * columns, 4 * rows
    cells: CellDots = {}

    def calc_dot_row(share: float) -> int:
        # Row 0 is the top of the screen, so the highest share has the lowest row.
        return high - 1 - round(max(0.0, min(1.0, share)) * (high - 1))

    def set_dots(x: int, top: int, bottom: int) -> None:
        for y in range(top, bottom + 1) if 0 <= x < wide else ():
            place = (x // 2, y // 4)
            cells[place] = cells.get(place, 0) | CELL_DOT_BITS[y % 4][x % 2]

    last: tuple[int, int, int] | None = None
    for piece in pieces:
        x = round(piece.at * (wide - 1))
        top, bottom = calc_dot_row(piece.high), calc_dot_row(piece.low)
        # The value is constant until the next piece: a sloped connection would show values that
        # were never measured.
        if piece.joined and last is not None:
            held = (last[1] + last[2]) // 2
            for between in range(max(0, last[0] + 1), x):
                set_dots(between, held, held)
            top, bottom = min(top, last[2]), max(bottom, last[1])
        set_dots(x, top, bottom)
        last = (x, calc_dot_row(piece.high), calc_dot_row(piece.low))
    return cells


def trace_values(values: Sequence[tuple[float, float | None]], columns: int, rows: int) -> CellDots:
    """Return the cells of a step line through points.

    Parameters
    ----------
    values
        Points (x, y), both as shares 0 to 1 of the plot; y = None interrupts the line.
    columns, rows
        Size of the plot in cells.
    """
    known = [y is not None for _x, y in values]
    return trace_cells(
        [
            PlotPiece(x, y, y, after > 0 and known[after - 1])
            for after, (x, y) in enumerate(values)
            if y is not None
        ],
        columns,
        rows,
    )
