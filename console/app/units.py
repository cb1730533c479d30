"""Converts SI values to displayed units: km/h and kg/ha, or mph and lb/ac. No other module does
so.
"""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.signals import Signal

# 1 ha = 10,000 m2.
M2_PER_HA = 10_000.0
# Distance from which the long unit is used, m: 10 km, or half a mile because nobody pictures 2640
# ft.
MIN_LONG_WAY_M = {"metric": 10_000.0, "imperial": 0.5 * 1609.344}


class Unit(NamedTuple):
    """Converts to a displayed unit: displayed value = SI value x per_si."""

    name: str
    per_si: float
    decimals: int

    def format_value(self, value: float | None, none: str = "--") -> str:
        """Return the number alone in this unit; `none` for an unknown value."""
        if value is None:
            return none
        # Adding 0.0 turns a rounded -0.0 into 0.0.
        shown = round(value * self.per_si, self.decimals) + 0.0
        return f"{shown:.{self.decimals}f}"

    def format_with_name(self, value: float | None) -> str:
        """Return the number with the unit's name."""
        return f"{self.format_value(value)} {self.name}"

    def convert_to_si(self, shown: float) -> float:
        """Return the SI value of a displayed number."""
        return shown / self.per_si


class Units(NamedTuple):
    """Holds every displayed unit. Internally rates are kg/ha and areas ha; other values are SI,
    with mm and r/min as in the log."""

    id: str
    # Internal unit: m/s.
    speed: Unit
    # Internal unit: kg/ha.
    rate: Unit
    # Internal unit: kg.
    mass: Unit
    # Internal unit: ha.
    area: Unit
    # Internal unit: m.
    distance: Unit
    fine_distance: Unit
    # Internal unit: mm.
    opening: Unit
    # Internal unit: r/min.
    shaft: Unit
    # Internal unit: s.
    time: Unit
    # Internal unit: V.
    voltage: Unit
    # Internal unit: m, for long distances.
    far: Unit

    def choose_way_unit(self, metres: float | None) -> Unit:
        """Return the unit of a distance over ground: metres up to 10 km, feet up to half a mile,
        above that km or miles."""
        return (
            self.far
            if metres is not None and abs(metres) >= MIN_LONG_WAY_M[self.id]
            else self.distance
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

# Exact by the international yard and pound agreement: 1 lb = 0.45359237 kg, 1 ac = 4046.8564224 m2,
# 1 ft = 0.3048 m, 1 mile = 1609.344 m.
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

# The ids are values of the settings file.
UNITS = {units.id: units for units in (METRIC, IMPERIAL)}


def choose_unit(signal: Signal, units: Units) -> Unit:
    """Return the unit in which a declared number is shown, one of the units in use or its own."""
    decimals = signal.shown_decimals
    if not signal.shown_as:
        return Unit("°" if signal.unit == "deg" else signal.unit, 1.0, decimals or 0)
    unit: Unit = getattr(units, signal.shown_as)
    return unit if decimals is None else unit._replace(decimals=decimals)
