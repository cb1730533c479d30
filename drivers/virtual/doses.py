"""Doses as the virtual board gives them: `D1` or `D3` in, one `DoseOrder` to the plant, `E1` out."""
from __future__ import annotations

from control.readings import DoseOrder
from drivers.devices.board_frames import COUNTERS, SEQUENCES, crc16
from drivers.devices.point_dose import REPORT, DoseFrame, DoseState

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
