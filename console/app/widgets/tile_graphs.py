"""How the values of the tiles ran over the last minutes: a small graph under each tile, where the terminal is large."""
from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from rich.segment import Segment
from textual.strip import Strip

from console.app.braille import BLANK, trace
from console.app.widgets.canvas import Canvas

CHANNELS = ("speed_used_mps", "shaft_rpm", "opening_mm", "hopper_kg")      # of the tiles, in their order
LEAST_SHARE = 0.05             # of the largest value: less than that is shown as a flat line, not as a mountain

Graph = tuple[tuple[float, float | None], ...]       # (share of the time, share of the height); None breaks the line


class GraphsView(NamedTuple):
    graphs: tuple[Graph, ...]
    stale: bool = False


def graph(times_s: Sequence[float], values: Sequence[float], from_s: float, span_s: float) -> Graph:
    """Values, NaN where unknown, on a scale of their own."""
    known = [value for value in values if value == value]
    if not known:
        return ()
    low, high = min(known), max(known)
    least = LEAST_SHARE * max(abs(low), abs(high)) or 1.0
    if high - low < least:
        low, high = 0.5 * (low + high) - 0.5 * least, 0.5 * (low + high) + 0.5 * least
    return tuple((round((time_s - from_s) / span_s, 3),
                  round((value - low) / (high - low), 2) if value == value else None)
                 for time_s, value in zip(times_s, values, strict=True))


class TileGraphs(Canvas[GraphsView]):
    COMPONENT_CLASSES: ClassVar[set[str]] = {"trend--applied", "trend--stale"}

    def paint(self, view: GraphsView, width: int, height: int) -> list[Strip]:
        each = width // len(CHANNELS)
        style = self.style("trend--stale" if view.stale else "trend--applied")
        dots = [trace(one, each - 2, height) for one in view.graphs]
        rows = []
        for row in range(height):
            segments: list[Segment] = []
            for cells in dots:
                drawn = "".join(chr(BLANK | cells[place]) if (place := (column, row)) in cells else " "
                                for column in range(each - 2))
                segments += [Segment(" ", self.rich_style), Segment(drawn, style), Segment(" ", self.rich_style)]
            rows.append(Strip(segments).adjust_cell_length(width, self.rich_style))
        return rows
