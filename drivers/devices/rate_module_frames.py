"""How are datagrams of the open rate modules encoded and decoded? Numbers are little-endian, the id
comes first, the sum of all bytes before it last (docs/rate-module.md).

A datagram counts when its length is exactly that of its id and its checksum is right.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from topdress.drivers.devices.lines import IgnoredSentence, RejectedSentence

# Ids of datagrams to the module.
TARGET_ID, RELAYS_ID, SETTINGS_ID = 32500, 32501, 32502
# Ids of datagrams from the module.
STATUS_ID, BOARD_ID, TRACE_ID, LABEL_ID = 32400, 32401, 32402, 32403
# Length of each datagram with id and checksum, bytes.
LENGTH_OF_ID = {
    TARGET_ID: 14,
    RELAYS_ID: 11,
    SETTINGS_ID: 24,
    STATUS_ID: 15,
    BOARD_ID: 15,
    TRACE_ID: 26,
    LABEL_ID: 20,
}
# Numbers of three bytes wrap at this number.
MODULUS_24_BITS = 1 << 24
# Full duty in either direction.
MAX_PWM = 255
# This number of a relay means that no relay is the flow master.
NO_FLOW_MASTER_RELAY = 255

CONTROL_TYPES = ("valve", "combo_close", "motor", "motor_weights", "fan", "timed")
# Bits of the command byte of a target.
RESET_QUANTITY, MASTER_ON, LOG_PID, AUTO, CALIBRATING = 0x01, 0x10, 0x20, 0x40, 0x80
# Bits of the state byte of a status (32400).
HEARS_YOU, BIN_EMPTY = 0x01, 0x02
# Bits of the state byte of a board status (32401).
WORK_SWITCH, ETHERNET, PINS_OK, CONFIG_REJECTED = 0x01, 0x10, 0x20, 0x80


class FlowTarget(NamedTuple):
    """Holds datagram 32500. `units_per_min` and `pulses_per_unit` are sent in thousandths with 24
    bits, so they stay below 16 777.216."""

    module: int
    sensor: int
    units_per_min: float
    pulses_per_unit: float
    control: str = "motor"
    master_on: bool = False
    auto: bool = True
    reset_quantity: bool = False
    manual_pwm: int = 0
    # Whether the module reports every step of its control loop (32402).
    log_pid: bool = False


# A relay datagram has 16 bits.
MAX_RELAYS = 16


class RelayStates(NamedTuple):
    """Holds datagram 32501. Bit 0 of `relays` is the first relay; with none set the module neither
    controls nor counts."""

    module: int
    sensor: int
    relays: int
    power_mask: int = 0
    inverted_mask: int = 0
    flow_master: int = NO_FLOW_MASTER_RELAY


class ModuleStatus(NamedTuple):
    """Holds datagram 32400, which the module sends every 200 ms."""

    module: int
    sensor: int
    units_per_min: float
    # Counted in tenths of a unit with 24 bits, so it wraps at 1 677 721.6.
    quantity: float
    pwm: int
    hears_you: bool
    bin_empty: bool
    pulse_hz: float


class BoardStatus(NamedTuple):
    """Holds datagram 32401, sent every 200 ms. `speed` is in the module's own unit."""

    module: int
    pressure: int
    speed: float
    wheel_count: int
    board_type: int
    firmware: int
    work_switch: bool
    ethernet: bool
    pins_ok: bool
    config_rejected: bool


class BoardLabel(NamedTuple):
    """Holds datagram 32403, sent every 2 s: the name of the board."""

    module: int
    text: str


class ModuleTrace(NamedTuple):
    """Holds datagram 32402, sent at every step of the module's own control loop while its log is
    on. Units are as in 32400; `millis` counts from the start of that log, ms."""

    module: int
    sensor: int
    millis: int
    target: float
    applied: float
    error: float
    integral: float
    change: int
    pwm: int
    samples: int
    firmware: int


ModuleMessage = ModuleStatus | BoardStatus | BoardLabel | ModuleTrace


def calc_checksum(data: bytes) -> int:
    """Returns the sum of the bytes, modulo 256."""
    return sum(data) & 0xFF


def seal_datagram(message: int, body: bytes) -> bytes:
    """Returns a datagram of `message` from the bytes between its id and its checksum."""
    data = message.to_bytes(2, "little") + body
    return data + bytes([calc_checksum(data)])


def encode_target(target: FlowTarget) -> bytes:
    """Returns a target as a datagram. Raises ValueError for a number that is not finite or does not
    fit, because a wrapped set-point would be a different set-point."""
    command = CONTROL_TYPES.index(target.control) << 1
    for flag, mask in (
        (target.reset_quantity, RESET_QUANTITY),
        (target.master_on, MASTER_ON),
        (target.auto, AUTO),
        (target.log_pid, LOG_PID),
    ):
        command |= mask * flag
    if not -MAX_PWM <= target.manual_pwm <= MAX_PWM:
        raise ValueError(
            f"rate module: manual_pwm {target.manual_pwm}, allowed is -{MAX_PWM} to {MAX_PWM}"
        )
    return seal_datagram(
        TARGET_ID,
        bytes([_encode_address(target.module, target.sensor)])
        + encode_thousandths("units_per_min", target.units_per_min)
        + encode_thousandths("pulses_per_unit", target.pulses_per_unit)
        + bytes([command])
        + target.manual_pwm.to_bytes(2, "little", signed=True)
        + b"\0",
    )


def encode_relays(relays: RelayStates) -> bytes:
    """Returns the datagram that sets the relays."""
    return seal_datagram(
        RELAYS_ID,
        bytes([_encode_address(relays.module, relays.sensor)])
        + b"".join(
            word.to_bytes(2, "little")
            for word in (relays.relays, relays.power_mask, relays.inverted_mask)
        )
        + bytes([relays.flow_master]),
    )


def encode_status(status: ModuleStatus) -> bytes:
    """Returns the datagram of a module's status."""
    flags = HEARS_YOU * status.hears_you | BIN_EMPTY * status.bin_empty
    return seal_datagram(
        STATUS_ID,
        bytes([_encode_address(status.module, status.sensor)])
        + encode_thousandths("units_per_min", status.units_per_min)
        + (round(status.quantity * 10.0) % MODULUS_24_BITS).to_bytes(3, "little")
        + status.pwm.to_bytes(2, "little", signed=True)
        + bytes([flags])
        + min(round(status.pulse_hz * 10.0), 0xFFFF).to_bytes(2, "little"),
    )


def encode_board(board: BoardStatus) -> bytes:
    """Returns the datagram with which a module names its board."""
    flags = (
        WORK_SWITCH * board.work_switch
        | ETHERNET * board.ethernet
        | PINS_OK * board.pins_ok
        | CONFIG_REJECTED * board.config_rejected
    )
    return seal_datagram(
        BOARD_ID,
        bytes([board.module])
        + board.pressure.to_bytes(2, "little")
        + round(board.speed * 10.0).to_bytes(2, "little")
        + (board.wheel_count % MODULUS_24_BITS).to_bytes(3, "little")
        + bytes([board.board_type])
        + board.firmware.to_bytes(2, "little")
        + bytes([flags]),
    )


def encode_label(label: BoardLabel) -> bytes:
    """Returns a label of at most 16 letters of Latin-1 as a datagram."""
    return seal_datagram(
        LABEL_ID,
        bytes([label.module]) + label.text.encode("latin-1", "replace")[:16].ljust(16, b"\0"),
    )


def encode_trace(trace: ModuleTrace) -> bytes:
    """Returns the datagram with the rate and target of a product."""
    return seal_datagram(
        TRACE_ID,
        bytes([_encode_address(trace.module, trace.sensor)])
        + (trace.millis % (1 << 32)).to_bytes(4, "little")
        + encode_thousandths("target", trace.target)
        + encode_thousandths("applied", trace.applied)
        + round(trace.error * 1000.0).to_bytes(3, "little", signed=True)
        + b"".join(
            word.to_bytes(2, "little", signed=True)
            for word in (round(trace.integral * 10.0), trace.change, trace.pwm)
        )
        + bytes([trace.samples])
        + trace.firmware.to_bytes(2, "little"),
    )


def decode_heard(data: bytes) -> ModuleMessage:
    """Returns the content of a datagram from a module. Raises RejectedSentence, Ignored:
    `unknown_message`, `wrong_length`, `bad_checksum`."""
    message, body = _open_datagram(data)
    if message == STATUS_ID:
        flags = body[9]
        return ModuleStatus(
            body[0] >> 4,
            body[0] & 15,
            int.from_bytes(body[1:4], "little") / 1000.0,
            int.from_bytes(body[4:7], "little") / 10.0,
            int.from_bytes(body[7:9], "little", signed=True),
            bool(flags & HEARS_YOU),
            bool(flags & BIN_EMPTY),
            int.from_bytes(body[10:12], "little") / 10.0,
        )
    if message == BOARD_ID:
        flags = body[11]
        return BoardStatus(
            body[0],
            int.from_bytes(body[1:3], "little"),
            int.from_bytes(body[3:5], "little") / 10.0,
            int.from_bytes(body[5:8], "little"),
            body[8],
            int.from_bytes(body[9:11], "little"),
            bool(flags & WORK_SWITCH),
            bool(flags & ETHERNET),
            bool(flags & PINS_OK),
            bool(flags & CONFIG_REJECTED),
        )
    if message == LABEL_ID:
        return BoardLabel(body[0], body[1:].rstrip(b"\0 ").decode("latin-1"))
    if message == TRACE_ID:
        signed = [int.from_bytes(body[at : at + 2], "little", signed=True) for at in (14, 16, 18)]
        return ModuleTrace(
            body[0] >> 4,
            body[0] & 15,
            int.from_bytes(body[1:5], "little"),
            int.from_bytes(body[5:8], "little") / 1000.0,
            int.from_bytes(body[8:11], "little") / 1000.0,
            int.from_bytes(body[11:14], "little", signed=True) / 1000.0,
            signed[0] / 10.0,
            signed[1],
            signed[2],
            body[20],
            int.from_bytes(body[21:23], "little"),
        )
    raise IgnoredSentence("unknown_message")


def decode_command(data: bytes) -> FlowTarget | RelayStates:
    """Returns the content of a datagram to a module, for the virtual module. Raises
    RejectedSentence, Ignored."""
    message, body = _open_datagram(data)
    if message == TARGET_ID:
        command, kind = body[7], body[7] >> 1 & 7
        if kind >= len(CONTROL_TYPES):
            raise RejectedSentence("out_of_range")
        return FlowTarget(
            body[0] >> 4,
            body[0] & 15,
            int.from_bytes(body[1:4], "little") / 1000.0,
            int.from_bytes(body[4:7], "little") / 1000.0,
            CONTROL_TYPES[kind],
            bool(command & MASTER_ON),
            bool(command & AUTO),
            bool(command & RESET_QUANTITY),
            int.from_bytes(body[8:10], "little", signed=True),
            bool(command & LOG_PID),
        )
    if message == RELAYS_ID:
        relays, power, inverted = (int.from_bytes(body[at : at + 2], "little") for at in (1, 3, 5))
        return RelayStates(body[0] >> 4, body[0] & 15, relays, power, inverted, body[7])
    raise IgnoredSentence("unknown_message")


def encode_thousandths(name: str, value: float) -> bytes:
    """Returns a number in thousandths as three bytes, little-endian. Raises ValueError where it is
    not finite or would overflow."""
    if not math.isfinite(value) or not 0 <= round(value * 1000.0) < MODULUS_24_BITS:
        raise ValueError(f"rate module: {name} {value}, allowed is 0 to 16777.215")
    return round(value * 1000.0).to_bytes(3, "little")


def _encode_address(module: int, sensor: int) -> int:
    if not (0 <= module <= 15 and 0 <= sensor <= 15):
        raise ValueError(f"rate module: module {module}, sensor {sensor}, allowed are 0 to 15")
    return module << 4 | sensor


def _open_datagram(data: bytes) -> tuple[int, bytes]:
    message = int.from_bytes(data[:2], "little")
    if message not in LENGTH_OF_ID:
        raise IgnoredSentence("unknown_message")
    if len(data) != LENGTH_OF_ID[message]:
        raise RejectedSentence("wrong_length")
    if calc_checksum(data[:-1]) != data[-1]:
        raise RejectedSentence("bad_checksum")
    return message, data[2:-1]
