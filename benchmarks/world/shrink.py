"""Which events of a broken day are needed? Events are taken away, and numbers made plain, as long
as the same promise breaks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from world.plan import Day
from world.run import run_day


def breaks_as_before(promise: str) -> Callable[[Day], bool]:
    """Returns a function that tells whether a day breaks this promise."""
    return lambda day: run_day(day).broken.partition(":")[0] == promise


def shrink_day(day: Day, breaks: Callable[[Day], bool]) -> Day:
    """Returns a smaller day that still breaks.

    Parameters
    ----------
    day : breaks.
    breaks : runs a day and returns whether it breaks in the same way.
    """
    day = remove_events(day, breaks)
    for smaller in list_plainer_days(day):
        if breaks(smaller):
            day = smaller
    return remove_events(day, breaks)


def remove_events(day: Day, breaks: Callable[[Day], bool]) -> Day:
    """Returns the day with as few events as single steps reach: halves first, then fewer."""
    size = max(1, len(day.events) // 2)
    while size >= 1:
        place = 0
        while place < len(day.events):
            fewer = day._replace(events=day.events[:place] + day.events[place + size :])
            if breaks(fewer):
                day = fewer
            else:
                place += size
        size = 0 if size == 1 else size // 2
    return day


def list_plainer_days(day: Day) -> Iterator[Day]:
    """Yields the day with one setting at a time made plain."""
    for name, plain in (("slope_deg", 0.0), ("wind_kg", 0.0), ("roughness_deg", 0.5)):
        if day.simulated.get(name) != plain:
            yield day._replace(simulated=day.simulated | {name: plain})
    if day.hz != 10.0:
        yield day._replace(hz=10.0)
    for number, event in enumerate(day.events):
        if event.lasts_s > 2.0:
            half = event._replace(lasts_s=round(event.lasts_s / 2.0, 3))
            yield day._replace(events=(*day.events[:number], half, *day.events[number + 1 :]))
