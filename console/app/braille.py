"""Lines in braille, 2 x 4 dots a cell: of values over a time, held level from one to the next.
Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

CELL_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # of a cell, row by row
BLANK_CODE = 0x2800
CellDots = dict[tuple[int, int], int]  # (column, row) of a cell -> its bits


class PlotPiece(NamedTuple):
    """Holds a piece of a line. at: place in the span, 0 ... 1; low, high: of the axis, 0 ... 1;
    joined: to the piece before."""

    at: float
    low: float
    high: float
    joined: bool


def trace_cells(pieces: Sequence[PlotPiece], columns: int, rows: int) -> CellDots:
    """Cells of pieces: from lowest to highest at their time, held level from one to the next;
    columns, rows: of the plot in cells, outside of which nothing is drawn."""
    wide, high = 2 * columns, 4 * rows
    cells: CellDots = {}

    def calc_dot_row(share: float) -> int:
        return high - 1 - round(max(0.0, min(1.0, share)) * (high - 1))

    def set_dots(x: int, top: int, bottom: int) -> None:
        for y in range(top, bottom + 1) if 0 <= x < wide else ():
            place = (x // 2, y // 4)
            cells[place] = cells.get(place, 0) | CELL_BITS[y % 4][x % 2]

    last: tuple[int, int, int] | None = None
    for piece in pieces:
        x = round(piece.at * (wide - 1))
        top, bottom = calc_dot_row(piece.high), calc_dot_row(piece.low)
        if piece.joined and last is not None:
            held = (last[1] + last[2]) // 2
            for between in range(max(0, last[0] + 1), x):
                set_dots(between, held, held)
            top, bottom = min(top, last[2]), max(bottom, last[1])
        set_dots(x, top, bottom)
        last = (x, calc_dot_row(piece.high), calc_dot_row(piece.low))
    return cells


def trace_values(values: Sequence[tuple[float, float | None]], columns: int, rows: int) -> CellDots:
    """Cells of a line through (x, y), x and y in 0 ... 1 of the plot: a step, as the drives see it;
    None breaks it."""
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
