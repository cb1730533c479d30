"""How are position and speed of AgOpenGPS decoded? The program sends UDP frames to port 17777 on
loopback.

    80 81 7F <id> <length> <length bytes> <sum of all bytes from the third on, modulo 256>

Frame 0x64 carries position and heading, frame 0xFE the speed. docs/rate-module.md names the
sources.
"""

from __future__ import annotations

import math
import struct

from topdress.control.readings import GnssFix
from topdress.drivers.devices.device import Receiver
from topdress.drivers.devices.lines import Decoder, IgnoredSentence, RejectedSentence
from topdress.drivers.devices.nmea import MAX_SPEED_MPS

# The three bytes with which every frame begins.
FRAME_HEADER = b"\x80\x81\x7f"
POSITION_ID, SPEED_ID = 0x64, 0xFE
# The shortest body that holds the fields read here; newer versions append fields.
MIN_FRAME_BYTES = {POSITION_ID: 24, SPEED_ID: 8}
# Age beyond which a speed is not combined with a position, s.
SPEED_VALID_S = 1.0
# Longitude, latitude and heading, degrees, as little-endian doubles.
_POSITION_FIELDS = struct.Struct("<ddd")


class AgOpenGpsDecoder(Decoder[GnssFix]):
    """Decodes bytes of the loopback to fixes; each position is a fix with the newest speed.

    The frames carry neither fix quality nor time: quality is 1 and `utc` is None. Counted as
    rejected: `bad_checksum`, `wrong_length`, `impossible_value`, `garbage` (bytes outside of
    frames, counted once for each run of them). Counted as ignored: every other frame as `pgn_<id in
    hexadecimal>`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._rest = b""
        # Number of bytes of `_rest` that are already read.
        self._at = 0
        self._in_garbage = False
        self._speed_mps: float | None = None
        self._speed_s = -math.inf

    def feed(self, data: bytes, time_s: float) -> list[GnssFix]:
        """Returns the fixes completed by `data`, which arrived at `time_s`; oldest first."""
        self._rest += data
        return [
            fix
            for frame in iter(self._find_next_frame, None)
            for fix in self._decode_and_count(frame, time_s)
        ]

    def flush(self, time_s: float) -> list[GnssFix]:
        """Ends a recording: a truncated frame is counted as rejected."""
        if self._rest:
            self.counts.reject("wrong_length")
            self._rest = b""
        return []

    def _find_next_frame(self) -> bytes | None:
        """Returns the next frame with a correct checksum; None means that more bytes are needed,
        and the bytes read are dropped.

        Every byte is examined once as the beginning of a frame and summed at most once for each
        header before it. No sequence of bytes therefore costs more than the longest frame for every
        three bytes.
        """
        while True:
            start = self._rest.find(FRAME_HEADER, self._at)
            if start < 0:
                self._skip_to_place(max(self._at, len(self._rest) - len(FRAME_HEADER) + 1))
                break
            self._skip_to_place(start)
            if len(self._rest) < start + 5 or len(self._rest) < (
                end := start + 6 + self._rest[start + 4]
            ):
                break
            self._in_garbage = False
            if sum(memoryview(self._rest)[start + 2 : end - 1]) & 0xFF == self._rest[end - 1]:
                self._at = end
                return self._rest[start:end]
            self.counts.reject("bad_checksum")
            self._at = start + len(FRAME_HEADER)
            # The bytes that follow were counted with the frame that had a wrong checksum.
            self._in_garbage = True
        self._rest, self._at = self._rest[self._at :], 0
        return None

    def _skip_to_place(self, place: int) -> None:
        if place > self._at and not self._in_garbage:
            self.counts.reject("garbage")
            self._in_garbage = True
        self._at = place

    def _decode_sentence(self, sentence: bytes, time_s: float) -> list[GnssFix]:
        name, body = sentence[3], sentence[5:-1]
        if name not in MIN_FRAME_BYTES:
            raise IgnoredSentence(f"pgn_{name:02x}")
        if len(body) < MIN_FRAME_BYTES[name]:
            raise RejectedSentence("wrong_length")
        if name == SPEED_ID:
            # The frame holds tenths of km/h; 36 of them are 1 m/s.
            speed_mps = int.from_bytes(body[:2], "little") / 36.0
            if speed_mps > MAX_SPEED_MPS:
                raise RejectedSentence("impossible_value")
            self._speed_mps, self._speed_s = speed_mps, time_s
            return []
        lon_deg, lat_deg, heading_deg = _POSITION_FIELDS.unpack_from(body)
        fine = all(map(math.isfinite, (lon_deg, lat_deg, heading_deg))) and (
            abs(lat_deg) <= 90.0
            and abs(lon_deg) <= 180.0
            and -360.0 <= heading_deg <= 360.0
            and (lat_deg, lon_deg) != (0.0, 0.0)
        )
        if not fine:
            raise RejectedSentence("impossible_value")
        fresh = time_s - self._speed_s <= SPEED_VALID_S
        return [
            GnssFix(
                time_s,
                lat_deg,
                lon_deg,
                1,
                speed_mps=self._speed_mps if fresh else None,
                heading_deg=heading_deg % 360.0,
            )
        ]


RECEIVER = Receiver(
    protocol="agopengps",
    captured_as="agopengps",
    make_decoder=lambda live: AgOpenGpsDecoder(),
    port="udp://127.0.0.1:17777",
)
