"""Defines the base class of drawn panels: rows of segments, painted once per view, size and theme,
then served by row.
"""

from __future__ import annotations

from typing import TypeVar

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from topdress.console.app.widgets.base_panel import DrawnWidget

View = TypeVar("View")


class Canvas(DrawnWidget[View, Strip]):
    """Draws strips of cells."""

    def list_click_places(self) -> tuple[tuple[int, int], ...]:
        """Return column and row of each clickable cell."""
        return ()

    def notify_style_update(self) -> None:
        """Draw again after a change of styles."""
        super().notify_style_update()
        self._drawn_for = None

    def render_line(self, y: int) -> Strip:
        """Return one row that was drawn before."""
        rows = self.find_drawn_rows()
        return rows[y] if y < len(rows) else Strip.blank(self.content_size.width, self.rich_style)

    def find_style(self, name: str) -> Style:
        """Return the style of a component of the style sheet."""
        return self.get_component_rich_style(name)

    def make_text_strip(self, width: int, *parts: tuple[str, Style]) -> Strip:
        """Return a row of texts, cut or filled to `width`."""
        return Strip([Segment(text, style) for text, style in parts]).adjust_cell_length(
            width, self.rich_style
        )
