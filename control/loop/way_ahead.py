"""What lies along the path ahead? The field's edge, its headland, ground that already has
material, the map, the canopy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import cos, inf, radians, sin

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.field.coverage import Coverage
from topdress.control.field.done_ground import DoneGround
from topdress.control.field.job import Job
from topdress.control.loop.canopy_heads import CanopyHeads
from topdress.control.loop.section_control import SectionControl
from topdress.control.loop.tick_state import MeasuredState, OperatorChoices
from topdress.control.machine.change_lag import LagParts
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.steps import CompiledSteps
from topdress.control.metering.rate_range import find_least_rate_kg_ha
from topdress.control.orders import TargetSource
from topdress.control.readings import OUTSIDE_RATE_VALID, Measurements, is_reading_fresh
from topdress.control.sensing import SensedMotion
from topdress.control.targets.boundary_profile import OUTSIDE_TARGET, BoundaryAhead, BoundedProfile
from topdress.control.targets.canopy_target import (
    CanopyDecisions,
    MapAndCanopy,
    MeanRateHold,
    RateBounds,
)
from topdress.control.targets.done_ground_ahead import MAX_TICK_WAY_M, DoneGroundAhead
from topdress.control.targets.external_target import ExternalTarget
from topdress.control.targets.index_map import IndexMap
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.section_ground import SectionsGround
from topdress.control.targets.target_profile import (
    ConstantProfile,
    DecidedStretches,
    Target,
    TargetProfile,
    UnspreadProfile,
)

# Cell size of the coverage bitmap, m.
CELL_M = 0.2
# Validity of a rate that another controller reports as applied, s: the same as for a target from
# such a display.
APPLIED_VALID_S = OUTSIDE_RATE_VALID.control_s
# Doses have no rate, so the profile of point mode is constant.
DOSE_PROFILE = ConstantProfile(Target(0.0, TargetSource.POINT))


class WayAhead:
    """Looks ahead once a tick, and then provides the profile of targets."""

    def __init__(
        self,
        machine: Machine,
        crop: Crop,
        rule: CropRule,
        job: Job,
        fence: BoundaryAhead | None,
        headland: BoundaryAhead | None,
        *,
        prescription: MapProfile | None,
        index_map: IndexMap | None = None,
        zone_map: IndexMap | None = None,
        done: DoneGround | None = None,
        steps: CompiledSteps | None = None,
    ) -> None:
        """Creates the object before its first look. steps: compiled steps for long runs."""
        geometry, width_m = machine.geometry, machine.geometry.working_width_m
        self._machine = machine
        self.fence = fence
        self.map = prescription
        rate = job.field.headland_rate_kg_ha
        # Without a rate of its own the headland is treated as the rest of the field.
        self._headland = None if rate is None else headland
        self._headland_target = Target(rate or 0.0, TargetSource.MANUAL)
        # At least six cells across a narrow machine resolve its sections.
        cell_m = min(CELL_M, width_m / 6.0)
        self.overlap = DoneGroundAhead(
            Coverage(
                width_m,
                cell_m,
                longest_m=MAX_TICK_WAY_M,
                strips=[(strip.left_m, strip.right_m) for strip in machine.switched_strips],
                steps=steps,
            ),
            geometry.outlets,
        )
        self.sections = SectionControl(machine, job.section_overlap_percent, cell_m)
        mean = job.target.hold_mean_kg_ha
        self.hold = None if mean is None else MeanRateHold(mean)
        self._around = RateBounds(job.target.around_percent, job.target.around_kg_ha)
        self.heads = CanopyHeads(
            geometry.heads,
            CanopyDecisions(
                rule,
                geometry.heads_m,
                job.target.decision_hz,
                DecidedStretches(crop.fallback_rate_kg_ha, first_reach_m=geometry.heads_m),
                self.hold,
            ),
            crop.index,
            index_map,
            geometry.heads_m,
            zone_map,
        )
        # Distance without a known position on which material landed, m, and whether that ground is
        # done; set in the tick in which the position is known again.
        self.unplaced: tuple[float, bool] | None = None
        # Ground of another job is done and does not count as this job's work.
        if done is not None:
            self.overlap.add_earlier_ground(done.raster, ours=False)
        self._fallback = ConstantProfile(Target(crop.fallback_rate_kg_ha, TargetSource.FALLBACK))
        self.outside_target = ExternalTarget(
            job.target.external_silent_kg_ha or 0.0,
            job.target.external_holds_s,
            partial(find_least_rate_kg_ha, machine),
        )

    def look_ahead(
        self, m: Measurements, sensed: SensedMotion, fired_to_m: float, no_double: bool
    ) -> None:
        """Looks ahead. Changes up to `fired_to_m` of the track were made and keep their
        position."""
        self.heads.fuse_and_decide(m, sensed)
        self.outside_target.take_reading(m.rate_asked, m.time_s, sensed.speed_mps or 0.0)
        self._look_at_edges(sensed, fired_to_m)
        self._look_at_done(m, sensed, fired_to_m, no_double)
        self._look_at_map(sensed, fired_to_m)

    def forget_view(self) -> None:
        """Clears the view ahead, because the position has jumped."""
        self.overlap.forget_view()
        self.sections.cancel_decisions()
        if self.map is not None:
            self.map.forget_place()

    def _look_at_edges(self, sensed: SensedMotion, fired_to_m: float) -> None:
        for fence in (self.fence, self._headland):
            if fence is None:
                continue
            # Without a position the edge ahead is unknown and must not be reused.
            if sensed.east_m is None or sensed.north_m is None or sensed.heading_deg is None:
                fence.forget_place()
            else:
                fence.look_ahead(
                    sensed.track_m, sensed.east_m, sensed.north_m, sensed.heading_deg, fired_to_m
                )

    def _look_at_done(
        self, m: Measurements, sensed: SensedMotion, fired_to_m: float, no_double: bool
    ) -> None:
        """Records material that lands here, and searches for done ground ahead."""
        place = None
        # Only a measured position may mark ground as done.
        if sensed.position_ok and sensed.east_m is not None and sensed.north_m is not None:
            place = (sensed.east_m, sensed.north_m)
        rpm = 0.0 if m.shaft_rpm is None else m.shaft_rpm.value
        said = m.rate_applied
        # A recorder has no shaft reading; the reported rate shows that material flows.
        turns = rpm >= 0.5 * self._machine.limits.shaft_low_rpm or (
            said is not None
            and said.value > 0.0
            and is_reading_fresh(said.time_s, m.time_s, APPLIED_VALID_S)
        )
        opened = self.sections.find_open_valves(sensed.time_s)
        released = (
            tuple([turns and on for on in opened]) if len(opened) > 1 else turns and opened[0]
        )
        self.unplaced = self.overlap.record_release(
            sensed.time_s,
            place,
            sensed.heading_deg,
            released,
            # Material lands after its drop time, at the position that the machine then has.
            calc_drop_s(self._machine.fall, rpm) if turns else 0.0,
            sensed.track_m,
        )
        # With sections each strip of ground is examined by itself.
        if no_double and not self.sections.strips:
            self.overlap.look_ahead(sensed.track_m, place, sensed.heading_deg, fired_to_m)

    def _look_at_map(self, sensed: SensedMotion, fired_to_m: float) -> None:
        if self.map is None:
            return
        if (
            sensed.east_m is None
            or sensed.north_m is None
            or sensed.heading_deg is None
            or not sensed.position_ok
        ):
            self.map.forget_place()
            return
        # A speed of at least 0.3 m/s keeps the curvature finite at standstill.
        turn_deg_m = sensed.turn_deg_s / max(0.3, sensed.speed_mps or 0.0)
        self.map.look_ahead(
            sensed.track_m,
            sensed.east_m,
            sensed.north_m,
            sensed.heading_deg,
            fired_to_m,
            turn_deg_m,
        )

    def make_profile(
        self, choices: OperatorChoices, may_outside: bool, spread_to_m: float = -inf
    ) -> TargetProfile:
        """Returns the profile of targets along the track: the chosen source, without done ground
        and ground outside the field.

        spread_to_m: after reversing, the profile is zero up to this position.
        """
        wanted = self._choose_profile(choices.source, choices.manual_rate_kg_ha)
        by_section = self._is_switched_by_section(choices)
        # A headland without a rate is switched by sections like an edge.
        if self._headland is not None and not (
            by_section and self._headland_target.rate_kg_ha <= 0.0
        ):
            wanted = BoundedProfile(wanted, self._headland, self._headland_target)
        if choices.no_double and not by_section:
            wanted = BoundedProfile(wanted, self.overlap, Target(0.0, choices.source))
        if spread_to_m > -inf:
            wanted = UnspreadProfile(wanted, spread_to_m, choices.source)
        # The edge is applied last, so that no source spreads outside the field.
        return (
            wanted
            if self.fence is None or may_outside or by_section
            else BoundedProfile(wanted, self.fence)
        )

    def _is_switched_by_section(self, choices: OperatorChoices) -> bool:
        """Returns whether each section is switched by its own strip of ground instead of the
        whole machine. Doses always use the whole machine."""
        return bool(self.sections.strips) and choices.source is not TargetSource.POINT

    def make_sections_ground(self, choices: OperatorChoices, may_outside: bool) -> SectionsGround:
        """Returns the ground that decides on the sections."""
        nothing = self._headland is not None and self._headland_target.rate_kg_ha <= 0.0
        by_map = self.map is not None and choices.source is TargetSource.MAP
        return SectionsGround(
            None if may_outside else self.fence,
            self._headland if nothing else None,
            self.overlap.coverage if choices.no_double else None,
            self.map.prescription if by_map and self.map is not None else None,
            (),
        )

    def _choose_profile(self, source: TargetSource, manual_rate_kg_ha: float) -> TargetProfile:
        if source is TargetSource.CANOPY:
            return self.heads.decisions.stretches
        if source is TargetSource.MAP and self.map is not None:
            return self.map
        if source is TargetSource.MAP_AND_CANOPY and self.map is not None:
            return MapAndCanopy(self.map, self.heads.decisions.stretches, self._around)
        if source is TargetSource.POINT:
            return DOSE_PROFILE
        if source is TargetSource.MANUAL:
            return ConstantProfile(Target(manual_rate_kg_ha, TargetSource.MANUAL))
        if source is TargetSource.EXTERNAL:
            return self.outside_target.profile
        # A source without its data gives the fallback rate.
        return self._fallback

    def list_source_rates(
        self, sources: tuple[TargetSource, ...], manual_rate_kg_ha: float, track_m: float
    ) -> tuple[float | None, ...]:
        """Returns the rate of each source here, kg/ha, without the nudge; None for single doses."""
        return tuple(
            [
                None
                if source is TargetSource.POINT
                else self._choose_profile(source, manual_rate_kg_ha).find_target(track_m).rate_kg_ha
                for source in sources
            ]
        )

    def is_landing_inside(
        self,
        moment: MeasuredState,
        holding: Target,
        stop: Callable[[], LagParts],
        choices: OperatorChoices,
        may_outside: bool,
    ) -> bool | None:
        """Returns whether material released now lands inside the field, from any section; None
        where no field is known.

        stop: returns the lag of a stop, where a stop is considered.
        """
        sensed = moment.sensed
        if self.fence is None:
            return None
        if sensed.east_m is None or sensed.north_m is None or sensed.heading_deg is None:
            return False
        # With sections, one section inside is enough to continue.
        if self._is_switched_by_section(choices) and not may_outside:
            return self.sections.is_any_inside(sensed.time_s)
        if not sensed.backwards and not may_outside:
            return holding != OUTSIDE_TARGET
        ahead_m = moment.ahead.predict_way_m(stop().total_s)
        if not sensed.backwards:
            return self.fence.is_inside(sensed.track_m + ahead_m)
        # While reversing, the edge is checked at the place behind the machine.
        angle = radians(sensed.heading_deg)
        return self.fence.edge.contains_place(
            sensed.east_m, sensed.north_m
        ) and self.fence.edge.contains_place(
            # Heading is clockwise from north: sine is east, cosine is north.
            sensed.east_m - ahead_m * sin(angle),
            sensed.north_m - ahead_m * cos(angle),
        )

    def is_done(self, place_m: float) -> bool:
        """Returns whether a position of the track already has material."""
        return not self.overlap.is_inside(place_m)

    def is_headland(self, place_m: float) -> bool:
        """Returns whether a position of the track is on a headland with its own rate."""
        return self._headland is not None and not self._headland.is_inside(place_m)
