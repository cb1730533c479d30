"""How a diagnosis treats each effect of the catalogue: one row an effect, and no second list.

A new effect is its parameter in its stage's file (control/machine) and its row here: an effect
without a row is an error at import, and so is a row without an effect. Sizes are in the unit
that the catalogue gives the effect, and those of the nominal machine; `Row.on` gives another's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from topdress.control.machine.machine import (
    CATALOGUE,
    Machine,
    SizeBounds,
    calc_size_scale,
    find_size_bounds,
)
from topdress.control.machine.shaft import MIN_TIME_CONSTANT_S

THRESHOLD_RATIO = 1.25  # of a threshold to the one tried below it
# of the highest shaft speed: a shaft that is asked for less stands still
MIN_THRESHOLD_SHARE = 0.01


class FoundBy(Enum):
    """How a run log shows an effect."""

    SCAN = "scan"  # its column held against the whole log
    # the same, at sizes of a grid: it acts on all commands below its size
    THRESHOLD = "threshold"
    # never there from the start: scanned with the time at which it begins
    ONSET = "onset"
    STOP = "stop"  # a drive that stands still to the end of the log
    # single readings of the wheel far too low; in a coarse log by the scan
    DIPS = "dips"
    # spells in which the scale stands still although the shaft turns
    STANDSTILL = "standstill"
    STEPS = "steps"  # shaft speeds that come in steps


class Needs(Enum):
    """What a run log must contain, for an effect to show in it."""

    REFILL = "refill"  # the hopper filled up
    OPENINGS = "openings"  # the opening's command moved far
    # the opening recorded: without it the effect looks like others
    OPENING = "opening"
    # a drive that does not hold its speed by its own encoder
    OPEN_LOOP = "open loop"
    BOTH_WAYS = "both ways"  # commands that turn the shaft either way
    # a shaft that turns by more, or otherwise, than a share of its command
    OFF_ZERO = "off zero"
    FINE_READINGS = "fine readings"  # a shaft's speed that is not read in steps
    # every command: it shows at each move of a drive, as a missing one does
    MOVES = "moves"


class Costs(Enum):
    """What an effect costs in the field when nobody knows of it."""

    DOSE = "dose"
    PLACE = "place"
    NEITHER = "neither"  # it is wrong in what is reported, or evens out
    # depends on the crop that the heads look at: left open
    CROP = "crop"


@dataclass(frozen=True, slots=True)
class EffectRow:
    """What a diagnosis must know of an effect besides its place in the model."""

    id: str
    # s.d. of its prior: what such effects usually are, in its unit
    usual: float
    # sizes at which its column is taken: one, where what it does is a straight line
    tried: tuple[float, ...] = ()
    found_by: FoundBy = FoundBy.SCAN
    needs: tuple[Needs, ...] = ()
    # recorded variable over which its form may differ from the catalogue's
    form_over: str = ""
    # its size is what is lost at the end of that variable, seldom where a log works
    at_end: bool = False
    # effects of nearly the same form: its own form may lean towards theirs
    siblings: tuple[str, ...] = ()
    # nominal value of its stage that it adds to: that value's tolerance is its own
    moves: str = ""
    may_begin: bool = True  # whether it may begin in the middle of a run
    # something lost or extra: never less of it than the machine file has
    only_adds: bool = False
    costs: Costs = Costs.DOSE

    def on(self, machine: Machine) -> EffectRow:
        """The row with the sizes that are natural on a machine: shares of its ranges."""
        scale = calc_size_scale(self.id, machine)
        tried = tuple(scale * size for size in self.tried)
        if self.threshold:
            tried = (*_list_finer_thresholds(tried[0], machine), *tried)
        return replace(self, usual=scale * self.usual, tried=tried)

    @property
    def probe(self) -> float | None:
        """Size at which the slope of a straight-line effect is taken; None of one that is none."""
        return self.tried[0] if len(self.tried) == 1 else None

    @property
    def trial_sizes(self) -> tuple[float, ...]:
        """Sizes tried where what an effect does is no straight line in its size; empty of one
        that is."""
        return self.tried if len(self.tried) > 1 else ()

    @property
    def threshold(self) -> bool:
        """Whether it has no slope and is sought on a grid."""
        return self.found_by is FoundBy.THRESHOLD

    @property
    def scanned(self) -> bool:
        """Whether it is there all along, and held as a column against the whole log."""
        return self.found_by in (FoundBy.SCAN, FoundBy.THRESHOLD)

    @property
    def move_shaped(self) -> bool:
        """Whether it shows at each move of a drive."""
        return Needs.MOVES in self.needs

    @property
    def stage(self) -> str:
        """Stage of the machine model that has the effect's parameter."""
        return CATALOGUE[self.id].stage

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of a run log that the effect moves, its own first; empty where no run log
        shows its stage."""
        # a read-back that is off opens the gate, and the flow, by as much
        if self.id == GATE_OFFSET.id:
            return "gate", "scale", "effort"
        if self.id in (EFFORT_GATE_FRICTION.id, EFFORT_GATE_DRAG.id):
            return ("gate_effort",)
        return {"fall": (), "flow": ("scale", "effort")}.get(self.stage, (self.stage,))

    @property
    def has_slope(self) -> bool:
        """Whether the prediction has a slope in its size."""
        return not (
            self.threshold or self.found_by is FoundBy.STEPS or CATALOGUE[self.id].effect.onset_only
        )


def _list_finer_thresholds(lowest_rpm: float, machine: Machine) -> tuple[float, ...]:
    """Thresholds below the lowest trial size that this shaft's commands pass; none where no
    command is so low.

    A threshold below the lowest command that is ever given shows nowhere.
    """
    found: list[float] = []
    least = max(machine.limits.shaft_low_rpm, MIN_THRESHOLD_SHARE * machine.limits.shaft_high_rpm)
    while (lowest_rpm := lowest_rpm / THRESHOLD_RATIO) > least:
        found.insert(0, lowest_rpm)
    return tuple(found)


# What such effects usually are (`usual`), 1 s.d. of a normal about nothing: by what a machine
# in use departs from its data sheet before somebody repairs it. A prior of half or twice as
# much moves the log evidence by 0.7: an order of size will do. Gains of drives, wheel and feed
# rollers: some per cent (a spreader in order keeps its rate to 5 %, ISO 5690-1); of a scale on
# a machine that drives no less, and some kg/h of drift (a scale at rest: OIML R 76, class 4).
# Times: fractions of a second, as drives of this size take. Openings: a millimetre or two, as a
# worn spindle or a moved stop gives. Supply: as it droops from 14 to 12 V. Slope: a per cent a
# degree, as a hopper rests on its side. A blocked outlet is one of six.
MOVED = (Needs.MOVES, Needs.FINE_READINGS)  # what a delay of the shaft needs
SHAFT_GAIN = EffectRow("shaft.gain", 3.0, (0.5,), form_over="shaft_rpm", moves="gain_percent")
SHAFT_SLOW = EffectRow(
    "shaft.slow",
    0.2,
    (0.03, 0.1, 0.3, 0.8),
    needs=MOVED,
    siblings=("shaft.dead_time",),
    moves="time_constant_s",
    costs=Costs.PLACE,
)
SHAFT_DEAD_TIME = EffectRow(
    "shaft.dead_time",
    0.15,
    (0.03, 0.1, 0.25, 0.6),
    needs=MOVED,
    siblings=("shaft.slow",),
    moves="dead_time_s",
    only_adds=True,
    costs=Costs.PLACE,
)
SHAFT_SECOND_ORDER = EffectRow(
    "shaft.second_order",
    0.1,
    (0.01, 0.04, 0.15, 0.5),
    needs=MOVED,
    # a setting, a coupling
    siblings=("shaft.dead_time",),
    may_begin=False,
    only_adds=True,
    costs=Costs.PLACE,
)
SHAFT_RAMP = EffectRow(
    "shaft.ramp",
    0.5,
    (0.05, 0.2, 1.0, 4.0),
    needs=(*MOVED, Needs.OPEN_LOOP),
    siblings=("shaft.slow",),
    may_begin=False,  # a setting; else the machine file's own limit
    only_adds=True,
    costs=Costs.PLACE,
)
SHAFT_DEAD_BAND = EffectRow(
    "shaft.dead_band", 20.0, (11.0, 13.0, 16.0, 20.0, 25.0, 31.0, 40.0), FoundBy.THRESHOLD
)
SHAFT_DEAD_ZONE = EffectRow(
    "shaft.dead_zone",
    10.0,
    (2.0, 8.0, 20.0, 40.0),
    needs=(Needs.OPEN_LOOP,),
    form_over="shaft_rpm",
    only_adds=True,
)
SHAFT_SATURATION = EffectRow(
    "shaft.saturation",
    15.0,
    (3.0, 12.0, 30.0, 60.0),
    needs=(Needs.OPEN_LOOP,),
    form_over="shaft_rpm",
    at_end=True,
    only_adds=True,
)
SHAFT_NEUTRAL = EffectRow(
    "shaft.neutral",
    10.0,
    (0.5,),
    needs=(Needs.OPEN_LOOP, Needs.OFF_ZERO),
    form_over="shaft_rpm",
    may_begin=False,
)  # a setting, a trim
SHAFT_BACK_GAIN = EffectRow(
    "shaft.back_gain", 5.0, (0.5,), needs=(Needs.BOTH_WAYS,), form_over="shaft_rpm"
)
SHAFT_BACK_ZONE = EffectRow(
    "shaft.back_zone", 5.0, (0.5,), needs=(Needs.BOTH_WAYS, Needs.OPEN_LOOP), form_over="shaft_rpm"
)
SHAFT_VOLTAGE_SAG = EffectRow("shaft.voltage_sag", 3.0, (0.5,), form_over="supply_v")
SHAFT_LOAD_DROOP = EffectRow(
    "shaft.load_droop", 6.0, (1.0,), needs=(Needs.OPENING,), form_over="opening_mm", at_end=True
)
SHAFT_COARSE_ENCODER = EffectRow(
    "shaft.coarse_encoder", 4.0, found_by=FoundBy.STEPS, costs=Costs.NEITHER
)
SHAFT_STALL = EffectRow("shaft.stall", 1.0, found_by=FoundBy.STOP)
GATE_OFFSET = EffectRow("gate.offset", 1.5, (0.1,), form_over="opening_mm")
GATE_HOME_ERROR = EffectRow("gate.home_error", 1.5, (0.1,), form_over="opening_mm")
GATE_BACKLASH = EffectRow(
    "gate.backlash", 0.8, (0.02, 0.06, 0.15, 0.4, 1.0, 2.5), needs=(Needs.MOVES, Needs.OPENINGS)
)
GATE_LOST_STEPS = EffectRow("gate.lost_steps", 0.3, (0.02,), may_begin=False)
GATE_SLOW = EffectRow(
    "gate.slow",
    8.0,
    (0.4, 1.5, 5.0, 10.0, 15.0),
    needs=(Needs.MOVES, Needs.OPENINGS),
    moves="slew_mm_s",
    costs=Costs.PLACE,
)
GATE_STUCK = EffectRow("gate.stuck", 1.0, found_by=FoundBy.STOP)
FLOW_GAIN = EffectRow("flow.gain", 6.0, (1.0,))
FLOW_ZERO_OFFSET = EffectRow("flow.zero_offset", 6.0, (1.0,), form_over="opening_mm")
FLOW_FILL_FALLOFF = EffectRow(
    "flow.fill_falloff", 6.0, (1.0,), form_over="shaft_rpm", at_end=True, only_adds=True
)
FLOW_HOPPER_HEAD = EffectRow("flow.hopper_head", 6.0, (1.0,), form_over="hopper_kg", at_end=True)
FLOW_MOISTURE_DRIFT = EffectRow(
    "flow.moisture_drift", 5.0, (1.0,), form_over="time_s", may_begin=False
)
FLOW_BATCH = EffectRow("flow.batch", 6.0, (1.0,), needs=(Needs.REFILL,), may_begin=False)
FLOW_BLOCKED_OUTLET = EffectRow("flow.blocked_outlet", 17.0, (2.0,), FoundBy.ONSET)
FLOW_OUTLET_UNEVEN = EffectRow("flow.outlet_uneven", 6.0)
FLOW_BRIDGING = EffectRow("flow.bridging", 10.0, found_by=FoundBy.STANDSTILL)
FLOW_LEAK = EffectRow("flow.leak", 20.0, (1.0,))
FLOW_SLOPE = EffectRow("flow.slope", 1.0, (0.2,), form_over="pitch_deg")
FLOW_PULSATION = EffectRow("flow.pulsation", 10.0, costs=Costs.NEITHER)
SCALE_GAIN = EffectRow("scale.gain", 4.0, (0.2,))
SCALE_DRIFT = EffectRow("scale.drift", 3.0, (0.5,), form_over="time_s", may_begin=False)
SCALE_TILT = EffectRow("scale.tilt", 0.5, (0.05,), form_over="pitch_deg")
SPEED_WHEEL_SLIP = EffectRow("speed.wheel_slip", 4.0, (0.5,), form_over="pitch_deg", only_adds=True)
SPEED_WHEEL_RADIUS = EffectRow("speed.wheel_radius", 3.0, (0.5,))
SPEED_MISSED_PULSES = EffectRow("speed.missed_pulses", 5.0, (0.5,), FoundBy.DIPS)
SPEED_GNSS_LATENCY = EffectRow("speed.gnss_latency", 0.3, (0.1, 0.3, 0.8), costs=Costs.PLACE)
CANOPY_HEAD_FOULED = EffectRow("canopy.head_fouled", 8.0, (1.0,), costs=Costs.CROP)
CANOPY_WARM_UP = EffectRow("canopy.warm_up", 8.0, costs=Costs.CROP)
CANOPY_SATURATION = EffectRow("canopy.saturation", 8.0, costs=Costs.CROP)
LAG_OFFSET = EffectRow("lag.offset", 0.2, costs=Costs.PLACE)
LAG_REBOUND = EffectRow("lag.rebound", 0.2, only_adds=True, costs=Costs.PLACE)
LAG_FIRST_FILL = EffectRow("lag.first_fill", 0.4, only_adds=True, costs=Costs.PLACE)
LAG_ASYMMETRY = EffectRow("lag.asymmetry", 0.2, costs=Costs.PLACE)
LAG_COARSE_CLOCK = EffectRow("lag.coarse_clock", 0.1, costs=Costs.NEITHER)
LAG_SPEED_SCALE = EffectRow("lag.speed_scale", 5.0, costs=Costs.PLACE)
PLACE_LEVER_ARM = EffectRow("place.lever_arm", 1.0, costs=Costs.PLACE)
PLACE_LATENCY = EffectRow("place.latency", 0.3, costs=Costs.PLACE)
# Effort: friction by some ten per cent before anything is heard, as much drag; a load that is
# gone is 100 %.
EFFORT_FRICTION = EffectRow("effort.friction", 20.0, (5.0,), only_adds=True, costs=Costs.NEITHER)
EFFORT_DRAG = EffectRow("effort.drag", 20.0, (5.0,), costs=Costs.NEITHER)
EFFORT_LOAD = EffectRow("effort.load", 50.0, (10.0,), costs=Costs.NEITHER)
EFFORT_GATE_FRICTION = EffectRow(
    "effort.gate_friction", 20.0, (5.0,), only_adds=True, costs=Costs.NEITHER
)
EFFORT_GATE_DRAG = EffectRow("effort.gate_drag", 20.0, (5.0,), costs=Costs.NEITHER)

ROWS: dict[str, EffectRow] = {
    row.id: row
    for row in (
        SHAFT_GAIN,
        SHAFT_SLOW,
        SHAFT_DEAD_TIME,
        SHAFT_SECOND_ORDER,
        SHAFT_RAMP,
        SHAFT_DEAD_BAND,
        SHAFT_DEAD_ZONE,
        SHAFT_SATURATION,
        SHAFT_NEUTRAL,
        SHAFT_BACK_GAIN,
        SHAFT_BACK_ZONE,
        SHAFT_VOLTAGE_SAG,
        SHAFT_LOAD_DROOP,
        SHAFT_COARSE_ENCODER,
        SHAFT_STALL,
        GATE_OFFSET,
        GATE_HOME_ERROR,
        GATE_BACKLASH,
        GATE_LOST_STEPS,
        GATE_SLOW,
        GATE_STUCK,
        FLOW_GAIN,
        FLOW_ZERO_OFFSET,
        FLOW_FILL_FALLOFF,
        FLOW_HOPPER_HEAD,
        FLOW_MOISTURE_DRIFT,
        FLOW_BATCH,
        FLOW_BLOCKED_OUTLET,
        FLOW_OUTLET_UNEVEN,
        FLOW_BRIDGING,
        FLOW_LEAK,
        FLOW_SLOPE,
        FLOW_PULSATION,
        SCALE_GAIN,
        SCALE_DRIFT,
        SCALE_TILT,
        SPEED_WHEEL_SLIP,
        SPEED_WHEEL_RADIUS,
        SPEED_MISSED_PULSES,
        SPEED_GNSS_LATENCY,
        CANOPY_HEAD_FOULED,
        CANOPY_WARM_UP,
        CANOPY_SATURATION,
        LAG_OFFSET,
        LAG_REBOUND,
        LAG_FIRST_FILL,
        LAG_ASYMMETRY,
        LAG_COARSE_CLOCK,
        LAG_SPEED_SCALE,
        PLACE_LEVER_ARM,
        PLACE_LATENCY,
        EFFORT_FRICTION,
        EFFORT_DRAG,
        EFFORT_LOAD,
        EFFORT_GATE_FRICTION,
        EFFORT_GATE_DRAG,
    )
}
_unmatched = sorted(set(ROWS) ^ set(CATALOGUE))
if _unmatched:
    raise RuntimeError(f"effects without a row, or rows without an effect: {', '.join(_unmatched)}")


def find_size_range(effect_id: str, machine: Machine) -> SizeBounds:
    """Range of an effect's size on top of a machine file: that of the catalogue, and no time
    that it adds to falls below nothing (the model holds it there: what is further off predicts
    the same). Raises KeyError."""
    low, high = find_size_bounds(effect_id, machine)
    least = {"dead_time_s": 0.0, "time_constant_s": MIN_TIME_CONSTANT_S}.get(ROWS[effect_id].moves)
    if least is None:
        return SizeBounds(low, high)
    entry = CATALOGUE[effect_id]
    stage = getattr(machine, entry.stage)
    total = getattr(stage, ROWS[effect_id].moves) + getattr(stage, entry.field)
    return SizeBounds(max(low, min(0.0, least - total)), high)
