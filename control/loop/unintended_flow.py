"""How much material leaves the machine although its shaft is commanded to stop?

A shaft needs a second to stop, and a faulty drive may not stop at all. The material that the
measured shaft meters meanwhile is on the ground and missing from the hopper, so it is counted in
every state and logged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, isfinite

from topdress.control.machine.machine import Machine
from topdress.control.machine.sections import SectionStrip
from topdress.control.metering.strategies import DrivePair
from topdress.control.orders import State
from topdress.control.readings import DriveCommand, Measurements, is_reading_fresh
from topdress.control.safety import POWERED_STATES, PreviousCommands, SafetyLimits, SafetyVerdict
from topdress.control.signals import VALID_FOR

# Interval of the events while the flow continues, s: a power cut loses no more than this.
EVENT_INTERVAL_S = 1.0
# Validity of a reading of the shaft, s, as in safety.
SHAFT_VALID_S = VALID_FOR["shaft_rpm"].control_s
# Maximum additional delay, s, of a valve's switch and the board's serial line over the machine
# file.
VALVE_DELAY_S = 1.0
# Resolution of the log, kg; a smaller mass waits for the next event.
MIN_EVENT_KG = 1e-4


def make_standing_limits(machine: Machine, limits: SafetyLimits) -> SafetyLimits:
    """Returns the limits for this machine's standing shaft: above its sensor's noise (six
    standard deviations) and below half its slowest turning. The valves' closing time plus a second
    is included."""
    noise_rpm = machine.noise.shaft_rpm
    stands_rpm = max(limits.shaft_stands_rpm, 6.0 * noise_rpm)
    # 0 means that the slowest turning speed is unknown.
    if machine.limits.shaft_low_rpm > 0.0:
        stands_rpm = min(stands_rpm, max(0.5 * machine.limits.shaft_low_rpm, 4.0 * noise_rpm))
    closes_s = max(
        (section.valve.close_s for section in machine.sections if section.valve), default=0.0
    )
    return replace(limits, shaft_stands_rpm=stands_rpm, valve_closes_s=closes_s + VALVE_DELAY_S)


def calc_open_share(strips: Sequence[SectionStrip], m: Measurements) -> float:
    """Returns the open share of the working width by the valves' own switches; 0 where the
    switches are silent."""
    if m.valves is None or not is_reading_fresh(m.valves.time_s, m.time_s, SHAFT_VALID_S):
        return 0.0
    return sum(strip.share for strip, on in zip(strips, m.valves.open, strict=False) if on)


class UnintendedFlow:
    """Counts the flow of a stopped machine. `commanded`: commands of the tick before. The order
    in each tick is `count_release`, `record_command`."""

    def __init__(self, machine: Machine, limits: SafetyLimits, obeyed: bool = True) -> None:
        """Creates the counter at zero. obeyed: False where the drives follow other commands, as
        in a replayed log."""
        self.commanded = PreviousCommands(
            turn=not obeyed,
            flow=not obeyed,
            enabled=False,
            opening_mm=machine.set_points.opening_mm,
        )
        self._shaft, self._stands_rpm, self._obeyed = machine.shaft, limits.shaft_stands_rpm, obeyed
        # Offset of the gate's sensor: the reading is larger by this, mm.
        self._offset_mm = machine.gate.offset_mm
        self._dose_until_s = -inf
        # Mass released since the stop command, kg.
        self._spell_kg = 0.0
        # Set after a calibrating run: the material of the stopping shaft falls into the tray.
        self._to_tray = False
        self._tray_kg = 0.0
        # Mass that is not in the log yet, kg.
        self._owed_kg = 0.0
        self._entered_s = -inf

    def find_turning_rpm(self, m: Measurements) -> float:
        """Returns the measured shaft speed, r/min; 0 where the shaft stands or is silent."""
        read = m.shaft_rpm
        known = read is not None and is_reading_fresh(read.time_s, m.time_s, SHAFT_VALID_S)
        return read.value if read is not None and known and read.value >= self._stands_rpm else 0.0

    def count_release(
        self,
        m: Measurements,
        dt_s: float,
        flow_kg_s: float | None,
        verdict: SafetyVerdict,
        worked: bool,
        unordered_kg: float = 0.0,
    ) -> tuple[float, str | None]:
        """Returns the mass to count in this tick, kg, and the row's event where due.

        worked: whether the tick counts as work. unordered_kg: mass that left by the scale while the
        shaft's reading is 0.
        """
        kg = self._calc_released_kg(m, dt_s, flow_kg_s)
        self._spell_kg = 0.0 if self.commanded.turn else self._spell_kg + kg
        counted_kg = (0.0 if worked else self._select_counted_kg(kg, verdict)) + unordered_kg
        return counted_kg, self._make_event(m.time_s, counted_kg)

    def record_command(
        self, now_s: float, command: DriveCommand, verdict: SafetyVerdict, expected: DrivePair
    ) -> None:
        """Stores the commands from now on. expected: present shaft speed and opening by the
        machine model."""
        if not self._obeyed:
            return
        if command.dose is not None:
            turns_s = command.dose.angle_deg / (6.0 * command.dose.shaft_rpm)
            answers_s = self._shaft.dead_time_s + self._shaft.extra_dead_time_s
            self._dose_until_s = max(self._dose_until_s, now_s) + answers_s + turns_s
        turn = command.shaft_rpm > 0.0 or now_s < self._dose_until_s
        self.commanded = PreviousCommands(
            turn,
            verdict.flow_allowed,
            verdict.state in POWERED_STATES,
            command.opening_mm,
            command.valves,
            expected.shaft_rpm,
            self._spell_kg,
            expected.opening_mm + self._offset_mm,
            command.shaft_rpm,
        )

    def _calc_released_kg(self, m: Measurements, dt_s: float, flow_kg_s: float | None) -> float:
        """Returns the mass by the measured shaft, kg; 0 unless the shaft turns despite a stop
        command."""
        if self.commanded.turn or flow_kg_s is None:
            return 0.0
        kg = flow_kg_s * dt_s
        return kg if self.find_turning_rpm(m) > 0.0 and kg > 0.0 and isfinite(kg) else 0.0

    def _select_counted_kg(self, kg: float, verdict: SafetyVerdict) -> float:
        """Returns the mass that counts. After a calibrating run the material of the stopping
        shaft falls into the tray; the material of a shaft that keeps turning counts."""
        if verdict.state is State.CALIBRATING:
            self._to_tray = True
        if not self._to_tray:
            return kg
        self._tray_kg += kg
        goes_on = any(
            alarm.id == "shaft_turns" and alarm.gone_s is None for alarm in verdict.alarms
        )
        counted_kg = self._tray_kg if goes_on else 0.0
        if goes_on or (
            kg <= 0.0 and verdict.state is not State.CALIBRATING and not self.commanded.turn
        ):
            self._to_tray, self._tray_kg = False, 0.0
        return counted_kg

    def _make_event(self, now_s: float, kg: float) -> str | None:
        """Returns the event at the end of a release, and every second during the release."""
        if self._owed_kg <= 0.0:
            self._entered_s = now_s
        self._owed_kg += kg
        if (
            kg > 0.0 and now_s - self._entered_s < EVENT_INTERVAL_S
        ) or self._owed_kg < MIN_EVENT_KG:
            return None
        event_kg, self._entered_s = round(self._owed_kg, 4), now_s
        self._owed_kg = max(0.0, self._owed_kg - event_kg)
        return f"released_stopped {event_kg:.4f}"
