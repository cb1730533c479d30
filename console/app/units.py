"""The one place where SI becomes what people read: km/h and kg/ha, or mph and lb/ac."""

from __future__ import annotations

from typing import NamedTuple

M2_PER_HA = 10_000.0
# 10 km; half a mile: 2640 ft is a number nobody pictures
FAR_WAY_M = {"metric": 10_000.0, "imperial": 0.5 * 1609.344}


class Unit(NamedTuple):
    """Converts to a unit that people read: shown = SI value x per_si."""

    name: str
    per_si: float
    decimals: int

    def format_value(self, value: float | None, none: str = "--") -> str:
        """The number alone, in this unit; `none` when it is not known."""
        if value is None:
            return none
        shown = round(value * self.per_si, self.decimals) + 0.0  # + 0.0: no "-0.0"
        return f"{shown:.{self.decimals}f}"

    def format_with_name(self, value: float | None) -> str:
        """The number with the unit's name."""
        return f"{self.format_value(value)} {self.name}"

    def convert_to_si(self, shown: float) -> float:
        """The SI value of a shown number."""
        return shown / self.per_si


class Units(NamedTuple):
    """Holds every unit shown. Rates are kg/ha inside, areas ha, the rest SI with mm and r/min as in
    the log."""

    id: str
    speed: Unit  # m/s
    rate: Unit  # kg/ha
    mass: Unit  # kg
    area: Unit  # ha
    distance: Unit  # m
    fine_distance: Unit
    opening: Unit  # mm
    shaft: Unit  # r/min
    time: Unit  # s
    voltage: Unit  # V
    far: Unit  # m, of a way that is long

    def choose_way_unit(self, metres: float | None) -> Unit:
        """The unit of a way or a distance over ground: feet up to half a mile, then miles; metres
        up to 10 km."""
        return (
            self.far if metres is not None and abs(metres) >= FAR_WAY_M[self.id] else self.distance
        )


METRIC = Units(
    "metric",
    Unit("km/h", 3.6, 1),
    Unit("kg/ha", 1.0, 0),
    Unit("kg", 1.0, 0),
    Unit("ha", 1.0, 2),
    Unit("m", 1.0, 0),
    Unit("m", 1.0, 1),
    Unit("mm", 1.0, 1),
    Unit("r/min", 1.0, 1),
    Unit("s", 1.0, 2),
    Unit("V", 1.0, 1),
    Unit("km", 0.001, 1),
)

# 1 lb = 0.45359237 kg, 1 ac = 4046.8564224 m2, 1 ft = 0.3048 m, 1 mile = 1609.344 m
# (international yard and pound)
IMPERIAL = Units(
    "imperial",
    Unit("mph", 3600 / 1609.344, 1),
    Unit("lb/ac", 4046.8564224 / 10_000 / 0.45359237, 0),
    Unit("lb", 1 / 0.45359237, 0),
    Unit("ac", 10_000 / 4046.8564224, 2),
    Unit("ft", 1 / 0.3048, 0),
    Unit("ft", 1 / 0.3048, 1),
    Unit("mm", 1.0, 1),
    Unit("r/min", 1.0, 1),
    Unit("s", 1.0, 2),
    Unit("V", 1.0, 1),
    Unit("mi", 1 / 1609.344, 2),
)

UNITS = {units.id: units for units in (METRIC, IMPERIAL)}
