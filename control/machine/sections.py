"""Which outlets open and close together? This module defines the sections of a machine.

One roller meters for all outlets; the open outlets share its mass evenly. A section's valve is at
the start of its tubes, so that material behind the valve falls for a whole drop time. With every
valve closed nothing flows: the material on the roller returns to the hopper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import Field
from topdress.control.frozen_model import FrozenModel

# Maximum number of sections: relays of a rate module, and bits of a board's command.
MAX_SECTIONS = 16


class Valve(FrozenModel):
    """Holds the delays of a valve, which opens and closes instantly after its delay. Without
    power the valve closes."""

    open_s: Annotated[float, Field(ge=0, le=2)] = 0.0
    close_s: Annotated[float, Field(ge=0, le=2)] = 0.0


class Section(FrozenModel):
    """Holds the outlets of a section; its width is their share of the working width."""

    outlets: Annotated[int, Field(ge=1, le=100)] = 1
    valve: Valve | None = None


class SectionStrip(NamedTuple):
    """Holds the strip of ground under one section: its edges to the right of the machine's
    middle, m, and its share of the working width."""

    left_m: float
    right_m: float
    share: float


def make_section_strips(sections: Sequence[Section], width_m: float) -> tuple[SectionStrip, ...]:
    """Returns the strips of sections from left to right over the working width."""
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
    """Follows the valves through a log's column `sections_cmd`, row by row; all valves are open
    where the column is empty."""

    def __init__(self, sections: Sequence[Section]) -> None:
        self._valves = [section.valve or Valve() for section in sections]
        self._shares = [strip.share for strip in make_section_strips(sections, 1.0)]
        self._commanded: list[bool] = [False] * len(self._valves)
        # Each entry is the time of a command and its position.
        self._turns: list[tuple[float, bool]] = [(0.0, False)] * len(self._valves)

    def find_open_valves(self, time_s: float, commanded: str | None) -> tuple[bool, ...]:
        """Returns the valves' positions at a row with this command; times must increase."""
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

    def calc_open_share(self, opened: Sequence[bool]) -> float:
        """Returns the open share of the working width."""
        return sum(share for share, on in zip(self._shares, opened, strict=True) if on)


def find_section_fault(sections: Sequence[Section], outlets: int) -> str:
    """Returns the fault of the sections of a machine with this number of outlets, as the allowed
    values; "" for none."""
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
