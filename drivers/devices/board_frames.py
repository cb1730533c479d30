"""How are frames of the slave board's line protocol, version 1, converted to records and back?

docs/protocol-slave-board.md describes the protocol with the names and ranges used here. A board's
word is a random 32-bit number that it draws at power-on; a frame recorded under an earlier word is
refused.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Sequence
from typing import NamedTuple

from topdress.drivers.board.framing import (
    MAX_REPEATED_FRAMES,
    SEQUENCE_MODULUS,
    WORD_MODULUS,
    parse_number,
    parse_whole,
    seal_frame,
)
from topdress.drivers.devices.lines import RejectedSentence

PROTOCOL_VERSION = 1
COMMAND_FRAME, STATUS_FRAME = f"T{PROTOCOL_VERSION}", f"S{PROTOCOL_VERSION}"
# Status frame of a board whose section valves report their position by switches.
STATUS_FRAME_VALVES = "S2"
# Status frame with valves (empty without switches) and with the effort of shaft and gate.
STATUS_FRAME_EFFORT = "S3"
# Command frame with the valves of the sections; a board without valves refuses it.
COMMAND_FRAME_VALVES = "T2"
# Command frame with the board's word, so that a recorded frame cannot be replayed.
COMMAND_FRAME_WORD = "T3"
# The board's word, sent in answer to a request.
WORD_FRAME = "W1"
# The angle that the shaft has turned, sent in answer to `TURNED_REQUEST`.
TURNED_FRAME = "C1"
# Microseconds and pulses wrap at this number; words and command counts stay below it.
COUNTER_MODULUS = WORD_MODULUS
# The board stops its drives after this time without a command, s.
BOARD_STOP_TIMEOUT_S = 1.0

# A command frame has room for so many section valves.
MAX_SECTION_VALVES = 16
# Ranges of the set-points, r/min and mm, beyond which the board refuses a command.
SHAFT_SET_POINT_RANGE_RPM = (0.0, 300.0)
OPENING_SET_POINT_RANGE_MM = (0.0, 100.0)
STATUS_RANGES: dict[str, tuple[float, float]] = {
    "shaft_rpm": (-10.0, 400.0),
    "opening_mm": (-10.0, 110.0),
    "hopper_kg": (-100.0, 5000.0),
    "supply_v": (0.0, 60.0),
    "pitch_deg": (-60.0, 60.0),
    "roll_deg": (-60.0, 60.0),
}
MEASURED_FIELDS = tuple(STATUS_RANGES)
# The effort is in % of full duty, A or N m, as the machine file states.
EFFORT_RANGE = (0.0, 1000.0)

_CRC_DIGITS = re.compile(rb"[0-9A-Fa-f]{4}")


class CommandFrame(NamedTuple):
    """Holds the set-points of a frame from host to board. Every frame is also the heartbeat.

    `valves`: bit 0 is the leftmost section and 1 means open; None means that the machine has no
    valves. `word`: the board's word; None means that the board has no word, and `seq` then wraps at
    65536 instead of 2^32.
    """

    seq: int
    shaft_rpm: float
    opening_mm: float
    enable: bool
    valves: int | None = None
    word: int | None = None


class StatusFrame(NamedTuple):
    """Holds a frame from board to host. None means that the sensor is not fitted."""

    seq: int
    # Sequence number of the last command that the board accepted.
    echo: int
    # Time of the frame on the board's clock, microseconds.
    micros: int
    # Pulses of the wheel since power-on.
    pulses: int
    # Time of the last pulse on the board's clock, microseconds.
    pulse_micros: int
    shaft_rpm: float
    opening_mm: float
    hopper_kg: float | None = None
    supply_v: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    work_switch: bool | None = None
    flags: int = 0
    # Bit 0 is the leftmost section; 1 means open.
    valves_open: int | None = None
    shaft_effort: float | None = None
    gate_effort: float | None = None


class ShaftTurned(NamedTuple):
    """Holds how far the shaft has turned since power-on, modulo 2^32, and the board's counts per
    turn. None means that the board has no encoder or no metering stepper."""

    seq: int
    counts: int | None
    counts_per_turn: float | None
    steps: int | None
    steps_per_turn: float | None


def calc_crc16(payload: bytes) -> int:
    """Returns the CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, no reflection); `123456789`
    gives 0x29B1."""
    return binascii.crc_hqx(payload, 0xFFFF)


def is_repeated_sequence(seq: int, last: int | None) -> bool:
    """Returns whether a sequence number repeats the last number or shortly precedes it, across the
    wrap at 65536."""
    return last is not None and (last - seq) % SEQUENCE_MODULUS < MAX_REPEATED_FRAMES


def encode_valves(valves: Sequence[bool]) -> int:
    """Returns the valves as a bit mask: bit 0 is the leftmost section, 1 means open."""
    return sum(1 << k for k, on in enumerate(valves) if on is True)


def decode_valves(mask: int) -> tuple[bool, ...]:
    """Returns all valves that a frame has room for, from left to right; valves that a machine lacks
    are closed."""
    return tuple([bool(mask >> k & 1) for k in range(MAX_SECTION_VALVES)])


def encode_command(frame: CommandFrame) -> bytes:
    """Returns the line of a command with its CRC and line end.

    Raises
    ------
    ValueError : a set-point is not finite or outside of the range of the protocol.
    """
    for name, value, (low, high) in (
        ("shaft_rpm", frame.shaft_rpm, SHAFT_SET_POINT_RANGE_RPM),
        ("opening_mm", frame.opening_mm, OPENING_SET_POINT_RANGE_MM),
    ):
        if not low <= value <= high:
            raise ValueError(f"board command: {name} {value}, allowed is {low:g} to {high:g}")
    if frame.valves is not None and not 0 <= frame.valves < 1 << MAX_SECTION_VALVES:
        raise ValueError(
            f"board command: valves {frame.valves}, allowed is 0 to {(1 << MAX_SECTION_VALVES) - 1}"
        )
    set_points = f"{frame.shaft_rpm:.3f},{frame.opening_mm:.3f},{frame.enable:d}"
    valves = "" if frame.valves is None else f",{frame.valves}"
    if frame.word is not None:
        count = frame.seq % COUNTER_MODULUS
        return seal_frame(f"{COMMAND_FRAME_WORD},{count},{set_points}{valves or ','},{frame.word}")
    name = COMMAND_FRAME_VALVES if valves else COMMAND_FRAME
    return seal_frame(f"{name},{frame.seq % SEQUENCE_MODULUS},{set_points}{valves}")


WORD_REQUEST, TURNED_REQUEST = seal_frame("A1"), seal_frame("A2")


def decode_word(frame: bytes) -> tuple[int, int]:
    """Returns sequence number and word. Raises ValueError with the kind of fault."""
    fields = split_frame(frame, WORD_FRAME, 2)
    return parse_whole(fields[0], SEQUENCE_MODULUS - 1), parse_whole(fields[1], COUNTER_MODULUS - 1)


def decode_turned(frame: bytes) -> ShaftTurned:
    """Returns the turns of the shaft. Raises ValueError with the kind of fault."""
    seq, *set_points = split_frame(frame, TURNED_FRAME, 5)
    (counts, per_count), (steps, per_step) = (
        (
            parse_whole(set_points[k], COUNTER_MODULUS - 1),
            parse_number(set_points[k + 1], 1.0, 100000.0),
        )
        if set_points[k]
        else (None, None)
        for k in (0, 2)
    )
    return ShaftTurned(parse_whole(seq, SEQUENCE_MODULUS - 1), counts, per_count, steps, per_step)


def decode_status(frame: bytes) -> StatusFrame:
    """Returns the status of a frame as received, without `$` and line end. Raises ValueError with
    the kind of fault."""
    name = next(
        (
            name
            for name in (STATUS_FRAME_VALVES, STATUS_FRAME_EFFORT)
            if frame.startswith(name.encode())
        ),
        STATUS_FRAME,
    )
    fields = split_frame(
        frame, name, {STATUS_FRAME: 13, STATUS_FRAME_VALVES: 14, STATUS_FRAME_EFFORT: 16}[name]
    )
    seq, echo = (parse_whole(text, SEQUENCE_MODULUS - 1) for text in fields[:2])
    micros, pulses, pulse_micros = (parse_whole(text, COUNTER_MODULUS - 1) for text in fields[2:5])
    shaft_rpm = parse_number(fields[5], *STATUS_RANGES["shaft_rpm"])
    opening_mm = parse_number(fields[6], *STATUS_RANGES["opening_mm"])
    fitted = [
        parse_number(text, *STATUS_RANGES[name]) if text else None
        for name, text in zip(MEASURED_FIELDS[2:], fields[7:11], strict=True)
    ]
    hopper_kg, supply_v, pitch_deg, roll_deg = fitted
    work_switch = bool(parse_whole(fields[11], 1)) if fields[11] else None
    valved = name == STATUS_FRAME_VALVES or (name == STATUS_FRAME_EFFORT and fields[13] != b"")
    return StatusFrame(
        seq,
        echo,
        micros,
        pulses,
        pulse_micros,
        shaft_rpm,
        opening_mm,
        hopper_kg,
        supply_v,
        pitch_deg,
        roll_deg,
        work_switch,
        parse_whole(fields[12], 255),
        parse_whole(fields[13], (1 << MAX_SECTION_VALVES) - 1) if valved else None,
        *(parse_number(text, *EFFORT_RANGE) if text else None for text in fields[14:]),
    )


def split_frame(frame: bytes, kind: str, count: int) -> list[bytes]:
    """Returns the fields after the frame's name if CRC, name and number of fields are right. Raises
    RejectedSentence otherwise."""
    payload, star, crc = frame.partition(b"*")
    crc = crc.strip()
    if not star or not crc:
        raise RejectedSentence("missing_crc")
    if not _CRC_DIGITS.fullmatch(crc) or int(crc, 16) != calc_crc16(payload):
        raise RejectedSentence("bad_crc")
    name, *fields = payload.split(b",")
    if name != kind.encode():
        raise RejectedSentence("unknown_frame")
    if len(fields) != count:
        raise RejectedSentence("wrong_length")
    return fields
