"""Declares how a diagnosis treats each effect of the catalogue: one row for each effect, and no
second list.

A new effect is a parameter in its stage's file (control/machine) and a row here. An effect without
a row is an error at import, and so is a row without an effect. Sizes are in the unit that the
catalogue gives the effect, for the nominal machine; `EffectRow.on` scales them to another machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from topdress.control.machine.effect import LONGEST_ANSWER
from topdress.control.machine.machine import (
    CATALOGUE,
    Machine,
    SizeBounds,
    calc_size_scale,
    find_size_bounds,
)
from topdress.control.machine.shaft import MIN_TIME_CONSTANT_S

# Ratio of a trial threshold to the next lower one.
TRIAL_THRESHOLD_RATIO = 1.25
# Ratio of a trial time to the next shorter one on a machine whose answers may be long.
LONGER_RATIO = 2.5
# Share of the highest shaft speed below which the shaft is commanded to stand.
STANDING_SHAFT_SPEED_SHARE = 0.01


class FoundBy(Enum):
    """Method by which a run log shows an effect."""

    # The column of the effect is fitted to the whole log.
    SCAN = "scan"
    # The column is fitted at sizes of a grid, because the effect acts on all commands below its
    # size.
    THRESHOLD = "threshold"
    # The effect is never present from the start, so it is scanned over its onset time.
    ONSET = "onset"
    # A drive stands still to the end of the log.
    STOP = "stop"
    # Single readings of the wheel are far too low; in a coarse log the scan shows the effect.
    DIPS = "dips"
    # The scale stands still for spells although the shaft turns.
    STANDSTILL = "standstill"
    # Shaft speeds are read in steps.
    STEPS = "steps"


class LogRequirement(Enum):
    """Content that a run log must have for an effect to show."""

    # The hopper is refilled.
    REFILL = "refill"
    # The opening's command changes by a large range.
    OPENINGS = "openings"
    # The opening is recorded: without it the effect is confounded with others.
    OPENING = "opening"
    # The drive does not control its speed by its own encoder.
    OPEN_LOOP = "open loop"
    # Commands turn the shaft in both directions.
    BOTH_WAYS = "both ways"
    # The shaft's speed is not proportional to its command.
    OFF_ZERO = "off zero"
    # The shaft's speed is not read in steps.
    FINE_READINGS = "fine readings"
    # Every command is recorded: the effect shows at each move of a drive, as a missing command
    # does.
    MOVES = "moves"


class CostKind(Enum):
    """Kind of cost of an uncompensated effect in the field."""

    DOSE = "dose"
    PLACE = "place"
    # The effect falsifies a report only, or averages out.
    NEITHER = "neither"
    # The cost depends on the crop under the heads and is not calculated.
    CROP = "crop"


@dataclass(frozen=True, slots=True)
class EffectRow:
    """Properties of an effect that a diagnosis needs besides its position in the model."""

    id: str
    # Prior standard deviation of the size: the usual size of such effects, in its unit.
    usual: float
    # Sizes at which the column is calculated: a single size for an effect that is linear in its
    # size.
    tried: tuple[float, ...] = ()
    found_by: FoundBy = FoundBy.SCAN
    needs: tuple[LogRequirement, ...] = ()
    # Recorded variable over which the form may differ from the catalogue's.
    form_over: str = ""
    # Whether the size is the loss at the end of that variable, where a log rarely works.
    at_end: bool = False
    # Effects of nearly the same form: the form may lean towards theirs.
    siblings: tuple[str, ...] = ()
    # Nominal value of the stage to which the effect adds: the effect shares that value's tolerance.
    moves: str = ""
    # Whether the effect may begin in the middle of a run.
    may_begin: bool = True
    # Whether the effect is a loss or an excess, which is never smaller than the machine file's.
    only_adds: bool = False
    costs: CostKind = CostKind.DOSE
    # Trial sizes beyond these on a machine whose answers may be long.
    longer: tuple[float, ...] = ()

    def scale_to_machine(self, machine: Machine) -> EffectRow:
        """Return the row with sizes scaled to a machine's ranges."""
        scale = calc_size_scale(self.id, machine)
        if CATALOGUE[self.id].effect.scales_with == LONGEST_ANSWER:
            # A drive with long answers may also have short ones.
            return replace(self, longer=_list_longer_times(self.tried, scale))
        tried = tuple(scale * size for size in self.tried)
        if self.threshold:
            tried = (*_list_finer_thresholds(tried[0], machine), *tried)
        return replace(self, usual=scale * self.usual, tried=tried)

    @property
    def probe(self) -> float | None:
        """Size at which the slope of a linear effect is calculated; None for a nonlinear effect."""
        return self.tried[0] if len(self.tried) == 1 else None

    @property
    def trial_sizes(self) -> tuple[float, ...]:
        """Trial sizes of an effect that is nonlinear in its size; empty for a linear effect."""
        return (*self.tried, *self.longer) if len(self.tried) > 1 else ()

    @property
    def threshold(self) -> bool:
        """Whether the effect has no slope and is searched for on a grid."""
        return self.found_by is FoundBy.THRESHOLD

    @property
    def scanned(self) -> bool:
        """Whether the effect is permanent, and its column is fitted to the whole log."""
        return self.found_by in (FoundBy.SCAN, FoundBy.THRESHOLD)

    @property
    def move_shaped(self) -> bool:
        """Whether the effect shows at each move of a drive."""
        return LogRequirement.MOVES in self.needs

    @property
    def stage(self) -> str:
        """Stage of the machine model that has the effect's parameter."""
        return CATALOGUE[self.id].stage

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of a run log that the effect changes, its own first; empty where no run log
        shows its stage."""
        # An error of the gate's reading changes the opening, and so the flow.
        if self.id == GATE_OFFSET.id:
            return "gate", "scale", "effort"
        if self.id in (EFFORT_GATE_FRICTION.id, EFFORT_GATE_DRAG.id):
            return ("gate_effort",)
        return {"fall": (), "flow": ("scale", "effort")}.get(self.stage, (self.stage,))

    @property
    def has_slope(self) -> bool:
        """Whether the prediction has a slope in the effect's size."""
        return not (
            self.threshold or self.found_by is FoundBy.STEPS or CATALOGUE[self.id].effect.onset_only
        )


def _list_longer_times(tried: tuple[float, ...], scale: float) -> tuple[float, ...]:
    """Return trial times beyond the largest, s, up to the largest on a machine with answers that
    are `scale` times as long."""
    found, longest = [], tried[-1]
    while (longest := longest * LONGER_RATIO) <= scale * tried[-1]:
        found.append(longest)
    return tuple(found)


def _list_finer_thresholds(lowest_rpm: float, machine: Machine) -> tuple[float, ...]:
    """Return thresholds below the lowest trial size that are above this shaft's lowest commands;
    empty where no command is that low.

    A threshold below the lowest command shows nowhere.
    """
    found: list[float] = []
    least = max(
        machine.limits.shaft_low_rpm, STANDING_SHAFT_SPEED_SHARE * machine.limits.shaft_high_rpm
    )
    while (lowest_rpm := lowest_rpm / TRIAL_THRESHOLD_RATIO) > least:
        found.insert(0, lowest_rpm)
    return tuple(found)


# The `usual` sizes are 1 s.d. of a normal prior around zero: the usual deviation of a machine in
# use from its data sheet before it is repaired. A prior of half or twice the size changes the log
# evidence by 0.7, so an order of magnitude suffices. Gains of drives, wheel and feed rollers: some
# per cent (a spreader in order keeps its rate to 5 %, ISO 5690-1); of a scale on a moving machine
# no less, and some kg/h of drift (a scale at rest: OIML R 76, class 4). Times: fractions of a
# second, typical of drives of this size. Openings: a millimetre or two, from a worn spindle or a
# moved stop. Supply: the droop from 14 to 12 V. Slope: a per cent a degree, as a hopper rests on
# its side. A blocked outlet is one of six.
# Requirements of a delay of the shaft.
DELAY_REQUIREMENTS = (LogRequirement.MOVES, LogRequirement.FINE_READINGS)
SHAFT_GAIN = EffectRow("shaft.gain", 3.0, (0.5,), form_over="shaft_rpm", moves="gain_percent")
SHAFT_SLOW = EffectRow(
    "shaft.slow",
    0.2,
    (0.03, 0.1, 0.3, 0.8),
    needs=DELAY_REQUIREMENTS,
    siblings=("shaft.dead_time",),
    moves="time_constant_s",
    costs=CostKind.PLACE,
)
SHAFT_DEAD_TIME = EffectRow(
    "shaft.dead_time",
    0.15,
    (0.03, 0.1, 0.25, 0.6),
    needs=DELAY_REQUIREMENTS,
    siblings=("shaft.slow",),
    moves="dead_time_s",
    only_adds=True,
    costs=CostKind.PLACE,
)
SHAFT_SECOND_ORDER = EffectRow(
    "shaft.second_order",
    0.1,
    (0.01, 0.04, 0.15, 0.5),
    needs=DELAY_REQUIREMENTS,
    # A coupling or a setting does not begin within a run.
    siblings=("shaft.dead_time",),
    may_begin=False,
    only_adds=True,
    costs=CostKind.PLACE,
)
SHAFT_RAMP = EffectRow(
    "shaft.ramp",
    0.5,
    (0.05, 0.2, 1.0, 4.0),
    needs=(*DELAY_REQUIREMENTS, LogRequirement.OPEN_LOOP),
    siblings=("shaft.slow",),
    # The ramp is a setting, or the machine file's own limit.
    may_begin=False,
    only_adds=True,
    costs=CostKind.PLACE,
)
SHAFT_DEAD_BAND = EffectRow(
    "shaft.dead_band", 20.0, (11.0, 13.0, 16.0, 20.0, 25.0, 31.0, 40.0), FoundBy.THRESHOLD
)
SHAFT_DEAD_ZONE = EffectRow(
    "shaft.dead_zone",
    10.0,
    (2.0, 8.0, 20.0, 40.0),
    needs=(LogRequirement.OPEN_LOOP,),
    form_over="shaft_rpm",
    only_adds=True,
)
SHAFT_SATURATION = EffectRow(
    "shaft.saturation",
    15.0,
    (3.0, 12.0, 30.0, 60.0),
    needs=(LogRequirement.OPEN_LOOP,),
    form_over="shaft_rpm",
    at_end=True,
    only_adds=True,
)
SHAFT_NEUTRAL = EffectRow(
    "shaft.neutral",
    10.0,
    (0.5,),
    needs=(LogRequirement.OPEN_LOOP, LogRequirement.OFF_ZERO),
    form_over="shaft_rpm",
    may_begin=False,
    # The neutral position is a setting, a trim.
)
SHAFT_BACK_GAIN = EffectRow(
    "shaft.back_gain", 5.0, (0.5,), needs=(LogRequirement.BOTH_WAYS,), form_over="shaft_rpm"
)
SHAFT_BACK_ZONE = EffectRow(
    "shaft.back_zone",
    5.0,
    (0.5,),
    needs=(LogRequirement.BOTH_WAYS, LogRequirement.OPEN_LOOP),
    form_over="shaft_rpm",
)
SHAFT_VOLTAGE_SAG = EffectRow("shaft.voltage_sag", 3.0, (0.5,), form_over="supply_v")
SHAFT_LOAD_DROOP = EffectRow(
    "shaft.load_droop",
    6.0,
    (1.0,),
    needs=(LogRequirement.OPENING,),
    form_over="opening_mm",
    at_end=True,
)
SHAFT_COARSE_ENCODER = EffectRow(
    "shaft.coarse_encoder", 4.0, found_by=FoundBy.STEPS, costs=CostKind.NEITHER
)
SHAFT_STALL = EffectRow("shaft.stall", 1.0, found_by=FoundBy.STOP)
GATE_OFFSET = EffectRow("gate.offset", 1.5, (0.1,), form_over="opening_mm")
GATE_HOME_ERROR = EffectRow("gate.home_error", 1.5, (0.1,), form_over="opening_mm")
GATE_BACKLASH = EffectRow(
    "gate.backlash",
    0.8,
    (0.02, 0.06, 0.15, 0.4, 1.0, 2.5),
    needs=(LogRequirement.MOVES, LogRequirement.OPENINGS),
)
GATE_LOST_STEPS = EffectRow("gate.lost_steps", 0.3, (0.02,), may_begin=False)
GATE_SLOW = EffectRow(
    "gate.slow",
    8.0,
    (0.4, 1.5, 5.0, 10.0, 15.0),
    needs=(LogRequirement.MOVES, LogRequirement.OPENINGS),
    moves="slew_mm_s",
    costs=CostKind.PLACE,
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
FLOW_BATCH = EffectRow("flow.batch", 6.0, (1.0,), needs=(LogRequirement.REFILL,), may_begin=False)
FLOW_BLOCKED_OUTLET = EffectRow("flow.blocked_outlet", 17.0, (2.0,), FoundBy.ONSET)
FLOW_OUTLET_UNEVEN = EffectRow("flow.outlet_uneven", 6.0)
FLOW_BRIDGING = EffectRow("flow.bridging", 10.0, found_by=FoundBy.STANDSTILL)
FLOW_LEAK = EffectRow("flow.leak", 20.0, (1.0,))
FLOW_SLOPE = EffectRow("flow.slope", 1.0, (0.2,), form_over="pitch_deg")
FLOW_PULSATION = EffectRow("flow.pulsation", 10.0, costs=CostKind.NEITHER)
SCALE_GAIN = EffectRow("scale.gain", 4.0, (0.2,))
SCALE_DRIFT = EffectRow("scale.drift", 3.0, (0.5,), form_over="time_s", may_begin=False)
SCALE_TILT = EffectRow("scale.tilt", 0.5, (0.05,), form_over="pitch_deg")
SPEED_WHEEL_SLIP = EffectRow("speed.wheel_slip", 4.0, (0.5,), form_over="pitch_deg", only_adds=True)
SPEED_WHEEL_RADIUS = EffectRow("speed.wheel_radius", 3.0, (0.5,))
SPEED_MISSED_PULSES = EffectRow("speed.missed_pulses", 5.0, (0.5,), FoundBy.DIPS)
SPEED_GNSS_LATENCY = EffectRow("speed.gnss_latency", 0.3, (0.1, 0.3, 0.8), costs=CostKind.PLACE)
CANOPY_HEAD_FOULED = EffectRow("canopy.head_fouled", 8.0, (1.0,), costs=CostKind.CROP)
CANOPY_WARM_UP = EffectRow("canopy.warm_up", 8.0, costs=CostKind.CROP)
CANOPY_SATURATION = EffectRow("canopy.saturation", 8.0, costs=CostKind.CROP)
LAG_OFFSET = EffectRow("lag.offset", 0.2, costs=CostKind.PLACE)
LAG_REBOUND = EffectRow("lag.rebound", 0.2, only_adds=True, costs=CostKind.PLACE)
LAG_FIRST_FILL = EffectRow("lag.first_fill", 0.4, only_adds=True, costs=CostKind.PLACE)
LAG_ASYMMETRY = EffectRow("lag.asymmetry", 0.2, costs=CostKind.PLACE)
LAG_COARSE_CLOCK = EffectRow("lag.coarse_clock", 0.1, costs=CostKind.NEITHER)
LAG_SPEED_SCALE = EffectRow("lag.speed_scale", 5.0, costs=CostKind.PLACE)
PLACE_LEVER_ARM = EffectRow("place.lever_arm", 1.0, costs=CostKind.PLACE)
PLACE_LATENCY = EffectRow("place.latency", 0.3, costs=CostKind.PLACE)
# Effort: friction rises by some ten per cent before it is audible, drag as much; a missing load is
# 100 %.
EFFORT_FRICTION = EffectRow("effort.friction", 20.0, (5.0,), only_adds=True, costs=CostKind.NEITHER)
EFFORT_DRAG = EffectRow("effort.drag", 20.0, (5.0,), costs=CostKind.NEITHER)
EFFORT_LOAD = EffectRow("effort.load", 50.0, (10.0,), costs=CostKind.NEITHER)
EFFORT_GATE_FRICTION = EffectRow(
    "effort.gate_friction", 20.0, (5.0,), only_adds=True, costs=CostKind.NEITHER
)
EFFORT_GATE_DRAG = EffectRow("effort.gate_drag", 20.0, (5.0,), costs=CostKind.NEITHER)

EFFECT_ROWS: dict[str, EffectRow] = {
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
_unmatched = sorted(set(EFFECT_ROWS) ^ set(CATALOGUE))
if _unmatched:
    raise RuntimeError(f"effects without a row, or rows without an effect: {', '.join(_unmatched)}")


def find_size_range(effect_id: str, machine: Machine) -> SizeBounds:
    """Return the range of an effect's size on top of a machine file's: that of the catalogue,
    limited where a time would become negative. Raises KeyError.

    The model limits negative times to zero, so a larger size predicts the same.
    """
    low, high = find_size_bounds(effect_id, machine)
    least = {"dead_time_s": 0.0, "time_constant_s": MIN_TIME_CONSTANT_S}.get(
        EFFECT_ROWS[effect_id].moves
    )
    if least is None:
        return SizeBounds(low, high)
    entry = CATALOGUE[effect_id]
    stage = getattr(machine, entry.stage)
    total = getattr(stage, EFFECT_ROWS[effect_id].moves) + getattr(stage, entry.field)
    return SizeBounds(max(low, min(0.0, least - total)), high)
