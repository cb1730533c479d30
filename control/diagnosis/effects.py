"""How a diagnosis treats each effect of the catalogue: one row an effect, and no second list.

A new effect is its parameter in its stage's file (control/machine) and its row here: an effect without a row is an
error at import, and so is a row without an effect. Sizes are in the unit that the catalogue gives the effect, and those
of the nominal machine; `Row.on` gives another's.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from control.machine.effect import OPENING_RANGE
from control.machine.machine import CATALOGUE, Bounds, Machine, bounds, of_nominal, size_scale
from control.machine.shaft import LEAST_LAG_S

THRESHOLD_RATIO = 1.25              # of a threshold to the one tried below it
MIN_THRESHOLD_SHARE = 0.01          # of the highest shaft speed: a shaft that is asked for less stands still


class FoundBy(Enum):
    """How a run log shows an effect."""

    SCAN = "scan"                   # its column held against the whole log
    ONSET = "onset"                 # never there from the start: scanned with the time at which it begins
    STOP = "stop"                   # a drive that stands still to the end of the log
    DIPS = "dips"                   # single readings of the wheel far too low; in a coarse log by the scan
    STANDSTILL = "standstill"       # spells in which the scale stands still although the shaft turns
    STEPS = "steps"                 # shaft speeds that come in steps


class Costs(Enum):
    """What an effect costs in the field when nobody knows of it."""

    DOSE = "dose"
    PLACE = "place"
    NEITHER = "neither"             # it is wrong in what is reported, or evens out
    CROP = "crop"                   # depends on the crop that the heads look at: left open


@dataclass(frozen=True, slots=True)
class Row:
    """What a diagnosis must know of an effect besides its place in the model."""

    id: str
    usual: float                        # s.d. of its prior: what such effects usually are, in its unit

    # -- how its column is made
    probe: float | None = None          # size at which the slope of a straight-line effect is taken
    trial_sizes: tuple[float, ...] = ()      # sizes tried, where what it does is no straight line in its size
    slope_step: float | None = None     # difference of size for its slope; None: the probe, or 2 % of the size
    threshold: bool = False             # acts on all commands below its size: it has no slope, it is sought on a grid

    # -- where a run log shows it
    found_by: FoundBy = FoundBy.SCAN
    also_on: tuple[str, ...] = ()       # channels besides its own stage's that it moves
    needs_refill: bool = False          # shows only after the hopper was filled up
    min_move_mm: float = 0.0            # the opening's command must move so far (1st to 99th percentile)
    needs: str = ""                     # recorded variable without which it looks like others
    open_loop: bool = False             # none in a drive that holds its speed by its own encoder
    both_ways: bool = False             # shows only where commands turn the shaft either way
    seen_in_steps: bool = True          # can be seen where the shaft's speed is read in steps

    # -- what it may be taken for
    form_over: str = ""                 # recorded variable over which its form may differ from the catalogue's
    siblings: tuple[str, ...] = ()      # effects of nearly the same form: its own form may lean towards theirs
    moves: str = ""                     # nominal value of its stage that it adds to: that value's tolerance is its own
    unties: tuple[str, ...] = ()        # effects that no nominal value off its tolerance does where this one is there
    along: str = ""                     # slow variable that it follows: tested again with that variable shifted in time
    move_shaped: bool = False           # shows at each move of a drive, as a command missing from the log does

    # -- when it begins
    may_begin: bool = True              # whether it may begin in the middle of a run
    ends: float = 1.0                   # how much rarer than others it comes and goes by itself
    loss_begins_as: str = ""            # effect that such a loss is called where it begins in mid-run

    # -- in bench tables
    only_adds: bool = False             # something lost or extra: never less of it than the machine file has
    constant_time: bool = False         # the same time in every row, as the steps of a coarse clock may make it
    half_looks_like: tuple[str, ...] = ()       # effects that half of it, all on one of two sides, may be taken for
    scoped_in: tuple[str, ...] = ()     # kinds of tables in which it may hold for one label or one table only

    # -- what it costs
    costs: Costs = Costs.DOSE

    def on(self, machine: Machine) -> Row:
        """The row with the sizes that are natural on a machine: shares of its ranges."""
        scale, opening = size_scale(self.id, machine), of_nominal(machine, OPENING_RANGE)
        trial_sizes = tuple(scale * size for size in self.trial_sizes)
        if self.threshold:
            trial_sizes = (*_finer(trial_sizes[0], machine), *trial_sizes)
        return replace(self, usual=scale * self.usual, probe=None if self.probe is None else scale * self.probe,
                       trial_sizes=trial_sizes,
                       slope_step=None if self.slope_step is None else scale * self.slope_step,
                       min_move_mm=opening * self.min_move_mm)

    @property
    def stage(self) -> str:
        """Stage of the machine model that has the effect's parameter."""
        return CATALOGUE[self.id].stage

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of a run log that the effect moves, its own first; empty where no run log shows its stage."""
        own = {"fall": (), "flow": ("scale",)}.get(self.stage, (self.stage,))
        return (*own, *self.also_on)

    @property
    def has_slope(self) -> bool:
        """Whether the prediction has a slope in its size."""
        return not (self.threshold or self.found_by is FoundBy.STEPS or CATALOGUE[self.id].effect.onset_only)


def _finer(lowest_rpm: float, machine: Machine) -> tuple[float, ...]:
    """Thresholds below the lowest trial size that this shaft's commands pass; none where no command is so low.

    A threshold below the lowest command that is ever given shows nowhere.
    """
    found: list[float] = []
    least = max(machine.limits.shaft_low_rpm, MIN_THRESHOLD_SHARE * machine.limits.shaft_high_rpm)
    while (lowest_rpm := lowest_rpm / THRESHOLD_RATIO) > least:
        found.insert(0, lowest_rpm)
    return tuple(found)


# What such effects usually are (`usual`), 1 s.d. of a normal about nothing: by what a machine in use departs from its
# data sheet before somebody repairs it. A prior of half or twice as much moves the log evidence by 0.7: an order of
# size will do. Gains of drives, wheel and feed rollers: some per cent (a spreader in order keeps its rate to 5 %,
# ISO 5690-1); of a scale on a machine that drives no less, and some kg/h of drift (a scale at rest: OIML R 76, class
# 4). Times: fractions of a second, as drives of this size take. Openings: a millimetre or two, as a worn spindle or a
# moved stop gives. Supply: as it droops from 14 to 12 V. Slope: a per cent a degree, as a hopper rests on its side.
# A blocked outlet is one of six.
SHAFT_GAIN = Row("shaft.gain", 3.0, probe=0.5, form_over="shaft_rpm", moves="gain_percent")
SHAFT_SLOW = Row("shaft.slow", 0.2, trial_sizes=(0.03, 0.1, 0.3, 0.8), siblings=("shaft.dead_time",),
                 moves="time_constant_s", seen_in_steps=False, move_shaped=True, costs=Costs.PLACE)
SHAFT_DEAD_TIME = Row("shaft.dead_time", 0.15, trial_sizes=(0.03, 0.1, 0.25, 0.6), siblings=("shaft.slow",),
                      moves="dead_time_s", seen_in_steps=False, move_shaped=True, costs=Costs.PLACE,
                      only_adds=True, constant_time=True, scoped_in=("lag",))
SHAFT_SECOND_ORDER = Row("shaft.second_order", 0.1, trial_sizes=(0.01, 0.04, 0.15, 0.5), siblings=("shaft.dead_time",),
                         unties=("shaft.slow",),    # of two orders the first is no data sheet's time constant
                         seen_in_steps=False, move_shaped=True, may_begin=False,    # a setting, a coupling
                         costs=Costs.PLACE, only_adds=True)
SHAFT_RAMP = Row("shaft.ramp", 0.5, trial_sizes=(0.05, 0.2, 1.0, 4.0), siblings=("shaft.slow",), seen_in_steps=False,
                 move_shaped=True, open_loop=True, may_begin=False,      # a setting; else the machine file's own limit
                 costs=Costs.PLACE, only_adds=True)
SHAFT_DEAD_BAND = Row("shaft.dead_band", 20.0, trial_sizes=(11.0, 13.0, 16.0, 20.0, 25.0, 31.0, 40.0), threshold=True)
SHAFT_DEAD_ZONE = Row("shaft.dead_zone", 10.0, trial_sizes=(2.0, 8.0, 20.0, 40.0), form_over="shaft_rpm",
                      only_adds=True, open_loop=True)
SHAFT_SATURATION = Row("shaft.saturation", 15.0, trial_sizes=(3.0, 12.0, 30.0, 60.0), form_over="shaft_rpm",
                       only_adds=True, open_loop=True)
SHAFT_BACK_GAIN = Row("shaft.back_gain", 5.0, probe=0.5, form_over="shaft_rpm", both_ways=True)
SHAFT_BACK_ZONE = Row("shaft.back_zone", 5.0, probe=0.5, form_over="shaft_rpm", both_ways=True, open_loop=True)
SHAFT_VOLTAGE_SAG = Row("shaft.voltage_sag", 3.0, probe=0.5, form_over="supply_v", along="supply_v")
SHAFT_LOAD_DROOP = Row("shaft.load_droop", 6.0, probe=1.0, form_over="opening_mm", needs="opening_mm")
SHAFT_COARSE_ENCODER = Row("shaft.coarse_encoder", 4.0, found_by=FoundBy.STEPS, costs=Costs.NEITHER)
SHAFT_STALL = Row("shaft.stall", 1.0, found_by=FoundBy.STOP)
GATE_OFFSET = Row("gate.offset", 1.5, probe=0.1, form_over="opening_mm", also_on=("scale",))
GATE_HOME_ERROR = Row("gate.home_error", 1.5, probe=0.1, form_over="opening_mm")
GATE_BACKLASH = Row("gate.backlash", 0.8, trial_sizes=(0.02, 0.06, 0.15, 0.4, 1.0, 2.5), min_move_mm=2.0,
                    move_shaped=True)
GATE_LOST_STEPS = Row("gate.lost_steps", 0.3, probe=0.02, may_begin=False)
GATE_SLOW = Row("gate.slow", 8.0, trial_sizes=(0.4, 1.5, 5.0, 10.0, 15.0), moves="slew_mm_s", min_move_mm=2.0,
                move_shaped=True, costs=Costs.PLACE)
GATE_STUCK = Row("gate.stuck", 1.0, found_by=FoundBy.STOP)
FLOW_GAIN = Row("flow.gain", 6.0, probe=1.0, loss_begins_as="flow.blocked_outlet", scoped_in=("catch",))
FLOW_ZERO_OFFSET = Row("flow.zero_offset", 6.0, probe=1.0, form_over="opening_mm")
FLOW_FILL_FALLOFF = Row("flow.fill_falloff", 6.0, probe=1.0, form_over="shaft_rpm", only_adds=True)
FLOW_HOPPER_HEAD = Row("flow.hopper_head", 6.0, probe=1.0, form_over="hopper_kg")
FLOW_MOISTURE_DRIFT = Row("flow.moisture_drift", 5.0, probe=1.0, form_over="time_s", may_begin=False)
FLOW_BATCH = Row("flow.batch", 6.0, probe=1.0, needs_refill=True, may_begin=False)
FLOW_BLOCKED_OUTLET = Row("flow.blocked_outlet", 17.0, probe=2.0, found_by=FoundBy.ONSET)
FLOW_OUTLET_UNEVEN = Row("flow.outlet_uneven", 6.0)
FLOW_BRIDGING = Row("flow.bridging", 10.0, found_by=FoundBy.STANDSTILL)
FLOW_LEAK = Row("flow.leak", 20.0, probe=1.0)
FLOW_SLOPE = Row("flow.slope", 1.0, probe=0.2, form_over="pitch_deg", along="pitch_deg")
FLOW_PULSATION = Row("flow.pulsation", 10.0, costs=Costs.NEITHER)
SCALE_GAIN = Row("scale.gain", 4.0, probe=0.2)
SCALE_DRIFT = Row("scale.drift", 3.0, probe=0.5, form_over="time_s", may_begin=False)
SCALE_TILT = Row("scale.tilt", 0.5, probe=0.05, form_over="pitch_deg", along="pitch_deg")
SPEED_WHEEL_SLIP = Row("speed.wheel_slip", 4.0, probe=0.5, form_over="pitch_deg", only_adds=True)
SPEED_WHEEL_RADIUS = Row("speed.wheel_radius", 3.0, probe=0.5)
SPEED_MISSED_PULSES = Row("speed.missed_pulses", 5.0, probe=0.5, found_by=FoundBy.DIPS)
SPEED_GNSS_LATENCY = Row("speed.gnss_latency", 0.3, trial_sizes=(0.1, 0.3, 0.8), slope_step=0.05,      # two rows of it
                         costs=Costs.PLACE)
# Dirt stays where it is; what wanders off and comes back is nearly always the sensor, which warms up and cools down.
CANOPY_HEAD_FOULED = Row("canopy.head_fouled", 8.0, probe=1.0, ends=0.01, costs=Costs.CROP)
CANOPY_WARM_UP = Row("canopy.warm_up", 8.0, costs=Costs.CROP)
CANOPY_SATURATION = Row("canopy.saturation", 8.0, costs=Costs.CROP)
LAG_OFFSET = Row("lag.offset", 0.2, costs=Costs.PLACE, constant_time=True, scoped_in=("lag",))
LAG_REBOUND = Row("lag.rebound", 0.2, costs=Costs.PLACE, only_adds=True)
LAG_FIRST_FILL = Row("lag.first_fill", 0.4, costs=Costs.PLACE, only_adds=True)
LAG_ASYMMETRY = Row("lag.asymmetry", 0.2, costs=Costs.PLACE, half_looks_like=("lag.offset", "shaft.dead_time"))
LAG_COARSE_CLOCK = Row("lag.coarse_clock", 0.1, costs=Costs.NEITHER)
LAG_SPEED_SCALE = Row("lag.speed_scale", 5.0, costs=Costs.PLACE, scoped_in=("lag",))
PLACE_LEVER_ARM = Row("place.lever_arm", 1.0, costs=Costs.PLACE, scoped_in=("place",))
PLACE_LATENCY = Row("place.latency", 0.3, costs=Costs.PLACE, scoped_in=("place",))

ROWS: dict[str, Row] = {row.id: row for row in list(globals().values()) if isinstance(row, Row)}
_unmatched = sorted(set(ROWS) ^ set(CATALOGUE))
if _unmatched:
    raise RuntimeError(f"effects without a row, or rows without an effect: {', '.join(_unmatched)}")


def reach(effect_id: str, machine: Machine) -> Bounds:
    """Range of an effect's size on top of a machine file: that of the catalogue, and no time that it adds to falls
    below nothing (the model holds it there: what is further off predicts the same). Raises KeyError."""
    low, high = bounds(effect_id, machine)
    least = {"dead_time_s": 0.0, "time_constant_s": LEAST_LAG_S}.get(ROWS[effect_id].moves)
    if least is None:
        return Bounds(low, high)
    entry = CATALOGUE[effect_id]
    stage = getattr(machine, entry.stage)
    total = getattr(stage, ROWS[effect_id].moves) + getattr(stage, entry.field)
    return Bounds(max(low, min(0.0, least - total)), high)
