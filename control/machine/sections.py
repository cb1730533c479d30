"""Sections: outlets side by side that are opened and closed together.

One roller meters for all outlets; what it gives is shared evenly by those that are open. A
section's valve stands where its tubes begin, so what has passed it falls on for a whole drop
time. With every valve closed nothing flows: what the roller carries round goes back to the
hopper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import Field
from topdress.control.frozen_model import FrozenModel

# as many relays as a rate module has, and bits a board's command
MOST_SECTIONS = 16


class Valve(FrozenModel):
    """Opens and closes at once, so long after its command. Without power it closes."""

    open_s: Annotated[float, Field(ge=0, le=2)] = 0.0
    close_s: Annotated[float, Field(ge=0, le=2)] = 0.0


class Section(FrozenModel):
    """So many outlets, as wide as their share of the working width."""

    outlets: Annotated[int, Field(ge=1, le=100)] = 1
    valve: Valve | None = None


class SectionStrip(NamedTuple):
    """Ground under one section: how far its edges lie to the right of the machine's middle, m;
    its share of the working width."""

    left_m: float
    right_m: float
    share: float


def strips(sections: Sequence[Section], width_m: float) -> tuple[SectionStrip, ...]:
    """Strips of sections from left to right over the working width."""
    outlets = sum(section.outlets for section in sections)
    found, before = [], 0
    for section in sections:
        after = before + section.outlets
        found.append(
            SectionStrip(
                width_m * before / outlets - 0.5 * width_m,
                width_m * after / outlets - 0.5 * width_m,
                section.outlets / outlets,
            )
        )
        before = after
    return tuple(found)


class LoggedValves:
    """Valves as a log's column `sections_cmd` tells of them, row by row; all open where it
    tells nothing."""

    def __init__(self, sections: Sequence[Section]) -> None:
        self._valves = [section.valve or Valve() for section in sections]
        self._shares = [strip.share for strip in strips(sections, 1.0)]
        self._commanded: list[bool] = [False] * len(self._valves)
        # from when, to what
        self._turns: list[tuple[float, bool]] = [(0.0, False)] * len(self._valves)

    def open_at(self, time_s: float, commanded: str | None) -> tuple[bool, ...]:
        """How they stand at a row that tells this; times rise."""
        cells = (commanded or "").split(";")
        if len(cells) != len(self._valves):
            return (True,) * len(self._valves)
        found = []
        for k, (valve, cell) in enumerate(zip(self._valves, cells, strict=True)):
            on = cell == "1"
            if on is not self._commanded[k]:
                self._commanded[k], self._turns[k] = (
                    on,
                    (time_s + (valve.open_s if on else valve.close_s), on),
                )
            from_s, to = self._turns[k]
            found.append(to if time_s >= from_s - 1e-6 else not to)
        return tuple(found)

    def share(self, opened: Sequence[bool]) -> float:
        """Of the working width."""
        return sum(share for share, on in zip(self._shares, opened, strict=True) if on)


def trouble_of(sections: Sequence[Section], outlets: int) -> str:
    """What is wrong with the sections of a machine with so many outlets, as what is allowed;
    empty: nothing."""
    if not sections:
        return ""
    there = sum(section.outlets for section in sections)
    if there != outlets:
        return (
            f"allowed sections whose outlets add up to geometry.outlets, {outlets}; found {there}"
        )
    if len({section.valve is None for section in sections}) > 1:
        return "allowed a valve in every section, or in none"
    return ""
