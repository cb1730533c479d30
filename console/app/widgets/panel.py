"""The base of all panels: one frozen view in, lines out, and no drawing while the view stays the same."""
from __future__ import annotations

import re
from collections.abc import Iterable
from typing import ClassVar, Generic, TypeVar

from rich.cells import cell_len, chop_cells, set_cell_size
from textual.content import Content
from textual.message import Message
from textual.widget import Widget

from console.locale import in_use

V = TypeVar("V")
K = TypeVar("K")
Part = str | tuple[str, str]
# Where a text may be broken: between words, and between any two Chinese characters; but no row begins with these.
_PIECES = re.compile(r"[ \t]+|[⺀-鿿　-〿＀-￯]|[^\s⺀-鿿　-〿＀-￯]+")
_NOT_FIRST = "，。；：、！？）」』】》"


class Picked(Message):
    """A line of a list was clicked."""

    def __init__(self, index: int) -> None:
        super().__init__()
        self.index = index


class Panel(Widget, Generic[V]):
    """Shows `view`; `redraws` counts how often that was asked of the screen."""

    ALLOW_SELECT = False
    can_focus = False
    DEFAULT_CLASSES = "panel"
    COMPONENT_CLASSES: ClassVar[set[str]] = set()

    def __init__(self, view: V, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self.view, self._language = view, in_use()
        self.redraws = 0

    def show(self, view: V) -> None:
        """Take a new view; the screen is touched only when it differs from the old one, or in another language."""
        if (view, in_use()) != (self.view, self._language):
            self.view, self._language = view, in_use()
            self.redraws += 1
            self.refresh()

    def places(self) -> tuple[tuple[int, int], ...]:
        """Column and row of everything in it that can be clicked, as it is drawn now."""
        return ((0, 0),) if hasattr(self, "on_click") else ()

    def render(self) -> Content:
        width, height = self.content_size
        lines = self.lines(self.view, width, height)[:height]
        return Content("\n").join(lines)

    def lines(self, view: V, width: int, height: int) -> list[Content]:
        """The panel's rows, each of exactly or less than `width` cells."""
        raise NotImplementedError


def line(*parts: Part) -> Content:
    """One row of texts and (text, style) pairs; empty texts may be given."""
    return Content.assemble(*parts)


def solid(text: str, colour: str, off: str = "") -> list[Part]:
    """Parts of a drawing of blocks in one colour; full blocks also get it as background, so that no seams show.

    colour, off: theme variables of the blocks and of what lies between them, e.g. "$target", "$track".
    """
    back = f" on {off}" if off else ""
    return [(run, f"{colour} on {colour}" if run[0] == "█" else f"{colour}{back}")
            for run in re.findall("█+|[^█]+", text)]


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


def fullest(forms: Iterable[str], width: int) -> str:
    """The first of the forms, the fullest one first, that has room; the last where none has."""
    form = ""
    for form in forms:
        if cell_len(form) <= width:
            break
    return form


def right(text: str, width: int) -> str:
    """Exactly `width` cells, flush right."""
    return " " * max(0, width - cell_len(text)) + text if cell_len(text) <= width else fit(text, width)


def spread(left: list[Part], end: list[Part], width: int) -> Content:
    """One row with parts at its left and right ends; what does not fit is lost from the left parts' end."""
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
    """Rows of `text`, each at most `width` cells; a word that is longer is cut. No row begins with a full stop."""
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
