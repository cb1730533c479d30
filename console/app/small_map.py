"""A field in a few characters, for lists and questions: its outline in dots, or its planned rates in shades. Pure."""
from __future__ import annotations

from collections.abc import Sequence

from console.app.braille import BITS, BLANK
from console.app.field_picture import FieldPicture, Planned, Ring

SHADES = "░▒▓█"             # from the lowest planned rate to the highest


def outline(rings: Sequence[Ring], columns: int, rows: int) -> tuple[str, ...]:
    """Rows of braille, north up, one scale both ways; () without a ring."""
    places = [place for ring in rings for place in ring]
    if not places:
        return ()
    east, north = zip(*places, strict=True)
    width, height = 2 * columns, 4 * rows
    metres = max((max(east) - min(east)) / (width - 1), (max(north) - min(north)) / (height - 1), 1e-9)
    cells = [[0] * columns for _row in range(rows)]
    for ring in rings:
        for (a_east, a_north), (b_east, b_north) in zip(ring, (*ring[1:], ring[0]), strict=True):
            steps = max(1, round(max(abs(b_east - a_east), abs(b_north - a_north)) / metres))
            for step in range(steps + 1):
                x = round((a_east + (b_east - a_east) * step / steps - min(east)) / metres)
                y = round((max(north) - a_north - (b_north - a_north) * step / steps) / metres)
                cells[min(y, height - 1) // 4][min(x, width - 1) // 2] |= BITS[min(y, height - 1) % 4][
                    min(x, width - 1) % 2]
    return tuple("".join(chr(BLANK + cell) if cell else " " for cell in row).rstrip() for row in cells)


def shaded(planned: Planned, columns: int, rows: int) -> tuple[str, ...]:
    """Planned rates as shades, north up; a character is twice as high as wide."""
    box, ends = planned.box, planned.ends
    metres = max((box.east_m - box.west_m) / columns, (box.north_m - box.south_m) / (2 * rows), 1e-9)
    low, high = ends if ends is not None else (0.0, 0.0)
    drawn = []
    for row in range(rows):
        north = box.north_m - (2 * row + 1) * metres
        line = ""
        for column in range(columns):
            rate = planned.at(box.west_m + (column + 0.5) * metres, north)
            level = len(SHADES) - 1 if rate is None or high <= low else int((rate - low) / (high - low)
                                                                            * (len(SHADES) - 1) + 0.5)
            line += " " if rate is None else SHADES[level]
        drawn.append(line.rstrip())
    while drawn and not drawn[-1]:
        drawn.pop()
    return tuple(drawn)


def preview(picture: FieldPicture | None, columns: int, rows: int) -> tuple[str, ...]:
    if picture is None:
        return ()
    return shaded(picture.planned, columns, rows) if picture.planned is not None else outline(picture.rings_m, columns,
                                                                                             rows)
