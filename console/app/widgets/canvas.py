"""The base of drawn panels: whole rows of segments, painted once per view, size and theme, then served by row."""
from __future__ import annotations

from typing import Generic, TypeVar

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget

from console.locale import in_use

V = TypeVar("V")


class Canvas(Widget, Generic[V]):
    ALLOW_SELECT = False
    can_focus = False
    DEFAULT_CLASSES = "panel"

    def __init__(self, view: V, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self.view, self._language = view, in_use()
        self.redraws = 0
        self._painted: list[Strip] = []
        self._painted_for: object = None

    def places(self) -> tuple[tuple[int, int], ...]:
        """Column and row of everything in it that has one place to be clicked at."""
        return ()

    def show(self, view: V) -> None:
        if (view, in_use()) != (self.view, self._language):
            self.view, self._language = view, in_use()
            self.redraws += 1
            self._painted_for = None
            self.refresh()

    def repaint(self) -> None:
        """Paint again although the view is the same: another language, another theme."""
        self._painted_for = None
        self.refresh()

    def notify_style_update(self) -> None:
        super().notify_style_update()
        self._painted_for = None

    def render_line(self, y: int) -> Strip:
        width, height = self.content_size
        wanted = (width, height, self.app.theme)
        if self._painted_for != wanted:
            self._painted = self.paint(self.view, width, height)
            self._painted_for = wanted
        return self._painted[y] if y < len(self._painted) else Strip.blank(width, self.rich_style)

    def paint(self, view: V, width: int, height: int) -> list[Strip]:
        """All rows, each `width` cells wide."""
        raise NotImplementedError

    def style(self, name: str) -> Style:
        return self.get_component_rich_style(name)

    def text_strip(self, width: int, *parts: tuple[str, Style]) -> Strip:
        """A row of texts, cut or filled to `width`."""
        return Strip([Segment(text, style) for text, style in parts]).adjust_cell_length(width, self.rich_style)
