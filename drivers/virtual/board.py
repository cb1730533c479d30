"""The slave board's program as the virtual machine runs it: commands in, safe stop, status lines out."""
from __future__ import annotations

from control.readings import DoseOrder, DriveCommand
from drivers.devices.board_frames import (
    FLAG_DRIVER_FAULT,
    FLAG_ENABLED,
    FLAG_HEARTBEAT_LOST,
    SEQUENCES,
    SILENT_HOST_S,
    BadFrame,
    CommandFrame,
    StatusFrame,
    decode_command,
    encode_status,
    is_repeat,
    open_frame,
    valves_mask,
    valves_of,
    whole,
)
from drivers.devices.lines import Counts, LineCutter
from drivers.devices.point_dose import DOSE
from drivers.virtual.doses import VirtualDoses
from drivers.virtual.encoders import Sensed

DOSE_FRAME = DOSE.encode()


class VirtualBoard:
    """One board. After power-on, and after the host was silent for a second, it stands still until it has received a
    command with enable 0; the next one with enable 1 then turns the drives. Standing still: the shaft stops, the gate
    keeps the set-point that it had; at power-on that is where it stands, `opening_mm`.
    """

    def __init__(self, opening_mm: float = 0.0) -> None:
        self.counts = Counts()
        self.driver_fault = False           # set by tests and by fault injection
        self._cutter = LineCutter(self.counts, longest=120)
        self._command = CommandFrame(0, 0.0, opening_mm, False)
        self._opening_mm = opening_mm
        self._heard_s: float | None = None
        self._last_seq: int | None = None
        self._armed = False
        self._heartbeat_lost = False
        self._status_seq = 0
        self._pulses = 0
        self._pulse_s = 0.0
        self._doses = VirtualDoses()

    def feed(self, data: bytes, now_s: float) -> None:
        """Commands received at `now_s`; wrong ones are counted by kind and change nothing."""
        for line in self._cutter.feed(data):
            for frame in line.split(b"$")[1:]:
                try:
                    if frame.startswith(DOSE_FRAME):
                        self._take_dose(frame, now_s)
                    else:
                        self._take(decode_command(frame), now_s)
                except BadFrame as kind:
                    self.counts.reject(str(kind))

    def set_points(self, now_s: float) -> tuple[DriveCommand, bool]:
        """What the drives follow at `now_s`, and whether they are enabled."""
        if self._heard_s is not None and now_s - self._heard_s >= SILENT_HOST_S:
            self._heartbeat_lost, self._armed = True, False
        enabled = self._armed and self._command.enable and not self.driver_fault
        if enabled:
            self._opening_mm = self._command.opening_mm
        mask = (self._command.valves or 0) if enabled else 0
        valves = () if self._command.valves is None else valves_of(mask)
        return DriveCommand(self._command.shaft_rpm if enabled else 0.0, self._opening_mm, valves=valves), enabled

    def dose(self, now_s: float) -> DoseOrder | None:
        """The dose that the plant begins in this step; to be asked once a step."""
        return self._doses.order(self.set_points(now_s)[1], now_s)

    def status(self, sensed: Sensed, now_s: float) -> bytes:
        """The status line of this tick. A plant may tell the moment of its last pulse as `wheel_pulse_s` (on its own
        clock, `Sensed.time_s`); otherwise a pulse is taken to have come at the end of its tick.
        """
        if sensed.wheel_pulses != self._pulses:
            self._pulses = sensed.wheel_pulses
            self._pulse_s = getattr(sensed, "wheel_pulse_s", None) or sensed.time_s
        enabled = self.set_points(now_s)[1]
        flags = (FLAG_ENABLED * enabled | FLAG_HEARTBEAT_LOST * self._heartbeat_lost
                 | FLAG_DRIVER_FAULT * self.driver_fault)
        switches = getattr(sensed, "valves_open", None)     # of a plant whose valves have some
        line = encode_status(StatusFrame(
            self._status_seq, self._last_seq or 0, round(sensed.time_s * 1e6), self._pulses,
            round(self._pulse_s * 1e6), sensed.shaft_rpm, sensed.opening_mm, sensed.hopper_kg, sensed.supply_v,
            sensed.pitch_deg, sensed.roll_deg, sensed.work_switch, flags,
            None if switches is None else valves_mask(switches)))
        self._status_seq += 1
        report = self._doses.report(self._status_seq, now_s)
        self._status_seq += 1 if report else 0
        return line + report

    def _take_dose(self, frame: bytes, now_s: float) -> None:
        seq = whole(open_frame(frame, DOSE, 4)[0], SEQUENCES - 1)
        if is_repeat(seq, self._last_seq):
            raise BadFrame("repeated_sequence")
        self._last_seq = self._doses.take(frame, self.set_points(now_s)[1], now_s)
        self.counts.accept()

    def _take(self, command: CommandFrame, now_s: float) -> None:
        silent = self._heard_s is None or now_s - self._heard_s >= SILENT_HOST_S
        if not silent and is_repeat(command.seq, self._last_seq):
            raise BadFrame("repeated_sequence")
        if silent:
            self._armed = False
        if not command.enable:
            self._armed, self._heartbeat_lost = True, False
        self._last_seq, self._heard_s, self._command = command.seq, now_s, command
        self.counts.accept()
