"""Shows speed, shaft, opening and hopper: a label, numerals of 3 rows, and the set-point or the
remaining distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from rich.cells import cell_len
from rich.segment import Segment
from textual.content import Content
from textual.strip import Strip
from topdress.console.app.block_digits import ROWS_AT_SCALE, draw_digits, find_largest_scale
from topdress.console.app.braille import BLANK_BRAILLE_CODE, trace_values
from topdress.console.app.panel_views import HeadsView, HeadView, TileView
from topdress.console.app.widgets.base_panel import (
    Panel,
    TextPart,
    choose_longest_fit,
    fit_text_width,
    make_line,
    make_solid_parts,
    spread_parts,
)
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.locale import _


def draw_share_bar(share: float, width: int) -> tuple[str, str]:
    """Return the filled and the empty part of a bar of `width` cells. The bar is half as high as
    its row, so that neighbouring bars stay separate."""
    full = round(max(0.0, min(1.0, share)) * width)
    return "▄" * full, "▁" * (width - full)


# The panel shows the NDVI heads as small bars, marks dropped heads, and gives the fused value that
# the decision used.
class HeadsPanel(Panel[HeadsView]):
    """Shows a heading and three rows of two heads."""

    def draw_rows(self, view: HeadsView, width: int, height: int) -> list[Content]:
        style = "$stale" if view.fused.stale else "bold"
        rows = [
            spread_parts(
                [(" NDVI ", "bold"), (view.fused.text, style)],
                [(f"{view.valid} ", "$muted")],
                width,
            )
        ]
        half = width // 2
        count = (len(view.heads) + 1) // 2
        for row in range(count):
            parts: list[TextPart] = []
            for head in (
                (view.heads[row], view.heads[row + count])
                if row + count < len(view.heads)
                else (view.heads[row],)
            ):
                parts += self._draw_head(head, half, view.fused.stale)
            rows.append(make_line(*parts))
        return rows

    @staticmethod
    def _draw_head(head: HeadView, width: int, stale: bool) -> list[TextPart]:
        """Return the parts of one head."""
        room = width - 11
        if head.dropped:
            word = f" ✖ {_('dropped')} "
            return [
                (f" {head.number} ", "bold $on-alarm-amber on $alarm-amber"),
                " ",
                (fit_text_width(word, room), "$on-alarm-amber on $alarm-amber"),
                (f" {head.value:>5} ", "$stale"),
            ]
        style = "$stale" if stale else "$target"
        full, rest = draw_share_bar(head.share or 0.0, room)
        return [
            (f" {head.number} ", "bold"),
            " ",
            (full, style),
            (rest, "$muted"),
            (f" {head.value:>5} ", "$stale" if stale else ""),
        ]


# Small graphs below the tiles show the last minutes on a large terminal; these are the channels of
# the tiles, in their order.
GRAPH_CHANNELS = ("speed_used_mps", "shaft_rpm", "opening_mm", "hopper_kg")
# Smallest range of a graph as a share of its largest value: noise is drawn as a flat line, not as a
# mountain.
MIN_GRAPH_RANGE_SHARE = 0.05

# Points (share of the time, share of the height); None interrupts the line.
GraphPoints = tuple[tuple[float, float | None], ...]


class GraphsView(NamedTuple):
    """Holds the graphs below the tiles."""

    graphs: tuple[GraphPoints, ...]
    stale: bool = False


def make_graph(
    times_s: Sequence[float], values: Sequence[float], from_s: float, span_s: float
) -> GraphPoints:
    """Return the points of values (NaN where unknown) on a scale of their own."""
    known = [value for value in values if value == value]
    if not known:
        return ()
    low, high = min(known), max(known)
    least = MIN_GRAPH_RANGE_SHARE * max(abs(low), abs(high)) or 1.0
    if high - low < least:
        low, high = 0.5 * (low + high) - 0.5 * least, 0.5 * (low + high) + 0.5 * least
    return tuple(
        (
            round((time_s - from_s) / span_s, 3),
            round((value - low) / (high - low), 2) if value == value else None,
        )
        for time_s, value in zip(times_s, values, strict=True)
    )


class TileGraphs(Canvas[GraphsView]):
    """Shows the last minutes of each tile."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {"trend--applied", "trend--stale"}

    def draw_rows(self, view: GraphsView, width: int, height: int) -> list[Strip]:
        each = width // len(GRAPH_CHANNELS)
        style = self.find_style("trend--stale" if view.stale else "trend--applied")
        dots = [trace_values(one, each - 2, height) for one in view.graphs]
        rows = []
        for row in range(height):
            segments: list[Segment] = []
            for cells in dots:
                drawn = "".join(
                    chr(BLANK_BRAILLE_CODE | cells[place])
                    if (place := (column, row)) in cells
                    else " "
                    for column in range(each - 2)
                )
                segments += [
                    Segment(" ", self.rich_style),
                    Segment(drawn, style),
                    Segment(" ", self.rich_style),
                ]
            rows.append(Strip(segments).adjust_cell_length(width, self.rich_style))
        return rows


class TilesPanel(Panel[tuple[TileView, ...]]):
    """Shows all tiles side by side with equal width: 5 rows, or 7 where the numerals fit."""

    def draw_rows(self, view: tuple[TileView, ...], width: int, height: int) -> list[Content]:
        each = width // max(1, len(view))
        scale = find_largest_scale((tile.value.text for tile in view), each, height - 2)
        rows: list[list[TextPart]] = [[] for _row in range(ROWS_AT_SCALE[scale] + 2)]
        for tile in view:
            style = "$stale" if tile.value.stale else "$foreground"
            unit_room = each - cell_len(tile.label) - 2
            rows[0] += [
                (f" {tile.label} ", "bold"),
                (fit_text_width(tile.unit, unit_room), "$muted"),
            ]
            for index, text in enumerate(_draw_large_number(tile.value.text, scale, each - 1)):
                rows[1 + index] += [" ", *make_solid_parts(fit_text_width(text, each - 1), style)]
            mark = "! " if tile.level else ""
            under = "bold $on-alarm-amber on $alarm-amber" if tile.level else "$muted"
            text = fit_text_width(
                choose_longest_fit((mark + tile.below, mark + tile.below_short), each - 2), each - 2
            )
            rows[-1] += [" ", (text, under), " "]
        return [make_line(*row) for row in rows]


def _draw_large_number(text: str, scale: int, width: int) -> tuple[str, ...]:
    """Return large numerals. Where they do not fit, plain digits appear in the middle row, because
    a truncated number is another number."""
    drawn = draw_digits(text, scale)
    if len(drawn[0]) <= width:
        return drawn
    return tuple(
        text if row == ROWS_AT_SCALE[scale] // 2 else "" for row in range(ROWS_AT_SCALE[scale])
    )
