"""Speed, shaft, opening, hopper: a label, numerals of 3 rows, and what was commanded or is left."""
from __future__ import annotations

from rich.cells import cell_len
from textual.content import Content

from console.app.digits import ROWS, draw, largest
from console.app.view import Tile
from console.app.widgets.panel import Panel, Part, fit, fullest, line, solid


class Tiles(Panel[tuple[Tile, ...]]):
    """All tiles side by side at equal width: 5 rows, 7 where the numerals have the room."""

    def lines(self, view: tuple[Tile, ...], width: int, height: int) -> list[Content]:
        each = width // max(1, len(view))
        scale = largest((tile.value.text for tile in view), each, height - 2)
        rows: list[list[Part]] = [[] for _row in range(ROWS[scale] + 2)]
        for tile in view:
            style = "$stale" if tile.value.stale else "$foreground"
            unit_room = each - cell_len(tile.label) - 2
            rows[0] += [(f" {tile.label} ", "bold"), (fit(tile.unit, unit_room), "$muted")]
            for index, text in enumerate(_drawn(tile.value.text, scale, each - 1)):
                rows[1 + index] += [" ", *solid(fit(text, each - 1), style)]
            mark = "! " if tile.level else ""
            under = "bold $on-alarm-amber on $alarm-amber" if tile.level else "$muted"
            text = fit(fullest((mark + tile.below, mark + tile.below_short), each - 2), each - 2)
            rows[-1] += [" ", (text, under), " "]
        return [line(*row) for row in rows]


def _drawn(text: str, scale: int, width: int) -> tuple[str, ...]:
    """Large numerals; plain ones in the middle row where they have no room: a number that is cut is another number."""
    drawn = draw(text, scale)
    if len(drawn[0]) <= width:
        return drawn
    return tuple(text if row == ROWS[scale] // 2 else "" for row in range(ROWS[scale]))
