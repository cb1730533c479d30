"""Which values do the steps of a tick pass on to each other? All of them are frozen."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.machine.change_lag import Lag
from topdress.control.metering.inverse import Conditions
from topdress.control.metering.strategies import Pair
from topdress.control.orders import TargetSource
from topdress.control.readings import Measurements
from topdress.control.sensing import Sensed, SpeedAhead
from topdress.control.targets.lag_correction import FiredChange
from topdress.control.targets.profile import Target


class Choices(NamedTuple):
    """Holds the operator's choices; at first they are the job's."""

    source: TargetSource
    manual_rate_kg_ha: float
    look_ahead: bool
    flow_trim_on: bool
    no_double: bool  # ground that has its material gets no more
    nudge_percent: float = 0.0
    sections_off: tuple[int, ...] = ()  # by hand, counted from 1, left to right


class Moment(NamedTuple):
    """Holds what is known when a tick begins to decide."""

    m: Measurements
    sensed: Sensed
    conditions: Conditions
    dt_s: float  # since the tick before, at most 1 s
    speed_mps: float  # 0 where it is not known
    ahead: SpeedAhead  # how fast it will go


class TickDecision(NamedTuple):
    """Holds what the machine is to do, before safety."""

    holding: Target
    planned_kg_ha: float  # of `holding`, nudged
    # the same, at most the crop's limit: what is metered
    rate_kg_ha: float
    lag: Lag  # of a small change from what is held
    # what is released now lands inside the field; None: no field is known
    inside: bool | None
    pair: Pair
    # highest speed at which changes are still made in time; infinite: any
    usable_mps: float
    fired: tuple[FiredChange, ...]
    by_point: bool
    # of the working width that is to be open where the pair will show
    open_share: float


class Metered(NamedTuple):
    """Holds what leaves the outlets, by measured shaft and opening through the model; None:
    unknown."""

    flow_kg_s: float | None  # without the scale's correction
    rate_kg_ha: float | None  # the same over the ground under what is open
    trim: float  # the scale's correction
    # from the shaft and the opening that the set-points should give by now
    expected_rate_kg_ha: float | None
    metres_left_m: float | None  # until the hopper is empty
    # of the working width, as the valves should stand by now
    open_share: float
