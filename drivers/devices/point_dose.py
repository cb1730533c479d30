"""How is the dose for one plant ordered (point-fertilisation paper)? The board receives an angle of
the shaft.

Doses go to the slave board on the line of its targets, in frames `D1` and `E1`
(docs/protocol-slave-board.md). The targets with enable 1 and 0 r/min continue meanwhile: they are
the heartbeat, and a stop ends the present dose.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from topdress.drivers.board.framing import SEQUENCE_MODULUS, parse_number, parse_whole, seal_frame
from topdress.drivers.devices.board_frames import COUNTER_MODULUS, split_frame
from topdress.drivers.devices.lines import RejectedSentence

DOSE_FRAME, REPORT_FRAME = "D1", "E1"
# Dose frame with the board's word, as `board_frames.COMMAND_FRAME_WORD`.
DOSE_FRAME_WORD = "D3"
# Range of the angle, degrees: at most ten turns.
ANGLE_RANGE_DEG = (0.0, 3600.0)
# Range of the shaft's speed during a dose, r/min.
SHAFT_RANGE_RPM = (1.0, 300.0)
# Time without a report after which the result of a dose is unknown, s.
REPORT_TIMEOUT_S = 0.3
# Time beyond the duration of its angle after which a dose is overdue, s.
DOSE_OVERDUE_S = 0.5


class DoseState(IntEnum):
    """Names the states that the board reports; SENT and LOST are the host's own."""

    SENT = 0
    RUNNING = 1
    DONE = 2
    REFUSED = 3
    ABORTED = 4
    LOST = 5


class DoseReport(NamedTuple):
    """Holds one `E1` frame. Times are on the board's 32-bit clock, microseconds."""

    seq: int
    dose: int
    state: DoseState
    turned_deg: float
    begin_micros: int
    end_micros: int


class DoseProgress(NamedTuple):
    """Holds the state of one dose. `took_s` is the time from the board's receipt to the end of the
    dose, on the board's clock."""

    number: int
    angle_deg: float
    shaft_rpm: float
    sent_s: float
    state: DoseState = DoseState.SENT
    turned_deg: float = 0.0
    took_s: float | None = None
    # Time of the board's first answer, s: link delay plus one tick after the sending.
    heard_s: float | None = None

    @property
    def is_settled(self) -> bool:
        """Whether the board has reported how this dose ended."""
        return self.state > DoseState.RUNNING


def encode_dose(
    seq: int, dose: int, angle_deg: float, shaft_rpm: float, word: int | None = None
) -> bytes:
    """Returns the line of a dose. Raises ValueError for a number that is not finite or not allowed
    by the protocol."""
    for name, value, (low, high) in (
        ("angle_deg", angle_deg, ANGLE_RANGE_DEG),
        ("shaft_rpm", shaft_rpm, SHAFT_RANGE_RPM),
    ):
        if not low <= value <= high:
            raise ValueError(f"dose: {name} {value}, allowed is {low:g} to {high:g}")
    name, count, tail = (
        (DOSE_FRAME, seq % SEQUENCE_MODULUS, "")
        if word is None
        else (DOSE_FRAME_WORD, seq % COUNTER_MODULUS, f",{word}")
    )
    return seal_frame(
        f"{name},{count},{dose % SEQUENCE_MODULUS},{angle_deg:.3f},{shaft_rpm:.3f}{tail}"
    )


def decode_dose_report(frame: bytes) -> DoseReport:
    """Returns the report of a frame as received, without `$` and line end. Raises ValueError with
    the kind of fault."""
    fields = split_frame(frame, REPORT_FRAME, 6)
    seq, dose = (
        parse_whole(fields[0], SEQUENCE_MODULUS - 1),
        parse_whole(fields[1], SEQUENCE_MODULUS - 1),
    )
    state = parse_whole(fields[2], DoseState.ABORTED)
    if state < DoseState.RUNNING:
        raise RejectedSentence("out_of_range")
    turned_deg = parse_number(fields[3], 0.0, 2.0 * ANGLE_RANGE_DEG[1])
    return DoseReport(
        seq,
        dose,
        DoseState(state),
        turned_deg,
        parse_whole(fields[4], COUNTER_MODULUS - 1),
        parse_whole(fields[5], COUNTER_MODULUS - 1),
    )


class PointDose:
    """Gives one dose after the other. Doses share the sequence numbers of the board driver, because
    every frame to the board counts.

    A dose is never sent twice: a missed plant is reported (LOST), but a double dose cannot be
    undone.
    """

    def __init__(self, max_shaft_rpm: float = 201.0) -> None:
        self.newest: DoseProgress | None = None
        self._max_shaft_rpm = max_shaft_rpm
        self._next = 0

    @property
    def is_ready(self) -> bool:
        """Returns whether the next dose may be sent."""
        return self.newest is None or self.newest.is_settled

    def give_dose(
        self, angle_deg: float, shaft_rpm: float, seq: int, now_s: float, word: int | None = None
    ) -> bytes:
        """Returns the line of a new dose, to be sent at `now_s`; the speed is cut to the limit.

        Raises
        ------
        ValueError : a number is not finite or not allowed, or the previous dose is not finished.
        """
        if not self.is_ready:
            raise ValueError("dose: the one before is still under way")
        if not math.isfinite(shaft_rpm):
            raise ValueError(
                f"dose: shaft_rpm {shaft_rpm}, allowed is {SHAFT_RANGE_RPM[0]:g} to "
                f"{self._max_shaft_rpm:g}"
            )
        rpm = min(shaft_rpm, self._max_shaft_rpm)
        line = encode_dose(seq, self._next, angle_deg, rpm, word)
        self.newest = DoseProgress(self._next, angle_deg, rpm, now_s)
        self._next = (self._next + 1) % SEQUENCE_MODULUS
        return line

    def take_report(self, report: DoseReport, now_s: float) -> None:
        """Updates the dose by a report of the board; reports of older or finished doses change
        nothing."""
        dose = self.newest
        if (
            dose is None
            or dose.is_settled
            or report.dose != dose.number
            or report.state < dose.state
        ):
            return
        took_s = (report.end_micros - report.begin_micros) % COUNTER_MODULUS * 1e-6
        self.newest = dose._replace(
            state=report.state,
            turned_deg=report.turned_deg,
            took_s=took_s if report.state > DoseState.RUNNING else None,
            heard_s=now_s if dose.heard_s is None else dose.heard_s,
        )

    def check_overdue(self, now_s: float) -> None:
        """Marks a dose without a report in time as LOST; the method is called every tick."""
        dose = self.newest
        if dose is None or dose.is_settled:
            return
        turning_s = dose.angle_deg / (6.0 * dose.shaft_rpm)
        limit_s = REPORT_TIMEOUT_S if dose.state is DoseState.SENT else turning_s + DOSE_OVERDUE_S
        if now_s - dose.sent_s > limit_s:
            self.newest = dose._replace(state=DoseState.LOST)
