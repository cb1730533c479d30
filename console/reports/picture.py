"""A picture of a report: its SVG text and what stands below it."""
from __future__ import annotations

from typing import NamedTuple


class Picture(NamedTuple):
    svg: str
    caption: str            # plain text, not escaped
