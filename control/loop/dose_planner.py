"""Which dose is due in this tick of point mode? No dose is due outside the field, and no plant
gets two doses.
"""

from __future__ import annotations

from math import inf

from topdress.control.field.job_totals import Totals
from topdress.control.geodesy import offset_place
from topdress.control.log_row import DOSE_EVENT
from topdress.control.loop.tick_state import MeasuredState, OperatorChoices
from topdress.control.loop.way_ahead import DOSE_PROFILE, WayAhead
from topdress.control.machine.machine import Machine
from topdress.control.metering.inverse_model import Conditions, calc_flow_kg_s
from topdress.control.orders import State, TargetSource
from topdress.control.readings import DoseOrder, Measurements
from topdress.control.safety import DriveLimits, SafetyVerdict, limit_dose
from topdress.control.sensing import SensedMotion
from topdress.control.targets.boundary_profile import OUTSIDE_TARGET
from topdress.control.targets.canopy_target import STRAIGHT_BELOW_DEG_S
from topdress.control.targets.plant_doser import PlantDoser
from topdress.control.targets.point_mode import DoseThreshold
from topdress.control.targets.target_profile import Target


class DosePlanner:
    """Plans the doses of a run. `ahead_m`: distance of the newest dose's plant ahead of the
    outlet at its order, m."""

    def __init__(
        self, machine: Machine, points: PlantDoser, ahead: WayAhead, limits: DriveLimits
    ) -> None:
        self.points = points
        self.ahead_m = 0.0
        self._machine = machine
        self._ahead = ahead
        self._limits = limits

    def look_for_plants(self, m: Measurements, sensed: SensedMotion) -> None:
        """Adds the plants ahead, except in turns and while reversing."""
        place = None
        # In a turn a straight line ahead would meet plants of other rows.
        straight = abs(sensed.turn_deg_s) <= STRAIGHT_BELOW_DEG_S and not sensed.backwards
        if (
            straight
            and sensed.position_ok
            and sensed.east_m is not None
            and sensed.north_m is not None
        ):
            place = (sensed.east_m, sensed.north_m)
        self.points.look_for_plants(
            sensed.time_s,
            sensed.track_m,
            place,
            sensed.heading_deg,
            sensed.speed_mps or 0.0,
            m.plants,
        )

    @property
    def max_speed_mps(self) -> float:
        """Returns the ground speed above which doses are missed, m/s."""
        return self.points.max_speed_mps

    @property
    def threshold(self) -> DoseThreshold:
        """Returns the learnt dose threshold."""
        return self.points.mode.threshold

    def are_chosen(self, choices: OperatorChoices) -> bool:
        """Returns whether plants are the source of the target."""
        return choices.source is TargetSource.POINT

    def may_still_be_turning(self, now_s: float) -> bool:
        """Returns whether the shaft may still be turning for an ordered dose."""
        return self.points.may_still_be_turning(now_s)

    def find_target(self, sensed: SensedMotion, may_outside: bool) -> Target:
        """Returns the target for doses: a dose where the next would land inside the field,
        otherwise zero."""
        fence = self._ahead.fence
        if fence is None or may_outside:
            return DOSE_PROFILE.target
        # A dose lands at the reach, so this place and not the outlet must be inside.
        inside = fence.is_inside(sensed.track_m + self.points.find_reach_m(sensed.speed_mps or 0.0))
        return DOSE_PROFILE.target if inside else OUTSIDE_TARGET

    def find_due_dose(
        self, moment: MeasuredState, choices: OperatorChoices, verdict: SafetyVerdict
    ) -> tuple[DoseOrder | None, list[str]]:
        """Returns the dose for this tick, and doses and missed plants as events of the row."""
        sensed = moment.sensed
        # A plant of an earlier part of the job keeps its dose.
        at_work = verdict.state is State.WORKING and not self.is_dosed_earlier(
            sensed, choices.no_double
        )
        due = self.points.find_due_dose(
            sensed.time_s,
            sensed.track_m,
            moment.speed_mps,
            moment.dt_s,
            verdict.flow_allowed,
            at_work,
        )
        events = [f"dose_missed {why}" for why in due.missed]
        if due.dose is None:
            return None, events
        more = due.dose._replace(
            # The operator's correction turns the shaft further; the rate follows the angle.
            angle_deg=round(due.dose.angle_deg * (1.0 + choices.nudge_percent / 100.0), 3)
        )
        # Safety has the last word on a dose as on a rate.
        dose = limit_dose(more, self._limits, verdict.flow_allowed)
        if dose is not None:
            # The distance is recorded when the dose is ordered, since the machine moves on.
            self.ahead_m = self.points.given[-1].plant_m - sensed.track_m
            events.append(f"{DOSE_EVENT}{dose.angle_deg:g}")
        return dose, events

    def is_dosed_earlier(self, sensed: SensedMotion, no_double: bool) -> bool:
        """Returns whether the plant of a dose commanded now got its dose in an earlier part of
        the job."""
        if (
            not no_double
            or sensed.east_m is None
            or sensed.north_m is None
            or sensed.heading_deg is None
        ):
            return False
        ahead_m = self.points.find_reach_m(sensed.speed_mps or 0.0)
        return self._ahead.overlap.is_done_earlier(
            offset_place((sensed.east_m, sensed.north_m), sensed.heading_deg, ahead_m)
        )

    def calc_rate_kg_ha(self, c: Conditions) -> float:
        """Returns the rate of the doses at the mean spacing of the last ones, kg/ha; 0 before
        the second."""
        spacing_m = self.points.recent_dose_spacing_m
        # Without two doses no spacing is known.
        if not spacing_m:
            return 0.0
        angle_deg, shaft_rpm = self.points.dose
        flow = calc_flow_kg_s(self._machine, shaft_rpm, self._machine.set_points.opening_mm, c)
        # 6 n degrees per second is the angular speed of a shaft at n r/min.
        dose_kg = flow * angle_deg / (6.0 * shaft_rpm)
        return dose_kg * 10_000.0 / (spacing_m * self._machine.geometry.working_width_m)

    def add_dose_counts(self, totals: Totals) -> Totals:
        """Returns the totals with the numbers of doses."""
        return totals._replace(doses=self.points.doses, doses_missed=self.points.missed)


# The neutral object saves a condition at each use in the loop.
class NoDosePlanner:
    """Replaces `DosePlanner` in a job without plants: no dose is ever due."""

    ahead_m = 0.0
    max_speed_mps = inf
    threshold = None

    def look_for_plants(self, m: Measurements, sensed: SensedMotion) -> None:
        pass

    def are_chosen(self, choices: OperatorChoices) -> bool:
        return False

    def may_still_be_turning(self, now_s: float) -> bool:
        return False

    def find_target(self, sensed: SensedMotion, may_outside: bool) -> Target:
        return OUTSIDE_TARGET

    def find_due_dose(
        self, moment: MeasuredState, choices: OperatorChoices, verdict: SafetyVerdict
    ) -> tuple[DoseOrder | None, list[str]]:
        return None, []

    def is_dosed_earlier(self, sensed: SensedMotion, no_double: bool) -> bool:
        return False

    def calc_rate_kg_ha(self, c: Conditions) -> float:
        return 0.0

    def add_dose_counts(self, totals: Totals) -> Totals:
        return totals
