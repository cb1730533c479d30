"""The best of several, some of which may be equal but for the last bits of their arithmetic.

Two names may stand for the same column of a table: a constant extra lag and a dead time that one table alone has. Their
scores are then equal, and the last bits, which differ from one processor to another, would choose between them.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .piece import Array

# Scores within this share of one another are equal. Rounding leaves some 1e-12 of a sum over a table's rows; two causes
# that differ are not told apart by a millionth of their sum of squares.
TIED = 1e-6


def first_best(scores: Sequence[float] | Array) -> int:
    """Index of the highest score (n,), of equal ones the first: the order given decides, not rounding."""
    values = np.asarray(scores, np.float64)
    highest = float(values.max())
    least = highest - TIED * abs(highest) if np.isfinite(highest) else highest
    return int(np.flatnonzero(values >= least)[0])


def best_first(scores: Sequence[float] | Array) -> list[int]:
    """Indices of the scores (n,) from the highest down, equal ones in the order given."""
    values = np.asarray(scores, np.float64)
    left = list(range(len(values)))
    out = []
    while left:
        out.append(left.pop(first_best(values[left])))
    return out
