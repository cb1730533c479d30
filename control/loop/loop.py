"""Runs one tick of control: measurements in, commands and a log row out, without clock, port or
file.
"""

from __future__ import annotations

from datetime import date
from math import inf, isfinite

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.growth_stage import assess_growth
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.field.coverage import Raster
from topdress.control.field.done_ground import DoneGround
from topdress.control.field.job import Job
from topdress.control.field.job_totals import Totaliser, Totals, TotalSums
from topdress.control.field.planned_speed import find_planned_mps
from topdress.control.geodesy import TangentPlane
from topdress.control.loop.canopy_heads import HEAD_LATENCY_S
from topdress.control.loop.dose_planner import DosePlanner, NoDosePlanner
from topdress.control.loop.effort_watch import EffortWatch
from topdress.control.loop.events import EventQueue
from topdress.control.loop.expected_drives import ExpectedDrives
from topdress.control.loop.known_terms import KnownTerms
from topdress.control.loop.look_ahead_distance import TickLookAhead
from topdress.control.loop.map_location_check import MapLocationCheck
from topdress.control.loop.order_handlers import LoopOrderHandler
from topdress.control.loop.reversing import ReversingWatch
from topdress.control.loop.section_control import SectionLeads
from topdress.control.loop.situation import make_situation
from topdress.control.loop.tick import Tick
from topdress.control.loop.tick_row import make_log_row, read_head_ndvi
from topdress.control.loop.tick_state import MeasuredState, MeteredMaterial, TickDecision
from topdress.control.loop.unintended_flow import (
    UnintendedFlow,
    calc_open_share,
    make_standing_limits,
)
from topdress.control.loop.way_ahead import APPLIED_VALID_S, WayAhead
from topdress.control.machine.change_lag import ChangeLags, LagParts
from topdress.control.machine.machine import Machine
from topdress.control.machine.product_calibration import find_newest_test_date
from topdress.control.machine.steps import CompiledSteps
from topdress.control.metering.flow_trim import FlowTrim
from topdress.control.metering.inverse_model import (
    Conditions,
    calc_conditions_factor,
    calc_flow_kg_s,
)
from topdress.control.metering.pair_planner import PairPlanner
from topdress.control.metering.rate_range import find_breach
from topdress.control.metering.strategies import DrivePair
from topdress.control.metering.trims import NO_ERROR, DriveTrim, TrimLimits
from topdress.control.orders import CANOPY_SOURCES, Answer, Do, Order, State, Strategy, TargetSource
from topdress.control.readings import (
    AnnouncedSpeeds,
    DriveCommand,
    Measurements,
    RangeBreach,
    Reading,
    describe_announcement,
    drop_impossible,
    is_reading_fresh,
)
from topdress.control.safety import (
    LOW_SUPPLY_SHARE,
    BenchRun,
    DriveLimits,
    Safety,
    SafetyLimits,
    SafetyVerdict,
    limit_command,
    limit_valves,
    make_refusal,
    select_machine_limits,
)
from topdress.control.sensing import SensedMotion, Sensing, SensingLimits, SpeedForecaster
from topdress.control.targets.boundary_profile import OUTSIDE_TARGET, BoundaryAhead
from topdress.control.targets.index_map import IndexMap
from topdress.control.targets.lag_correction import ChangeQueue
from topdress.control.targets.map_profile import MapProfile
from topdress.control.targets.plant_doser import PlantDoser
from topdress.control.targets.point_mode import DoseThreshold
from topdress.control.targets.target_profile import Target, TargetChange

# Maximum length of a tick, s; a longer tick counts as this.
MAX_TICK_S = 1.0
# Number of ticks with a stopped clock after which no reading is trusted: half a second at 20 Hz,
# the permitted silence of a drive.
MAX_STANDING_TICKS = 10
# Time after START for which a crop outside its growth window is reported, s.
GROWTH_REPORT_S = 15.0
# Reasons for a rule's rate of 0.
# A rate of 0 by fault, e.g. without a reading, has reasons of its own and is not in this list.
CANOPY_ZERO_REASONS = ("above_cutoff", "below_cutoff", "yield_reached", "no_zone")
# The mean of a job counts ground of these sources, since the fallback replaces the canopy there.
SOURCES_OF_CANOPY = (TargetSource.CANOPY, TargetSource.INDEX_MAP, TargetSource.FALLBACK)
ZERO_RATE_SOURCES = (
    TargetSource.MAP,
    TargetSource.MANUAL,
    TargetSource.FALLBACK,
    TargetSource.EXTERNAL,
)
# Minimum speed for a rate calculated from flow over speed, m/s.
# Below this speed the quotient of flow and speed grows without bound.
MIN_RATE_SPEED_MPS = 0.3


class ControlLoop:
    """Controls one run of one machine on one job. `handle_order` is called between ticks,
    `run_tick` once a control period."""

    def __init__(
        self,
        machine: Machine,
        crop: Crop,
        rule: CropRule,
        job: Job,
        fence: BoundaryAhead | None = None,
        has_work_switch: bool = False,
        *,
        safety_limits: SafetyLimits | None = None,
        prescription: MapProfile | None = None,
        points: PlantDoser | None = None,
        headland: BoundaryAhead | None = None,
        obeyed: bool = True,
        index_map: IndexMap | None = None,
        zone_map: IndexMap | None = None,
        done: DoneGround | None = None,
        steps: CompiledSteps | None = None,
        record_only: bool = False,
    ) -> None:
        """Starts a run.

        Parameters
        ----------
        machine, crop, rule, job : content of their files. fence, headland : edge of the field, and
        edge of a headland with its own rate. has_work_switch : whether a work switch is fitted.
        safety_limits : None for the published table. prescription, points : sources of map mode and
        point mode. obeyed : False where the drives follow other commands, as in a replayed log.
        index_map : replaces silent heads. zone_map : factors of the canopy's rule by position. done
        : ground that others have covered. steps : compiled steps for long runs. record_only :
        whether only the work of another controller's machine is recorded, without commands.
        """
        self.machine = machine
        self.crop = crop
        self.job = job
        limits = machine.limits
        # The limits of the last check before the drives are the machine's own, whatever the job
        # requests.
        self._drive_limits = DriveLimits(
            limits.shaft_low_rpm,
            limits.shaft_high_rpm,
            limits.opening_low_mm,
            limits.opening_high_mm,
        )
        # Limits that depend on the machine are derived here unless a test gives its own.
        allowed = safety_limits or make_standing_limits(
            machine,
            SafetyLimits(
                **{"supply_low_v": LOW_SUPPLY_SHARE * machine.shaft.nominal_supply_v}
                | select_machine_limits(limits)
            ),
        )
        self.safety = Safety(allowed, has_work_switch)
        self._stopped, self._record_only = (
            # A controller that only records has no drives that obey, so flow after a stop is not
            # its fault.
            UnintendedFlow(machine, allowed, obeyed and not record_only),
            record_only,
        )
        self._effort = EffortWatch(machine)
        self._sensing = Sensing(
            machine.geometry.antenna_m,
            # All positions need a single plane: map, field and plants must agree to the centimetre.
            _choose_plane(job, prescription, points, index_map or zone_map, done),
            SensingLimits(reckoned_m=_find_reckoning_limit_m(machine, prescription, points)),
        )
        self._ahead = WayAhead(
            machine,
            crop,
            rule,
            job,
            fence,
            headland,
            prescription=prescription,
            index_map=index_map,
            zone_map=zone_map,
            done=done,
            steps=steps,
        )
        # An object without doses replaces conditions at each place where point mode would differ.
        self._doses: DosePlanner | NoDosePlanner = (
            NoDosePlanner()
            if points is None
            else DosePlanner(machine, points, self._ahead, self._drive_limits)
        )
        # While reversing, ground that already has material passes the outlets again.
        self._backing = ReversingWatch(machine)
        self._near = MapLocationCheck(
            None if prescription is None else prescription.prescription, job.field.boundary_m
        )
        # Result of the newest tick.
        self._sensed: SensedMotion | None = None
        self._queue = ChangeQueue(Target(0.0, TargetSource.NONE))
        self._lags = ChangeLags(machine)
        self._setting = PairPlanner(machine, job.strategy)
        self._forecaster = SpeedForecaster()
        self._drive_trim = DriveTrim(TrimLimits(), still=1.0)
        self._flow_trim = FlowTrim(
            machine.noise.scale_kg,
            machine.noise.scale_correlation_s,
            outlets=machine.geometry.outlets,
            most_kg_s=calc_flow_kg_s(machine, limits.shaft_high_rpm, limits.opening_high_mm),
            scale=machine.scale,
        )
        # Unknown until a GNSS fix has a time.
        self._catch_test = find_newest_test_date(machine)
        self._expected = ExpectedDrives(machine, steps)
        self._terms = KnownTerms(machine)
        self._operator = LoopOrderHandler(
            job,
            crop,
            self.safety,
            self._setting,
            flow_trim=self._flow_trim,
            points=points,
            has_map=prescription is not None,
            # The loop begins work only after safety has accepted START.
            started=self._begin_work,
            strip_measured=self._ahead.heads.decisions.replace_strip,
            sections=len(machine.switched_strips),
            hopper_kg=machine.flow.full_kg,
            why_no_start=self._find_start_refusal,
            record_only=record_only,
        )
        self._totals = Totaliser(machine.geometry.working_width_m, crop.product_n_fraction)
        # Command of the tick before.
        self._command: DriveCommand | None = None
        # Events of the next rows.
        self._events = EventQueue()
        # Time of the last refused GNSS position, s.
        self._refused_s: float | None = None
        # Time of the tick before, s.
        self._time_s: float | None = None
        # Number of ticks since the clock last advanced.
        self._standing = 0
        self._started_s = 0.0
        self._metres_left_m: float | None = None
        # Time of the tractor announcement that the rows already contain, s.
        self._announced_s: float | None = None
        self._growth = assess_growth(crop.growth_window, job.growth, rule.days)
        self._growth_reported_s = -inf

    # The following methods concern the whole run.

    @property
    def strategy(self) -> Strategy:
        return self._setting.strategy

    @property
    def totals(self) -> Totals:
        """Returns area, product, nitrogen and uniformity so far. The call takes some 50 us, too
        long for every tick."""
        # Area and overlap come from the coverage raster, which also knows ground of earlier parts.
        covered = self._ahead.overlap.covered_area
        totals = self._totals.make_totals()._replace(
            covered_ha=covered.area_ha,
            overlap_ha=covered.overlap_ha,
            metres_left_m=self._metres_left_m,
        )
        return self._doses.add_dose_counts(totals)

    @property
    def running_sums(self) -> TotalSums:
        """Returns the sums from which a later loop continues the totals. The call takes some 50
        us, too long for every tick."""
        return self._totals.running_sums

    @property
    def plane(self) -> TangentPlane | None:
        """Returns the tangent plane of all positions; None before the first fix where neither
        field nor map has a plane."""
        return self._sensing.plane

    @property
    def dose_ahead_m(self) -> float:
        """Returns the distance of the newest dose's plant ahead of the outlet at its order, m."""
        return self._doses.ahead_m

    @property
    def threshold(self) -> DoseThreshold | None:
        """Returns the learnt threshold of point mode."""
        return self._doses.threshold

    def resume_job(
        self, sums: TotalSums, done: Raster, plane: TangentPlane | None, after_cut_kg: float = 0.0
    ) -> None:
        """Resumes an interrupted job, before the first tick.

        Parameters
        ----------
        sums : totals of the earlier parts. done, plane : ground that the earlier parts have spread,
        on `plane`. after_cut_kg : part of the sums that was presumably released after the last row;
        the first row reports this mass.
        """
        self._totals = Totaliser(
            self.machine.geometry.working_width_m, self.crop.product_n_fraction, sums
        )
        # The mean over the field includes the earlier parts, so the rest compensates their
        # deviation.
        if self._ahead.hold is not None and sums.area_ha > 0.0:
            self._ahead.hold.resume_job(
                sums.area_ha * 10_000.0 / self.machine.geometry.working_width_m,
                sums.kg / sums.area_ha,
            )
        # The earlier ground lies on its own plane, which must remain that of the resumed job.
        if self._sensing.plane is None:
            self._sensing.plane = plane
        self._ahead.overlap.add_earlier_ground(done)
        # After a resumption the other display's last rate is old, so silence gives no flow.
        self._ahead.outside_target.forbid_flow_in_silence()
        if after_cut_kg > 0.0:
            self._events.add_events(f"released_after_cut {after_cut_kg:.3f}")

    def add_foreign_ground(self, done: Raster) -> None:
        """Adds ground, on this loop's plane, that another job has spread. The ground does not
        count in the totals and gets no more material."""
        # Foreign ground counts as done and not as work of this job.
        self._ahead.overlap.add_earlier_ground(done, ours=False)

    def find_target(self, track_m: float) -> Target:
        """Returns the target at a position of the track, field edge included: the rate that the
        ground should get."""
        return self._ahead.make_profile(
            self._operator.choices, self.safety.memory.allow.outside
        ).find_target(track_m)

    def add_event(self, event: str) -> None:
        """Adds an event without effect to the log."""
        self._events.add_events(event)

    def handle_order(self, order: Order, by: str = "") -> Answer:
        """Executes or refuses an order; `Answer.why` gives the reason. by: person who ordered,
        appended to the order's event."""
        # A mark is only a text in the log, so it can wait.
        # A full queue must keep room for events that have an effect.
        if order.do is Do.MARK and self._events.is_full:
            return Answer(False, "busy")
        answer, event = self._operator.handle_order(order, self._time_s or 0.0)
        # A new source may be a map, whose distance must be checked again from here.
        if answer.accepted and order.do is Do.SOURCE:
            self._near.record_start()
        if event:
            self._events.add_events(event, *((f"{order.do.value}_by {by}",) if by else ()))
        return answer

    def _begin_work(self) -> None:
        """Releases done ground, because the operator wants flow from here on. A crop outside the
        growth stages of its rule is reported only."""
        if self._growth is not None and self._growth.is_outside:
            self._events.add_events(f"growth_stage_outside {self._growth.event_text}")
            self._growth_reported_s = self._time_s or 0.0
        # The landing positions of earlier work have no meaning after a pause.
        self._backing.forget_landings()
        self._flow_trim.begin_work()
        self._near.record_start()
        # Under a yearly ceiling no ground gets material twice.
        if self.job.nitrogen.year_max_kg_ha is None:
            self._ahead.overlap.record_start()
            self._ahead.sections.record_start()

    def _find_start_refusal(self) -> str:
        """Returns the reason why START is refused, apart from reasons of safety; "" for no
        refusal."""
        # The operator may have confirmed that the map lies elsewhere.
        if self.safety.memory.allow.map_elsewhere or self._ahead.map is None:
            return ""
        away_m = self._near.find_distance_m(self._operator.choices.source, self._sensed)
        outside_kg_ha = self._ahead.map.prescription.outside_kg_ha
        return (
            ""
            if away_m is None
            else make_refusal(
                "map_elsewhere", away_m=f"{away_m:.0f}", outside_kg_ha=f"{outside_kg_ha:g}"
            )
        )

    # The following methods run one tick.

    def run_tick(
        self, m: Measurements, console_age_s: float | None = None, log_ok: bool = True
    ) -> Tick:
        """Runs one tick. console_age_s: time since the operating console was heard; None where
        no console is required. log_ok: whether rows reach the disk."""
        # The order matters: position first, then the decision, the flow, safety, and last the
        # command.
        moment = self._sense_and_look(m)
        decision = self._decide_pair(moment)
        metered = self._measure_flow(moment, decision)
        choices = self._operator.choices
        between = decision.by_point and self._doses.may_still_be_turning(moment.m.time_s)
        # Safety sees the decision before the drives do and can forbid any flow.
        verdict = self.safety.check_tick(
            moment.m.time_s,
            make_situation(
                moment,
                decision,
                metered,
                choices,
                heads=self._ahead.heads,
                between_doses=between,
                console_age_s=console_age_s,
                log_ok=log_ok,
                commanded=self._stopped.commanded,
                map_elsewhere=self._near.elsewhere_m is not None,
                scale=self._flow_trim.scale_finding,
                effort=self._effort.finding,
                outside_target=self._ahead.outside_target,
                range_breach=self._find_breach(moment, decision),
            ),
        )
        command = self._make_command(moment, decision, verdict)
        self._update_followers(moment, decision, metered, verdict, command)
        return self._make_tick(moment, decision, metered, verdict, command)

    def _sense_and_look(self, m: Measurements) -> MeasuredState:
        """Determines position and speed of the machine, and the ground ahead."""
        # Impossible readings are removed first, so that no later step must consider them.
        m, dt_s = self._check_clock(drop_impossible(m))
        sensed = self._sensing.sense_motion(m)
        self._sensed = sensed
        self._near.check_location(self.safety.state, self._operator.choices.source, sensed)
        self._note_jump(m, sensed)
        # Changes that already went to the drives cannot be moved any more.
        self._ahead.look_ahead(m, sensed, self._queue.fired_to_m, self._operator.choices.no_double)
        self._note_unplaced()
        self._doses.look_for_plants(m, sensed)
        # The terms are advanced with the command of the tick before, which was in force until now.
        self._terms.advance_terms(m, sensed, m.time_s - self._started_s, self._command, dt_s)
        mps = None if sensed.speed_mps is None else sensed.quick.speed_mps
        ahead = self._forecaster.forecast_speed(
            m.time_s,
            mps,
            sensed.quick.acceleration_mps2,
            dt_s,
            # The tractor's own announcement takes precedence over the job's speed plan.
            m.speed_told or self._find_planned_speed(m.time_s, sensed),
        )
        return MeasuredState(
            m, sensed, self._find_conditions(m), dt_s, sensed.speed_mps or 0.0, ahead
        )

    def _check_clock(self, m: Measurements) -> tuple[Measurements, float]:
        """Returns the measurements and the time since the last tick.

        If the clock goes backwards or is not a number, the time stands still. Readings do not age
        meanwhile, so after `MAX_STANDING_TICKS` no reading is trusted.
        """
        self._standing = (
            0 if self._time_s is None or self._time_s < m.time_s < inf else self._standing + 1
        )
        if self._standing > MAX_STANDING_TICKS:
            # Work switch and drive fault remain, because they only ever stop the flow.
            m = Measurements(m.time_s, work_switch=m.work_switch, drive_fault=m.drive_fault)
        if self._time_s is None:
            # A first time that is no number would make every later difference invalid.
            m = m if isfinite(m.time_s) else m._replace(time_s=0.0)
            self._time_s = self._started_s = m.time_s
            read = self._find_true_opening(m)
            # The gate may stand anywhere at the start, so its reading is the first expected
            # opening.
            self._expected.start_at(
                self.machine.set_points.opening_mm if read is None else read.value, m.time_s
            )
        elif not self._time_s <= m.time_s < inf:
            m = m._replace(time_s=self._time_s)
        # A pause of the computer must not integrate a long step.
        dt_s = min(MAX_TICK_S, m.time_s - self._time_s)
        self._time_s = m.time_s
        return m, dt_s

    def _note_jump(self, m: Measurements, sensed: SensedMotion) -> None:
        """Reports refused epochs as events, and clears the view ahead after a jump of the
        position."""
        # An epoch stays in the measurements for several ticks and is reported once.
        if sensed.refused_m is not None and m.gnss is not None and m.gnss.time_s != self._refused_s:
            self._refused_s = m.gnss.time_s
            self._events.add_events(f"position_refused {sensed.refused_m:.0f}")
        if sensed.moved_m is not None:
            self._events.add_events(f"position_moved {sensed.moved_m:.0f}")
            # Everything that lies ahead was found from the old position.
            self._ahead.forget_view()
            self._queue.restart_queue(Target(0.0, self._operator.choices.source), sensed.track_m)

    def _note_unplaced(self) -> None:
        """Reports material that was spread without a known position, in the row in which the
        position is known again."""
        if self._ahead.unplaced is not None:
            way_m, is_done = self._ahead.unplaced
            event = "spread_unplaced" if is_done else "spread_unknown"
            self._events.add_events(f"{event} {way_m:.1f}")

    def _decide_pair(self, moment: MeasuredState) -> TickDecision:
        """Decides the target of the material released now, and the set-points for it."""
        choices, sensed, now = self._operator.choices, moment.sensed, moment.m.time_s
        allow = self.safety.memory.allow
        # Everything that a lag depends on in this tick is collected once for all changes.
        reach = TickLookAhead(
            self._setting,
            self._lags,
            self._expected.pair.opening_mm,
            moment,
            choices.look_ahead,
            self._ahead.sections.find_share_at(now) or 1.0,
        )
        if self._backing.update_direction(sensed, allow.reverse):
            self._queue.restart_queue(Target(0.0, choices.source), sensed.track_m)
        profile = self._ahead.make_profile(choices, allow.outside, self._backing.spread_to_m)
        fired = (
            # While reversing the track runs backwards, and no change ahead can be due.
            ()
            if sensed.backwards
            else tuple(self._queue.fire_changes(profile, now, sensed.track_m, reach))
        )
        self._setting.return_opening(moment.dt_s)
        for made in fired:
            self._setting.record_rate_change(made.before.rate_kg_ha, made.after.rate_kg_ha)
        by_point = self._doses.are_chosen(choices)
        holding = (
            self._doses.find_target(sensed, allow.outside) if by_point else self._queue.holding
        )
        share = self._switch_sections(moment, holding, reach, by_point)
        wanted = holding if by_point else self._find_section_target(holding, now, share)
        planned = wanted.rate_kg_ha * (1.0 + choices.nudge_percent / 100.0)
        # The crop's limit holds after the operator's correction too.
        rate = min(self.crop.max_rate_kg_ha, planned)
        lag = reach.find_small_change_lag(
            self._queue.holding.rate_kg_ha, self.crop.fallback_rate_kg_ha
        )
        # Where the scale contradicts the flow, a drive's reading may be wrong, so its error is not
        # compensated.
        left = (
            self._drive_trim.find_uncorrected(self._setting.strategy is Strategy.SPEED_FIRST)
            if self._flow_trim.is_scale_agreeing
            else NO_ERROR
        )
        pair = self._setting.plan_pair(
            # The speed is the one that holds when the set-point shows in the flow.
            share * rate,
            moment.ahead.predict_speed_mps,
            now,
            moment.dt_s,
            self._expected.pair.opening_mm,
            moment.conditions,
            left,
        )
        # The lag of a stop is computed only where a stop is considered.
        inside = self._ahead.is_landing_inside(
            moment, wanted, lambda: _find_stop_lag(reach, holding, sensed), choices, allow.outside
        )
        return TickDecision(
            wanted,
            planned,
            rate,
            lag,
            inside,
            pair,
            self._find_usable_mps(lag),
            fired,
            by_point,
            share,
        )

    def _find_breach(self, moment: MeasuredState, decision: TickDecision) -> RangeBreach | None:
        """Returns the rate that the machine spreads where its range does not include the wanted
        rate; None within the range."""
        # A dose has an angle and no rate.
        if decision.by_point:
            return None
        # With closed sections the same flow lies on less width.
        width_m = decision.open_share * self.machine.geometry.working_width_m
        return find_breach(
            self.machine,
            decision.pair,
            decision.rate_kg_ha,
            moment.speed_mps,
            width_m,
            moment.conditions,
        )

    def _switch_sections(
        self, moment: MeasuredState, holding: Target, reach: TickLookAhead, by_point: bool
    ) -> float:
        """Switches the sections, and returns the open share of the width at the time at which a
        present set-point shows in the flow."""
        sections, choices = self._ahead.sections, self._operator.choices
        if not sections.strips:
            return 1.0
        now, prepare_s, shaft_s = moment.m.time_s, sections.prepare_s, sections.shaft_answers_s
        # A rate of 0 cannot start flow; the fallback rate stands for the rate to come.
        rate = Target(holding.rate_kg_ha or self.crop.fallback_rate_kg_ha, holding.source)
        start = reach.find_lag(
            Target(0.0, holding.source), TargetChange(moment.sensed.track_m, rate)
        )
        small = reach.find_small_change_lag(holding.rate_kg_ha, self.crop.fallback_rate_kg_ha)
        leads = SectionLeads(
            reach.find_switch_m(prepare_s, small, small.response_s + small.transition_s),
            reach.find_switch_m(prepare_s, start, shaft_s),
            reach.find_switch_m(prepare_s, _find_stop_lag(reach, holding, moment.sensed), shaft_s),
        )
        sections.decide_switches(
            moment.sensed,
            moment.dt_s,
            leads,
            self._ahead.make_sections_ground(choices, self.safety.memory.allow.outside),
            choices.sections_off,
            by_point,
        )
        # Half of the lowest speed separates a standing shaft from a slow one despite noise.
        standing = self._expected.pair.shaft_rpm < 0.5 * self.machine.limits.shaft_low_rpm
        answers_s = sections.find_metering_s(
            self._setting.is_shaft_metering, standing, self._expected.pair.opening_mm
        )
        return sections.find_share_at(now + answers_s)

    def _find_section_target(self, holding: Target, now_s: float, open_share: float) -> Target:
        """Returns the target of the open sections.

        The target is zero where no section is open or about to open; it is the sections' rate where
        the map is zero under the machine's middle.
        """
        sections, field_map = self._ahead.sections, self._ahead.map
        if not (sections.is_any_decided or open_share or sections.find_share_at(now_s)):
            return Target(0.0, holding.source) if sections.is_any_inside(now_s) else OUTSIDE_TARGET
        if (
            field_map is None
            or holding.source is not TargetSource.MAP
            or holding.rate_kg_ha > 0.0
            or not sections.is_any_decided
        ):
            return holding
        return Target(sections.find_map_rate_kg_ha(field_map.prescription), TargetSource.MAP)

    def _measure_flow(self, moment: MeasuredState, decision: TickDecision) -> MeteredMaterial:
        """Returns the material that leaves the outlets now."""
        m, c = moment.m, moment.conditions
        opening, flow = self._find_true_opening(m), None
        # Without both readings the flow is unknown, which differs from zero.
        if m.shaft_rpm is not None and opening is not None:
            flow = calc_flow_kg_s(
                self.machine,
                max(0.0, m.shaft_rpm.value),
                max(0.0, opening.value),
                # The trim is left out here: it is applied where the row and the totals use it.
                c._replace(flow_trim=1.0),
            )
        should = (
            calc_flow_kg_s(
                self.machine, self._expected.pair.shaft_rpm, self._expected.pair.opening_mm, c
            )
            # The commanded pair contains the compensation; the flow that it should give does not.
            / self._setting.compensation_factor
        )
        rate = self._doses.calc_rate_kg_ha(c) if decision.by_point else decision.rate_kg_ha
        self._metres_left_m = self._calc_metres_left(m.hopper_kg, rate)
        said = m.rate_applied
        # A recorder uses the rate of the other controller while this rate is fresh.
        if (
            self._record_only
            and said is not None
            and is_reading_fresh(said.time_s, m.time_s, APPLIED_VALID_S)
        ):
            return MeteredMaterial(flow, said.value, 1.0, None, self._metres_left_m, 1.0)
        share = self._ahead.sections.find_open_share(m.time_s)
        if share <= 0.0:
            # A valve may stay open although its command is to close.
            share = calc_open_share(self.machine.switched_strips, m)
        return MeteredMaterial(
            flow if share > 0.0 or flow is None else 0.0,
            self._convert_to_rate(flow, moment.speed_mps, share),
            c.flow_trim,
            self._convert_to_rate(should, moment.speed_mps, share),
            self._metres_left_m,
            share,
        )

    def _make_command(
        self, moment: MeasuredState, decision: TickDecision, verdict: SafetyVerdict
    ) -> DriveCommand:
        """Returns the command of the drives after the last safety check."""
        if verdict.state is State.CALIBRATING:
            # A bench run follows the operator's set-points without plan or trims.
            asked = self._make_bench_command()
        elif decision.by_point:
            asked = self._setting.make_manual_command(0.0, self.machine.set_points.opening_mm)
        # In point mode the shaft stands between doses, and only the gate is set.
        else:
            asked = self._setting.make_command(
                decision.pair, moment.conditions, self._drive_trim, self._command
            )
        # This is the last function that changes the command before the drives.
        command = limit_command(
            asked,
            self._drive_limits,
            verdict.flow_allowed,
            None if self._command is None else self._command.opening_mm,
        )
        valves, dose = self._command_valves(moment, decision, verdict, command), None
        if decision.by_point:
            dose, events = self._doses.find_due_dose(moment, self._operator.choices, verdict)
            self._events.add_events(*events)
        return command._replace(dose=dose, valves=valves)

    def _command_valves(
        self,
        moment: MeasuredState,
        decision: TickDecision,
        verdict: SafetyVerdict,
        command: DriveCommand,
    ) -> tuple[bool, ...]:
        """Returns the command of the valves after the last safety check. All valves are closed
        while no flow is wanted, and open during calibration."""
        sections, off, now = (
            self._ahead.sections,
            self._operator.choices.sections_off,
            moment.m.time_s,
        )
        if not sections.strips:
            return ()
        # A shaft that still turns must not press material against closed valves.
        turns = (
            max(command.shaft_rpm, self._expected.pair.shaft_rpm)
            >= 0.5 * self.machine.limits.shaft_low_rpm
        )
        flows = decision.rate_kg_ha > 0.0 or decision.by_point or turns
        wanted = tuple([flows and on for on in sections.find_valves(now, moment.dt_s, off)])
        if verdict.state is State.CALIBRATING:
            wanted = (True,) * len(wanted)
        valves = limit_valves(wanted, verdict.flow_allowed)
        sections.record_commands(now, valves)
        # Only commands that went out count for the later open share.
        return valves

    def _update_followers(
        self,
        moment: MeasuredState,
        decision: TickDecision,
        metered: MeteredMaterial,
        verdict: SafetyVerdict,
        command: DriveCommand,
    ) -> None:
        """Updates trims, expected drives and totals with the commands and measurements."""
        m, sensed, dt_s, now = moment.m, moment.sensed, moment.dt_s, moment.m.time_s
        calibrating = verdict.state is State.CALIBRATING
        if self._ahead.hold is not None:
            # The mean is held only while the canopy decides, and learns only during work.
            self._ahead.hold.is_active = self._operator.choices.source is TargetSource.CANOPY
            self._ahead.hold.is_learning = verdict.state is State.WORKING
        # With a stopped shaft the gate stays and no trim is updated.
        if command.shaft_rpm > 0.0 and not calibrating:
            expected = self._expected.pair
            self._drive_trim.update_trims(
                now,
                dt_s,
                expected.shaft_rpm,
                m.shaft_rpm,
                expected.opening_mm,
                self._find_true_opening(m),
            )
        # A bench catch is weighed outside of the hopper and must not train the flow trim.
        self._update_scale(moment, metered, calibrating and command.shaft_rpm > 0.0)
        # A forbidden flow stops the shaft and leaves the gate where it is.
        bare = decision.pair if verdict.flow_allowed else DrivePair(0.0, decision.pair.opening_mm)
        turns = verdict.flow_allowed and not calibrating and not decision.by_point
        self._effort.update_watch(m, moment.conditions, dt_s, turns and command.shaft_rpm > 0.0)
        self._setting.record_command(
            decision.pair if turns else DrivePair(0.0, decision.pair.opening_mm)
        )
        self._expected.advance_drives(
            command
            if calibrating
            else self._setting.make_untrimmed_command(bare, moment.conditions),
            moment.conditions,
            dt_s,
            self._terms.drive_errors,
        )
        self._update_totals(moment, decision, metered, verdict, command)
        # The shaft's reading is used because material falls while the shaft really turns.
        self._backing.note_landing(m.shaft_rpm, sensed)
        self._command = command

    def _update_scale(
        self, moment: MeasuredState, metered: MeteredMaterial, catching: bool
    ) -> None:
        """Compares the scale with the flow by the shaft's reading. catching: whether caught
        material may be returned to the hopper."""
        m, now = moment.m, moment.m.time_s
        # The date of work is known only from GNSS: the computer's clock may be wrong.
        if self._catch_test is not None and m.gnss is not None and m.gnss.utc:
            self._flow_trim.set_catch_test_age(
                (date.fromisoformat(m.gnss.utc[:10]) - self._catch_test).days
            )
            self._catch_test = None
        rpm = self._stopped.find_turning_rpm(m)
        # Caught material may return to the hopper, which would look like a refill.
        if catching:
            self._flow_trim.restart_level()
        else:
            self._flow_trim.update_trim(
                now,
                moment.dt_s,
                metered.flow_kg_s or 0.0 if rpm > 0.0 else 0.0,
                rpm,
                moment.conditions.pitch_deg,
                self._terms.correct_weighing(m.hopper_kg),
                self._effort.finding.harder_percent > 0.0,
            )

    def _update_totals(
        self,
        moment: MeasuredState,
        decision: TickDecision,
        metered: MeteredMaterial,
        verdict: SafetyVerdict,
        command: DriveCommand,
    ) -> None:
        """Updates the totals: worked ground, and mass that leaves the machine despite a stop
        command."""
        m, now, applied = moment.m, moment.m.time_s, metered.rate_kg_ha
        runs_out = (
            m.shaft_rpm is not None and m.shaft_rpm.value >= 0.5 * self.machine.limits.shaft_low_rpm
        )
        # Mass during run-out lies on worked ground even after a stop command.
        worked = self._record_only or (
            verdict.state is State.WORKING
            and applied is not None
            and (verdict.flow_allowed or runs_out)
        )
        if worked and applied is not None:
            if self._totals.add_tick(
                moment.dt_s,
                moment.sensed.speed_mps,
                applied * metered.trim,
                None if decision.by_point else decision.planned_kg_ha,
                metered.open_share,
            ):
                # The mean counts only ground that the totals accepted.
                self._update_mean(moment, decision, applied * metered.trim)
        else:
            self._totals.stop_work()
        flow_kg_s = None if metered.flow_kg_s is None else metered.flow_kg_s * metered.trim
        stopped_kg, event = self._stopped.count_release(
            m, moment.dt_s, flow_kg_s, verdict, worked, self._flow_trim.take_unordered_kg()
        )
        self._totals.add_stopped(stopped_kg)
        if event is not None:
            self._events.add_events(event)
        self._stopped.record_command(now, command, verdict, self._expected.pair)

    def _update_mean(
        self, moment: MeasuredState, decision: TickDecision, given_kg_ha: float
    ) -> None:
        """Adds ground to the mean of the canopy, except headlands with their own rate and ground
        done before."""
        hold, sensed = self._ahead.hold, moment.sensed
        if (
            hold is None
            or decision.holding.source not in SOURCES_OF_CANOPY
            or (self._operator.choices.no_double and self._ahead.is_done(sensed.track_m))
        ):
            return
        # The operator's correction is removed, so that the mean refers to the rule's own rates.
        hold.record_landed(
            given_kg_ha / (1.0 + self._operator.choices.nudge_percent / 100.0),
            moment.speed_mps * moment.dt_s,
        )

    def _make_tick(
        self,
        moment: MeasuredState,
        decision: TickDecision,
        metered: MeteredMaterial,
        verdict: SafetyVerdict,
        command: DriveCommand,
    ) -> Tick:
        """Returns the row, and the content of the console."""
        choices, heads, usable_mps = self._operator.choices, self._ahead.heads, decision.usable_mps
        ndvi = read_head_ndvi(moment.m)
        events = self._events.take_row_events()
        # The threshold exists in jobs with plants only.
        threshold = self.threshold if decision.by_point else None
        row = make_log_row(
            self._started_s,
            moment,
            decision=decision,
            metered=metered,
            verdict=verdict,
            command=command,
            choices=choices,
            strategy=self._setting.strategy,
            heads=ndvi,
            decided_ndvi=heads.decisions.ndvi,
            events=events,
            speed_told=self._describe_announcement(moment.m),
        )
        # The state of another controller is unknown, as in a log of another program.
        if self._record_only:
            row = row._replace(state=None, shaft_rpm_cmd=None, opening_mm_cmd=None)
            verdict = verdict._replace(why_state="record_only")
        return Tick(
            row=row,
            command=command,
            sensed=moment.sensed,
            verdict=verdict,
            choices=choices,
            allow=self.safety.memory.allow,
            fired=decision.fired,
            notes=self._list_notes(moment, decision),
            dropped_heads=heads.dropped_heads,
            head_ndvi=ndvi,
            metres_left_m=metered.metres_left_m,
            # The limit is shown only while the machine is faster than it.
            usable_speed_mps=usable_mps if moment.speed_mps > usable_mps else None,
            area_ha=self._totals.area_ha,
            applied_kg=self._totals.applied_kg,
            bench=self._describe_bench_run(command) if verdict.state is State.CALIBRATING else None,
            threshold_m=None if threshold is None else threshold.find_threshold_m(moment.speed_mps),
            sections=self._ahead.sections.describe_states(command.valves, choices.sections_off),
            strips=heads.decisions.rule.strip_ndvi,
            sources=self._operator.sources,
            source_rates=self._ahead.list_source_rates(
                self._operator.sources, choices.manual_rate_kg_ha, moment.sensed.track_m
            ),
            effort=self._effort.finding,
        )

    # The following methods are parts of the steps.

    def _find_planned_speed(self, now_s: float, sensed: SensedMotion) -> AnnouncedSpeeds | None:
        """Returns the job's speed plan of the present pass, where the tractor announces none."""
        place = (
            None
            if sensed.east_m is None or sensed.north_m is None
            else (sensed.east_m, sensed.north_m)
        )
        mps = find_planned_mps(
            self.job, self.machine.geometry.working_width_m, place, sensed.heading_deg
        )
        return None if mps is None else AnnouncedSpeeds(now_s, ((0.0, mps),))

    def _describe_announcement(self, m: Measurements) -> str | None:
        """Returns the text of an announcement that is new since the last row."""
        if m.speed_told is None or m.speed_told.time_s == self._announced_s:
            return None
        self._announced_s = m.speed_told.time_s
        return describe_announcement(m.speed_told, m.time_s)

    def _find_conditions(self, m: Measurements) -> Conditions:
        elapsed_s, refilled = m.time_s - self._started_s, self._operator.refilled
        hopper_kg = None if m.hopper_kg is None else m.hopper_kg.value
        pitch_deg = 0.0 if m.pitch_deg is None else m.pitch_deg.value
        return Conditions(
            elapsed_s,
            hopper_kg,
            pitch_deg,
            None if m.supply_v is None else m.supply_v.value,
            refilled,
            self._flow_trim.present_factor if self._operator.choices.flow_trim_on else 1.0,
            self._terms.now,
            calc_conditions_factor(self.machine.flow, elapsed_s, hopper_kg, pitch_deg, refilled),
        )

    def _find_true_opening(self, m: Measurements) -> Reading | None:
        """Returns the true opening: the reading minus the sensor's offset in the machine file."""
        read = m.opening_mm
        return (
            None if read is None else Reading(read.value - self.machine.gate.offset_mm, read.time_s)
        )

    def _convert_to_rate(
        self, flow_kg_s: float | None, speed_mps: float, open_share: float
    ) -> float | None:
        """Converts a flow to a rate under the open width, kg/ha; None where the speed is
        unknown, unless the flow is zero."""
        if flow_kg_s is None:
            # A flow of zero is a rate of zero at any speed.
            return None
        if speed_mps < MIN_RATE_SPEED_MPS or open_share <= 0.0:
            return 0.0 if flow_kg_s <= 0.0 or open_share <= 0.0 else None
        return (
            flow_kg_s * 10_000.0 / (open_share * self.machine.geometry.working_width_m * speed_mps)
        )

    def _calc_metres_left(self, hopper: Reading | None, rate_kg_ha: float) -> float | None:
        if hopper is None or rate_kg_ha <= 0.0:
            return None
        left_m = max(0.0, hopper.value) / (
            rate_kg_ha * self.machine.geometry.working_width_m / 10_000.0
        )
        return left_m if left_m < inf else None

    def _find_usable_mps(self, lag: LagParts) -> float:
        """Returns the highest speed at which a change is still made in time, m/s; infinity where
        any speed is low enough."""
        source = self._operator.choices.source
        if self._doses.are_chosen(self._operator.choices):
            return self._doses.max_speed_mps
        if source not in CANOPY_SOURCES:
            return inf
        # The heads see `heads_m` ahead: decision, latency and lag must fit into this way.
        return self.machine.geometry.heads_m / (
            lag.total_s + self._ahead.heads.decisions.period_s + HEAD_LATENCY_S
        )

    def _make_bench_command(self) -> DriveCommand:
        """Returns the command of a calibrating run."""
        wanted, last = (
            self._operator.bench,
            self._command or DriveCommand(0.0, self._expected.pair.opening_mm),
        )
        return self._setting.make_manual_command(
            wanted.shaft_rpm, last.opening_mm if wanted.opening_mm is None else wanted.opening_mm
        )

    def _describe_bench_run(self, command: DriveCommand) -> BenchRun:
        memory, now = self.safety.memory, self._time_s or 0.0
        return BenchRun(
            command.shaft_rpm,
            command.opening_mm,
            now - memory.entered_s,
            memory.calibrate_until_s - now,
        )

    def _list_notes(self, moment: MeasuredState, decision: TickDecision) -> tuple[str, ...]:
        """Returns further remarks on this tick."""
        sensed, pair, choices = moment.sensed, decision.pair, self._operator.choices
        # Notes describe the ground on which material released now will land.
        lands_m = sensed.track_m + moment.speed_mps * decision.lag.total_s
        notes = [f"limited_{pair.limited}"] if pair.limited else []
        if pair.shaft_rpm > self.machine.fall.valid_to_rpm:
            notes.append("lag_out_of_range")
        if decision.by_point:
            done = self._doses.is_dosed_earlier(sensed, choices.no_double)
        else:
            done = choices.no_double and decision.rate_kg_ha <= 0.0 and self._ahead.is_done(lands_m)
        if done:
            notes.append("already_spread")
        if self._ahead.is_headland(lands_m):
            notes.append("on_headland")
        # A reason for zero is given only if no other note explains it.
        if not notes and decision.holding.rate_kg_ha == 0.0 and not decision.by_point:
            notes += self._list_zero_reasons(decision.holding.source, sensed)
        if sensed.time_s - self._growth_reported_s < GROWTH_REPORT_S:
            notes.append("growth_stage_outside")
        return tuple(notes)

    def _list_zero_reasons(self, source: TargetSource, sensed: SensedMotion) -> list[str]:
        """Returns the reasons for a target of 0, where its source gives a reason. A canopy's
        reason is that of its newest decision."""
        if source in (TargetSource.CANOPY, TargetSource.INDEX_MAP):
            decided = self._ahead.heads.decisions
            why = (
                decided.rule.decide_rate(decided.ndvi, decided.zone_factor).why
                if decided.rate_kg_ha == 0.0
                else ""
            )
            return [f"zero_{why}"] if why in CANOPY_ZERO_REASONS else []
        if source is TargetSource.FALLBACK:
            chosen = self._operator.choices.source
            if chosen is TargetSource.EXTERNAL:
                return ["zero_silent"]
            if chosen is TargetSource.MAP and sensed.east_m is not None:
                return ["zero_unmapped"]
        return [f"zero_{source.value}"] if source in ZERO_RATE_SOURCES else []


def _find_stop_lag(reach: TickLookAhead, holding: Target, sensed: SensedMotion) -> LagParts:
    """Returns the lag of a stop at this position."""
    return reach.find_lag(holding, TargetChange(sensed.track_m, OUTSIDE_TARGET))


def _find_reckoning_limit_m(
    machine: Machine, prescription: MapProfile | None, points: PlantDoser | None
) -> float:
    """Returns the maximum error of a dead-reckoned position, m: half the width, or half a cell
    of the map. Doses require a measured position."""
    if points is not None:
        # A dose must hit a plant, which dead reckoning cannot promise.
        return 0.0
    cell_m = inf if prescription is None else prescription.prescription.cell_m
    return 0.5 * min(machine.geometry.working_width_m, cell_m)


def _choose_plane(
    job: Job,
    prescription: MapProfile | None,
    points: PlantDoser | None,
    index_map: IndexMap | None,
    done: DoneGround | None,
) -> TangentPlane | None:
    """Returns the plane of the plant list, or else of the map, the field, the index map or the
    done ground; None where none has a plane."""
    if points is not None and points.plane is not None:
        return points.plane
    if prescription is not None:
        return prescription.plane
    ground = job.field
    if ground.boundary_m:
        return TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg)
    return next((one.plane for one in (index_map, done) if one is not None), None)
