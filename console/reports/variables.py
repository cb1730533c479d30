"""Recorded variables and settings in plain words, with their units."""
from __future__ import annotations

from typing import NamedTuple

from console.locale import N_, _


class Variable(NamedTuple):
    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """For an axis, in the language in use."""
        return f"{_(self.name)}, {_(self.unit)}" if self.unit else _(self.name)


OF_RUNS = {
    "shaft_rpm": Variable(N_("shaft speed commanded"), "r/min"), "opening_mm": Variable(N_("opening commanded"), "mm"),
    "supply_v": Variable(N_("supply"), "V"), "pitch_deg": Variable(N_("pitch"), N_("degrees nose up")),
    "roll_deg": Variable(N_("roll"), N_("degrees right side down")), "hopper_kg": Variable(N_("hopper"), "kg"),
    "speed_mps": Variable(N_("ground speed"), "m/s"), "heading_deg": Variable(N_("heading"), N_("degrees")),
    "time_s": Variable(N_("time"), "min"), "gain_of_speed": Variable(N_("acceleration"), "m/s per s"),
    "ndvi": Variable(N_("NDVI, mean of all heads")), "way": Variable(N_("last change of the command")),
    "moved": Variable(N_("distance moved so far"), "mm"), "working": Variable(N_("out of work / in work")),
    "since_change": Variable(N_("seconds since the command changed"))}
OF_TABLES = {
    "shaft_rpm": Variable(N_("shaft speed"), "r/min"), "opening_mm": Variable(N_("opening"), "mm"),
    "duration_s": Variable(N_("duration"), "s"), "speed_mps": Variable(N_("ground speed"), "m/s"),
    "target_kg": Variable(N_("target"), "kg"), "area_m2": Variable(N_("area"), "m2"), "outlet": Variable(N_("outlet")),
    "ndvi": Variable(N_("NDVI")),
    "ndvi_reference": Variable(N_("NDVI of the reference")), "head": Variable(N_("head")),
    "warm_min": Variable(N_("minutes since switched on")), "height_m": Variable(N_("height"), "m"),
    "corrected_lag_s": Variable(N_("lag corrected for"), "s"),
    "before_rpm": Variable(N_("shaft speed before"), "r/min"), "replicate": Variable(N_("replicate")),
    "label": Variable(N_("label")), "constant": Variable(N_("a constant"))}


def recorded(name: str, kind: str = "run") -> Variable:
    """The variable of a run log, or of a table; by its own name where it is not known."""
    first, second = (OF_RUNS, OF_TABLES) if kind == "run" else (OF_TABLES, OF_RUNS)
    return first.get(name) or second.get(name) or Variable(name)
