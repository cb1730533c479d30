"""The slave board's program as the virtual machine runs it: commands in, safe stop, status lines out."""
from __future__ import annotations

import secrets
from collections.abc import Callable

from control.readings import DoseOrder, DriveCommand
from control.simulation.plant import SensorReadings
from drivers.board.framing import Newest
from drivers.devices.board_frames import (
    ASK,
    COUNTERS,
    FLAG_DRIVER_FAULT,
    FLAG_ENABLED,
    FLAG_HEARTBEAT_LOST,
    FLAG_OLD_ORDER,
    FLAG_WORD_UNUSED,
    SEQUENCES,
    SILENT_HOST_S,
    BadFrame,
    CommandFrame,
    StatusFrame,
    crc16,
    decode_command,
    encode_status,
    encode_word,
    valves_mask,
    valves_of,
)
from drivers.devices.lines import Counts, LineCutter
from drivers.devices.point_dose import DOSE, DOSE_WORD, REPORT, DoseFrame, DoseState, decode_dose

# Doses as the virtual board gives them: `D1` or `D3` in, one `DoseOrder` to the plant, `E1` out.
REPORTED_S = 0.3                # what became of a dose is said again this long


class VirtualDoses:
    """One after the other; what the board's own program does (docs/protocol-slave-board.md) without its steps."""

    def __init__(self) -> None:
        self.given = 0
        self._order: DoseOrder | None = None        # not yet at the plant
        self._dose = 0
        self._angle_deg = 0.0
        self._begin_s = 0.0
        self._ends_s: float | None = None           # of the one under way
        self._report: str | None = None
        self._reported_until_s = float("-inf")

    def take(self, frame: DoseFrame, enabled: bool, now_s: float) -> None:
        """One that is newer than all before it."""
        if not enabled or self._ends_s is not None:
            self._tell(frame.dose, DoseState.REFUSED, 0.0, now_s, now_s)
            return
        self._order = order = DoseOrder(frame.angle_deg, frame.shaft_rpm)
        self._dose, self._angle_deg, self._begin_s = frame.dose, order.angle_deg, now_s
        self._ends_s = now_s + order.angle_deg / (6.0 * order.shaft_rpm)
        self._tell(frame.dose, DoseState.RUNNING, 0.0, now_s, now_s)

    def order(self, enabled: bool, now_s: float) -> DoseOrder | None:
        """The dose that begins in this step. A stop ends the one under way."""
        if self._ends_s is not None and not enabled:
            share = (now_s - self._begin_s) / (self._ends_s - self._begin_s)
            self._tell(self._dose, DoseState.ABORTED, min(1.0, share) * self._angle_deg, self._begin_s, now_s)
            self._order = self._ends_s = None
        elif self._ends_s is not None and now_s >= self._ends_s - 1e-9:
            self._tell(self._dose, DoseState.DONE, self._angle_deg, self._begin_s, self._ends_s)
            self._ends_s = None
        order, self._order = self._order, None
        self.given += order is not None
        return order

    def report(self, seq: int, now_s: float) -> bytes:
        """The line that follows a status line; empty where there is nothing to say."""
        if self._report is None or now_s > self._reported_until_s:
            return b""
        payload = f"{REPORT},{seq % SEQUENCES},{self._report}".encode()
        return b"$%b*%04X\r\n" % (payload, crc16(payload))

    def _tell(self, dose: int, state: DoseState, turned_deg: float, begin_s: float, end_s: float) -> None:
        begin, end = (round(at_s * 1e6) % COUNTERS for at_s in (begin_s, end_s))
        self._report = f"{dose},{state:d},{turned_deg:.3f},{begin},{end}"
        self._reported_until_s = end_s + REPORTED_S


DOSE_FRAMES = DOSE.encode(), DOSE_WORD.encode()
ASK_FRAME = ASK[1:].strip()
OLD_ORDER_S = 1.0               # an old order is reported this long


class VirtualBoard:
    """One board. After power-on, and after the host was silent for a second, it stands still until it has received a
    command with enable 0; the next one with enable 1 then turns the drives. Standing still: the shaft stops, the gate
    keeps the set-point that it had; at power-on that is where it stands, `opening_mm`. `chance`: of its words, as the
    board's own program has it; None: an older board, which knows none.
    """

    def __init__(self, opening_mm: float = 0.0,
                 chance: Callable[[], int | None] = lambda: secrets.randbits(32)) -> None:
        self.counts = Counts()
        self.driver_fault = False           # set by tests and by fault injection
        self._cutter = LineCutter(self.counts, longest=120)
        self._command = CommandFrame(0, 0.0, opening_mm, False)
        self._opening_mm = opening_mm
        self._heard_s: float | None = None
        self._newest = Newest(chance)
        self._old_order_until_s = float("-inf")
        self._asked = False
        self._armed = False
        self._heartbeat_lost = False
        self._status_seq = 0
        self._pulses = 0
        self._pulse_s = 0.0
        self._doses = VirtualDoses()

    @property
    def word(self) -> int | None:
        """Under which it takes orders now."""
        return self._newest.word

    def feed(self, data: bytes, now_s: float) -> None:
        """Commands received at `now_s`; wrong ones are counted by kind and change nothing, but for an old one, which
        stops the board."""
        self._watch_heartbeat(now_s)
        for line in self._cutter.feed(data):
            for frame in line.split(b"$")[1:]:
                try:
                    self._obey(frame, now_s)
                except (BadFrame, ValueError) as kind:
                    self._reject(str(kind), now_s)

    def set_points(self, now_s: float) -> tuple[DriveCommand, bool]:
        """What the drives follow at `now_s`, and whether they are enabled."""
        self._watch_heartbeat(now_s)
        enabled = self._armed and self._command.enable and not self.driver_fault
        if enabled:
            self._opening_mm = self._command.opening_mm
        mask = (self._command.valves or 0) if enabled else 0
        valves = () if self._command.valves is None else valves_of(mask)
        return DriveCommand(self._command.shaft_rpm if enabled else 0.0, self._opening_mm, valves=valves), enabled

    def dose(self, now_s: float) -> DoseOrder | None:
        """The dose that the plant begins in this step; to be asked once a step."""
        return self._doses.order(self.set_points(now_s)[1], now_s)

    def status(self, sensed: SensorReadings, now_s: float) -> bytes:
        """The status line of this tick. A pulse whose moment is not known is taken to have come at the end of its
        tick."""
        if sensed.wheel_pulses != self._pulses:
            self._pulses = sensed.wheel_pulses
            self._pulse_s = sensed.wheel_pulse_s or sensed.time_s
        enabled = self.set_points(now_s)[1]
        flags = (FLAG_ENABLED * enabled | FLAG_HEARTBEAT_LOST * self._heartbeat_lost
                 | FLAG_DRIVER_FAULT * self.driver_fault | FLAG_OLD_ORDER * (now_s < self._old_order_until_s)
                 | FLAG_WORD_UNUSED * (self._newest.word is not None and not self._newest.used))
        line = encode_status(StatusFrame(
            self._status_seq, max(self._newest.last, 0) % SEQUENCES, round(sensed.time_s * 1e6), self._pulses,
            round(self._pulse_s * 1e6), sensed.shaft_rpm, sensed.opening_mm, sensed.hopper_kg, sensed.supply_v,
            sensed.pitch_deg, sensed.roll_deg, sensed.work_switch, flags,
            None if sensed.valves_open is None else valves_mask(sensed.valves_open), sensed.shaft_effort,
            sensed.gate_effort))
        self._status_seq += 1
        report = self._doses.report(self._status_seq, now_s)
        self._status_seq += 1 if report else 0
        return line + report + self._answer()

    def _answer(self) -> bytes:
        if not self._asked or self._newest.word is None:
            return b""
        self._asked = False
        self._status_seq += 1
        return encode_word(self._status_seq - 1, self._newest.word)

    def _watch_heartbeat(self, now_s: float) -> None:
        if self._heard_s is not None and now_s - self._heard_s >= SILENT_HOST_S:
            self._heartbeat_lost, self._armed, self._heard_s = True, False, None
            self._newest.renew()

    def _reject(self, kind: str, now_s: float) -> None:
        self.counts.reject(kind)
        if kind == "old_order":
            self._armed = False
            if self._newest.used or self._newest.word is None:
                self._old_order_until_s = now_s + OLD_ORDER_S

    def _obey(self, frame: bytes, now_s: float) -> None:
        """Raises BadFrame, or ValueError, with its kind."""
        if self._newest.word is None and frame[:2] in (b"A1", b"T3", b"D3"):
            raise BadFrame("unknown_frame")
        if frame == ASK_FRAME:
            self._asked = True
        elif frame.startswith(DOSE_FRAMES):
            dose = decode_dose(frame)
            self._newest.take(dose.seq, dose.word)
            self._doses.take(dose, self.set_points(now_s)[1], now_s)
        else:
            self._take(decode_command(frame), now_s)
        self.counts.accept()

    def _take(self, command: CommandFrame, now_s: float) -> None:
        self._newest.take(command.seq, command.word)
        if not command.enable:
            self._armed, self._heartbeat_lost = True, False
        self._heard_s, self._command = now_s, command
