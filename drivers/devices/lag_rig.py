"""How are the lag rig's lines decoded and its orders encoded? This is the host's side; see
docs/protocol-lag-rig.md and the lag paper, section 1.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from topdress.control.readings import Reading
from topdress.control.signals import N_
from topdress.drivers.board.framing import SEQUENCE_MODULUS, parse_number, parse_whole, seal_frame
from topdress.drivers.board.lag_rig import LANDED, PLATE_BEFORE, TURNED_BEFORE, TURNING
from topdress.drivers.devices.board_frames import COUNTER_MODULUS, is_repeated_sequence, split_frame
from topdress.drivers.devices.device import LineConfig, LineDevice
from topdress.drivers.devices.lines import LineDecoder, RejectedSentence

ORDER_FRAME, STATUS_FRAME = "R1", "L1"
# The smallest delay is searched in the last two blocks of this length, s, because crystals drift by
# some 50 ppm.
CLOCK_BLOCK_S = 10.0


class LagRigConfig(LineConfig):
    """Describes the lag rig, where it is mounted for calibration."""


class RigStatus(NamedTuple):
    """Holds one line of the rig. Times are on the rig's 32-bit clock; None means that the event has
    not happened yet."""

    seq: int
    run: int
    state: int
    micros: int
    shaft_rpm: float
    plate: int
    start_micros: int | None
    land_micros: int | None
    flags: int


class RigReadings(NamedTuple):
    """Holds one accepted line. `start_s` is on the host's clock; `drop_s` is measured by the rig's
    own clock, which no link delays."""

    time_s: float
    run: int
    state: int
    shaft_rpm: Reading
    start_s: float | None
    drop_s: float | None
    turned_before: bool
    plate_before: bool


class LagRig(LineDecoder[RigReadings]):
    """Decodes bytes of the rig to readings and encodes orders. It opens nothing and reads no clock.

    The rig's clock is aligned with the host's clock by the line of the last 10 to 20 s that had the
    smallest delay. `start_s` is late by that delay: 1 to 3 ms at 115 200 Bd, and less than one tick
    where bytes are stamped once a tick.

    Rejected lines are counted as `slave_board.SlaveBoard` counts them.
    """

    longest, framed, wrong = 200, True, ValueError

    def __init__(self) -> None:
        super().__init__()
        self._last_seq: int | None = None
        self._next_order = 0
        # The rig's clock without its wraps, microseconds.
        self._micros: int | None = None
        # Host's clock minus the rig's clock, s: the minima of the last block and of the present
        # block.
        self._offsets_s = [math.inf, math.inf]
        self._block_s = -math.inf

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[RigReadings]:
        return [self._take_status(decode_rig_status(sentence), time_s)]

    def make_order(self, run: int, arm: bool) -> bytes:
        """Returns an order that arms the rig for run number `run`, or sets it to idle. Repeating an
        order has no effect."""
        count, self._next_order = self._next_order, (self._next_order + 1) % SEQUENCE_MODULUS
        return seal_frame(f"{ORDER_FRAME},{count},{run % SEQUENCE_MODULUS},{arm:d}")

    def _take_status(self, status: RigStatus, time_s: float) -> RigReadings:
        if is_repeated_sequence(status.seq, self._last_seq):
            raise RejectedSentence("repeated_sequence")
        restarted = (
            self._last_seq is not None
            and (self._last_seq - status.seq) % SEQUENCE_MODULUS < SEQUENCE_MODULUS // 2
        )
        self._last_seq = status.seq
        if restarted:
            self._micros, self._offsets_s = None, [math.inf, math.inf]
        if self._micros is None:
            self._micros = status.micros
        self._micros += (status.micros - self._micros) % COUNTER_MODULUS
        if time_s - self._block_s > CLOCK_BLOCK_S:
            self._block_s, self._offsets_s = time_s, [self._offsets_s[1], math.inf]
        self._offsets_s[1] = min(self._offsets_s[1], time_s - self._micros * 1e-6)
        start_us = self._unwrap_micros(status, status.start_micros)
        land_us = self._unwrap_micros(status, status.land_micros)
        return RigReadings(
            time_s,
            status.run,
            status.state,
            Reading(status.shaft_rpm, time_s),
            None if start_us is None else start_us * 1e-6 + min(self._offsets_s),
            None if start_us is None or land_us is None else (land_us - start_us) * 1e-6,
            bool(status.flags & TURNED_BEFORE),
            bool(status.flags & PLATE_BEFORE),
        )

    def _unwrap_micros(self, status: RigStatus, micros: int | None) -> int | None:
        """Converts an earlier time on the rig's clock to its unwrapped clock, microseconds."""
        assert self._micros is not None
        return None if micros is None else self._micros - (status.micros - micros) % COUNTER_MODULUS


def decode_rig_status(frame: bytes) -> RigStatus:
    """Returns the status of a frame as received, without `$` and line end. Raises ValueError with
    the kind of fault."""
    fields = split_frame(frame, STATUS_FRAME, 9)
    seq, run = (
        parse_whole(fields[0], SEQUENCE_MODULUS - 1),
        parse_whole(fields[1], SEQUENCE_MODULUS - 1),
    )
    state, micros = parse_whole(fields[2], LANDED), parse_whole(fields[3], COUNTER_MODULUS - 1)
    shaft_rpm = parse_number(fields[4], -400.0, 400.0)
    plate = int(parse_number(fields[5], -999999.0, 999999.0))
    start = parse_whole(fields[6], COUNTER_MODULUS - 1) if fields[6] else None
    land = parse_whole(fields[7], COUNTER_MODULUS - 1) if fields[7] else None
    if (start is None) != (state < TURNING) or (land is None) != (state < LANDED):
        raise RejectedSentence("wrong_length")
    return RigStatus(
        seq, run, state, micros, shaft_rpm, plate, start, land, parse_whole(fields[8], 255)
    )


def make_example() -> bytes:
    """Returns forty lines of an idle rig, 50 ms apart."""
    return b"".join(
        seal_frame(f"{STATUS_FRAME},{seq},0,0,{seq * 50_000},0.000,500,,,0") for seq in range(40)
    )


DEVICE = LineDevice(
    section="lag_rig",
    title=N_("lag rig"),
    protocol="lag-rig/1",
    heard_as="lag-rig/1",
    config=LagRigConfig,
    make_decoder=lambda config: LagRig(),
    # The rig measures the machine's response for a calibration, and nothing that control needs.
    find_measurements=lambda readings: {},
    make_example=make_example,
)
