"""The 11 grades of paper A, section 2.1 (5): ten steps of NDVI and the zero grade.

The paper's text gives a step of 0.5; its own example ((0.25, 0.3] is one grade) says 0.05.
"""
from __future__ import annotations

import math
from typing import NamedTuple

_EDGE = 1e-9   # NDVI this close above an edge still belongs to the grade below


class Graded(NamedTuple):
    """`grade` 0 is the zero grade; `ndvi` is the upper edge whose rate the grade takes (None in the zero grade)."""

    grade: int
    ndvi: float | None


def graded_ndvi(ndvi: float, low: float = 0.25, high: float = 0.75, width: float = 0.05) -> Graded:
    """The grade of an NDVI: (low, low + width] is grade 1, and so on up to `high`; elsewhere grade 0.

    Raises ValueError for a width that is not positive. Source: paper A, section 2.1 (5).
    """
    if width <= 0.0:
        raise ValueError(f"grade width {width:g}: allowed is above 0")
    if not low + _EDGE < ndvi <= high + _EDGE:
        return Graded(0, None)
    grade = math.ceil((ndvi - low) / width - _EDGE / width)
    return Graded(grade, min(low + grade * width, high))


def grade_edges(low: float = 0.25, high: float = 0.75, width: float = 0.05) -> tuple[float, ...]:
    """Upper edges of grades 1, 2, ..., rounded to 1e-9: ten for the paper's values."""
    return tuple(round(low + k * width, 9) for k in range(1, round((high - low) / width) + 1))
