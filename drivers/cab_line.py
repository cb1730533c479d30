"""How is the line of one device in the cab managed? Its port has a name, counts, a message rate and
listeners.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Literal

from topdress.drivers.datagrams import Datagrams
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.lines import Counts
from topdress.drivers.plugins import PluginFault
from topdress.drivers.ports import Port

# Window over which the message rate is counted, s; a device silent for longer has rate 0.
RATE_WINDOW_S = 2.0
# Longest text of an error of a driver that the page Devices shows.
MAX_FAULT_CHARACTERS = 200

# "<" marks received bytes and ">" sent bytes, as in a capture file.
Direction = Literal["<", ">"]
# A tap receives all bytes. It must return at once, because the control loop calls it.
Tap = Callable[[float, Direction, bytes], None]


class DeviceLine:
    """Holds the line of one device. `baud` is the rate of a serial line; None for a socket, memory
    or datagrams."""

    def __init__(
        self, name: str, protocol: str, port: Port, counts: Counts, baud: int | None = None
    ) -> None:
        self.name = name
        self.port = port
        self.baud = baud
        self.plugged = True
        # The reason why the device is no longer read; empty while the device is read.
        self.aside = ""
        # The name to show as the cause of a fault: the device, with the plug-in that reads it.
        self.blamed = name
        self._protocol = protocol
        self._counts = counts
        self._taps: list[Tap] = []
        self._times_s: deque[float] = deque(maxlen=64)

    def read_bytes(self, now_s: float) -> bytes:
        """Returns the bytes that have arrived since the last call."""
        data = self.port.read()
        if data:
            self._inform_taps(now_s, "<", data)
        return data

    def read_input(self, now_s: float) -> Any:
        """Returns what has arrived, as the decoder takes it."""
        return self.read_bytes(now_s)

    def write_bytes(self, now_s: float, data: bytes) -> None:
        """Queues bytes for sending."""
        self.port.write(data)
        self._inform_taps(now_s, ">", data)

    def note_accepted(self, times_s: Iterable[float]) -> None:
        """Records the times of accepted messages, s."""
        self._times_s.extend(times_s)

    def add_tap(self, tap: Tap) -> None:
        """Passes all received and sent bytes to `tap` from now on, unchanged, each datagram
        separately."""
        self._taps.append(tap)

    def remove_tap(self, tap: Tap) -> None:
        """Stops passing bytes to `tap`."""
        if tap in self._taps:
            self._taps.remove(tap)

    def put_aside(self, error: Exception) -> None:
        """Stops reading a device whose driver failed on its bytes, until the device is plugged in
        again. Sending continues, so that a drive can be stopped."""
        by_plugin = isinstance(error, PluginFault)
        why = str(error) if by_plugin else f"{type(error).__name__}: {error}"
        self.aside = f"put aside: {why}"[:MAX_FAULT_CHARACTERS]
        self.blamed = f"{self.name} (plug-in {self._protocol})" if by_plugin else self.name

    def set_plugged(self, plugged: bool) -> None:
        """Closes the port and keeps it closed (False), or opens it again (True)."""
        self.plugged, self.aside = plugged, ""
        self.port.plug(plugged)

    def make_status(self, now_s: float) -> DeviceStatus:
        """Returns the state of the line for the page Devices."""
        state = self.port.state()
        times_s = self._times_s
        age_s = now_s - times_s[-1] if times_s else None
        span_s = times_s[-1] - times_s[0] if times_s else 0.0
        lively = age_s is not None and age_s < RATE_WINDOW_S and span_s > 0.0
        last = state.format_last_lines()
        return DeviceStatus(
            self.name,
            self.port.name,
            self._protocol,
            state.connected,
            age_s,
            (len(times_s) - 1) / span_s if lively else 0.0,
            self._counts.accepted,
            self._counts.rejected_total,
            self.aside or (last[0] if last else state.last_error),
            state.connects,
            state.bytes_in,
            state.bytes_out,
            self.aside or state.last_error,
            tuple(sorted(self._counts.rejected.items())),
        )

    def _inform_taps(self, now_s: float, direction: Direction, data: bytes) -> None:
        for tap in list(self._taps):
            try:
                tap(now_s, direction, data)
            # A failing listener must interrupt neither the device nor the tick.
            except Exception:
                self._taps.remove(tap)


class DatagramLine(DeviceLine):
    """Holds the line of a port that keeps datagrams apart."""

    def __init__(self, name: str, protocol: str, port: Datagrams, counts: Counts) -> None:
        super().__init__(name, protocol, port, counts)
        self._datagrams = port

    def read_input(self, now_s: float) -> list[bytes]:
        """Returns the datagrams that have arrived since the last call, oldest first."""
        found = self._datagrams.read_each()
        for data in found:
            self._inform_taps(now_s, "<", data)
        return found
