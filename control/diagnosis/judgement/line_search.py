"""The one search in one dimension: to where something is worth most, in ever smaller steps.

For what has no slope: thresholds, delays and times leap between two rows of a log (pattern
search: Hooke and Jeeves, Journal of the ACM 8, 1961, 212).
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
    """The best place that is reached from `here`. near(place, step) : what is tried from one.
    again : a step is taken as long as it gains, else once."""
    most = worth(here)
    for step in steps:
        moved = True
        while moved:
            moved = False
            for tried in near(here, step):
                if (gained := worth(tried)) > most:
                    here, most, moved = tried, gained, again
    return here
