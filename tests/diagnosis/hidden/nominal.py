"""The figures of the nominal machine, its noise and its tolerances, written down a second time
on purpose.

Source: the published machine description (machine file and catalogue of effects), not the
program's code.
"""

from __future__ import annotations

from typing import NamedTuple

from .courses import Course
from .terms import Term

WIDTH_M = 2.4
OUTLETS = 6
HEADS = 6
FLOW_G_PER_REV_MM = 5.5
SHAFT_ACCELERATION_RPM_S = 200.0
GATE_DEAD_S = 0.10
FULL_OPENING_MM = 60.0
FULL_HOPPER_KG = 300.0
NOMINAL_SUPPLY_V = 13.5
FLUTES = 6
DROP_INTERCEPT_S = 1.8288
DROP_SLOPE_S_PER_RPM = -0.0083
RESPONSE_S = 0.383


class Physics(NamedTuple):
    """What a machine of this type really is, once it has been built: nominal values and their
    scatter."""

    shaft_ratio: float = 1.0
    shaft_dead_s: float = 0.373
    shaft_tau_s: float = 0.05
    gate_dead_s: float = GATE_DEAD_S
    gate_slew_mm_s: float = 20.0
    opening_off_mm: float = 0.0
    flow_ratio: float = 1.0
    wheel_ratio: float = 1.0
    heads_ratio: tuple[float, ...] = (1.0,) * HEADS
    # reading's unknown level at the start, and error of the refill's kg
    level_kg: tuple[float, ...] = (0.0, 0.0)


TOLERANCE = {
    "shaft_ratio": 0.0005,
    "shaft_dead_s": 0.010,
    "shaft_tau_s": 0.015,
    "gate_dead_s": 0.010,
    "gate_slew_mm_s": 0.6,
    "opening_off_mm": 0.01,
    "flow_ratio": 0.001,
    "wheel_ratio": 0.0005,
}
# Effects that move what a tolerance moves too: the value, and by how much for one unit of the size.
TWINS = {
    "shaft.dead_time": ("shaft_dead_s", 1.0),
    "shaft.slow": ("shaft_tau_s", 1.0),
    "gate.slow": ("gate_slew_mm_s", -1.0),
    "gate.home_error": ("opening_off_mm", 1.0),
}
HEAD_TOLERANCE = 0.001
LEVEL_TOLERANCE_KG = (50.0, 0.05)


class Kind(NamedTuple):
    """How the generator treats one id: sign of its size, first guess, largest size, unit, where
    it shows."""

    sign: int  # +1: only positive, 0: either sign
    guess: float
    most: float
    unit: str
    seen: tuple[str, ...]
    # False: the size is drawn from [guess, most], its z is what comes out
    by_z: bool = True
    # True: it shows in a run, and came after the timetable, whose cases stay as they are;
    # tests/diagnosis/test_new_effects.py asks for it
    is_new: bool = False


IDS: dict[str, Kind] = {
    "shaft.gain": Kind(0, 0.2, 30.0, "%", ("run",)),
    "shaft.slow": Kind(1, 0.04, 1.0, "s", ("run",)),
    "shaft.dead_time": Kind(1, 0.03, 1.0, "s", ("run", "lag")),
    "shaft.dead_band": Kind(1, 12.0, 24.0, "r/min", ("run",), by_z=False),
    # None of the examined machine, which holds its speed by an encoder and turns one way:
    # tests/diagnosis has others.
    "shaft.dead_zone": Kind(1, 1.0, 40.0, "r/min", ()),
    "shaft.saturation": Kind(1, 2.0, 60.0, "%", ()),
    # tests/diagnosis/test_planted_drives.py
    "shaft.neutral": Kind(0, 1.0, 60.0, "r/min", ()),
    "shaft.back_gain": Kind(0, 0.2, 30.0, "%", ()),
    "shaft.back_zone": Kind(0, 1.0, 40.0, "r/min", ()),
    # tests/diagnosis/test_second_order.py
    "shaft.second_order": Kind(1, 0.02, 1.0, "s", ()),
    "shaft.ramp": Kind(1, 0.1, 10.0, "s", ()),  # tests/diagnosis/test_planted_drives.py
    "shaft.voltage_sag": Kind(1, 0.2, 10.0, "%/V", ("run",)),
    "shaft.load_droop": Kind(1, 0.5, 30.0, "%", ("run",)),
    "shaft.coarse_encoder": Kind(1, 0.8, 6.0, "r/min", ("run",), by_z=False),
    "shaft.stall": Kind(1, 0.2, 0.8, "s", ("run",), by_z=False),
    "gate.offset": Kind(0, 0.05, 5.0, "mm", ("run",)),
    "gate.home_error": Kind(0, 0.05, 5.0, "mm", ("run",)),
    "gate.backlash": Kind(1, 0.05, 3.0, "mm", ("run",)),
    "gate.lost_steps": Kind(1, 0.02, 3.0, "mm/100 mm", ("run",)),
    "gate.slow": Kind(1, 3.0, 17.0, "mm/s", ("run",)),
    "gate.stuck": Kind(1, 0.2, 0.8, "s", ("run",), by_z=False),
    "flow.gain": Kind(0, 0.5, 50.0, "%", ("run", "catch", "weigh")),
    "flow.zero_offset": Kind(0, 1.0, 25.0, "g/rev", ("run", "catch")),
    "flow.fill_falloff": Kind(1, 1.0, 35.0, "%", ("run", "catch")),
    "flow.hopper_head": Kind(1, 1.0, 20.0, "%", ("run",)),
    "flow.moisture_drift": Kind(0, 1.0, 40.0, "%/h", ("run",)),
    "flow.batch": Kind(0, 1.0, 50.0, "%", ("run",)),
    "flow.blocked_outlet": Kind(1, 1.0, 60.0, "%", ("run",)),
    "flow.outlet_uneven": Kind(0, 1.0, 50.0, "%", ("catch",)),
    "flow.bridging": Kind(1, 0.3, 4.0, "%", ("run",), by_z=False),
    "flow.leak": Kind(1, 0.5, 60.0, "kg/h", ("run",)),
    "flow.slope": Kind(0, 0.2, 5.0, "%/deg", ("run",)),
    "flow.pulsation": Kind(1, 2.0, 40.0, "%", ("catch",)),
    "speed.wheel_slip": Kind(1, 0.3, 20.0, "%", ("run",)),
    "speed.wheel_radius": Kind(0, 0.3, 15.0, "%", ("run",)),
    "speed.missed_pulses": Kind(1, 0.3, 20.0, "%", ("run",)),
    "speed.gnss_latency": Kind(1, 0.03, 1.5, "s", ("run",)),
    "canopy.head_fouled": Kind(0, 0.5, 40.0, "%", ("run", "heads")),
    "canopy.warm_up": Kind(0, 2.0, 40.0, "%", ("heads",)),
    "canopy.saturation": Kind(1, 2.0, 40.0, "%", ("heads",)),
    "scale.gain": Kind(0, 0.5, 20.0, "%", ("run",)),
    "scale.drift": Kind(0, 0.5, 30.0, "kg/h", ("run",)),
    "scale.tilt": Kind(0, 0.02, 4.0, "%/deg", ("run",)),
    "lag.offset": Kind(0, 0.05, 2.0, "s", ("lag",)),
    "lag.rebound": Kind(1, 0.05, 1.5, "s", ("lag",)),
    "lag.first_fill": Kind(1, 0.05, 2.0, "s", ("lag",)),
    "lag.asymmetry": Kind(0, 0.05, 1.5, "s", ("lag",)),
    "lag.coarse_clock": Kind(1, 0.1, 0.5, "s", ("lag",), by_z=False),
    "lag.speed_scale": Kind(0, 1.0, 30.0, "%", ("lag",)),
    "place.lever_arm": Kind(0, 0.05, 3.0, "m", ("place",)),
    "place.latency": Kind(0, 0.05, 2.0, "s", ("place",)),
    # How hard the drives work: a generator of its own, tests/diagnosis/hidden/effort.py, so
    # that the timetable stays.
    **{
        name: Kind(0, 5.0, 200.0, "%", ())
        for name in (
            "effort.friction",
            "effort.drag",
            "effort.load",
            "effort.gate_friction",
            "effort.gate_drag",
        )
    },
}

# Effects that no catalogue holds: channel they are born in, variables an answer may rightly name.
OUTSIDE: dict[str, tuple[str, float, tuple[str, ...]]] = {
    "x.flow_roll": ("flow", 0.2, ("roll_deg",)),
    "x.shaft_heading": ("shaft", 0.2, ("heading_deg",)),
    "x.shaft_day": ("shaft", 0.2, ("time_s",)),
    "x.gate_supply": ("gate", 0.05, ("supply_v",)),
    "x.gate_roll": ("gate", 0.02, ("roll_deg",)),
    "x.wheel_roll": ("speed", 0.1, ("roll_deg",)),
    "x.wheel_supply": ("speed", 0.3, ("supply_v",)),
    "x.scale_supply": ("scale", 0.1, ("supply_v",)),
    "x.scale_roll": ("scale", 0.02, ("roll_deg",)),
    "x.flow_vibration": ("flow", 1.0, ("speed_mps", "wheel_speed_mps", "speed_used_mps")),
}
# The same for bench tables: kind of table, layouts' variants, first guess, variables.
OUTSIDE_TABLES: dict[str, tuple[str, tuple[str, ...], float, tuple[str, ...]]] = {
    "x.lag_hump": ("lag", ("lag_s", "response_s"), 0.05, ("shaft_rpm",)),
    "x.lag_tiring": ("lag", ("lag_s", "response_s"), 0.05, ("replicate",)),
    "x.lag_ground_speed": ("lag", ("both",), 0.05, ("speed_mps", "speed_kmh")),
    "x.catch_resonance": ("catch", ("all",), 1.0, ("shaft_rpm",)),
    "x.catch_waist": ("catch", ("all",), 1.0, ("opening_mm",)),
    "x.catch_packing": ("catch", ("all", "outlet"), 1.0, ("replicate",)),
    "x.heads_hump": ("heads", ("all",), 0.01, ("ndvi_reference",)),
    "x.heads_swing": ("heads", ("all",), 1.0, ("warm_min",)),
    "x.place_speeding": ("place", ("plain",), 0.05, ("shaft_rpm",)),
    "x.place_tiring": ("place", ("plain",), 0.05, ("replicate",)),
}


class Effect(NamedTuple):
    """One thing hidden in a machine. `form` picks one of several mathematical shapes, `knob`
    bends it (0 to 1)."""

    id: str
    size: float
    form: int = 0
    knob: float = 0.5
    onset_s: float | None = None
    member: int | None = None  # 1-based
    seed: int = 0  # of whatever is random in it
    # over time; None: the form's own, from the first row on
    course: Course | None = None
    term: Term | None = None  # of an id `y.*`: the dependence
