"""The table of truth of a season: what is wrong with which machine when, who drives it and what
it spreads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

MACHINES, DAYS = 20, 50
WEAK, WEAK_DAYS = "m15", 30
# always the same work: the effect has the same z in each log
WEAK_PROGRAMME = "stairs_speed"
PRODUCTS, OTHER_PRODUCT, OTHER_FLOW = ("urea", "compound"), "compound", 5.0
OPERATORS = ("王强", "Li, Ming", "Zhao", "Sun", "O'Brien")


class Planted(NamedTuple):
    """A straight course of one effect, in the catalogue's units, on days `first` to `last`."""

    machine: str
    effect: str
    first: int
    last: int
    begin: float
    end: float
    member: int | None = None

    def at(self, day: int) -> float:
        if not self.first <= day <= self.last:
            return 0.0
        return self.begin + (self.end - self.begin) * (day - self.first) / max(
            self.last - self.first, 1
        )

    @property
    def name(self) -> str:
        """As a season calls it."""
        return self.effect if self.member is None else f"{self.effect}#{self.member}"

    @property
    def per_day(self) -> float:
        return (self.end - self.begin) / max(self.last - self.first, 1)

    @property
    def wears(self) -> bool:
        return abs(self.end) > abs(self.begin)

    @property
    def repaired(self) -> bool:
        return self.last < DAYS - 1


PLANTED = (
    Planted("m03", "flow.fill_falloff", 0, 49, 0.0, 15.0),
    Planted("m05", "speed.wheel_radius", 0, 49, 0.0, -2.0),
    Planted("m07", "flow.fill_falloff", 0, 49, 4.0, 16.0),
    Planted("m08", "flow.gain", 0, 49, -6.0, -6.0),
    Planted("m09", "gate.home_error", 0, 24, 0.6, 0.6),
    Planted("m11", "flow.fill_falloff", 0, 29, 0.0, 12.0),
    Planted("m13", "canopy.head_fouled", 0, 34, 0.0, -8.0, member=3),
    Planted("m14", "shaft.gain", 20, 49, 1.0, 1.0),
    Planted(WEAK, "shaft.load_droop", 0, WEAK_DAYS - 1, 0.52, 0.52),
)


class Day(NamedTuple):
    """One machine on one day. effects: (id, size, member)."""

    machine: str
    number: int
    day: int
    product: str
    operator: str
    field: str
    effects: tuple[tuple[str, float, int | None], ...]


def days(machines: int = MACHINES, count: int = DAYS) -> Iterator[Day]:
    """Every day of every machine, day by day."""
    for day in range(count):
        for number in range(machines):
            name = f"m{number:02d}"
            product = PRODUCTS[(day // 8 + number) % 3 == 0]
            effects = [
                (one.effect, one.at(day), one.member) for one in PLANTED if one.machine == name
            ]
            if product == OTHER_PRODUCT:
                effects.append(("flow.gain", OTHER_FLOW, None))
            yield Day(
                name,
                number,
                day,
                product,
                OPERATORS[(day // 2 + number) % len(OPERATORS)],
                f"field {number // 4}-{day // 10}",
                tuple(one for one in effects if one[1]),
            )
