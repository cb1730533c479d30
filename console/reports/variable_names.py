"""Which plain words and units do recorded variables and settings have?"""

from __future__ import annotations

from typing import NamedTuple

from topdress.console.locale import N_, _
from topdress.control.signals import SIGNALS


class NamedVariable(NamedTuple):
    """Names a variable in words, with its unit."""

    name: str
    unit: str = ""

    @property
    def label(self) -> str:
        """The name for an axis, in the language in use."""
        return f"{_(self.name)}, {_(self.unit)}" if self.unit else _(self.name)


# Numbers of a log are shown by their declared names, but a model's variable may be another number
# than the column of its name (a command) and needs a sign's meaning.
RUN_VARIABLES = {
    **{name: NamedVariable(one.label, one.unit) for name, one in SIGNALS.items() if one.term_label},
    "shaft_rpm": NamedVariable(N_("shaft speed commanded"), "r/min"),
    "opening_mm": NamedVariable(N_("opening commanded"), "mm"),
    "pitch_deg": NamedVariable(N_("pitch"), N_("degrees nose up")),
    "roll_deg": NamedVariable(N_("roll"), N_("degrees right side down")),
    "speed_mps": NamedVariable(N_("ground speed"), "m/s"),
    "heading_deg": NamedVariable(N_("heading"), N_("degrees")),
    "time_s": NamedVariable(N_("time"), "min"),
    "gain_of_speed": NamedVariable(N_("acceleration"), "m/s per s"),
    "ndvi": NamedVariable(N_("NDVI, mean of all heads")),
    "way": NamedVariable(N_("last change of the command")),
    "moved": NamedVariable(N_("distance moved so far"), "mm"),
    "working": NamedVariable(N_("out of work / in work")),
    "since_change": NamedVariable(N_("seconds since the command changed")),
}
TABLE_VARIABLES = {
    "shaft_rpm": NamedVariable(N_("shaft speed"), "r/min"),
    "opening_mm": NamedVariable(N_("opening"), "mm"),
    "duration_s": NamedVariable(N_("duration"), "s"),
    "speed_mps": NamedVariable(N_("ground speed"), "m/s"),
    "target_kg": NamedVariable(N_("target"), "kg"),
    "area_m2": NamedVariable(N_("area"), "m2"),
    "outlet": NamedVariable(N_("outlet")),
    "ndvi": NamedVariable(N_("NDVI")),
    "ndvi_reference": NamedVariable(N_("NDVI of the reference")),
    "head": NamedVariable(N_("head")),
    "warm_min": NamedVariable(N_("minutes since switched on")),
    "height_m": NamedVariable(N_("height"), "m"),
    "corrected_lag_s": NamedVariable(N_("lag corrected for"), "s"),
    "before_rpm": NamedVariable(N_("shaft speed before"), "r/min"),
    "replicate": NamedVariable(N_("replicate")),
    "label": NamedVariable(N_("label")),
    "constant": NamedVariable(N_("a constant")),
}


def find_variable(name: str, kind: str = "run") -> NamedVariable:
    """Returns the variable of a run log, or of a table; an unknown variable keeps its own name."""
    first, second = (
        (RUN_VARIABLES, TABLE_VARIABLES) if kind == "run" else (TABLE_VARIABLES, RUN_VARIABLES)
    )
    return first.get(name) or second.get(name) or NamedVariable(name)
