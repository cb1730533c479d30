"""Defines the base class of all panels: it receives a frozen view and draws only those rows that
have changed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import Generic, Self, TypeVar

from rich.cells import cell_len, chop_cells, set_cell_size
from textual import events
from textual.content import Content
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.visual import Visual
from textual.widget import Widget
from topdress.console.locale import find_language_code

View = TypeVar("View")
Row = TypeVar("Row")
Key = TypeVar("Key")
TextPart = str | tuple[str, str]
# Positions at which a text may break: between words, and between any two Chinese characters.
_TEXT_PIECES = re.compile(r"[ \t]+|[⺀-鿿　-〿＀-￯]|[^\s⺀-鿿　-〿＀-￯]+")
# Chinese typography forbids these characters at the beginning of a row.
_NO_LINE_START_SIGNS = "，。；：、！？）」』】》"


class Picked(Message):
    """Reports a click on an entry of a list."""

    def __init__(self, index: int) -> None:
        super().__init__()
        self.index = index


class DrawnWidget(Widget, Generic[View, Row]):
    """Shows `view` in rows; `redraws` counts the different views."""

    # Selection by mouse would conflict with clicks; keys have their own actions, so no panel takes
    # the focus.
    ALLOW_SELECT = False
    can_focus = False
    DEFAULT_CLASSES = "panel"

    def __init__(self, view: View, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self.view, self._language = view, find_language_code()
        self.redraws = 0
        self._drawn: Sequence[Row] = ()
        # Rows are drawn for this size and theme; None means that nothing is drawn.
        self._drawn_for: object = None

    def show_view(self, view: View) -> None:
        """Show a new view; only screen rows that look different are updated."""
        # Equal views in another language have other texts.
        if (view, find_language_code()) == (self.view, self._language):
            return
        self.view, self._language = view, find_language_code()
        # Tests check by this count that unchanged values are not drawn.
        self.redraws += 1
        if self._drawn_for is None or self._drawn_for != self._make_cache_key():
            self.refresh()
        elif changed := self._find_changed_rows():
            self.refresh(*(Region(0, row, self.content_size.width, 1) for row in changed))

    def refresh(
        self, *regions: Region, repaint: bool = True, layout: bool = False, recompose: bool = False
    ) -> Self:
        """Draw again; without regions all cached rows are dropped."""
        # A refresh of regions keeps the other rows.
        if not regions:
            self._drawn_for = None
        return super().refresh(*regions, repaint=repaint, layout=layout, recompose=recompose)

    def find_drawn_rows(self) -> Sequence[Row]:
        """Return the rows to show, drawn once per view, size and theme."""
        if self._drawn_for is None or self._drawn_for != self._make_cache_key():
            width, height = self.content_size
            self._drawn, self._drawn_for = (
                self.draw_rows(self.view, width, height)[:height],
                self._make_cache_key(),
            )
        return self._drawn

    def draw_rows(self, view: View, width: int, height: int) -> Sequence[Row]:
        """Return the rows: of a panel at most `width` cells, of a canvas exactly `width` cells."""
        raise NotImplementedError

    def _find_changed_rows(self) -> list[int]:
        """Return the indices of the rows that the new view has changed."""
        # The old rows are compared with the new ones before they are dropped.
        before, self._drawn_for = self._drawn, None
        return [
            row
            for row, (old, new) in enumerate(zip_longest(before, self.find_drawn_rows()))
            if not (
                old.is_same(new)
                if isinstance(old, Content) and isinstance(new, Content)
                else old == new
            )
        ]

    def _make_cache_key(self) -> object:
        """Return the key of the cached rows: size and theme."""
        return self.content_size, self.app.theme


class Panel(DrawnWidget[View, Content]):
    """Shows rows of text with named styles."""

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Return column and row of each clickable cell, as drawn now."""
        return ((0, 0),) if hasattr(self, "on_click") else ()

    def render(self) -> Content:
        """Return all rows."""
        return Content("\n").join(self.find_drawn_rows())

    def render_line(self, y: int) -> Strip:
        """Return one row. Textual's own method would lay out all rows again for one changed row."""
        rows = self.find_drawn_rows()
        laid = (
            Visual.to_strips(self, rows[y], self.size.width, 1, self.visual_style)
            if y < len(rows)
            else []
        )
        return laid[0] if laid else Strip.blank(self.size.width, self.visual_style.rich_style)


class PickList(Panel[View]):
    """Shows rows that represent items; a click on a row posts `Picked` with the item's index."""

    def list_row_items(self) -> Sequence[int | None]:
        """Return the index of each row's item; None marks a heading."""
        raise NotImplementedError

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        things = self.list_row_items()
        return tuple((0, things.index(one)) for one in dict.fromkeys(things) if one is not None)

    def on_click(self, event: events.Click) -> None:
        """Post the clicked item."""
        event.stop()
        things = self.list_row_items()
        if 0 <= event.y < len(things) and (picked := things[event.y]) is not None:
            self.post_message(Picked(picked))


def make_line(*parts: TextPart) -> Content:
    """Return one row of texts and (text, style) pairs; empty texts are allowed."""
    return Content.assemble(*parts)


def make_solid_parts(text: str, colour: str, off: str = "") -> list[TextPart]:
    """Return the parts of a drawing of blocks in one colour. Full blocks also have the colour as
    background, so that no seams are visible.

    Parameters
    ----------
    text
        Blocks and gaps.
    colour, off
        Theme variables of blocks and gaps, e.g. "$target", "$track".
    """
    # Gaps have a background of their own.
    back = f" on {off}" if off else ""
    return [
        (run, f"{colour} on {colour}" if run[0] == "█" else f"{colour}{back}")
        for run in re.findall("█+|[^█]+", text)
    ]


def place_in_row(
    texts: Iterable[tuple[Key, str]], start: int = 0
) -> tuple[tuple[Key, str, int], ...]:
    """Return keys in a row one after the other, each with its text and first cell."""
    found = []
    for what, text in texts:
        found.append((what, text, start))
        start += cell_len(text)
    return tuple(found)


def find_at_cell(row: Iterable[tuple[Key, str, int]], x: int) -> Key | None:
    """Return the key at a cell of a row, or None."""
    return next((what for what, text, start in row if start <= x < start + cell_len(text)), None)


def fit_text_width(text: str, width: int) -> str:
    """Return exactly `width` cells of a text: filled with spaces, or cut and ended with two
    points."""
    if width <= 0:
        return ""
    if cell_len(text) <= width:
        return set_cell_size(text, width)
    # Two points would leave nothing of the text.
    if width <= 3:
        return set_cell_size(text, width)
    return set_cell_size(text, width - 2) + ".."


def choose_longest_fit(forms: Iterable[str], width: int) -> str:
    """Return the first form that fits into `width`, else the last form; forms are ordered from long
    to short."""
    form = ""
    for form in forms:
        if cell_len(form) <= width:
            break
    return form


def align_text_right(text: str, width: int) -> str:
    """Return exactly `width` cells with the text aligned right."""
    return (
        " " * max(0, width - cell_len(text)) + text
        if cell_len(text) <= width
        else fit_text_width(text, width)
    )


def spread_parts(left: list[TextPart], end: list[TextPart], width: int) -> Content:
    """Return one row with parts at its left and right end; parts that do not fit are cut at the end
    of the left parts."""

    def count_part_cells(parts: list[TextPart]) -> int:
        return sum(cell_len(part if isinstance(part, str) else part[0]) for part in parts)

    # The right end has priority: marks and times must stay visible.
    room = width - count_part_cells(end)
    kept: list[TextPart] = []
    for part in left:
        text, style = (part, "") if isinstance(part, str) else part
        have = room - count_part_cells(kept)
        if cell_len(text) > have:
            text = fit_text_width(text, have)
        kept.append((text, style) if style else text)
    gap = max(0, width - count_part_cells(kept) - count_part_cells(end))
    return make_line(*kept, " " * gap, *end)


def wrap_text(text: str, width: int) -> list[str]:
    """Return the rows of a text of at most `width` cells; a longer word is cut. No row begins with
    a full stop."""
    if width < 2:
        return []
    rows: list[list[str]] = [[]]
    for piece in _TEXT_PIECES.findall(text):
        row = rows[-1]
        if cell_len("".join(row) + piece.rstrip()) <= width:
            row.append(piece)
            continue
        # The character before a full stop moves to the next row together with it.
        carried = [row.pop()] if piece in _NO_LINE_START_SIGNS and len(row) > 1 else []
        *whole, rest = chop_cells("".join(carried) + piece.strip(), width) or [""]
        rows += [*([one] for one in whole), [rest]]
    return [line for line in ("".join(row).strip() for row in rows) if line]
