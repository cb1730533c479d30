"""How are the parts at the slave board read? They are a load-cell amplifier HX711, an accelerometer
LIS3DH, and the USB plug.
"""

from math import atan2, degrees

# Length of a conversion of the HX711, bits (data sheet, figure 2).
HX711_BITS = 24
# One pulse after the 24 bits selects channel A with gain 128 for the next conversion.
GAIN_PULSES = 1

# Address and registers of the LIS3DH (data sheet, tables 13 and 21).
LIS3DH_ADDRESS = 0x18
WHO_AM_I, IS_LIS3DH = 0x0F, 0x33
CONTROL_1, ALL_AXES_50_HZ = 0x20, b"\x47"
CONTROL_4, WHOLE_SAMPLES_2_G = 0x23, b"\x88"
# The top bit makes the address advance during a read.
SAMPLE_REGISTER = 0x28 | 0x80
# Range of the squared acceleration in g^2; a sample outside is a jolt and gives no slope.
MIN_G2, MAX_G2 = 0.5, 2.0

# Number of bytes that wait for the host; a frame beyond them is dropped.
USB_WAITING_BYTES = 1024
# Number of bytes read and written in one round: 64 kB a second without a long round.
USB_ROUND_BYTES = 64


class UsbLine:
    """Reads and writes through the board's own USB plug, on the streams of MicroPython's prompt.

    Bytes pass one at a time, and only while `can_write` is True: `stdout` blocks the program up to
    0.5 s for a host that does not read (MicroPython's shared/tinyusb/mp_usbd_cdc.c). `can_read` and
    `can_write` return without waiting.
    """

    def __init__(self, stdin, stdout, can_read, can_write) -> None:  # type: ignore[no-untyped-def]
        self._in, self._out = stdin, stdout
        self._can_read, self._can_write = can_read, can_write
        self._waiting = b""

    def read(self) -> bytes:
        """Returns received bytes, after sending waiting bytes. The method is called every round."""
        sent = 0
        while sent < min(len(self._waiting), USB_ROUND_BYTES) and self._can_write():
            self._out.write(self._waiting[sent : sent + 1])
            sent += 1
        self._waiting = self._waiting[sent:]
        got = b""
        while len(got) < USB_ROUND_BYTES and self._can_read():
            byte = self._in.read(1)
            if not byte:
                break
            got += byte
        return got

    def write(self, data: bytes) -> None:
        """Queues bytes for the host."""
        if len(self._waiting) + len(data) <= USB_WAITING_BYTES:
            self._waiting += data


class Hx711LoadCell:
    """Reads an HX711: `data` falls when a conversion is ready (10 a second), and `clock` fetches it
    bit by bit. kg = slope x counts + zero, from the two-point calibration of the hopper."""

    def __init__(self, clock, data, kg_per_count: float, zero_kg: float) -> None:  # type: ignore[no-untyped-def]
        self._clock, self._data = clock, data
        self._slope, self._zero_kg = kg_per_count, zero_kg
        self._silent = 0
        # None means that no conversion has arrived yet, or that the converter is silent.
        self.kg: float | None = None
        clock.value(0)

    def poll_conversion(self, rounds_silent: int = 1000) -> None:
        """Polls the converter once a round (about a millisecond); a ready conversion takes
        0.3 ms."""
        if self._data.value():
            self._silent += 1
            if self._silent > rounds_silent:
                self.kg = None
            return
        self._silent = 0
        count = 0
        for _ in range(HX711_BITS):
            count = count << 1 | self._read_bit()
        for _ in range(GAIN_PULSES):
            self._read_bit()
        # The limits of the converter mean a broken cell or cable.
        if count in (0x7FFFFF, 0x800000):
            self.kg = None
            return
        self.kg = (
            self._slope * (count - (1 << HX711_BITS) if count & 0x800000 else count) + self._zero_kg
        )

    def _read_bit(self) -> int:
        self._clock.value(1)
        bit = int(self._data.value())
        self._clock.value(0)
        return bit


class Lis3dhInclinometer:
    """Reads a LIS3DH that is mounted flat, x to the front, y to the right, z up. A mean with time
    constant `tau_s` removes shaking."""

    def __init__(self, i2c, tau_s: float = 0.5) -> None:  # type: ignore[no-untyped-def]
        self._i2c = i2c
        self._tau_s = tau_s
        self._g: list[float] | None = None
        self._there = False
        # Positive with the nose up, degrees.
        self.pitch_deg: float | None = None
        # Positive with the right side down, degrees.
        self.roll_deg: float | None = None

    def poll_sample(self, dt_s: float) -> None:
        """Polls the sensor about every 50 ms; a sensor that does not answer is configured again at
        the next call."""
        try:
            if not self._there:
                self._configure_part()
            raw = self._i2c.readfrom_mem(LIS3DH_ADDRESS, SAMPLE_REGISTER, 6)
        except OSError:
            self._there, self._g = False, None
            self.pitch_deg = self.roll_deg = None
            return
        g = [
            _convert_to_signed(raw[2 * axis] | raw[2 * axis + 1] << 8) / 16000.0
            for axis in range(3)
        ]
        if not MIN_G2 < g[0] * g[0] + g[1] * g[1] + g[2] * g[2] < MAX_G2:
            return
        if self._g is None:
            self._g = g
        share = min(1.0, dt_s / self._tau_s)
        x, y, z = self._g = [self._g[axis] + share * (g[axis] - self._g[axis]) for axis in range(3)]
        self.pitch_deg = degrees(atan2(x, (y * y + z * z) ** 0.5))
        self.roll_deg = degrees(atan2(-y, z))

    def _configure_part(self) -> None:
        if self._i2c.readfrom_mem(LIS3DH_ADDRESS, WHO_AM_I, 1)[0] != IS_LIS3DH:
            raise OSError("another part")
        self._i2c.writeto_mem(LIS3DH_ADDRESS, CONTROL_1, ALL_AXES_50_HZ)
        self._i2c.writeto_mem(LIS3DH_ADDRESS, CONTROL_4, WHOLE_SAMPLES_2_G)
        self._there = True


def _convert_to_signed(value: int) -> int:
    return value - 65536 if value & 0x8000 else value
