"""How does the modelled machine behave in its field? Commands in, sensor readings out, and the
truth kept apart."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from math import cos, degrees, radians, sin
from typing import Any, NamedTuple

from topdress.control.field.job import Job
from topdress.control.geodesy import TangentPlane
from topdress.control.machine.effort import EffortInput, calc_gate_effort, calc_shaft_effort
from topdress.control.machine.fall import FallInput, calc_drop_s, make_fall_start, step_fall
from topdress.control.machine.fault_injection import InjectedEffect, schedule_effects
from topdress.control.machine.flow import FlowInput, calc_flute_load, make_flow_start, step_flow
from topdress.control.machine.gate import GateInput, GateOutput, make_gate_start, step_gate
from topdress.control.machine.heads import HeadInput, read_head
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array, convert_to_lists, round_to_step
from topdress.control.machine.scale import ScaleInput, read_scale
from topdress.control.machine.shaft import ShaftInput, ShaftOutput, make_shaft_start, step_shaft
from topdress.control.machine.speed import SpeedInput, make_speed_start, step_speed
from topdress.control.machine.steps import CompiledSteps
from topdress.control.machine.term_form import SHAFT_ANGLE
from topdress.control.machine.term_sums import NO_TERMS, HeldCommands, TermSums, TermTotals
from topdress.control.machine.terms import Term
from topdress.control.readings import AnnouncedSpeeds, CameraPlant, DoseOrder, DriveCommand, GnssFix

from .hopper_disturbance import HopperDisturbance
from .plant_rows import find_plants_along_way, make_simulated_plants
from .sensor_noise import CorrelatedNoise, NormalNumbers
from .simulated_camera import SimulatedCamera
from .simulated_canopy import HeadRow, make_canopy_field
from .simulated_valves import SimulatedValves
from .skip_resting_steps import (
    advance_idle_hopper,
    advance_resting,
    is_drive_resting,
    is_hopper_unchanged,
)
from .tractor import TractorDriver, TractorPath, TractorPose, make_field_boundary, make_field_path

# Time after a refill to close the lid, s.
REFILL_LID_S = 6.0
# Steps of the model in a control tick.
MODEL_STEPS = 4
# The day of topdressing in the decision paper.
START_UTC = datetime(2014, 3, 7, 8, 0, 0, tzinfo=UTC)
# Wander of the supply by engine speed and consumers, V (1 standard deviation).
SUPPLY_WANDER_V = 0.25
# A rise or fall of the flow counts as a change for this long, s.
FLOW_CHANGE_S = 1.0


class SensorReadings(NamedTuple):
    """Holds the readings of the machine's sensors at `time_s`; None where a sensor had none in
    this step."""

    time_s: float
    gnss: GnssFix | None
    wheel_speed_mps: float
    wheel_pulses: int
    ndvi: tuple[float, ...] | None
    shaft_rpm: float
    opening_mm: float
    hopper_kg: float
    supply_v: float
    pitch_deg: float
    roll_deg: float
    work_switch: bool | None
    # Time of the newest pulse, s.
    wheel_pulse_s: float | None = None
    # Plants that the camera reports in this step.
    plants: tuple[CameraPlant, ...] = ()
    # Announcement of the tractor in this step.
    speed_told: AnnouncedSpeeds | None = None
    # Index that the heads read.
    canopy_index: str = "ndvi"
    # Positions of the sections' valves by their own switches; None for a machine without valves.
    valves_open: tuple[bool, ...] | None = None
    # Effort of the shaft; None where the drive reports none.
    shaft_effort: float | None = None
    gate_effort: float | None = None


class PlantTruth(NamedTuple):
    """Holds what really happened in the step that ended at `time_s`."""

    time_s: float
    shaft_rpm: float
    opening_mm: float
    # Mean flow over the step, kg/s.
    flow_kg_s: float
    # Drop time of the material released in the step at a constant shaft speed, s.
    drop_s: float
    # Part of the drop time in the tube, s.
    settled_drop_s: float
    # Distance of the outlet along its path at the end of the step, m.
    driven_m: float
    speed_mps: float
    hopper_kg: float
    east_m: float
    north_m: float
    in_pass: bool
    refill_kg: float
    # Number of doses that the shaft has started.
    doses: int = 0
    # Canopy at the outlets.
    canopy: HeadRow | None = None
    heading_deg: float = 0.0
    # Mass released in the step by each section, kg; empty for a machine without valves.
    section_kg: tuple[float, ...] = ()
    # Mean open share of the working width over the step.
    open_share: float = 1.0
    # Share of the pace in the tube that the stream determines.
    carried_share: float = 1.0


class Plant:
    """Simulates one machine on one job. `step` advances it by `dt_s`; it reads no clock."""

    def __init__(
        self,
        machine: Machine,
        job: Job,
        seed: int,
        dt_s: float = 0.05,
        planted: Sequence[InjectedEffect] = (),
        *,
        path: TractorPath | None = None,
        keep: Callable[[PlantTruth], None] | None = None,
        plants: Array | None = None,
        terms: Sequence[Term] = (),
        steps: CompiledSteps | None = None,
    ) -> None:
        """Starts at rest.

        Parameters
        ----------
        planted : effects that the controller does not know.
        path : of the tractor; None: the passes of the job.
        keep : called with the truth of each step.
        plants : places (n, 2) of the plants of point mode, east and north, m; None: those of the
            job.
        terms : added to those of the machine's file.
        steps : compiled drives and flow for long runs; not for a machine with valves, which
            share out each step."""
        sim = job.simulated
        self.machine = machine
        self.dt_s = dt_s
        self.truth: PlantTruth | None = None
        self._sim = sim
        self._keep = keep
        self._stages = schedule_effects(machine, planted)
        self._true = self._stages[0][1]
        self.valves = SimulatedValves(machine) if machine.switched_strips else None
        self._terms = TermSums((*machine.terms, *terms))
        self._commands = HeldCommands(machine, 0.0, machine.set_points.opening_mm)
        self._more, self._ran_away_kg, self._angle_deg = NO_TERMS, 0.0, 0.0
        width = machine.geometry.working_width_m
        self._path = path or make_field_path(sim, width, job.field.pass_heading_deg)
        self.plants_m = find_plants_along_way(
            self._path,
            make_simulated_plants(job, width, seed) if plants is None else plants,
            0.5 * width,
        )
        self._vision = (
            SimulatedCamera(sim.camera, self.plants_m, seed + 2) if sim.camera is not None else None
        )
        self._dose: DoseOrder | None = None
        # Start times of the accepted doses, s.
        self._begins_s: deque[float] = deque()
        self._doses = 0
        self._leaves_s = 0.0
        # Whether the driver stops or does not start.
        self.parked = False
        self._heading0 = job.field.pass_heading_deg
        self._plane = TangentPlane(job.field.origin_lat_deg, job.field.origin_lon_deg)
        corners = make_field_boundary(sim, width, job.field.pass_heading_deg)
        east, north = [e for e, _ in corners], [n for _, n in corners]
        rim = sim.run_in_m + machine.geometry.heads_m
        self._canopy = HeadRow(
            make_canopy_field(
                sim.canopy,
                (min(east) - rim, max(east) + rim),
                (min(north) - rim, max(north) + rim),
                seed,
            ),
            machine.geometry.heads,
            width,
            sim.heads_index,
        )
        self._driver = TractorDriver(sim, seed + 4)
        self._normal = NormalNumbers(seed + 1)
        # Separate random numbers, so that a drive with effort changes no other noise.
        self._effort_normal = NormalNumbers(seed + 5)
        self._on_hopper, self._lot_percent = HopperDisturbance(sim, seed + 6), 0.0
        # Shaft speed, opening, and the gate's speed.
        self._before = 0.0, machine.set_points.opening_mm, 0.0
        self._asked_rpm = 0.0
        noise = machine.noise
        self._scale_noise = CorrelatedNoise(self._normal, noise.scale_kg, noise.scale_correlation_s)
        self._supply = CorrelatedNoise(self._normal, SUPPLY_WANDER_V, 30.0)
        self._pitch = CorrelatedNoise(self._normal, sim.roughness_deg, 3.0)
        self._roll = CorrelatedNoise(self._normal, sim.roughness_deg, 3.0)
        self._ticks = 0
        self._driven_m = sim.begin_m
        self._wheel_m = 0.0
        self._pulses = 0
        self._pulse_s: float | None = None
        shaft, gate, ground = (
            make_shaft_start(0.0),
            make_gate_start(machine.set_points.opening_mm),
            make_speed_start(0.0),
        )
        self._shaft, self._gate = (
            shaft._replace(line=convert_to_lists(shaft.line)),
            gate._replace(line=convert_to_lists(gate.line)),
        )
        self._flow = make_flow_start(min(sim.hopper_kg, machine.flow.full_kg))
        self._speed = ground._replace(line=convert_to_lists(ground.line))
        self._drives: Any = None
        if steps is not None and self.valves is None:
            self._drives = steps.drives(shaft, gate, self._flow)
        self._fall = make_fall_start()
        self._shaft_out = ShaftOutput(0.0, 0.0)
        self._gate_out = GateOutput(machine.set_points.opening_mm, machine.set_points.opening_mm)
        self._next_gnss_s = 0.0
        self._next_heads_s = 0.0
        self._standing_s = 0.0
        self._flow_before = 0.0
        self._change = (0.0, -1e9)

    @property
    def time_s(self) -> float:
        return self._ticks * self.dt_s

    def advance_plant(self, command: DriveCommand, enabled: bool) -> SensorReadings:
        """Advances by `dt_s` with the command held, and reads the sensors at the end."""
        dt, begin = self.dt_s, self.time_s
        while len(self._stages) > 1 and begin >= self._stages[1][0]:
            self._stages.pop(0)
            self._true = self._stages[0][1]
        speed = self._driver.advance_speed(
            begin, self.parked or self._is_stopped(), self._normal.draw_number(), dt
        )
        self._driven_m += speed * dt
        pose = self._path.find_pose(self._driven_m)
        pitch = self._sim.slope_deg * cos(
            radians(pose.heading_deg - self._heading0)
        ) + self._pitch.advance_noise(dt)
        supply = self.machine.shaft.nominal_supply_v + self._supply.advance_noise(dt)
        refill = self._refill_hopper(speed, dt)
        if refill > 0.0:
            self._lot_percent = self._on_hopper.draw_lot_percent()
        self._asked_rpm = command.shaft_rpm if enabled else 0.0
        # Without power the shaft stands.
        rpm = command.shaft_rpm if enabled else self._true.shaft.neutral_rpm
        self._accept_dose(command.dose, enabled)
        if self.valves is not None:
            self.valves.command_valves(begin, command.valves if enabled else ())
        if self._terms:
            self._more = self._calc_terms(rpm, command.opening_mm, supply, pitch, speed, pose)
        flow = self._move_drives(rpm, command.opening_mm, supply, pitch, refill)
        self._ticks += 1
        drop = self._calc_drop_s(flow)
        self.truth = PlantTruth(
            self.time_s,
            self._shaft_out[0],
            self._gate_out[0],
            flow,
            drop,
            calc_drop_s(self._true.fall, self._shaft_out[0]),
            self._driven_m,
            speed,
            self._flow.hopper_kg,
            pose.east_m,
            pose.north_m,
            pose.in_pass,
            refill,
            self._doses,
            self._canopy,
            pose.heading_deg,
            carried_share=self._true.fall.carried_share,
        )
        if self.valves is not None:
            self.truth = self.truth._replace(
                section_kg=self.valves.take_kg(), open_share=self.valves.take_share()
            )
        if self._keep is not None:
            self._keep(self.truth)
        return self._read_sensors(speed, pose, pitch, supply, flow)

    def _calc_terms(
        self,
        rpm: float,
        opening_mm: float,
        supply: float,
        pitch: float,
        speed: float,
        pose: TractorPose,
    ) -> TermTotals:
        """Returns the sums of the machine's terms in this step."""
        dt, shaft = self.dt_s, self._shaft_out[0]
        turned = 6.0 * shaft * dt
        more = self._terms.advance_terms(
            {
                "shaft_rpm": shaft,
                "opening_mm": self._gate_out[0],
                "hopper_kg": self._flow.hopper_kg,
                "pitch_deg": pitch,
                "roll_deg": self._roll.value,
                "supply_v": supply,
                "speed_mps": abs(speed),
                "heading_deg": pose.heading_deg,
                "time_s": self.time_s,
                SHAFT_ANGLE: self._angle_deg + 0.5 * turned,
                **self._commands.average_commands(self.time_s, rpm, opening_mm, dt),
            },
            dt,
        )
        self._angle_deg = (self._angle_deg + turned) % 360.0
        self._ran_away_kg += more.scale_kg_min / 60.0 * dt
        return more

    def _accept_dose(self, dose: DoseOrder | None, enabled: bool) -> None:
        """Accepts a dose. A stop ends the present dose; a dose that comes while another turns is
        refused."""
        if not enabled:
            self._dose = None
        elif self._dose is None and dose is not None:
            self._dose = dose
            self._begins_s.append(
                self.time_s + self._true.shaft.dead_time_s + self._true.shaft.extra_dead_time_s
            )
        while self._begins_s and self._begins_s[0] < self.time_s + self.dt_s - 1e-9:
            self._begins_s.popleft()
            self._doses += 1

    def _calc_dose_rpm(self, step_s: float) -> float:
        """Returns the mean speed of the present dose in this model step, r/min."""
        if self._dose is None:
            return 0.0
        angle_deg, rpm = self._dose
        turned_deg = min(angle_deg, 6.0 * rpm * step_s)
        left_deg = angle_deg - turned_deg
        self._dose = DoseOrder(left_deg, rpm) if left_deg > 1e-6 else None
        return turned_deg / (6.0 * step_s)

    def _is_stopped(self) -> bool:
        return self.time_s < self._leaves_s or self._is_empty()

    def _is_empty(self) -> bool:
        return self._sim.refill_at_kg > 0.0 and self._flow.hopper_kg <= self._sim.refill_at_kg

    def _refill_hopper(self, speed: float, dt: float) -> float:
        if not self._is_empty() or speed > 0.0:
            self._standing_s = 0.0
            return 0.0
        self._standing_s += dt
        if self._standing_s < self._sim.refill_stop_s:
            return 0.0
        self._leaves_s = self.time_s + REFILL_LID_S
        return self._true.flow.full_kg - self._flow.hopper_kg

    def _move_drives(
        self, rpm: float, opening_mm: float, supply: float, pitch: float, refill: float
    ) -> float:
        true, step, more, valves = self._true, self.dt_s / MODEL_STEPS, self._more, self.valves
        if self._lot_percent != 0.0:
            more = more._replace(flow_percent=more.flow_percent + self._lot_percent)
        if self._drives is not None:
            self._drives.set_stages(true.shaft, true.gate, true.flow)
            turns = (
                (rpm,) * MODEL_STEPS
                if self._dose is None
                else tuple(
                    [
                        rpm if self._dose is None else max(rpm, self._calc_dose_rpm(step))
                        for _ in range(MODEL_STEPS)
                    ]
                )
            )
            flow_kg_s, self._shaft_out, self._gate_out, self._flow = self._drives.step_tick(
                turns, opening_mm, supply, pitch, refill, more, step
            )
            return float(flow_kg_s)
        shafts, gates, flows = true.shaft, true.gate, true.flow
        shaft_state, gate_state, flow_state = self._shaft, self._gate, self._flow
        shaft_out, gate_out = self._shaft_out, self._gate_out
        moves, more_kg_s, total = GateInput(opening_mm, more.gate_mm), more.flow_kg_min / 60.0, 0.0
        rests = False
        for k in range(MODEL_STEPS):
            if rests:
                shaft_state, gate_state = advance_resting(shaft_state, gate_state, step)
            else:
                turn_rpm = rpm if self._dose is None else max(rpm, self._calc_dose_rpm(step))
                shaft_was, gate_was, stood = shaft_state, gate_state, gate_out
                shaft_state, shaft_out = step_shaft(
                    shafts,
                    shaft_state,
                    ShaftInput(
                        turn_rpm,
                        gate_out.opening_mm,
                        supply,
                        more.shaft_percent,
                        more.shaft_rpm,
                        pitch,
                    ),
                    step,
                )
                gate_state, gate_out = step_gate(gates, gate_state, moves, step)
                rests = (
                    self._dose is None
                    and gate_out == stood
                    and is_drive_resting(shaft_was, shaft_state, gate_was, gate_state)
                )
            opened = valves is None or valves.is_any_open(self.time_s + (k + 0.5) * step)
            if rests and valves is None and is_hopper_unchanged(flows, shaft_out.rpm, refill):
                flow_state = advance_idle_hopper(flow_state, step)
                continue
            flow_state, flow = step_flow(
                flows,
                flow_state,
                FlowInput(
                    shaft_out.rpm if opened else 0.0,
                    gate_out.opening_mm,
                    pitch,
                    refill,
                    more.flow_percent,
                    more_kg_s,
                ),
                step,
            )
            refill = 0.0
            total += flow.flow_kg_s
            if valves is not None:
                valves.distribute_kg(flow.flow_kg_s * step)
        self._shaft, self._gate, self._flow = shaft_state, gate_state, flow_state
        self._shaft_out, self._gate_out = shaft_out, gate_out
        return total / MODEL_STEPS

    def _calc_drop_s(self, flow: float) -> float:
        if abs(flow - self._flow_before) > 0.02 * max(flow, self._flow_before):
            self._change = (1.0 if flow > self._flow_before else -1.0, self.time_s)
        self._flow_before = flow
        change = self._change[0] if self.time_s - self._change[1] < FLOW_CHANGE_S else 0.0
        parcel = FallInput(self._shaft_out[0], flow, change)
        self._fall, drop = step_fall(self._true.fall, self._fall, parcel, self.dt_s)
        return drop

    def _read_sensors(
        self, speed: float, pose: TractorPose, pitch: float, supply: float, flow: float
    ) -> SensorReadings:
        now, dt, normal = self.time_s, self.dt_s, self._normal.draw_number
        true, noise = self._true, self.machine.noise
        self._speed, reads = step_speed(
            true.speed,
            self._speed,
            SpeedInput(abs(speed), 1.0 if flow > 0.0 else 0.0, pitch, self._more.wheel_percent),
            dt,
        )
        wheel = max(0.0, reads.wheel_mps + (noise.wheel_mps * normal() if speed != 0.0 else 0.0))
        self._count_wheel_pulses(wheel, dt)
        more_kg = (
            self._more.scale_kg + self._ran_away_kg + self._on_hopper.advance_disturbance(speed, dt)
        )
        scale = read_scale(
            true.scale, ScaleInput(self._flow.hopper_kg, now, pitch, more_kg)
        ) + self._scale_noise.advance_noise(dt)
        return SensorReadings(
            now,
            self._make_gnss_fix(pose, reads.gnss_mps, speed < 0.0),
            wheel,
            self._pulses,
            self._read_heads(pose),
            max(0.0, self._shaft_out[1] + noise.shaft_rpm * normal()),
            self._gate_out[1] + noise.opening_mm * normal(),
            round_to_step(scale, true.scale.resolution_kg),
            supply + noise.supply_v * normal(),
            pitch + noise.pitch_deg * normal(),
            self._roll.advance_noise(dt),
            None,
            self._pulse_s,
            () if self._vision is None else self._vision.report_plants(now, self._driven_m),
            self._driver.announce_speeds(),
            self._sim.heads_index,
            None if self.valves is None else self.valves.open_valves,
            *self._calc_efforts(pitch, supply),
        )

    def _calc_efforts(self, pitch: float, supply: float) -> tuple[float | None, float | None]:
        """Returns the efforts of shaft and gate; None of a drive that reports none."""
        true, dt = self._true, self.dt_s
        rpm, opening = self._shaft_out[0], self._gate_out[0]
        turned_rpm, stood_mm, moved_mm_s = self._before
        moves = (opening - stood_mm) / dt
        self._before = rpm, opening, moves
        share = true.shaft.nominal_supply_v / max(1.0, supply)
        shaft = gate = None
        if true.has_stage("effort"):
            # A term changes what lands, not the filling of the flutes: the drive's load is that
            # of the flow without it.
            flutes = calc_flute_load(
                true.flow,
                rpm,
                opening,
                pitch,
                self._flow.hopper_kg / true.flow.full_kg,
                self._flow.time_s,
                self._lot_percent,
                self._flow.refills > 0.0,
            )
            shaft = (
                true.effort.limit
                if true.shaft.stalled > 0.0 and self._asked_rpm != 0.0
                else calc_shaft_effort(
                    true.effort, EffortInput(rpm, (rpm - turned_rpm) / dt, share, *flutes)
                )
            )
            shaft = min(
                max(0.0, shaft + self.machine.noise.effort * self._effort_normal.draw_number()),
                true.effort.limit or 1000.0,
            )
        if true.has_stage("gate_effort"):
            gate = calc_gate_effort(
                true.effort, EffortInput(moves, (moves - moved_mm_s) / dt, share)
            )
            gate = max(0.0, gate + self.machine.noise.effort * self._effort_normal.draw_number())
        return shaft, gate

    def _count_wheel_pulses(self, wheel_mps: float, dt: float) -> None:
        """Counts pulses; the time of the newest is when its distance was reached within the
        step."""
        speed = self._true.speed
        pulse_m = speed.wheel_circumference_m / speed.pulses_per_turn
        self._wheel_m += wheel_mps * dt
        pulses = int(self._wheel_m / pulse_m)
        if pulses > self._pulses:
            self._pulses = pulses
            self._pulse_s = self.time_s - (self._wheel_m - pulses * pulse_m) / wheel_mps

    def _make_gnss_fix(self, pose: TractorPose, speed: float, backwards: bool) -> GnssFix | None:
        now = self.time_s
        if now < self._next_gnss_s - 1e-9:
            return None
        self._next_gnss_s += 1.0 / self._sim.gnss_hz
        noise, normal = self.machine.noise, self._normal.draw_number
        ahead, angle = self.machine.geometry.antenna_m, radians(pose.heading_deg)
        lat, lon = self._plane.convert_to_deg(
            pose.east_m + ahead * sin(angle) + noise.gnss_m * normal(),
            pose.north_m + ahead * cos(angle) + noise.gnss_m * normal(),
        )
        course = pose.heading_deg + (180.0 if backwards else 0.0)
        course += degrees(noise.gnss_mps / max(0.1, speed)) * normal()
        utc = (
            (START_UTC + timedelta(seconds=round(now, 3)))
            .isoformat(timespec="milliseconds")
            .replace("+00:00", "Z")
        )
        return GnssFix(
            now,
            lat,
            lon,
            4,
            14,
            0.8,
            max(0.0, speed + noise.gnss_mps * normal()),
            course % 360.0,
            utc,
        )

    def _read_heads(self, pose: TractorPose) -> tuple[float, ...] | None:
        now = self.time_s
        if now < self._next_heads_s - 1e-9:
            return None
        self._next_heads_s += 1.0 / self._sim.heads_hz
        ahead_m, angle, readings = self.machine.geometry.heads_m, radians(pose.heading_deg), []
        for head, here in enumerate(
            self._canopy.read_heads(
                pose.east_m + ahead_m * sin(angle),
                pose.north_m + ahead_m * cos(angle),
                pose.heading_deg,
            )
        ):
            reads = read_head(self._true.heads, HeadInput(here, head + 1.0, now))
            readings.append(
                min(0.99, max(-0.1, reads + self.machine.noise.ndvi * self._normal.draw_number()))
            )
        return tuple(readings)
