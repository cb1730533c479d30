"""How does the lag rig measure response and drop time (lag paper, 1.2)? An encoder on the metering
shaft starts the clock, and the first granule on a pressure plate stops it. Both times come from
this board's own clock. See docs/protocol-lag-rig.md.

`RigProgram.run_round` is called about every millisecond. A pin layer has:

    read() -> bytes, write(data)                as for the slave board
    encoder() -> (counts, us, us_before)        count; time of the newest count and of the
                                                count before
    plate() -> int                              the plate's reading, any scale
"""

from .framing import SEQUENCE_MODULUS, WORD_MODULUS, Receiver, parse_whole, seal_frame
from .motion import SpeedMeter

# Interval of the status lines, microseconds.
STATUS_INTERVAL_US = 50000
# Shaft speed at which the response ends and the drop time begins, r/min (lag paper, 1.2).
MIN_TURNING_RPM = 2.0
# States of the rig in a status line.
IDLE, ARMED, TURNING, LANDED = 0, 1, 2, 3
# Flags of a status line: the shaft turned, or the plate moved, before the run began.
TURNED_BEFORE, PLATE_BEFORE = 1, 2
# Weight of a sample in the running mean and noise of the plate.
SAMPLE_WEIGHT = 1.0 / 64.0


class RigSettings:
    """Holds the settings of a rig."""

    counts_per_turn = 1000.0
    # Smallest step of the plate's reading that counts as a landing.
    least_step = 20.0
    # A landing must also exceed the plate's mean by this multiple of its mean deviation.
    noises = 8.0


class RigPins:
    """Defines the hardware functions that the program needs; pin layers and tests inherit
    from it."""

    def read(self) -> bytes:
        """Returns the bytes that the host has sent."""
        return b""

    def write(self, data: bytes) -> None:
        """Sends bytes to the host."""

    def encoder(self) -> "tuple[int, int, int]":
        """Returns the counts, and the times of the newest count and the count before,
        microseconds."""
        return 0, 0, 0

    def plate(self) -> int:
        """Returns the reading of the impact plate's converter."""
        return 0


class RigProgram:
    """Holds the state of the program. `run_round` runs one round; it neither waits nor reads a
    clock."""

    def __init__(self, pins: RigPins, settings: RigSettings) -> None:
        self.receiver = Receiver()
        self.state = IDLE
        self._pins, self._settings = pins, settings
        self._slow_us = 60e6 / (MIN_TURNING_RPM * settings.counts_per_turn)
        self._meter = SpeedMeter(settings.counts_per_turn, 100000)
        self._run = 0
        self._flags = 0
        self._start_us = self._land_us = 0
        self._counts_armed = 0
        self._mean: float | None = None
        self._noise = 0.0
        self._last_seq = -1
        self._seq = 0
        self._next_status_us = 0

    def run_round(self, now_us: int) -> None:
        """Runs one round at `now_us` of a clock that never overflows."""
        counts, count_us, before_us = self._pins.encoder()
        for fields in self.receiver.feed_bytes(self._pins.read()):
            try:
                self._obey_order(fields, counts, now_us)
            except ValueError as kind:
                self.receiver.reject(str(kind.args[0]))
        landed = self._has_plate_moved()
        last_state = self.state
        if self.state == ARMED:
            if landed:
                self._flags |= PLATE_BEFORE
            if counts - self._counts_armed >= 2 and count_us - before_us <= self._slow_us:
                self.state, self._start_us = TURNING, count_us
        elif self.state == TURNING and landed:
            self.state, self._land_us = LANDED, now_us
        if self.state != last_state or now_us >= self._next_status_us:
            self._next_status_us = now_us + STATUS_INTERVAL_US
            self._pins.write(self._make_status(now_us, counts))

    def _obey_order(self, fields: "list[bytes]", counts: int, now_us: int) -> None:
        if fields[0] != b"R1":
            raise ValueError("unknown_frame")
        if len(fields) != 4:
            raise ValueError("wrong_length")
        seq, run, arm = (
            parse_whole(fields[1], SEQUENCE_MODULUS - 1),
            parse_whole(fields[2], SEQUENCE_MODULUS - 1),
            parse_whole(fields[3], 1),
        )
        if seq == self._last_seq:
            raise ValueError("repeated_sequence")
        self._last_seq = seq
        if not arm:
            self.state = IDLE
        elif self.state == IDLE or run != self._run:
            self.state, self._run, self._flags = ARMED, run, 0
            self._counts_armed = counts
            if abs(self._meter.measure_rpm(now_us, counts)) >= MIN_TURNING_RPM:
                self._flags = TURNED_BEFORE

    def _has_plate_moved(self) -> bool:
        """Returns whether this sample is an outlier; only other samples update mean and noise."""
        value = self._pins.plate()
        if self._mean is None:
            self._mean = float(value)
        above = value - self._mean
        if above > max(self._settings.least_step, self._settings.noises * self._noise):
            return True
        self._mean += SAMPLE_WEIGHT * above
        self._noise += SAMPLE_WEIGHT * (abs(above) - self._noise)
        return False

    def _make_status(self, now_us: int, counts: int) -> bytes:
        start = str(self._start_us % WORD_MODULUS) if self.state >= TURNING else ""
        land = str(self._land_us % WORD_MODULUS) if self.state == LANDED else ""
        rpm = min(max(self._meter.measure_rpm(now_us, counts), -400.0), 400.0)
        seq, self._seq = self._seq, (self._seq + 1) % SEQUENCE_MODULUS
        return seal_frame(
            f"L1,{seq},{self._run},{self.state},{now_us % WORD_MODULUS},"
            f"{rpm:.3f},{self._pins.plate()},"
            f"{start},{land},{self._flags}"
        )
