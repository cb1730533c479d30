"""The base of drawn panels: whole rows of segments, painted once per view, size and theme, then
served by row."""

from __future__ import annotations

from typing import TypeVar

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from topdress.console.app.widgets.panel import Drawn

V = TypeVar("V")


class Canvas(Drawn[V, Strip]):
    def places(self) -> tuple[tuple[int, int], ...]:
        """Column and row of everything in it that has one place to be clicked at."""
        return ()

    def notify_style_update(self) -> None:
        super().notify_style_update()
        self._drawn_for = None

    def render_line(self, y: int) -> Strip:
        rows = self.drawn()
        return rows[y] if y < len(rows) else Strip.blank(self.content_size.width, self.rich_style)

    def style(self, name: str) -> Style:
        return self.get_component_rich_style(name)

    def text_strip(self, width: int, *parts: tuple[str, Style]) -> Strip:
        """A row of texts, cut or filled to `width`."""
        return Strip([Segment(text, style) for text, style in parts]).adjust_cell_length(
            width, self.rich_style
        )
