"""How are charts drawn as SVG? They have lines, points with intervals, bands, bars and coloured
ground.

Colours are variables of the page (`html.py`), so that charts are readable by day, by night and on
paper. Lengths are points (1/72 inch). The fonts of the page draw the texts, so their widths are
estimated.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil, floor, isfinite, log10
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.reports.html import Picture, escape_text

# Series arrive as lists or arrays; inside of this module all are float arrays.
Array = npt.NDArray[np.float64]
Values = npt.ArrayLike

# The page defines these variables for light, dark and print, so a picture needs no colour of its
# own.
INK_COLOUR, LINE_COLOUR, GRID_COLOUR, DIM_COLOUR = (
    "var(--ink)",
    "var(--line)",
    "var(--grid)",
    "var(--dim)",
)
BEFORE_COLOUR, AFTER_COLOUR, THIRD_COLOUR = "var(--before)", "var(--after)", "var(--third)"
PAPER_COLOUR = "var(--paper)"

# CSS and SVG define a point as 1/72 inch.
POINTS_PER_INCH = 72.0
FONT_PT, SMALL_FONT_PT = 10.0, 9.0
# Mean width of a letter divided by its font size: sans-serif faces have 0.5 to 0.6, Chinese
# characters 1.
LETTER_WIDTH, WIDE_LETTER_WIDTH = 0.55, 1.0
# Distances between a panel and its numbers, between numbers and words, and around the sheet,
# points.
GAP_PT, EDGE_PT = 4.0, 4.0
# Distance to the right of a panel, so that its last number does not touch the next panel, points.
RIGHT_PT = 8.0
# Height of a row of text: the font size of 10 points and its line spacing, points.
ROW_PT = 14.0
# Smallest distances between ticks, points.
TICK_X_PT, TICK_Y_PT = 55.0, 22.0
# Share of their span by which data end inside of the panel.
DATA_MARGIN_SHARE = 0.05
# Steps that people read easily, as multiples of a power of ten.
STEPS_OF_TEN = (1.0, 2.0, 2.5, 5.0, 10.0)
# Powers of ten beyond which numbers are written as a power.
MIN_PLAIN_POWER, MAX_PLAIN_POWER = -4, 6
# More entries in a row are shorter than the names of most series.
LEGEND_COLUMNS = 4
# Width for the colour bar, its numbers and its unit, points.
COLOUR_BAR_PT = 62.0

Tick = tuple[float, str]


def measure_text(text: str, font_pt: float = FONT_PT) -> float:
    """Returns the estimated width of a text, points."""
    # "W" and "F" are the classes of Unicode for wide and full-width characters.
    wide = sum(unicodedata.east_asian_width(letter) in "WF" for letter in text)
    return font_pt * (LETTER_WIDTH * (len(text) - wide) + WIDE_LETTER_WIDTH * wide)


def find_ticks(low: float, high: float, most: int) -> list[Tick]:
    """Returns round numbers between two ends, at most `most`, each with its text."""
    span = high - low
    # A span of 0 or NaN has no round step; its only tick is the value itself.
    if not (isfinite(span) and span > 0.0):
        return [(low, _format_tick(low, 3))]
    power = 10.0 ** floor(log10(span / max(1, most)))
    step = next(
        one * power
        # Twenty is the next step after 10.0, for a span whose power of ten is just too small.
        for one in (*STEPS_OF_TEN, 20.0)
        if floor(high / (one * power)) - ceil(low / (one * power)) < max(1, most)
    )
    # A step of 2.5 needs one decimal more than 2 or 5; 1.001 avoids a rounding error of log10 at
    # powers of ten.
    decimals = max(0, -floor(log10(step * 1.001)) + (step / 10.0 ** floor(log10(step)) == 2.5))
    # The tolerance of 1e-9 steps keeps a tick at an end that is a multiple of the step.
    first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
    return [(k * step, _format_tick(k * step, decimals)) for k in range(first, last + 1)]


def _format_tick(value: float, decimals: int) -> str:
    # Adding 0.0 turns -0.0 into 0.0, which would otherwise print as "-0".
    value += 0.0
    if value and not MIN_PLAIN_POWER <= log10(abs(value)) < MAX_PLAIN_POWER:
        text = f"{value:.3g}"
    else:
        text = f"{value:.{decimals}f}"
    # Values that round to zero lose their sign; the typographic minus has the width of a digit.
    return text.replace("-", "\N{MINUS SIGN}") if float(text) else text.lstrip("-")


class SeriesStyle(NamedTuple):
    """Describes how a series is drawn; an entry of the legend shows the same style."""

    colour: str
    dash: str = "-"
    width: float = 1.5
    marker: str = ""
    size: float = 5.0
    fill: str = ""
    opacity: float = 1.0


DASH_PATTERNS = {"-": "", "--": "5.5 3", ":": "1.5 2.5"}


def _format_stroke(colour: str, width: float, dash: str = "-") -> str:
    # A solid line needs no dash array.
    dashes = f";stroke-dasharray:{DASH_PATTERNS[dash]}" if DASH_PATTERNS[dash] else ""
    return f"fill:none;stroke:{colour};stroke-width:{width:g}{dashes}"


def _draw_text(
    x: float, y: float, text: str, anchor: str = "start", font_pt: float = FONT_PT, **more: str
) -> str:
    colour, turn = more.get("colour", INK_COLOUR), more.get("turn", "")
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" style="font-size:{font_pt:g}px;text-anchor:{anchor};'
        f'fill:{colour}"{turn}>{escape_text(text)}</text>'
    )


def _make_path(x: Array, y: Array) -> str:
    # One decimal is a tenth of a point, which is finer than any screen or printer shows.
    """Returns a line through points; a point that is not finite leaves a gap."""
    parts, joined = [], False
    for one, other in zip(x.tolist(), y.tolist(), strict=True):
        known = isfinite(one) and isfinite(other)
        if known:
            parts.append(f"{'L' if joined else 'M'}{one:.1f} {other:.1f}")
        joined = known
    return "".join(parts)


# Corners of each marker as multiples of half its size; y points down in SVG. The areas look alike.
_MARKER_SHAPES: dict[str, tuple[tuple[float, float], ...]] = {
    "s": ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "^": ((0.0, -1.1), (1.0, 0.8), (-1.0, 0.8)),
    "v": ((0.0, 1.1), (1.0, -0.8), (-1.0, -0.8)),
    "D": ((0.0, -1.2), (1.2, 0.0), (0.0, 1.2), (-1.2, 0.0)),
    "P": ((-0.9, -0.3), (0.9, -0.3), (0.9, 0.3), (-0.9, 0.3)),
}


def _draw_markers(x: Array, y: Array, look: SeriesStyle) -> str:
    """Returns the markers of a series as one path."""
    half = 0.5 * look.size
    shape = _MARKER_SHAPES.get(look.marker)
    parts = []
    for one, other in zip(x.tolist(), y.tolist(), strict=True):
        # NaN in a path would make the browser drop the whole path.
        if not (isfinite(one) and isfinite(other)):
            continue
        if shape is None:
            r = 0.5 * half if look.marker == "." else half
            # SVG has no circle in a path: two half arcs make one, so all markers remain a single
            # element.
            parts.append(
                f"M{one - r:.1f} {other:.1f}a{r:.1f} {r:.1f} 0 1 0 {2 * r:.1f} 0"
                f"a{r:.1f} {r:.1f} 0 1 0 {-2 * r:.1f} 0"
            )
        else:
            corners = "L".join(f"{one + half * a:.1f} {other + half * b:.1f}" for a, b in shape)
            parts.append(f"M{corners}Z")
    fill = look.fill or look.colour
    width = 0.0 if look.marker == "." else 1.0
    return (
        f'<path d="{"".join(parts)}" style="fill:{fill};stroke:{look.colour};'
        f'stroke-width:{width:g};opacity:{look.opacity:g}"/>'
    )


class _PanelScales(NamedTuple):
    """Converts the data of a panel to points of the sheet."""

    x: Callable[[Values], Array]
    y: Callable[[Values], Array]
    left: float
    top: float
    right: float
    bottom: float


Drawing = Callable[[_PanelScales], str]


@dataclass
class ChartPanel:
    """Holds one pair of axes. Its drawings are placed when the sheet is made."""

    title: str = ""
    title_colour: str = INK_COLOUR
    x_label: str = ""
    y_label: str = ""
    # Named positions on the x axis in place of numbers.
    x_names: tuple[Tick, ...] = ()
    x_ends: tuple[float, float] | None = None
    # Named positions on the y axis; its ends may be reversed, so that the axis runs down.
    y_names: tuple[Tick, ...] = ()
    y_ends: tuple[float, float] | None = None
    # Returns the ticks of the x axis; the default makes plain numbers.
    make_x_ticks: Callable[[float, float, int], list[Tick]] = find_ticks
    has_equal_scales: bool = False
    drawings: list[Drawing] = field(default_factory=list)
    looks: dict[str, SeriesStyle] = field(default_factory=dict)
    # The plotted points under each label, x and y of shape (n,).
    series: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    _x: list[Array] = field(default_factory=list)
    _y: list[Array] = field(default_factory=list)

    def label(self, x: str = "", y: str = "", title: str = "") -> None:
        """Sets the names of the axes and the title of the panel; an empty text changes nothing."""
        self.x_label, self.y_label = x or self.x_label, y or self.y_label
        self.title = title or self.title

    def plot(
        self,
        x: Values,
        y: Values,
        colour: str,
        *,
        label: str = "",
        dash: str = "-",
        width: float = 1.5,
        marker: str = "",
        size: float = 6.0,
        fill: str = "",
        opacity: float = 1.0,
    ) -> None:
        """Draws a line and markers through points.

        Parameters
        ----------
        x, y : points of shape (n,); NaN leaves a gap.
        colour : one of the colours of this module.
        label : its text in the legend; empty for no entry.
        dash : "-", "--" or ":"; empty for markers alone.
        marker : "o", ".", "s", "^", "v", "D" or "P"; empty for a line alone.
        width, size : width of the line and size of the markers, points.
        fill : colour inside of the markers; empty means `colour`.
        """
        at, value = self._collect_values(x, y)
        # The first series of a label keeps its points, as the legend keeps its first style.
        self.series.setdefault(label, (at, value))
        look = SeriesStyle(colour, dash, width, marker, size, fill, opacity)

        def draw_series(scales: _PanelScales) -> str:
            px, py = scales.x(at), scales.y(value)
            parts = [_draw_markers(px, py, look)] if marker else []
            if dash:
                style = _format_stroke(colour, width, dash)
                # The line lies below the markers.
                parts.insert(0, f'<path d="{_make_path(px, py)}" style="{style}"/>')
            return "".join(parts)

        self._add_drawing(draw_series, label, look)

    def plot_intervals(
        self,
        x: Values,
        y: Values,
        half: Values,
        colour: str,
        *,
        bar_colour: str = "",
        label: str = "",
        marker: str = "o",
        size: float = 6.0,
        fill: str = "",
    ) -> None:
        """Draws points with bars from y - half to y + half, all of shape (n,)."""
        at, value = self._collect_values(x, y)
        reach = np.asarray(half, float)
        # The ends of the bars count for the range of the axis, so that no interval is cut.
        self._collect_values(at, value - reach)
        self._collect_values(at, value + reach)
        look = SeriesStyle(colour, "", 1.5, marker, size, fill)

        def draw_intervals(scales: _PanelScales) -> str:
            px, py = scales.x(at), scales.y(value)
            low, high = scales.y(value - reach), scales.y(value + reach)
            bars = "".join(
                f"M{a:.1f} {b:.1f}V{c:.1f}M{a - 3:.1f} {b:.1f}h6M{a - 3:.1f} {c:.1f}h6"
                for a, b, c in zip(px.tolist(), low.tolist(), high.tolist(), strict=True)
                if isfinite(a) and isfinite(b) and isfinite(c)
            )
            style = _format_stroke(bar_colour or colour, 1.0)
            return f'<path d="{bars}" style="{style}"/>{_draw_markers(px, py, look)}'

        self._add_drawing(draw_intervals, label, look)

    def fill_between(self, x: Values, low: Values, high: Values, colour: str) -> None:
        """Draws a faint band between two lines of shape (n,); NaN leaves a gap."""
        at, lower = self._collect_values(x, low)
        _, upper = self._collect_values(x, high)
        known = np.isfinite(at) & np.isfinite(lower) & np.isfinite(upper)
        # Each change between known and unknown rows begins a new piece, because a band cannot cross
        # a gap.
        pieces = np.split(np.arange(len(at)), np.flatnonzero(np.diff(known.astype(int))) + 1)

        def draw_band(scales: _PanelScales) -> str:
            rings = []
            for rows in pieces:
                # A piece of one point has no width to fill.
                if len(rows) < 2 or not known[rows[0]]:
                    continue
                # The ring runs along the upper line and back along the lower line.
                there, back = scales.x(at[rows]), scales.x(at[rows[::-1]])
                ring_y = np.concatenate([scales.y(upper[rows]), scales.y(lower[rows[::-1]])])
                rings.append(_make_path(np.concatenate([there, back]), ring_y) + "Z")
            style = f"fill:{colour};fill-opacity:0.22;stroke:none"
            return f'<path d="{"".join(rings)}" style="{style}"/>'

        self._add_drawing(draw_band)

    def draw_level(
        self,
        y: float,
        colour: str = DIM_COLOUR,
        *,
        width: float = 0.9,
        dash: str = "-",
        label: str = "",
    ) -> None:
        """Draws a horizontal line across the panel at one value."""
        self._collect_values((), (y,))

        def draw_level_line(scales: _PanelScales) -> str:
            (at,) = scales.y((y,)).tolist()
            style = _format_stroke(colour, width, dash)
            return f'<path d="M{scales.left:.1f} {at:.1f}H{scales.right:.1f}" style="{style}"/>'

        self._add_drawing(draw_level_line, label, SeriesStyle(colour, dash, width))

    def draw_moment(
        self,
        x: float,
        colour: str = INK_COLOUR,
        *,
        width: float = 1.4,
        dash: str = ":",
        label: str = "",
        words: str = "",
    ) -> None:
        """Draws a vertical line in the panel at one value, with words at its upper end."""
        self._collect_values((x,), ())

        def draw_moment_line(scales: _PanelScales) -> str:
            (at,) = scales.x((x,)).tolist()
            line = (
                f'<path d="M{at:.1f} {scales.top:.1f}V{scales.bottom:.1f}" '
                f'style="{_format_stroke(colour, width, dash)}"/>'
            )
            return line + (_draw_text(at + 3, scales.top + 9, words, font_pt=8.5) if words else "")

        self._add_drawing(draw_moment_line, label, SeriesStyle(colour, dash, width))

    def draw_bars(
        self,
        edges: Values,
        heights: Values,
        colour: str,
        *,
        edge_colour: str = "",
        label: str = "",
    ) -> None:
        """Draws bars of shape (n,) between edges of shape (n + 1,), from 0 up."""
        ends, tops = np.asarray(edges, float), np.asarray(heights, float)
        # Bars begin at zero, so zero belongs to the axis.
        self._collect_values(ends, np.append(tops, 0.0))

        def draw_bar_path(scales: _PanelScales) -> str:
            px, py = scales.x(ends).tolist(), scales.y(tops).tolist()
            (floor_y,) = scales.y((0.0,)).tolist()
            bars = "".join(
                f"M{left:.1f} {floor_y:.1f}V{top:.1f}H{right:.1f}V{floor_y:.1f}Z"
                for left, right, top in zip(px[:-1], px[1:], py, strict=True)
            )
            return f'<path d="{bars}" style="fill:{colour};stroke:{edge_colour or "none"}"/>'

        self._add_drawing(draw_bar_path, label, SeriesStyle(colour, "", 1.5, "s", 7.0))

    def draw_spans(self, spans: Sequence[tuple[float, float]], row: float, colour: str) -> None:
        """Draws intervals along x, each from and to, as bars of height 0.7 about y = `row`."""
        self._collect_values([end for span in spans for end in span], (row,))

        def draw_span_bars(scales: _PanelScales) -> str:
            top, bottom = scales.y((row + 0.35, row - 0.35)).tolist()
            bars = "".join(
                "M{0:.1f} {2:.1f}H{1:.1f}V{3:.1f}H{0:.1f}Z".format(
                    *scales.x(span).tolist(), top, bottom
                )
                for span in spans
            )
            return f'<path d="{bars}" style="fill:{colour};stroke:none"/>'

        self._add_drawing(draw_span_bars)

    def write(self, x: float, y: float, words: str) -> None:
        """Writes words to the right of a point."""

        def draw_words(scales: _PanelScales) -> str:
            (at,), (level,) = scales.x((x,)).tolist(), scales.y((y,)).tolist()
            return _draw_text(at + 6.0, level + 3.0, words, font_pt=8.0)

        self._add_drawing(draw_words)

    def draw_ground(self, rings: Array, colours: Sequence[str]) -> None:
        """Draws quadrilaterals of shape (n, 4, 2), each in its colour."""
        self._collect_values(rings[..., 0].ravel(), rings[..., 1].ravel())

        def draw_polygons(scales: _PanelScales) -> str:
            x, y = scales.x(rings[..., 0]), scales.y(rings[..., 1])
            # One path for each colour keeps the file small: a map has thousands of cells.
            by_colour: dict[str, list[str]] = {}
            for k, colour in enumerate(colours):
                by_colour.setdefault(colour, []).append(_make_path(x[k], y[k]) + "Z")
            return "".join(
                f'<path d="{"".join(paths)}" style="fill:{colour};stroke:none"/>'
                for colour, paths in by_colour.items()
            )

        self._add_drawing(draw_polygons)

    def _collect_values(self, x: Values, y: Values) -> tuple[Array, Array]:
        at, value = np.asarray(x, float), np.asarray(y, float)
        # Axes end at finite values; infinite or missing values must not stretch them.
        self._x.append(at[np.isfinite(at)])
        self._y.append(value[np.isfinite(value)])
        return at, value

    def _add_drawing(self, draw: Drawing, label: str = "", look: SeriesStyle | None = None) -> None:
        self.drawings.append(draw)
        if label and look is not None:
            self.looks.setdefault(label, look)

    def find_x_ends(self) -> tuple[float, float]:
        """Returns the ends of the x axis by the data."""
        return self.x_ends or _widen_ends(_find_data_ends(self._x))

    def find_y_ends(self) -> tuple[float, float]:
        """Returns the ends of the y axis by the data."""
        return self.y_ends or _widen_ends(_find_data_ends(self._y))


def _find_data_ends(parts: Iterable[Array]) -> tuple[float, float]:
    known = [part for part in parts if len(part)]
    # An empty panel still needs a scale, and 0 to 1 avoids a division by zero.
    if not known:
        return 0.0, 1.0
    return float(min(part.min() for part in known)), float(max(part.max() for part in known))


def _widen_ends(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not high > low:
        # A constant series gets 5 % of its value on both sides, so that the line lies in the
        # middle.
        half = 0.05 * abs(low) or 0.05
        return low - half, high + half
    return low - DATA_MARGIN_SHARE * (high - low), high + DATA_MARGIN_SHARE * (high - low)


class ColourBar(NamedTuple):
    """Describes the scale of coloured ground: its ends, its unit and its colours from low
    to high."""

    low: float
    high: float
    unit: str
    colours: Sequence[str]


class ChartSheet:
    """Lays out panels in rows and columns, with one legend below them.

    Parameters
    ----------
    width_in, height_in : size, inches.
    rows, columns : number of rows and columns of panels.
    shares_x : whether the panels of a column share their x axis.
    shares_y : whether the panels of a row share their y axis.
    """

    def __init__(
        self,
        width_in: float,
        height_in: float,
        rows: int = 1,
        columns: int = 1,
        *,
        shares_x: bool = False,
        shares_y: bool = False,
    ) -> None:
        self.width_pt, self.height_pt = width_in * POINTS_PER_INCH, height_in * POINTS_PER_INCH
        self.panels = [[ChartPanel() for _ in range(columns)] for _ in range(rows)]
        self.shares_x, self.shares_y = shares_x, shares_y
        self.colour_bar: ColourBar | None = None

    @property
    def panel(self) -> ChartPanel:
        """The first panel."""
        return self.panels[0][0]

    def _repr_svg_(self) -> str:
        return self.to_svg("chart")

    def make_picture(self, title: str, caption: str) -> Picture:
        """Returns the sheet as a picture of a page, with its caption in plain text below it."""
        return Picture(self.to_svg(title), caption, self)

    def to_svg(self, title: str) -> str:
        """Returns the sheet as an SVG element without ids, addresses or fonts of its own.

        `title` describes the picture for people who cannot see it.
        """
        looks: dict[str, SeriesStyle] = {}
        for panel in self._list_panels():
            # The first panel's style of a label wins, so a legend has one entry for each label.
            looks = panel.looks | looks
        legend, legend_pt = self._draw_legend(looks)
        body = self._draw_panels(self.height_pt - legend_pt)
        return (
            f'<svg class="picture" style="max-width:{self.width_pt:.0f}pt" role="img" '
            f'aria-label="{escape_text(title)}" viewBox="0 0 {self.width_pt:.0f} '
            f'{self.height_pt:.0f}">'
            f"\n{body}{legend}\n</svg>"
        )

    def _list_panels(self) -> list[ChartPanel]:
        return [panel for row in self.panels for panel in row]

    def _draw_legend(self, looks: dict[str, SeriesStyle]) -> tuple[str, float]:
        """Returns the legend and its height, points."""
        if not looks:
            return "", 0.0
        # A sample of 20 points, the gap to its text, and space before the next entry add up to 34
        # points.
        widths = [34.0 + measure_text(label, SMALL_FONT_PT) for label in looks]
        columns = min(LEGEND_COLUMNS, len(looks))
        # Columns shrink until the widest entry fits; a legend of one column may still be cut by a
        # very long name.
        while columns > 1 and columns * max(widths) > self.width_pt:
            columns -= 1
        rows = ceil(len(looks) / columns)
        wide = max(widths)
        left = 0.5 * (self.width_pt - columns * wide)
        top = self.height_pt - rows * ROW_PT
        parts = []
        for k, (label, look) in enumerate(looks.items()):
            x, y = left + wide * (k % columns), top + ROW_PT * (k // columns) + 0.5 * ROW_PT
            if look.dash:
                style = _format_stroke(look.colour, look.width, look.dash)
                parts.append(f'<path d="M{x:.1f} {y:.1f}h20" style="{style}"/>')
            if look.marker:
                parts.append(_draw_markers(np.array([x + 10.0]), np.array([y]), look))
            parts.append(_draw_text(x + 25.0, y + 3.0, label, font_pt=SMALL_FONT_PT))
        return "".join(parts), rows * ROW_PT + GAP_PT

    def _draw_panels(self, height_pt: float) -> str:
        rows, columns = len(self.panels), len(self.panels[0])
        bar_pt = COLOUR_BAR_PT if self.colour_bar is not None else 0.0
        cell_pt = (height_pt - 2.0 * EDGE_PT) / rows
        frames = [
            [self._make_frame(i, k, EDGE_PT + i * cell_pt, cell_pt) for k in range(columns)]
            for i in range(rows)
        ]
        # All panels of a column share the width for their numbers, so that their left ends align.
        words_pt = [max(row[k].words_pt for row in frames) for k in range(columns)]
        inner_pt = (self.width_pt - 2.0 * EDGE_PT - bar_pt - sum(words_pt)) / columns
        parts = []
        for row, framed in zip(self.panels, frames, strict=True):
            outer = EDGE_PT
            for panel, frame, wide in zip(row, framed, words_pt, strict=True):
                left = outer + wide
                placed = frame._replace(outer=outer, left=left, right=left + inner_pt - RIGHT_PT)
                parts.append(_draw_panel(panel, placed))
                outer = left + inner_pt
        if self.colour_bar is not None:
            left = self.width_pt - COLOUR_BAR_PT + 14.0
            parts.append(_draw_colour_bar(self.colour_bar, left, EDGE_PT + 20.0, height_pt - 56.0))
        return "\n".join(parts)

    def _make_frame(self, row: int, column: int, above: float, height_pt: float) -> _PanelFrame:
        """Returns a panel's position from top to bottom, and the texts at its axes."""
        panel = self.panels[row][column]
        has_x_words = row == len(self.panels) - 1 or not self.shares_x
        has_y_words = column == 0 or not self.shares_y
        top = above + (ROW_PT if panel.title else 2.0)
        bottom = above + height_pt - (ROW_PT if has_x_words else GAP_PT)
        bottom -= ROW_PT if panel.x_label and has_x_words else 0.0
        y_ends = panel.find_y_ends()
        if self.shares_y:
            y_ends = _unite_ends(one.find_y_ends() for one in self.panels[row])
        frame = _PanelFrame(
            top=top,
            bottom=bottom,
            x_ends=self._find_shared_x_ends(column) or panel.find_x_ends(),
            y_ends=y_ends,
            has_x_words=has_x_words,
            has_y_words=has_y_words,
        )
        if not has_y_words:
            # A panel that shares its y axis has no numbers of its own and needs no width for them.
            return frame
        widest = max(measure_text(text, SMALL_FONT_PT) for _, text in frame.find_y_ticks(panel))
        return frame._replace(words_pt=widest + GAP_PT + (ROW_PT if panel.y_label else 0.0))

    def _find_shared_x_ends(self, column: int) -> tuple[float, float] | None:
        if not self.shares_x:
            return None
        return _unite_ends(row[column].find_x_ends() for row in self.panels)


def _unite_ends(ends: Iterable[tuple[float, float]]) -> tuple[float, float]:
    lows, highs = zip(*ends, strict=True)
    return min(lows), max(highs)


class _PanelFrame(NamedTuple):
    """Holds a panel's position on the sheet, points, and the ends of its axes."""

    top: float
    bottom: float
    x_ends: tuple[float, float]
    y_ends: tuple[float, float]
    has_x_words: bool
    has_y_words: bool
    # Width for the numbers and the name of the y axis.
    words_pt: float = GAP_PT
    # Positions of the left end of these texts, and of the left and right end of the panel.
    outer: float = 0.0
    left: float = 0.0
    right: float = 0.0

    def find_x_ticks(self, panel: ChartPanel) -> list[Tick]:
        """Returns round numbers along the x axis."""
        most = max(2, int((self.right - self.left) / TICK_X_PT))
        return list(panel.x_names) or panel.make_x_ticks(*self.x_ends, most)

    def find_y_ticks(self, panel: ChartPanel) -> list[Tick]:
        """Returns round numbers along the y axis."""
        most = max(2, int((self.bottom - self.top) / TICK_Y_PT))
        return list(panel.y_names) or find_ticks(*self.y_ends, most)


def _draw_panel(panel: ChartPanel, frame: _PanelFrame) -> str:
    left, right, top, bottom = frame.left, frame.right, frame.top, frame.bottom
    if panel.has_equal_scales:
        x_ends, y_ends = _equalise_scales(
            frame.x_ends, frame.y_ends, (right - left) / (bottom - top)
        )
        frame = frame._replace(x_ends=x_ends, y_ends=y_ends)
    x_ticks, y_ticks = frame.find_x_ticks(panel), frame.find_y_ticks(panel)
    # Screen y grows downwards, so the scale runs from bottom to top.
    x, y = _make_scale(frame.x_ends, left, right), _make_scale(frame.y_ends, bottom, top)
    scales = _PanelScales(x, y, left, top, right, bottom)
    grid = [f"M{left:.1f} {at:.1f}H{right:.1f}" for at in _place_ticks(y, y_ticks)]
    # Named positions, e.g. groups of bars, need no vertical grid lines.
    if not panel.x_names:
        grid += [f"M{at:.1f} {top:.1f}V{bottom:.1f}" for at in _place_ticks(x, x_ticks)]
    drawn = "".join(draw(scales) for draw in panel.drawings)
    axes = f"M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}"
    return (
        f'<path d="{"".join(grid)}" style="{_format_stroke(GRID_COLOUR, 0.6)}"/>{drawn}'
        f'<path d="{axes}" style="{_format_stroke(LINE_COLOUR, 0.8)}"/>'
        + _draw_panel_words(panel, frame, scales, x_ticks, y_ticks)
    )


def _draw_panel_words(
    panel: ChartPanel,
    frame: _PanelFrame,
    scales: _PanelScales,
    x_ticks: list[Tick],
    y_ticks: list[Tick],
) -> str:
    left, top, right, bottom = frame.left, frame.top, frame.right, frame.bottom
    parts = []
    if panel.title:
        parts.append(_draw_text(left, top - 4.0, panel.title, colour=panel.title_colour))
    if frame.has_x_words:
        parts += [
            _draw_text(x, bottom + 11.0, words, "middle", SMALL_FONT_PT)
            for x, (_, words) in zip(_place_ticks(scales.x, x_ticks), x_ticks, strict=True)
        ]
        middle = 0.5 * (left + right)
        parts += (
            [_draw_text(middle, bottom + 24.0, panel.x_label, "middle")] if panel.x_label else []
        )
    if frame.has_y_words:
        parts += [
            _draw_text(left - GAP_PT, y + 3.0, words, "end", SMALL_FONT_PT)
            for y, (_, words) in zip(_place_ticks(scales.y, y_ticks), y_ticks, strict=True)
        ]
        x, y = frame.outer + 9.0, 0.5 * (top + bottom)
        turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"'
        parts += [_draw_text(x, y, panel.y_label, "middle", turn=turn)] if panel.y_label else []
    return "".join(parts)


def _place_ticks(scale: Callable[[Values], Array], ticks: list[Tick]) -> list[float]:
    found: list[float] = scale([at for at, _ in ticks]).tolist()
    return found


def _make_scale(ends: tuple[float, float], begin: float, end: float) -> Callable[[Values], Array]:
    low, high = ends

    def place_values(values: Values) -> Array:
        share = (np.asarray(values, float) - low) / (high - low)
        return np.asarray(begin + share * (end - begin))

    return place_values


def _equalise_scales(
    x_ends: tuple[float, float], y_ends: tuple[float, float], aspect: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns ends that give both axes the same scale in a panel with the ratio `aspect` of width
    to height."""
    wide = max(x_ends[1] - x_ends[0], aspect * (y_ends[1] - y_ends[0]))
    return _centre_span(x_ends, wide), _centre_span(y_ends, wide / aspect)


def _centre_span(ends: tuple[float, float], span: float) -> tuple[float, float]:
    middle = 0.5 * (ends[0] + ends[1])
    return middle - 0.5 * span, middle + 0.5 * span


def _draw_colour_bar(bar: ColourBar, left: float, top: float, height: float) -> str:
    step = height / len(bar.colours)
    cells = "".join(
        # Cells overlap by 0.3 points; otherwise viewers draw hairlines between them.
        f'<path d="M{left:.1f} {top + height - (k + 1) * step:.2f}h12v{step + 0.3:.2f}h-12Z" '
        f'style="fill:{colour};stroke:none"/>'
        for k, colour in enumerate(bar.colours)
    )
    place = _make_scale(
        # A bar of one value would divide by zero.
        (bar.low, bar.high if bar.high > bar.low else bar.low + 1.0),
        top + height,
        top,
    )
    ticks = find_ticks(bar.low, bar.high, max(2, int(height / TICK_Y_PT)))
    words = "".join(
        _draw_text(left + 16.0, y + 3.0, text, font_pt=SMALL_FONT_PT)
        for y, (_, text) in zip(_place_ticks(place, ticks), ticks, strict=True)
    )
    return cells + words + _draw_text(left, top - 8.0, bar.unit, font_pt=SMALL_FONT_PT)
