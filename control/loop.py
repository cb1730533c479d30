"""One tick of control: measurements in, commands and a log row out. No clock, no port, no file."""
from __future__ import annotations

from math import cos, inf, isfinite, radians, sin
from typing import NamedTuple

from control.agronomy import fusion
from control.agronomy.crop import Crop
from control.agronomy.noa import Rule
from control.field.coverage import Coverage, Raster
from control.field.job import Job
from control.field.totals import Sums, Totaliser, Totals
from control.geodesy import TangentPlane, offset
from control.log_row import GNSS_HOLDS_S, HOLDS_S, LogRow
from control.machine.change_lag import ChangeLags, Lag, Settled
from control.machine.fall import drop_s
from control.machine.gate import GateInput, gate_start, gate_step
from control.machine.machine import Machine
from control.machine.shaft import ShaftInput, shaft_start, shaft_step
from control.metering.inverse import Conditions, flow_kg_s
from control.metering.setting import Setting
from control.metering.strategies import Pair
from control.metering.trims import DriveTrim, FlowTrim, TrimLimits
from control.orders import Alarm, Answer, Do, Order, State, Strategy, TargetSource
from control.readings import DoseOrder, DriveCommand, Measurements, Reading, is_fresh
from control.safety import (
    SETTINGS,
    Allowances,
    BenchRun,
    BenchSetting,
    DriveLimits,
    Safety,
    SafetyLimits,
    Situation,
    Verdict,
    after_setting,
    limited,
    limited_dose,
)
from control.sensing import Sensed, Sensing, speed_ahead_mps, travelled_ahead_m
from control.targets.canopy import STRAIGHT_DEG_S, CanopyDecisions
from control.targets.fence import OUTSIDE, Fence, Fenced
from control.targets.lag_correction import ChangeQueue, Fired
from control.targets.map_profile import MapProfile
from control.targets.overlap import LONGEST_M, Overlap
from control.targets.point import Threshold
from control.targets.point_source import PointSource
from control.targets.profile import Change, Everywhere, Profile, Stretches, Target
from control.targets.unspread import Unspread

FARTHEST_S = 4.0                # changes are looked for this far ahead
HEAD_SILENT_S = HOLDS_S["ndvi_1"]
HEAD_LATENCY_S = 0.5            # a head's reading may be one period old
NUDGE_PERCENT = 30.0
FARTHEST_DOSE_M = 2.0           # a dose farther from its plant was meant for another
CELL_M = 0.2                    # of the bitmap of ground that is done
DOSES_ONLY = Everywhere(Target(0.0, TargetSource.POINT))


class Tick(NamedTuple):
    """What one tick yields; the view fields are named as in the console's frame."""

    row: LogRow
    command: DriveCommand
    enabled: bool
    alarms: tuple[Alarm, ...]
    fired: tuple[Fired, ...]
    why_no_flow: tuple[str, ...]
    sensed: Sensed
    dropped_heads: tuple[int, ...]
    metres_left_m: float | None
    area_ha: float
    applied_kg: float
    gnss_age_s: float | None
    gnss_hz: float | None
    usable_speed_mps: float | None
    look_ahead: bool
    flow_trim_on: bool
    place_m: tuple[float, float] | None
    notes: tuple[str, ...]
    why_state: str                          # an order, an alarm id, or one of STATE_REASONS
    allow: Allowances
    head_ndvi: tuple[float | None, ...]     # as many as there are heads, left to right; None: silent
    bench: BenchRun | None                  # while calibrating
    no_double: bool                         # ground that has its material gets no more
    threshold_m: float | None               # of point mode, as learned, at this speed


class ControlLoop:
    """One run of one machine on one job. Call `order` between ticks, `tick` once per control period."""

    def __init__(self, machine: Machine, crop: Crop, rule: Rule, job: Job, fence: Fence | None = None,
                 has_work_switch: bool = False, safety_limits: SafetyLimits | None = None,
                 prescription: MapProfile | None = None, points: PointSource | None = None,
                 headland: Fence | None = None) -> None:
        self.machine = machine
        self.crop = crop
        self.job = job
        limits = machine.limits
        self._drive_limits = DriveLimits(limits.shaft_low_rpm, limits.shaft_high_rpm,
                                         limits.opening_low_mm, limits.opening_high_mm)
        self.safety = Safety(safety_limits or SafetyLimits(hopper_low_kg=limits.hopper_low_kg), has_work_switch)
        ground = job.field
        plane = TangentPlane(ground.origin_lat_deg, ground.origin_lon_deg) if ground.boundary_m else None
        if prescription is not None:
            plane = prescription.plane
        if points is not None and points.plane is not None:
            plane = points.plane
        self._map = prescription
        self._points = points
        self._sensing = Sensing(machine.geometry.antenna_m, plane)
        self._fence = fence
        self._headland = headland
        rate = ground.headland_rate_kg_ha
        self._headland_target = None if rate is None else Target(rate, TargetSource.MANUAL)
        self._no_double = job.no_double
        width_m = machine.geometry.working_width_m
        self._overlap = Overlap(Coverage(width_m, min(CELL_M, width_m / 6.0), longest_m=LONGEST_M),
                                machine.geometry.outlets)
        self._fusion = fusion.start(machine.geometry.heads)
        self._fused: fusion.Fused | None = None
        self._head_times: tuple[float | None, ...] = ()
        self._fused_s = float("-inf")
        stretches = Stretches(crop.fallback_rate_kg_ha)
        self._canopy = CanopyDecisions(rule, machine.geometry.heads_m, job.target.decision_hz, stretches)
        self._manual = Everywhere(Target(job.target.manual_rate_kg_ha, TargetSource.MANUAL))
        self._fallback = Everywhere(Target(crop.fallback_rate_kg_ha, TargetSource.FALLBACK))
        self._source = TargetSource(job.target.source)
        self._queue = ChangeQueue(Target(0.0, TargetSource.NONE))
        self._lags = ChangeLags(machine)
        self._look_ahead = job.look_ahead
        self._flow_trim_on = job.flow_trim
        self._nudge = 0.0
        self._setting = Setting(machine, job.strategy)
        self._drive_trim = DriveTrim(TrimLimits(), still=1.0)
        self._flow_trim = FlowTrim(TrimLimits())
        self._expected_shaft = shaft_start(0.0)
        self._expected_gate = gate_start(machine.set_points.opening_mm)
        self._expected = Pair(0.0, machine.set_points.opening_mm)
        self._command: DriveCommand | None = None
        self._bench = BenchSetting()
        self._events: list[str] = []
        self._refused_s: float | None = None    # epoch that was refused last
        self._time_s: float | None = None
        self._begun_s = 0.0
        self._refilled = False
        self._totals = Totaliser(machine.geometry.working_width_m, crop.product_n_fraction)
        self._dose_ahead_m = 0.0
        self._metres_left_m: float | None = None
        self._backed = False                    # backwards at the tick before
        self._landed_to_m = float("-inf")       # farthest place at which material has landed since START
        self._spread_to_m = float("-inf")       # the same when it last backed up: nothing more before that

    # -- the operator ------------------------------------------------------------------------------------------

    @property
    def strategy(self) -> Strategy:
        return self._setting.strategy

    @property
    def totals(self) -> Totals:
        """Area, product, nitrogen and evenness so far. Takes some 50 us: not for every tick."""
        covered, points = self._overlap.covered, self._points
        return self._totals.snapshot()._replace(
            covered_ha=covered.area_ha, overlap_ha=covered.overlap_ha, metres_left_m=self._metres_left_m,
            doses=None if points is None else points.doses, doses_missed=None if points is None else points.missed)

    @property
    def sums(self) -> Sums:
        """What a later loop needs to go on with the totals. Takes some 50 us: not for every tick."""
        return self._totals.sums

    @property
    def flow_trim(self) -> float:
        return self._flow_trim.value

    @property
    def plane(self) -> TangentPlane | None:
        """On which places are told; None before the first fix where neither field nor map has one."""
        return self._sensing.plane

    def go_on(self, sums: Sums, flow_trim: float, done: Raster, plane: TangentPlane | None) -> None:
        """Before the first tick: go on with a job that was cut off. done: on `plane`, what its parts have spread."""
        self._totals = Totaliser(self.machine.geometry.working_width_m, self.crop.product_n_fraction, sums)
        self._flow_trim.value = flow_trim
        if self._sensing.plane is None:
            self._sensing.plane = plane
        self._overlap.seed(done)

    def target_at(self, track_m: float) -> Target:
        """The target that holds at a place of the track, fence included: what the ground was meant to get."""
        return self._fenced(self._once(self._wanted())).at(track_m)

    def order(self, order: Order) -> Answer:
        now = self._time_s or 0.0
        value = order.value
        if order.do is Do.STRATEGY:
            if value not in list(Strategy):
                return Answer(False, "unknown_strategy")
            self._setting.switch(Strategy(str(value)), now)
        elif order.do is Do.SOURCE:
            if value not in self._sources():
                return Answer(False, "source_not_ready")
            self._source = TargetSource(str(value))
        elif order.do is Do.NUDGE:
            percent = _number(value)
            if percent is None or not abs(percent) <= NUDGE_PERCENT:
                return Answer(False, "nudge_out_of_range")
            self._nudge = percent
        elif order.do is Do.MANUAL_RATE:
            rate = _number(value)
            if rate is None or not 0.0 <= rate <= self.crop.max_rate_kg_ha:
                return Answer(False, "rate_out_of_range")
            self._manual = Everywhere(Target(rate, TargetSource.MANUAL))
        elif order.do in (Do.LOOK_AHEAD, Do.FLOW_TRIM, Do.NO_DOUBLE):
            if not isinstance(value, bool):
                return Answer(False, "yes_or_no")
            if order.do is Do.LOOK_AHEAD:
                self._look_ahead = value
            elif order.do is Do.NO_DOUBLE:
                self._no_double = value
            else:
                self._flow_trim_on = value
        elif order.do is Do.DOSE_ERROR:
            error_m = _number(value)
            if error_m is None or abs(error_m) > FARTHEST_DOSE_M:
                return Answer(False, "dose_error_out_of_range")
            if self._points is None or not self._points.learn(error_m, now):
                return Answer(False, "no_dose_landed")
        elif order.do in SETTINGS:
            self._bench, answer = after_setting(self._bench, order, self.safety.state)
            if not answer.accepted:
                return answer
        elif order.do is not Do.MARK:
            before = self.safety.state
            answer = self.safety.order(order, now)
            if not answer.accepted:
                return answer
            if order.do is Do.CALIBRATE and before is State.CALIBRATING:
                return answer                   # the button is still down: no event of its own
            self._obeyed(order.do)
        if order.do is not Do.ACKNOWLEDGE:
            self._events.append(_event(order))
        return Answer(True)

    def _obeyed(self, do: Do) -> None:
        """What an order that safety accepted means here."""
        if do is Do.REFILL:
            self._refilled = True
            self._flow_trim.restart()
        elif do is Do.CALIBRATE:
            self._bench = BenchSetting()
        elif do is Do.START:                # the operator wants flow from here on, also where some lies already
            self._landed_to_m = self._spread_to_m = float("-inf")
            self._overlap.started()

    def _sources(self) -> tuple[TargetSource, ...]:
        """Those that can be ordered: map and point only where the job has them."""
        placed = [(TargetSource.MAP, self._map), (TargetSource.POINT, self._points)]
        return (TargetSource.CANOPY, TargetSource.MANUAL, TargetSource.FALLBACK,
                *(source for source, there in placed if there is not None))

    @property
    def dose_ahead_m(self) -> float:
        """How far ahead of the outlet the plant of the newest dose stood when it was ordered."""
        return self._dose_ahead_m

    @property
    def threshold(self) -> Threshold | None:
        """Of point mode, as learned."""
        return None if self._points is None else self._points.mode.threshold

    # -- one tick ----------------------------------------------------------------------------------------------

    def tick(self, m: Measurements, console_age_s: float | None = None, log_ok: bool = True) -> Tick:
        if self._time_s is not None and not self._time_s <= m.time_s < inf:     # a clock that goes back: time stands
            m = m._replace(time_s=self._time_s)
        now = m.time_s
        dt = 0.0 if self._time_s is None else min(1.0, now - self._time_s)
        if self._time_s is None:
            self._begun_s = now
            self._expected_shaft = shaft_start(0.0, now)
            read = self._opening(m)
            opening = read.value if read is not None else self.machine.set_points.opening_mm
            self._expected_gate = gate_start(opening, now)
            self._expected = Pair(0.0, opening)
        self._time_s = now
        sensed = self._sensing.update(m)
        self._note_jump(m, sensed)
        self._look_at_canopy(m, sensed, now)
        conditions = self._conditions(m, now)
        speed = sensed.speed_mps or 0.0
        self._look_at_fence(sensed)
        self._look_at_done(m, sensed)
        self._look_at_map(sensed)
        self._look_at_plants(m, sensed)
        reach = _Reach(self, sensed, conditions)
        self._look_back(sensed)
        fired = [] if sensed.backwards else self._queue.advance(self._profile(), now, sensed.track_m, reach)
        by_point = self._points is not None and self._source is TargetSource.POINT
        holding = self._dose_target(sensed) if by_point else self._queue.holding
        rate = min(self.crop.max_rate_kg_ha, holding.rate_kg_ha * (1.0 + self._nudge / 100.0))
        lag = reach.holding_lag()
        wanted = rate * self.machine.geometry.working_width_m * speed_ahead_mps(
            speed, sensed.acceleration_mps2, lag.total_s) / 10_000.0
        pair = self._setting.pair(wanted, now, self._expected, conditions)
        model_flow = self._measured_flow(m, conditions._replace(flow_trim=1.0))
        trim = self._flow_trim.value if self._flow_trim_on else 1.0
        applied = _rate(model_flow, speed, self.machine)
        metres_left = self._metres_left(m.hopper_kg, self._dosed_rate(conditions) if by_point else rate)
        self._metres_left_m = metres_left
        usable = self._usable_speed(lag)
        verdict = self.safety.check(now, self._situation(
            m, sensed, holding, rate, model_flow, applied, trim, metres_left, usable,
            reach.lag(holding, Change(sensed.track_m, OUTSIDE)),
            console_age_s, log_ok, conditions))
        calibrating = verdict.state is State.CALIBRATING
        if calibrating:
            asked = self._by_hand()
        elif by_point:
            asked = self._setting.by_hand(0.0, self.machine.set_points.opening_mm)
        else:
            asked = self._setting.command(pair, conditions, self._drive_trim, self._command)
        command = limited(asked, self._drive_limits, verdict.flow_allowed,
                          None if self._command is None else self._command.opening_mm)
        if by_point:
            command = command._replace(dose=self._dose_due(sensed, dt, verdict))
        enabled = verdict.state in (State.WORKING, State.HELD, State.CALIBRATING)
        if command.shaft_rpm > 0.0 and not calibrating:     # a stopped shaft: the gate stays, nothing to trim
            self._drive_trim.update(now, dt, self._expected.shaft_rpm, m.shaft_rpm,
                                    self._expected.opening_mm, self._opening(m))
        if model_flow is not None and self._flow_trim_on:
            self._flow_trim.update(now, dt, model_flow, m.hopper_kg)
        bare = pair if verdict.flow_allowed else Pair(0.0, pair.opening_mm)
        self._expect(command if calibrating else self._setting.wire(bare, conditions), conditions, dt)
        if verdict.state is State.WORKING and applied is not None and (verdict.flow_allowed or applied > 0.0):
            self._totals.add(dt, sensed.speed_mps, applied * trim, None if by_point else rate)
        self._note_landing(m, sensed)
        self._command = command
        row = self._row(m, sensed, holding, rate, command, applied, lag, trim, verdict.state, verdict.alarms)
        notes = [f"limited_{pair.limited}"] if pair.limited else []
        if pair.shaft_rpm > self.machine.fall.valid_to_rpm:
            notes.append("lag_out_of_range")
        if by_point:
            spread = self._dosed_earlier(sensed)
        else:
            spread = self._no_double and rate <= 0.0 and not self._overlap.inside(sensed.track_m + speed * lag.total_s)
        if spread:
            notes.append("already_spread")
        if self._headland is not None and self._headland_target is not None and not self._headland.inside(
                sensed.track_m + speed * lag.total_s):
            notes.append("on_headland")
        threshold_m = self._points.mode.threshold.at(speed) if by_point and self._points is not None else None
        place = None
        if sensed.east_m is not None and sensed.north_m is not None:
            place = (sensed.east_m, sensed.north_m)
        hz = 1.0 / sensed.gnss_period_s if sensed.gnss_age_s is not None else None
        return Tick(row, command, enabled, verdict.alarms, tuple(fired), verdict.why_no_flow, sensed,
                    self._fused.dropped if self._fused else (), metres_left,
                    self._totals.area_ha, self._totals.applied_kg, sensed.gnss_age_s, hz,
                    usable if speed > usable else None, self._look_ahead, self._flow_trim_on, place, tuple(notes),
                    verdict.why_state, self.safety.memory.allow, tuple(_fresh(r, now, HEAD_SILENT_S) for r in m.ndvi),
                    self._bench_run(command, now) if calibrating else None, self._no_double, threshold_m)

    # -- parts of a tick -----------------------------------------------------------------------------------------

    def _by_hand(self) -> DriveCommand:
        """What a calibrating run asks for."""
        wanted, last = self._bench, self._command or DriveCommand(0.0, self._expected.opening_mm)
        return self._setting.by_hand(
            wanted.shaft_rpm, last.opening_mm if wanted.opening_mm is None else wanted.opening_mm)

    def _bench_run(self, command: DriveCommand, now: float) -> BenchRun:
        memory = self.safety.memory
        return BenchRun(command.shaft_rpm, command.opening_mm, now - memory.entered_s, memory.calibrate_until_s - now)

    def _note_jump(self, m: Measurements, sensed: Sensed) -> None:
        """Epochs that were refused become events; where a new place was taken, what was seen ahead lay elsewhere."""
        if sensed.refused_m is not None and m.gnss is not None and m.gnss.time_s != self._refused_s:
            self._refused_s = m.gnss.time_s
            self._events.append(f"position_refused {sensed.refused_m:.0f}")
        if sensed.moved_m is not None:
            self._events.append(f"position_moved {sensed.moved_m:.0f}")
            self._overlap.moved()
            if self._map is not None:
                self._map.lost()
            self._queue.restart(Target(0.0, self._source), sensed.track_m)

    def _look_at_canopy(self, m: Measurements, sensed: Sensed, now: float) -> None:
        times = tuple(None if r is None else r.time_s for r in m.ndvi)
        fresh = times != self._head_times
        if fresh or now - self._fused_s > HEAD_LATENCY_S:
            self._head_times, self._fused_s = times, now
            self._fusion, self._fused = fusion.fuse_readings(self._fusion, m.ndvi, now)
            if sensed.backwards:
                self._canopy.pause()
            else:
                self._canopy.sample(self._fused.ndvi if fresh else None, sensed.track_m, now, sensed.turn_deg_s)
        self._canopy.decide(sensed.track_m, now)

    def _look_at_fence(self, sensed: Sensed) -> None:
        for fence in (self._fence, self._headland):
            if fence is None:
                continue
            if sensed.east_m is None or sensed.north_m is None or sensed.heading_deg is None:
                fence.lost()
            else:
                fence.look(sensed.track_m, sensed.east_m, sensed.north_m, sensed.heading_deg, self._queue.fired_to_m)

    def _look_at_done(self, m: Measurements, sensed: Sensed) -> None:
        """Note what lands here, and look for ground ahead that has its material."""
        place = None
        if sensed.position_ok and sensed.east_m is not None and sensed.north_m is not None:
            place = (sensed.east_m, sensed.north_m)
        rpm = 0.0 if m.shaft_rpm is None else m.shaft_rpm.value
        turns = rpm >= 0.5 * self.machine.limits.shaft_low_rpm
        self._overlap.note(sensed.time_s, place, sensed.heading_deg, turns,
                           drop_s(self.machine.fall, rpm) if turns else 0.0)
        if self._no_double:
            self._overlap.look(sensed.track_m, place, sensed.heading_deg, self._queue.fired_to_m)

    def _look_at_map(self, sensed: Sensed) -> None:
        if self._map is None:
            return
        if sensed.east_m is None or sensed.north_m is None or sensed.heading_deg is None or not sensed.position_ok:
            self._map.lost()
            return
        turn_deg_m = sensed.turn_deg_s / max(0.3, sensed.speed_mps or 0.0)
        self._map.look(sensed.track_m, sensed.east_m, sensed.north_m, sensed.heading_deg, self._queue.fired_to_m,
                       turn_deg_m)

    def _look_at_plants(self, m: Measurements, sensed: Sensed) -> None:
        if self._points is None:
            return
        place = None
        straight = abs(sensed.turn_deg_s) <= STRAIGHT_DEG_S and not sensed.backwards
        if straight and sensed.position_ok and sensed.east_m is not None and sensed.north_m is not None:
            place = (sensed.east_m, sensed.north_m)
        self._points.look(sensed.time_s, sensed.track_m, place, sensed.heading_deg, sensed.speed_mps or 0.0, m.plants)

    def _dose_target(self, sensed: Sensed) -> Target:
        """Doses where the next one would fall inside the field, nothing outside."""
        if self._points is None or self._fence is None or self.safety.memory.allow.outside:
            return DOSES_ONLY.target
        inside = self._fence.inside(sensed.track_m + self._points.reach_m(sensed.speed_mps or 0.0))
        return DOSES_ONLY.target if inside else OUTSIDE

    def _dose_due(self, sensed: Sensed, dt: float, verdict: Verdict) -> DoseOrder | None:
        """The dose to be commanded now; doses and misses become events of the row."""
        assert self._points is not None
        due = self._points.tick(sensed.time_s, sensed.track_m, sensed.speed_mps or 0.0, dt, verdict.flow_allowed,
                                verdict.state is State.WORKING and not self._dosed_earlier(sensed))
        self._events += [f"dose_missed {why}" for why in due.missed]
        if due.dose is None:
            return None
        more = due.dose._replace(angle_deg=round(due.dose.angle_deg * (1.0 + self._nudge / 100.0), 3))
        dose = limited_dose(more, self._drive_limits, verdict.flow_allowed)
        if dose is not None:
            self._dose_ahead_m = self._points.given[-1].plant_m - sensed.track_m
            self._events.append(f"dose {dose.angle_deg:g}")
        return dose

    def _dosed_earlier(self, sensed: Sensed) -> bool:
        """Whether the plant of a dose commanded now has its dose from an earlier part of the job."""
        if (not self._no_double or self._points is None or sensed.east_m is None or sensed.north_m is None
                or sensed.heading_deg is None):
            return False
        ahead_m = self._points.reach_m(sensed.speed_mps or 0.0)
        return self._overlap.earlier(offset((sensed.east_m, sensed.north_m), sensed.heading_deg, ahead_m))

    def _dosed_rate(self, c: Conditions) -> float:
        """What the doses amount to, kg/ha, at the mean spacing of the last ones; 0 before there are two."""
        spacing_m = None if self._points is None else self._points.spacing_m
        if self._points is None or not spacing_m:
            return 0.0
        angle_deg, shaft_rpm = self._points.dose
        flow = flow_kg_s(self.machine, shaft_rpm, self.machine.set_points.opening_mm, c)
        dose_kg = flow * angle_deg / (6.0 * shaft_rpm)
        return dose_kg * 10_000.0 / (spacing_m * self.machine.geometry.working_width_m)

    def _look_back(self, sensed: Sensed) -> None:
        """Backing up without leave to spread: what has landed is not spread upon again by itself."""
        if abs(sensed.turn_deg_s) > STRAIGHT_DEG_S:
            self._landed_to_m = self._spread_to_m = float("-inf")
        if sensed.backwards != self._backed and not self.safety.memory.allow.reverse:
            self._spread_to_m = max(self._spread_to_m, self._landed_to_m)
            self._queue.restart(Target(0.0, self._source), sensed.track_m)
        self._backed = sensed.backwards

    def _note_landing(self, m: Measurements, sensed: Sensed) -> None:
        if m.shaft_rpm is not None and m.shaft_rpm.value >= 0.5 * self.machine.limits.shaft_low_rpm:
            falls_s = drop_s(self.machine.fall, m.shaft_rpm.value)
            falls_m = travelled_ahead_m(sensed.speed_mps or 0.0, sensed.acceleration_mps2, falls_s)
            self._landed_to_m = max(self._landed_to_m, sensed.track_m + falls_m)

    def _wanted(self) -> Profile:
        if self._source is TargetSource.CANOPY:
            return self._canopy.stretches
        if self._source is TargetSource.MAP and self._map is not None:
            return self._map
        if self._source is TargetSource.POINT:
            return DOSES_ONLY
        return self._manual if self._source is TargetSource.MANUAL else self._fallback

    def _once(self, wanted: Profile) -> Profile:
        """The headland's own rate, and nothing where an earlier pass has spread."""
        if self._headland is not None and self._headland_target is not None:
            wanted = Fenced(wanted, self._headland, self._headland_target)
        return Fenced(wanted, self._overlap, Target(0.0, self._source)) if self._no_double else wanted

    def _fenced(self, inner: Profile) -> Profile:
        return inner if self._fence is None or self.safety.memory.allow.outside else Fenced(inner, self._fence)

    def _profile(self) -> Profile:
        """What the queue follows: wanted, not where something lies already, not outside."""
        wanted = self._once(self._wanted())
        if self._spread_to_m > float("-inf"):
            wanted = Unspread(wanted, self._spread_to_m, self._source)
        return self._fenced(wanted)

    def _landing_inside(self, sensed: Sensed, holding: Target, stops: Lag) -> bool | None:
        """Whether what is released now lands inside the field; None where no field is known. `stops`: the lag of a
        stop."""
        if self._fence is None:
            return None
        if sensed.east_m is None or sensed.north_m is None or sensed.heading_deg is None:
            return False
        if sensed.backwards:
            ahead_m = travelled_ahead_m(sensed.speed_mps or 0.0, sensed.acceleration_mps2, stops.total_s)
            angle = radians(sensed.heading_deg)
            return (self._fence.contains(sensed.east_m, sensed.north_m) and self._fence.contains(
                sensed.east_m - ahead_m * sin(angle), sensed.north_m - ahead_m * cos(angle)))
        if self.safety.memory.allow.outside:
            return self._fence.inside(sensed.track_m + travelled_ahead_m(
                sensed.speed_mps or 0.0, sensed.acceleration_mps2, stops.total_s))
        return holding != OUTSIDE

    def _conditions(self, m: Measurements, now: float) -> Conditions:
        return Conditions(now - self._begun_s,
                          None if m.hopper_kg is None else m.hopper_kg.value,
                          0.0 if m.pitch_deg is None else m.pitch_deg.value,
                          None if m.supply_v is None else m.supply_v.value,
                          self._refilled, self._flow_trim.value if self._flow_trim_on else 1.0)

    def _opening(self, m: Measurements) -> Reading | None:
        """The opening as it truly is: a sensor's shift that the machine file knows is taken off its reading."""
        read = m.opening_mm
        return None if read is None else read._replace(value=read.value - self.machine.gate.offset_mm)

    def _measured_flow(self, m: Measurements, c: Conditions) -> float | None:
        opening = self._opening(m)
        if m.shaft_rpm is None or opening is None:
            return None
        return flow_kg_s(self.machine, max(0.0, m.shaft_rpm.value), max(0.0, opening.value), c)

    def _expect(self, command: DriveCommand, c: Conditions, dt: float) -> None:
        """What the drives as the model knows them do with the untrimmed set-points."""
        if dt <= 0.0:
            return
        supply = c.supply_v if c.supply_v is not None else self.machine.shaft.nominal_supply_v
        self._expected_shaft, shaft = shaft_step(
            self.machine.shaft, self._expected_shaft,
            ShaftInput(command.shaft_rpm, self._expected.opening_mm, supply), dt)
        self._expected_gate, gate = gate_step(
            self.machine.gate, self._expected_gate, GateInput(command.opening_mm), dt)
        self._expected = Pair(shaft.rpm, gate.opening_mm)

    def _metres_left(self, hopper: Reading | None, rate: float) -> float | None:
        if hopper is None or rate <= 0.0:
            return None
        return max(0.0, hopper.value) / (rate * self.machine.geometry.working_width_m / 10_000.0)

    def _usable_speed(self, lag: Lag) -> float:
        if self._points is not None and self._source is TargetSource.POINT:
            return self._points.fastest_mps
        if self._source is not TargetSource.CANOPY:
            return float("inf")
        return self.machine.geometry.heads_m / (lag.total_s + self._canopy.period_s + HEAD_LATENCY_S)

    def _situation(self, m: Measurements, sensed: Sensed, holding: Target, rate: float,
                   model_flow: float | None, applied: float | None, trim: float, metres_left: float | None,
                   usable: float, stops: Lag, console_age_s: float | None, log_ok: bool, c: Conditions) -> Situation:
        speed = sensed.speed_mps
        needs_heads = self._source is TargetSource.CANOPY
        heard = [r.time_s for r in m.ndvi if r is not None]
        expected_flow = flow_kg_s(self.machine, self._expected.shaft_rpm, self._expected.opening_mm, c)
        expected = _rate(expected_flow, speed or 0.0, self.machine)
        if self._points is not None and self._source is TargetSource.POINT and self._points.may_turn(m.time_s):
            expected = applied = None               # a rate means nothing between doses
        return Situation(
            measurements=m, speed_used_mps=speed, gnss_period_s=sensed.gnss_period_s,
            wheel_standstill=sensed.wheel_standstill, target_source=self._source, position_ok=sensed.position_ok,
            landing_inside=self._landing_inside(sensed, holding, stops),
            valid_heads=(self._fused.valid if self._fused else 0) if needs_heads else None,
            ndvi_age_s=(sensed.time_s - max(heard) if heard else None) if needs_heads else None,
            expected_rate_kg_ha=expected,
            applied_rate_kg_ha=None if applied is None else applied * trim,
            expected_flow_kg_s=0.0 if model_flow is None else model_flow * trim,
            target_rate_kg_ha=rate, metres_left_m=metres_left,
            usable_speed_mps=usable if speed is not None and speed > usable else None,
            console_age_s=console_age_s, log_ok=log_ok, position_refused_m=sensed.refused_m)

    def _row(self, m: Measurements, sensed: Sensed, holding: Target, rate: float, command: DriveCommand,
             applied: float | None, lag: Lag, trim: float, state: State, alarms: tuple[Alarm, ...]) -> LogRow:
        fix = m.gnss if sensed.gnss_age_s is not None and sensed.gnss_age_s <= GNSS_HOLDS_S else None
        placed = fix if sensed.refused_m is None else None
        ndvi = [_fresh(r, m.time_s, HEAD_SILENT_S) for r in m.ndvi] + [None] * 6
        events, self._events = self._events, []
        speed = sensed.speed_mps
        return LogRow(
            time_s=m.time_s - self._begun_s,
            utc=fix.utc if fix else None,
            lat_deg=placed.lat_deg if placed else None, lon_deg=placed.lon_deg if placed else None,
            fix_quality=placed.fix_quality if placed else None, satellites=fix.satellites if fix else None,
            hdop=fix.hdop if fix else None, heading_deg=fix.heading_deg if fix else None,
            pitch_deg=_held(m, "pitch_deg"), roll_deg=_held(m, "roll_deg"),
            speed_mps=fix.speed_mps if fix else None, wheel_speed_mps=_held(m, "wheel_speed_mps"),
            speed_used_mps=speed,
            ndvi_1=ndvi[0], ndvi_2=ndvi[1], ndvi_3=ndvi[2], ndvi_4=ndvi[3], ndvi_5=ndvi[4], ndvi_6=ndvi[5],
            ndvi=self._canopy.ndvi if self._source is TargetSource.CANOPY else None,
            target_rate_kg_ha=None if holding.source is TargetSource.POINT else rate, nudge_percent=self._nudge,
            shaft_rpm_cmd=command.shaft_rpm, shaft_rpm=_held(m, "shaft_rpm"),
            opening_mm_cmd=command.opening_mm, opening_mm=_held(m, "opening_mm"),
            hopper_kg=_held(m, "hopper_kg"), flow_trim=trim, supply_v=_held(m, "supply_v"),
            applied_rate_kg_ha=applied, lag_s=lag.total_s, lag_m=None if speed is None else speed * lag.total_s,
            state=state.value, strategy=self._setting.strategy.value, target_source=holding.source.value,
            work_switch=None if m.work_switch is None else int(m.work_switch),
            alarms=";".join(a.id for a in alarms) or None, events=";".join(events) or None)


class _Reach:
    """How far ahead a change must be made now; see `targets.lag_correction.Reach`."""

    def __init__(self, loop: ControlLoop, sensed: Sensed, conditions: Conditions) -> None:
        self._loop = loop
        self._speed = sensed.speed_mps or 0.0
        self._acceleration = sensed.acceleration_mps2
        self._conditions = conditions
        self.farthest_m = self._speed * FARTHEST_S + 1.0 if loop._look_ahead else 0.0

    def _settled(self, rate_kg_ha: float) -> Settled:
        loop = self._loop
        flow = rate_kg_ha * loop.machine.geometry.working_width_m * self._speed / 10_000.0
        pair = loop._setting.settled(flow, loop._expected.opening_mm, self._conditions)
        return Settled(pair.shaft_rpm, pair.opening_mm)

    def lag(self, before: Target, change: Change) -> Lag:
        return self._loop._lags.lag(self._settled(before.rate_kg_ha), self._settled(change.target.rate_kg_ha))

    def distance_m(self, lag: Lag) -> float:
        if not self._loop._look_ahead:
            return 0.0
        return travelled_ahead_m(self._speed, self._acceleration, lag.total_s)

    def holding_lag(self) -> Lag:
        """Lag of a small change from what is held now."""
        held = self._settled(self._loop._queue.holding.rate_kg_ha)
        if held.shaft_rpm <= 0.0:
            held = self._settled(self._loop.crop.fallback_rate_kg_ha)
        return self._loop._lags.lag(held, self._loop._setting.nudged(held))


def _rate(flow_kg_s: float | None, speed_mps: float, machine: Machine) -> float | None:
    """kg/ha from flow and ground speed; None below 0.3 m/s, where the quotient means nothing, unless nothing flows."""
    if flow_kg_s is None:
        return None
    if speed_mps < 0.3:
        return 0.0 if flow_kg_s <= 0.0 else None
    return flow_kg_s * 10_000.0 / (machine.geometry.working_width_m * speed_mps)


def _held(m: Measurements, column: str) -> float | None:
    """What the row holds of a sensor."""
    return _fresh(getattr(m, column), m.time_s, HOLDS_S[column])


def _fresh(reading: Reading | None, now_s: float, most_s: float) -> float | None:
    return None if reading is None or not is_fresh(reading.time_s, now_s, most_s) else reading.value


def _number(value: str | float | bool | None) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value) else None


def _event(order: Order) -> str:
    return order.do.value if order.value is None else f"{order.do.value} {order.value}".replace(";", ",")
