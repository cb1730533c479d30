"""Removes terminal control characters from every line before it is drawn, whatever the source of
its text.
"""

from __future__ import annotations

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter
from topdress.drivers.plain_text import remove_control_characters


class ControlCharacterFilter(LineFilter):
    """Filters every line that is drawn. The removed characters have no width, so no line becomes
    shorter."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Remove characters that control the terminal."""
        # Nearly every line is clean, so it is returned without a copy.
        if all(segment.control or segment.text.isprintable() for segment in segments):
            return segments
        return [
            segment
            if segment.control
            else Segment(remove_control_characters(segment.text), segment.style)
            for segment in segments
        ]
