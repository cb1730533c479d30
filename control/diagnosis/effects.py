"""How a diagnosis treats each effect of the catalogue: one row an effect, and no second list.

A new effect is its parameter in its stage's file (control/machine) and its row here: an effect without a row is an
error at import, and so is a row without an effect.
"""
from __future__ import annotations

from dataclasses import dataclass

from control.machine.machine import CATALOGUE


@dataclass(frozen=True, slots=True)
class Row:
    """What a diagnosis must know of an effect beside its place in the model."""

    id: str
    only_adds: bool = False                 # something lost or extra: never less of it than the machine file has
    constant_time: bool = False             # the same time in every row, as the steps of a coarse clock may make it
    half_looks_like: tuple[str, ...] = ()   # what half of it, all on one of two sides, may pass for
    scoped_in: tuple[str, ...] = ()         # kinds of tables in which it may hold for one label or one table only


SHAFT_GAIN = Row("shaft.gain")
SHAFT_SLOW = Row("shaft.slow")
SHAFT_DEAD_TIME = Row("shaft.dead_time", only_adds=True, constant_time=True, scoped_in=("lag",))
SHAFT_DEAD_BAND = Row("shaft.dead_band")
SHAFT_VOLTAGE_SAG = Row("shaft.voltage_sag")
SHAFT_LOAD_DROOP = Row("shaft.load_droop")
SHAFT_COARSE_ENCODER = Row("shaft.coarse_encoder")
SHAFT_STALL = Row("shaft.stall")
GATE_OFFSET = Row("gate.offset")
GATE_HOME_ERROR = Row("gate.home_error")
GATE_BACKLASH = Row("gate.backlash")
GATE_LOST_STEPS = Row("gate.lost_steps")
GATE_SLOW = Row("gate.slow")
GATE_STUCK = Row("gate.stuck")
FLOW_GAIN = Row("flow.gain", scoped_in=("catch",))
FLOW_ZERO_OFFSET = Row("flow.zero_offset")
FLOW_FILL_FALLOFF = Row("flow.fill_falloff", only_adds=True)
FLOW_HOPPER_HEAD = Row("flow.hopper_head")
FLOW_MOISTURE_DRIFT = Row("flow.moisture_drift")
FLOW_BATCH = Row("flow.batch")
FLOW_BLOCKED_OUTLET = Row("flow.blocked_outlet")
FLOW_OUTLET_UNEVEN = Row("flow.outlet_uneven")
FLOW_BRIDGING = Row("flow.bridging")
FLOW_LEAK = Row("flow.leak")
FLOW_SLOPE = Row("flow.slope")
FLOW_PULSATION = Row("flow.pulsation")
SCALE_GAIN = Row("scale.gain")
SCALE_DRIFT = Row("scale.drift")
SCALE_TILT = Row("scale.tilt")
SPEED_WHEEL_SLIP = Row("speed.wheel_slip", only_adds=True)
SPEED_WHEEL_RADIUS = Row("speed.wheel_radius")
SPEED_MISSED_PULSES = Row("speed.missed_pulses")
SPEED_GNSS_LATENCY = Row("speed.gnss_latency")
CANOPY_HEAD_FOULED = Row("canopy.head_fouled")
CANOPY_WARM_UP = Row("canopy.warm_up")
CANOPY_SATURATION = Row("canopy.saturation")
LAG_OFFSET = Row("lag.offset", constant_time=True, scoped_in=("lag",))
LAG_REBOUND = Row("lag.rebound", only_adds=True)
LAG_FIRST_FILL = Row("lag.first_fill", only_adds=True)
LAG_ASYMMETRY = Row("lag.asymmetry", half_looks_like=(LAG_OFFSET.id, SHAFT_DEAD_TIME.id))
LAG_COARSE_CLOCK = Row("lag.coarse_clock")
LAG_SPEED_SCALE = Row("lag.speed_scale", scoped_in=("lag",))
PLACE_LEVER_ARM = Row("place.lever_arm", scoped_in=("place",))
PLACE_LATENCY = Row("place.latency", scoped_in=("place",))

ROWS: dict[str, Row] = {row.id: row for row in list(globals().values()) if isinstance(row, Row)}
_unmatched = sorted(set(ROWS) ^ set(CATALOGUE))
if _unmatched:
    raise RuntimeError(f"effects without a row, or rows without an effect: {', '.join(_unmatched)}")
