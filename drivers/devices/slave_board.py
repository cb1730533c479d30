"""How does the host talk to the slave board? Status lines become readings, set-points become
command lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

from pydantic import Field
from topdress.control.readings import SENSED_COLUMNS, DriveCommand, Reading, ValvePositions
from topdress.control.signals import N_
from topdress.drivers.board.framing import SEQUENCE_MODULUS, seal_frame
from topdress.drivers.board.slave import (
    DRIVER_FAULT,
    ENABLED,
    HEARTBEAT_LOST,
    HOMING,
    OLD_ORDER,
    STEPS_LOST,
    WORD_UNUSED,
)
from topdress.drivers.devices.board_frames import (
    TURNED_FRAME,
    WORD_FRAME,
    WORD_REQUEST,
    CommandFrame,
    ShaftTurned,
    StatusFrame,
    decode_status,
    decode_turned,
    decode_valves,
    decode_word,
    encode_command,
    encode_valves,
    is_repeated_sequence,
)
from topdress.drivers.devices.device import LineConfig, LineDevice, OpenLine, Record
from topdress.drivers.devices.lines import LineDecoder, RejectedSentence
from topdress.drivers.devices.point_dose import REPORT_FRAME, PointDose, decode_dose_report
from topdress.drivers.devices.wheel import WheelGeometry, WheelSpeed

DOSE_REPORT_PREFIX = REPORT_FRAME.encode() + b","
BOARD_WORD_PREFIX, SHAFT_TURNED_PREFIX = WORD_FRAME.encode() + b",", TURNED_FRAME.encode() + b","
# Number of unanswered requests for the word, one with each command at 20 a second, after which the
# board is taken to have no word.
MAX_WORD_REQUESTS = 20


class BoardConfig(LineConfig):
    """Describes the slave board, the limits of its drives and the wheel whose pulses it counts."""

    max_shaft_rpm: Annotated[float, Field(gt=0, le=300)] = 100.0
    max_opening_mm: Annotated[float, Field(gt=0, le=100)] = 60.0
    wheel_circumference_m: Annotated[float, Field(gt=0, le=20)] = 2.50
    wheel_pulses_per_turn: Annotated[float, Field(ge=1, le=10000)] = 16.0
    # On a machine with a switch, silence of the switch means that the implement is lifted.
    work_switch: bool = False


class SetPointLimits(NamedTuple):
    """Limits set-points to the range from 0 to these values before they are sent."""

    max_shaft_rpm: float = 100.0
    max_opening_mm: float = 60.0


class BoardReadings(NamedTuple):
    """Holds one accepted status line. None means that the sensor is not fitted or, for the wheel,
    that the speed is unknown."""

    time_s: float
    shaft_rpm: Reading
    opening_mm: Reading
    wheel_speed_mps: Reading | None
    hopper_kg: Reading | None
    supply_v: Reading | None
    pitch_deg: Reading | None
    roll_deg: Reading | None
    work_switch: bool | None
    pulses: int
    echo: int
    enabled: bool
    heartbeat_lost: bool
    driver_fault: bool
    steps_lost: bool = False
    homing: bool = False
    valves: ValvePositions | None = None
    old_order: bool = False
    shaft_effort: Reading | None = None
    gate_effort: Reading | None = None


class SlaveBoard(LineDecoder[BoardReadings]):
    """Decodes bytes of the board to readings and encodes commands. It opens nothing and reads no
    clock.

    Counted as rejected: `bad_crc`, `missing_crc`, `unknown_frame` (another name or version),
    `wrong_length` (number of fields), `not_a_number`, `out_of_range`, `repeated_sequence`,
    `garbage`, `overlong`. `missed` counts the status lines that are missing by their sequence
    numbers. `dose` holds the state of the doses sent by `give_dose`.
    """

    longest, framed, wrong = 200, True, ValueError

    def __init__(
        self, limits: SetPointLimits | None = None, wheel: WheelGeometry | None = None
    ) -> None:
        super().__init__()
        self.missed = 0
        self._limits = limits or SetPointLimits()
        self._wheel = WheelSpeed(wheel or WheelGeometry())
        self._last_seq: int | None = None
        self._next_command = 0
        # The board's word; None means that the board has no word, or has not sent it yet.
        self._word: int | None = None
        # Whether the word is requested with every command until the answer arrives.
        self._ask = False
        self._asked = 0
        self._sent_opening_mm = 0.0
        # The valves of the newest command.
        self._valves = 0
        self.dose = PointDose(self._limits.max_shaft_rpm)
        # The newest answer to `TURNED_REQUEST`.
        self.turned: ShaftTurned | None = None

    def make_command_line(self, command: DriveCommand | None, enabled: bool) -> bytes:
        """Returns the next command line, heartbeat included, to be sent at least 10 times a second.
        A request for the board's word precedes it while the board has not received a frame with
        that word.

        Set-points are limited to the range of the drives. Without `enabled` or a command the
        set-point of the shaft is 0, the gate keeps its set-point, and every valve of a machine with
        valves is closed.

        Raises
        ------
        ValueError : a set-point is not finite. Nothing is sent then; send a stop.
        """
        running = enabled and command is not None
        shaft_rpm, opening_mm = 0.0, self._sent_opening_mm
        if command is not None:
            if not (math.isfinite(command.shaft_rpm) and math.isfinite(command.opening_mm)):
                raise ValueError(
                    f"board command: shaft_rpm {command.shaft_rpm}, opening_mm "
                    f"{command.opening_mm}: "
                    "allowed are finite numbers"
                )
            opening_mm = min(max(command.opening_mm, 0.0), self._limits.max_opening_mm)
            shaft_rpm = (
                min(max(command.shaft_rpm, 0.0), self._limits.max_shaft_rpm) if running else 0.0
            )
            self._valves = len(command.valves)
        valves = (
            encode_valves(command.valves if running and command is not None else ())
            if self._valves
            else None
        )
        line = encode_command(
            CommandFrame(self._next_command, shaft_rpm, opening_mm, running, valves, self._word)
        )
        self._next_command += 1
        self._sent_opening_mm = opening_mm
        if not self._ask:
            return line
        self._asked += 1
        if self._asked >= MAX_WORD_REQUESTS:
            self._word, self._ask = None, False
        return WORD_REQUEST + line

    def forget_board(self) -> None:
        """Forgets the board, because another board or an older program may be connected now. The
        word is requested again from a board that had one."""
        self._ask, self._asked = self._word is not None, 0

    def give_dose(self, angle_deg: float, shaft_rpm: float, now_s: float) -> bytes:
        """Returns the line of one dose of a point applicator. Raises ValueError as
        `PointDose.give_dose` does."""
        line = self.dose.give_dose(angle_deg, shaft_rpm, self._next_command, now_s, self._word)
        self._next_command += 1
        return line

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[BoardReadings]:
        if sentence.startswith(DOSE_REPORT_PREFIX):
            report = decode_dose_report(sentence)
            self._count_sequence(report.seq)
            self.dose.take_report(report, time_s)
            return []
        if sentence.startswith(BOARD_WORD_PREFIX):
            seq, word = decode_word(sentence)
            self._count_sequence(seq)
            self._word, self._ask, self._asked = word, False, 0
            return []
        if sentence.startswith(SHAFT_TURNED_PREFIX):
            turned = decode_turned(sentence)
            self._count_sequence(turned.seq)
            self.turned = turned
            return []
        return [self._take_status(decode_status(sentence), time_s)]

    def _count_sequence(self, seq: int) -> None:
        """Counts missed frames. Raises RejectedSentence for a repeated frame."""
        if is_repeated_sequence(seq, self._last_seq):
            raise RejectedSentence("repeated_sequence")
        if self._last_seq is not None:
            skipped = (seq - self._last_seq - 1) % SEQUENCE_MODULUS
            self.missed += skipped if skipped < SEQUENCE_MODULUS // 2 else 0
        self._last_seq = seq

    def _take_status(self, status: StatusFrame, time_s: float) -> BoardReadings:
        self._count_sequence(status.seq)
        self._ask = self._ask or bool(status.flags & WORD_UNUSED)
        speed_mps = self._wheel.update_speed(status.micros, status.pulses, status.pulse_micros)

        def reading(value: float | None) -> Reading | None:
            return None if value is None else Reading(value, time_s)

        return BoardReadings(
            time_s,
            Reading(status.shaft_rpm, time_s),
            Reading(status.opening_mm, time_s),
            reading(speed_mps),
            reading(status.hopper_kg),
            reading(status.supply_v),
            reading(status.pitch_deg),
            reading(status.roll_deg),
            status.work_switch,
            status.pulses,
            status.echo,
            bool(status.flags & ENABLED),
            bool(status.flags & HEARTBEAT_LOST),
            bool(status.flags & DRIVER_FAULT),
            bool(status.flags & STEPS_LOST),
            bool(status.flags & HOMING),
            None
            if status.valves_open is None
            else ValvePositions(time_s, decode_valves(status.valves_open)),
            bool(status.flags & OLD_ORDER),
            reading(status.shaft_effort),
            reading(status.gate_effort),
        )


# Names of the readings that the board contributes to `Measurements`.
BOARD_READINGS = tuple(name for name in SENSED_COLUMNS if name in BoardReadings._fields)


def make_board(config: BoardConfig | None) -> SlaveBoard:
    """Returns the decoder of a section; of None with the limits and the wheel of no machine."""
    if config is None:
        return SlaveBoard()
    return SlaveBoard(
        SetPointLimits(config.max_shaft_rpm, config.max_opening_mm),
        WheelGeometry(config.wheel_circumference_m, config.wheel_pulses_per_turn),
    )


def find_measurements(readings: BoardReadings) -> Mapping[str, Any]:
    """Returns the measurements of a status line; a sensor that is not fitted sets none."""
    found = {
        name: value for name in BOARD_READINGS if (value := getattr(readings, name)) is not None
    }
    if readings.work_switch is not None:
        found["work_switch"] = readings.work_switch, readings.time_s
    return found | {
        "valves": readings.valves,
        "drive_fault": readings.driver_fault,
        "old_orders": readings.old_order,
    }


def make_record(readings: BoardReadings) -> Record:
    """Returns a status line under the run log's column names."""
    record: Record = {
        name: None if (reading := getattr(readings, name)) is None else reading.value
        for name in BOARD_READINGS
    }
    record["work_switch"] = None if readings.work_switch is None else int(readings.work_switch)
    return record


def make_example() -> bytes:
    """Returns forty status lines of a board at work, 50 ms apart."""
    return b"".join(
        seal_frame(
            f"S1,{tick},{tick},{tick * 50_000},{tick // 3},{tick * 50_000},60.000,25.000,"
            "250.000,13.500,1.000,0.000,1,1"
        )
        for tick in range(40)
    )


def open_board(config: BoardConfig) -> Sequence[OpenLine]:
    """Returns the line of a board. After a connection another board, or the same board restarted,
    may be at its end; a dose without an answer is given up in time."""
    line = DEVICE.make_line(config)
    board: SlaveBoard = line.decoder

    def begin() -> bytes:
        board.forget_board()
        return b""

    def find_state(now_s: float) -> Mapping[str, Any]:
        board.dose.check_overdue(now_s)
        return {}

    return (replace(line, begin=begin, find_state=find_state),)


DEVICE = LineDevice(
    section="board",
    title=N_("drive board"),
    protocol="slave-board/1",
    heard_as="slave-board/1",
    config=BoardConfig,
    make_decoder=make_board,
    find_measurements=find_measurements,
    make_record=make_record,
    make_example=make_example,
    open_lines=open_board,
    rank=3,
)
