"""How are frames of the slave board's line protocol, version 1, converted to records and back?

The protocol is described in docs/protocol-slave-board.md; the names and ranges here are the
same as there."""

from __future__ import annotations

import binascii
import re
from collections.abc import Sequence
from typing import NamedTuple

from topdress.drivers.board.framing import (
    REPEAT_WINDOW,
    SEQUENCE_MODULUS,
    WORD_MODULUS,
    parse_number,
    parse_whole,
    seal_frame,
)
from topdress.drivers.devices.lines import Rejected

VERSION = 1
COMMAND, STATUS = f"T{VERSION}", f"S{VERSION}"
# the same with how the sections' valves stand, from a board whose valves have switches
STATUS_VALVES = "S2"
# both, valves empty where it has none, and how hard shaft and gate work
STATUS_EFFORT = "S3"
# the same with the sections' valves; a board without them does not obey it
COMMAND_VALVES = "T2"
# both, with the board's word: what was recorded under another one is old
COMMAND_WORD = "T3"
WORD = "W1"  # the board's word, in answer to ASK
# how far the shaft turned, in answer to ASK_TURNED
TURNED = "C1"
# micros and pulses run over here; words, and counts of commands with one, are below it
COUNTER_MODULUS = WORD_MODULUS
HOST_TIMEOUT_S = 1.0  # the board stops by itself after this

MAX_VALVES = 16
COMMAND_SHAFT_RPM = (0.0, 300.0)
COMMAND_OPENING_MM = (0.0, 100.0)
STATUS_RANGES: dict[str, tuple[float, float]] = {
    "shaft_rpm": (-10.0, 400.0),
    "opening_mm": (-10.0, 110.0),
    "hopper_kg": (-100.0, 5000.0),
    "supply_v": (0.0, 60.0),
    "pitch_deg": (-60.0, 60.0),
    "roll_deg": (-60.0, 60.0),
}
MEASURED_FIELDS = tuple(STATUS_RANGES)
# % of full duty, A or N m: as the machine file says
EFFORT_RANGE = (0.0, 1000.0)

_CRC = re.compile(rb"[0-9A-Fa-f]{4}")


class CommandFrame(NamedTuple):
    """Holds a frame from host to board: set-points. Every frame is also the heartbeat. `valves`:
    bit 0 the leftmost section, 1 open; None: the machine has none. `word`: the board's; None: it
    has none, and `seq` overflows at 65536 instead of 2^32."""

    seq: int
    shaft_rpm: float
    opening_mm: float
    enable: bool
    valves: int | None = None
    word: int | None = None


class StatusFrame(NamedTuple):
    """Holds a frame from board to host. `None`: not fitted."""

    seq: int
    echo: int  # sequence number of the last command accepted
    micros: int  # the board's clock now
    pulses: int  # of the wheel, since power-on
    pulse_micros: int  # the board's clock at the last pulse
    shaft_rpm: float
    opening_mm: float
    hopper_kg: float | None = None
    supply_v: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    work_switch: bool | None = None
    flags: int = 0
    valves_open: int | None = None  # bit 0 the leftmost section, 1 open
    shaft_effort: float | None = None
    gate_effort: float | None = None


class ShaftTurned(NamedTuple):
    """Holds how far the shaft turned since power-on, below 2^32, and the board's length of a
    turn. `None`: no encoder, or no metering stepper."""

    seq: int
    counts: int | None
    counts_per_turn: float | None
    steps: int | None
    steps_per_turn: float | None


def calc_crc16(payload: bytes) -> int:
    """Returns the CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected;
    `123456789` gives 0x29B1."""
    return binascii.crc_hqx(payload, 0xFFFF)


def is_repeated_sequence(seq: int, last: int | None) -> bool:
    """Returns whether a sequence number is the last one or shortly before it, over the wrap at
    65536."""
    return last is not None and (last - seq) % SEQUENCE_MODULUS < REPEAT_WINDOW


def encode_valves(valves: Sequence[bool]) -> int:
    """Encodes valves: bit 0 is the leftmost section; 1: open."""
    return sum(1 << k for k, on in enumerate(valves) if on is True)


def decode_valves(mask: int) -> tuple[bool, ...]:
    """Decodes all valves that a frame has room for, left to right; those that a machine lacks
    are closed."""
    return tuple([bool(mask >> k & 1) for k in range(MAX_VALVES)])


def encode_command(frame: CommandFrame) -> bytes:
    """Returns the line of a command with its CRC and line end.

    Raises
    ------
    ValueError : a set-point that is not finite or that the protocol does not allow."""
    for name, value, (low, high) in (
        ("shaft_rpm", frame.shaft_rpm, COMMAND_SHAFT_RPM),
        ("opening_mm", frame.opening_mm, COMMAND_OPENING_MM),
    ):
        if not low <= value <= high:
            raise ValueError(f"board command: {name} {value}, allowed is {low:g} to {high:g}")
    if frame.valves is not None and not 0 <= frame.valves < 1 << MAX_VALVES:
        raise ValueError(
            f"board command: valves {frame.valves}, allowed is 0 to {(1 << MAX_VALVES) - 1}"
        )
    said = f"{frame.shaft_rpm:.3f},{frame.opening_mm:.3f},{frame.enable:d}"
    valves = "" if frame.valves is None else f",{frame.valves}"
    if frame.word is not None:
        return seal_frame(
            f"{COMMAND_WORD},{frame.seq % COUNTER_MODULUS},{said}{valves or ','},{frame.word}"
        )
    return seal_frame(
        f"{COMMAND_VALVES if valves else COMMAND},{frame.seq % SEQUENCE_MODULUS},{said}{valves}"
    )


ASK, ASK_TURNED = seal_frame("A1"), seal_frame("A2")


def decode_word(frame: bytes) -> tuple[int, int]:
    """Returns sequence number and word. Raises ValueError with the kind of fault."""
    fields = split_frame(frame, WORD, 2)
    return parse_whole(fields[0], SEQUENCE_MODULUS - 1), parse_whole(fields[1], COUNTER_MODULUS - 1)


def decode_turned(frame: bytes) -> ShaftTurned:
    """Returns the turns of the shaft. Raises ValueError with the kind of fault."""
    seq, *said = split_frame(frame, TURNED, 5)
    (counts, per_count), (steps, per_step) = (
        (parse_whole(said[k], COUNTER_MODULUS - 1), parse_number(said[k + 1], 1.0, 100000.0))
        if said[k]
        else (None, None)
        for k in (0, 2)
    )
    return ShaftTurned(parse_whole(seq, SEQUENCE_MODULUS - 1), counts, per_count, steps, per_step)


def decode_status(frame: bytes) -> StatusFrame:
    """Decodes a frame as received, without `$` and line end. Raises ValueError with the kind of
    fault."""
    name = next(
        (name for name in (STATUS_VALVES, STATUS_EFFORT) if frame.startswith(name.encode())), STATUS
    )
    fields = split_frame(frame, name, {STATUS: 13, STATUS_VALVES: 14, STATUS_EFFORT: 16}[name])
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
    valved = name == STATUS_VALVES or (name == STATUS_EFFORT and fields[13] != b"")
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
        parse_whole(fields[13], (1 << MAX_VALVES) - 1) if valved else None,
        *(parse_number(text, *EFFORT_RANGE) if text else None for text in fields[14:]),
    )


def split_frame(frame: bytes, kind: str, count: int) -> list[bytes]:
    """Returns the fields after the frame's name, once CRC, name and number of fields are right.
    Raises Rejected."""
    payload, star, crc = frame.partition(b"*")
    crc = crc.strip()
    if not star or not crc:
        raise Rejected("missing_crc")
    if not _CRC.fullmatch(crc) or int(crc, 16) != calc_crc16(payload):
        raise Rejected("bad_crc")
    name, *fields = payload.split(b",")
    if name != kind.encode():
        raise Rejected("unknown_frame")
    if len(fields) != count:
        raise Rejected("wrong_length")
    return fields
