"""Which values do the steps of a tick pass to each other? All of them are frozen."""

from __future__ import annotations

from typing import NamedTuple

from topdress.control.machine.change_lag import LagParts
from topdress.control.metering.inverse_model import Conditions
from topdress.control.metering.strategies import DrivePair
from topdress.control.orders import TargetSource
from topdress.control.readings import Measurements
from topdress.control.sensing import SensedMotion, SpeedForecast
from topdress.control.targets.lag_correction import FiredChange
from topdress.control.targets.target_profile import Target


class OperatorChoices(NamedTuple):
    """Holds the operator's choices, which start as the job's."""

    source: TargetSource
    manual_rate_kg_ha: float
    look_ahead: bool
    flow_trim_on: bool
    # Whether ground that already has material gets no more.
    no_double: bool
    nudge_percent: float = 0.0
    # Sections closed by hand, counted from 1, left to right.
    sections_off: tuple[int, ...] = ()


class MeasuredState(NamedTuple):
    """Holds the measured state at the start of the decisions of a tick."""

    m: Measurements
    sensed: SensedMotion
    conditions: Conditions
    # Time since the tick before, at most 1 s.
    dt_s: float
    # Ground speed, m/s; 0 where unknown.
    speed_mps: float
    # Expected speed ahead.
    ahead: SpeedForecast


class TickDecision(NamedTuple):
    """Holds the decision on flow and sections, before safety."""

    holding: Target
    # Rate of `holding` with the nudge, kg/ha.
    planned_kg_ha: float
    # Metered rate: the planned rate, limited to the crop's maximum, kg/ha.
    rate_kg_ha: float
    # Lag of a small change from the present rate.
    lag: LagParts
    # Whether material released now lands inside the field; None where no field is known.
    inside: bool | None
    pair: DrivePair
    # Highest speed at which changes are still made in time, m/s; infinite for any speed.
    usable_mps: float
    fired: tuple[FiredChange, ...]
    by_point: bool
    # Planned open share of the working width when the set-points take effect.
    open_share: float


class MeteredMaterial(NamedTuple):
    """Holds the material that leaves the outlets, by measured shaft and opening through the
    model; None means unknown."""

    # Flow without the scale's correction, kg/s.
    flow_kg_s: float | None
    # Rate over the ground under the open width, kg/ha.
    rate_kg_ha: float | None
    # Correction factor from the scale.
    trim: float
    # Rate from the shaft speed and opening that the model expects now, kg/ha.
    expected_rate_kg_ha: float | None
    # Distance until the hopper is empty, m.
    metres_left_m: float | None
    # Open share of the working width by the expected positions of the valves.
    open_share: float
