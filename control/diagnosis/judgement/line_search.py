"""Searches a maximum in one dimension in decreasing steps.

The search needs no slope: thresholds, delays and times make the likelihood jump between two rows of
a log (pattern search: Hooke and Jeeves, Journal of the ACM 8, 1961, 212).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

T = TypeVar("T")


def climb_to_best(
    here: T,
    worth: Callable[[T], float],
    near: Callable[[T, float], Iterable[T]],
    steps: Iterable[float],
    again: bool = True,
) -> T:
    """Return the best point that the search reaches from `here`.

    near(place, step) : trial points around a point. again : whether a step is repeated as long as
    it gains.
    """
    most = worth(here)
    for step in steps:
        moved = True
        while moved:
            moved = False
            for tried in near(here, step):
                if (gained := worth(tried)) > most:
                    here, most, moved = tried, gained, again
    return here
