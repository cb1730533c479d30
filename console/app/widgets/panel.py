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

V = TypeVar("V")
R = TypeVar("R")
K = TypeVar("K")
Part = str | tuple[str, str]
# Where a text may be broken: between words, and between any two Chinese characters; but no row
# begins with these.
_PIECES = re.compile(r"[ \t]+|[⺀-鿿　-〿＀-￯]|[^\s⺀-鿿　-〿＀-￯]+")
_NOT_FIRST = "，。；：、！？）」』】》"


class Picked(Message):
    """A line of a list was clicked."""

    def __init__(self, index: int) -> None:
        super().__init__()
        self.index = index


class Drawn(Widget, Generic[V, R]):
    """Shows `view` in rows; `redraws` counts how often there was another one to show."""

    ALLOW_SELECT = False
    can_focus = False
    DEFAULT_CLASSES = "panel"

    def __init__(self, view: V, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self.view, self._language = view, find_language_code()
        self.redraws = 0
        self._drawn: Sequence[R] = ()
        self._drawn_for: object = None

    def show(self, view: V) -> None:
        """Take a new view; of the screen those rows are touched that look other than before."""
        if (view, find_language_code()) == (self.view, self._language):
            return
        self.view, self._language = view, find_language_code()
        self.redraws += 1
        if self._drawn_for is None or self._drawn_for != self._wanted():
            self.refresh()
        elif changed := self._changed():
            self.refresh(*(Region(0, row, self.content_size.width, 1) for row in changed))

    def refresh(
        self, *regions: Region, repaint: bool = True, layout: bool = False, recompose: bool = False
    ) -> Self:
        if not regions:
            self._drawn_for = None
        return super().refresh(*regions, repaint=repaint, layout=layout, recompose=recompose)

    def drawn(self) -> Sequence[R]:
        """What is to be seen, made once for a view, a size and a theme."""
        if self._drawn_for is None or self._drawn_for != self._wanted():
            width, height = self.content_size
            self._drawn, self._drawn_for = (
                self.lines(self.view, width, height)[:height],
                self._wanted(),
            )
        return self._drawn

    def lines(self, view: V, width: int, height: int) -> Sequence[R]:
        """The rows: of a panel each of exactly or less than `width` cells, of a canvas all
        `width` cells wide."""
        raise NotImplementedError

    def _changed(self) -> list[int]:
        """Numbers of the rows that the view has made other than they were."""
        before, self._drawn_for = self._drawn, None
        return [
            row
            for row, (old, new) in enumerate(zip_longest(before, self.drawn()))
            if not (
                old.is_same(new)
                if isinstance(old, Content) and isinstance(new, Content)
                else old == new
            )
        ]

    def _wanted(self) -> object:
        return self.content_size, self.app.theme


class Panel(Drawn[V, Content]):
    """Rows of text in styles by name."""

    def places(self) -> tuple[tuple[int, int], ...]:
        """Column and row of everything in it that can be clicked, as it is drawn now."""
        return ((0, 0),) if hasattr(self, "on_click") else ()

    def render(self) -> Content:
        return Content("\n").join(self.drawn())

    def render_line(self, y: int) -> Strip:
        """Textual's own would lay out all rows anew for one that is other than before."""
        rows = self.drawn()
        laid = (
            Visual.to_strips(self, rows[y], self.size.width, 1, self.visual_style)
            if y < len(rows)
            else []
        )
        return laid[0] if laid else Strip.blank(self.size.width, self.visual_style.rich_style)


class PickList(Panel[V]):
    """Rows that stand for things: a click on one posts Picked with the number of its thing."""

    def things(self) -> Sequence[int | None]:
        """What each row stands for; None: a heading."""
        raise NotImplementedError

    def places(self) -> tuple[tuple[int, int], ...]:
        things = self.things()
        return tuple((0, things.index(one)) for one in dict.fromkeys(things) if one is not None)

    def on_click(self, event: events.Click) -> None:
        event.stop()
        things = self.things()
        if 0 <= event.y < len(things) and (picked := things[event.y]) is not None:
            self.post_message(Picked(picked))


def line(*parts: Part) -> Content:
    """One row of texts and (text, style) pairs; empty texts may be given."""
    return Content.assemble(*parts)


def solid(text: str, colour: str, off: str = "") -> list[Part]:
    """Parts of a drawing of blocks in one colour; full blocks also get it as background, so
    that no seams show.

    colour, off: theme variables of the blocks and of what lies between them, e.g. "$target",
    "$track".
    """
    back = f" on {off}" if off else ""
    return [
        (run, f"{colour} on {colour}" if run[0] == "█" else f"{colour}{back}")
        for run in re.findall("█+|[^█]+", text)
    ]


def in_row(texts: Iterable[tuple[K, str]], start: int = 0) -> tuple[tuple[K, str, int], ...]:
    """What stands in a row one after the other, each with its text and its first cell."""
    found = []
    for what, text in texts:
        found.append((what, text, start))
        start += cell_len(text)
    return tuple(found)


def at_cell(row: Iterable[tuple[K, str, int]], x: int) -> K | None:
    """What of a row stands at this cell."""
    return next((what for what, text, start in row if start <= x < start + cell_len(text)), None)


def fit(text: str, width: int) -> str:
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


def right(text: str, width: int) -> str:
    """Exactly `width` cells, flush right."""
    return (
        " " * max(0, width - cell_len(text)) + text if cell_len(text) <= width else fit(text, width)
    )


def spread(left: list[Part], end: list[Part], width: int) -> Content:
    """One row with parts at its left and right ends; what does not fit is lost from the left
    parts' end."""

    def cells(parts: list[Part]) -> int:
        return sum(cell_len(part if isinstance(part, str) else part[0]) for part in parts)

    room = width - cells(end)
    kept: list[Part] = []
    for part in left:
        text, style = (part, "") if isinstance(part, str) else part
        have = room - cells(kept)
        if cell_len(text) > have:
            text = fit(text, have)
        kept.append((text, style) if style else text)
    gap = max(0, width - cells(kept) - cells(end))
    return line(*kept, " " * gap, *end)


def wrapped(text: str, width: int) -> list[str]:
    """Rows of `text`, each at most `width` cells; a word that is longer is cut. No row begins
    with a full stop."""
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
