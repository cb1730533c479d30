"""The last gate before the screen: no text, wherever it came from, steers the terminal."""

from __future__ import annotations

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter
from topdress.drivers.plain_text import remove_steering


class PlainLines(LineFilter):
    """Filters every line that is drawn. The signs that it removes have no width, so that no line
    becomes shorter."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Remove signs that steer the terminal."""
        if all(segment.control or segment.text.isprintable() for segment in segments):
            return segments
        return [
            segment if segment.control else Segment(remove_steering(segment.text), segment.style)
            for segment in segments
        ]
