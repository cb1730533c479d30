"""The base of all panels: one frozen view in, rows out, and only those rows are drawn that look
other than before."""

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
# Where a text may be broken: between words, and between any two Chinese characters; but no row
# begins with these.
_TEXT_PIECES = re.compile(r"[ \t]+|[⺀-鿿　-〿＀-￯]|[^\s⺀-鿿　-〿＀-￯]+")
_NOT_FIRST = "，。；：、！？）」』】》"


class Picked(Message):
    """Reports a click on a line of a list."""

    def __init__(self, index: int) -> None:
        super().__init__()
        self.index = index


class DrawnWidget(Widget, Generic[View, Row]):
    """Shows `view` in rows; `redraws` counts how often there was another one to show."""

    ALLOW_SELECT = False
    can_focus = False
    DEFAULT_CLASSES = "panel"

    def __init__(self, view: View, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self.view, self._language = view, find_language_code()
        self.redraws = 0
        self._drawn: Sequence[Row] = ()
        self._drawn_for: object = None

    def show_view(self, view: View) -> None:
        """Take a new view; only rows of the screen that look other than before are touched."""
        if (view, find_language_code()) == (self.view, self._language):
            return
        self.view, self._language = view, find_language_code()
        self.redraws += 1
        if self._drawn_for is None or self._drawn_for != self._make_cache_key():
            self.refresh()
        elif changed := self._find_changed_rows():
            self.refresh(*(Region(0, row, self.content_size.width, 1) for row in changed))

    def refresh(
        self, *regions: Region, repaint: bool = True, layout: bool = False, recompose: bool = False
    ) -> Self:
        """Draw anew."""
        if not regions:
            self._drawn_for = None
        return super().refresh(*regions, repaint=repaint, layout=layout, recompose=recompose)

    def find_drawn_rows(self) -> Sequence[Row]:
        """The rows to be seen, made once for a view, a size and a theme."""
        if self._drawn_for is None or self._drawn_for != self._make_cache_key():
            width, height = self.content_size
            self._drawn, self._drawn_for = (
                self.draw_rows(self.view, width, height)[:height],
                self._make_cache_key(),
            )
        return self._drawn

    def draw_rows(self, view: View, width: int, height: int) -> Sequence[Row]:
        """The rows: of a panel each of exactly or less than `width` cells, of a canvas all `width`
        cells wide."""
        raise NotImplementedError

    def _find_changed_rows(self) -> list[int]:
        """Numbers of the rows that the view has changed."""
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
        return self.content_size, self.app.theme


class Panel(DrawnWidget[View, Content]):
    """Shows rows of text in styles by name."""

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Column and row of each thing that can be clicked, as it is drawn now."""
        return ((0, 0),) if hasattr(self, "on_click") else ()

    def render(self) -> Content:
        """All rows."""
        return Content("\n").join(self.find_drawn_rows())

    def render_line(self, y: int) -> Strip:
        """One row: Textual's own would lay out all rows anew for one that has changed."""
        rows = self.find_drawn_rows()
        laid = (
            Visual.to_strips(self, rows[y], self.size.width, 1, self.visual_style)
            if y < len(rows)
            else []
        )
        return laid[0] if laid else Strip.blank(self.size.width, self.visual_style.rich_style)


class PickList(Panel[View]):
    """Shows rows that stand for things: a click on one posts Picked with the number of its
    thing."""

    def list_row_items(self) -> Sequence[int | None]:
        """The number of each row's thing; None: a heading."""
        raise NotImplementedError

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        things = self.list_row_items()
        return tuple((0, things.index(one)) for one in dict.fromkeys(things) if one is not None)

    def on_click(self, event: events.Click) -> None:
        """Post the clicked thing."""
        event.stop()
        things = self.list_row_items()
        if 0 <= event.y < len(things) and (picked := things[event.y]) is not None:
            self.post_message(Picked(picked))


def make_line(*parts: TextPart) -> Content:
    """One row of texts and (text, style) pairs; empty texts may be given."""
    return Content.assemble(*parts)


def make_solid_parts(text: str, colour: str, off: str = "") -> list[TextPart]:
    """Parts of a drawing of blocks in one colour; full blocks also get it as background, so that no
    seams show.

    colour, off: theme variables of the blocks and of the gaps between them, e.g. "$target",
    "$track".
    """
    back = f" on {off}" if off else ""
    return [
        (run, f"{colour} on {colour}" if run[0] == "█" else f"{colour}{back}")
        for run in re.findall("█+|[^█]+", text)
    ]


def place_in_row(
    texts: Iterable[tuple[Key, str]], start: int = 0
) -> tuple[tuple[Key, str, int], ...]:
    """Things in a row one after the other, each with its text and its first cell."""
    found = []
    for what, text in texts:
        found.append((what, text, start))
        start += cell_len(text)
    return tuple(found)


def find_at_cell(row: Iterable[tuple[Key, str, int]], x: int) -> Key | None:
    """The thing of a row at this cell."""
    return next((what for what, text, start in row if start <= x < start + cell_len(text)), None)


def fit_width(text: str, width: int) -> str:
    """Exactly `width` cells: cut, or filled with spaces. A text that is cut ends in two points."""
    if width <= 0:
        return ""
    if cell_len(text) <= width:
        return set_cell_size(text, width)
    if width <= 3:
        return set_cell_size(text, width)
    return set_cell_size(text, width - 2) + ".."


def choose_fullest(forms: Iterable[str], width: int) -> str:
    """The first of the forms, the fullest one first, that has room; the last where none has."""
    form = ""
    for form in forms:
        if cell_len(form) <= width:
            break
    return form


def align_right(text: str, width: int) -> str:
    """Exactly `width` cells, flush right."""
    return (
        " " * max(0, width - cell_len(text)) + text
        if cell_len(text) <= width
        else fit_width(text, width)
    )


def spread_parts(left: list[TextPart], end: list[TextPart], width: int) -> Content:
    """One row with parts at its left and right ends; parts that do not fit are cut at the left
    parts' end."""

    def count_part_cells(parts: list[TextPart]) -> int:
        return sum(cell_len(part if isinstance(part, str) else part[0]) for part in parts)

    room = width - count_part_cells(end)
    kept: list[TextPart] = []
    for part in left:
        text, style = (part, "") if isinstance(part, str) else part
        have = room - count_part_cells(kept)
        if cell_len(text) > have:
            text = fit_width(text, have)
        kept.append((text, style) if style else text)
    gap = max(0, width - count_part_cells(kept) - count_part_cells(end))
    return make_line(*kept, " " * gap, *end)


def wrap_text(text: str, width: int) -> list[str]:
    """Rows of `text`, each at most `width` cells; a word that is longer is cut. No row begins with
    a full stop."""
    if width < 2:
        return []
    rows: list[list[str]] = [[]]
    for piece in _TEXT_PIECES.findall(text):
        row = rows[-1]
        if cell_len("".join(row) + piece.rstrip()) <= width:
            row.append(piece)
            continue
        carried = [row.pop()] if piece in _NOT_FIRST and len(row) > 1 else []
        *whole, rest = chop_cells("".join(carried) + piece.strip(), width) or [""]
        rows += [*([one] for one in whole), [rest]]
    return [line for line in ("".join(row).strip() for row in rows) if line]
