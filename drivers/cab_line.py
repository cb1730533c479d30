"""One device's line in the cab: its port with name, counts and rate, and who listens in."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Literal

from topdress.drivers.datagrams import Datagrams
from topdress.drivers.device_status import DeviceStatus
from topdress.drivers.devices.lines import Counts
from topdress.drivers.plugins import PluginFault
from topdress.drivers.ports import Port

RATE_OVER_S = 2.0  # a device silent for this long has rate 0
ASIDE_CHARACTERS = 200

Direction = Literal["<", ">"]  # received, sent
# must return at once: the control loop calls it
Tap = Callable[[float, Direction, bytes], None]


class DeviceLine:
    """`baud`: of a serial line; None where the port has none (socket, memory, datagrams)."""

    def __init__(
        self, name: str, protocol: str, port: Port, counts: Counts, baud: int | None = None
    ) -> None:
        self.name = name
        self.port = port
        self.baud = baud
        self.plugged = True
        # why the device is not listened to any more; empty: it is
        self.aside = ""
        # what is named for it: the device, with the plug-in that reads it
        self.blamed = name
        self._protocol = protocol
        self._counts = counts
        self._taps: list[Tap] = []
        self._times_s: deque[float] = deque(maxlen=64)

    def read(self, now_s: float) -> bytes:
        """What has arrived since the last call."""
        data = self.port.read()
        if data:
            self._tell(now_s, "<", data)
        return data

    def write(self, now_s: float, data: bytes) -> None:
        """Queue for sending."""
        self.port.write(data)
        self._tell(now_s, ">", data)

    def note(self, times_s: Iterable[float]) -> None:
        """Times of accepted messages."""
        self._times_s.extend(times_s)

    def listen_in(self, tap: Tap) -> None:
        """Give `tap` everything that is received and sent from now on, as it is (each datagram
        by itself)."""
        self._taps.append(tap)

    def leave(self, tap: Tap) -> None:
        if tap in self._taps:
            self._taps.remove(tap)

    def put_aside(self, error: Exception) -> None:
        """Its driver could not digest what it said: it is not listened to until it is plugged
        again. What is sent to it goes on, so that a drive can be stopped."""
        by_plugin = isinstance(error, PluginFault)
        why = str(error) if by_plugin else f"{type(error).__name__}: {error}"
        self.aside = f"put aside: {why}"[:ASIDE_CHARACTERS]
        self.blamed = f"{self.name} (plug-in {self._protocol})" if by_plugin else self.name

    def plug(self, plugged: bool) -> None:
        """False: let go of the port and leave it alone until True."""
        self.plugged, self.aside = plugged, ""
        self.port.plug(plugged)

    def status(self, now_s: float) -> DeviceStatus:
        state = self.port.state()
        times_s = self._times_s
        age_s = now_s - times_s[-1] if times_s else None
        span_s = times_s[-1] - times_s[0] if times_s else 0.0
        lively = age_s is not None and age_s < RATE_OVER_S and span_s > 0.0
        last = state.last_lines()
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

    def _tell(self, now_s: float, direction: Direction, data: bytes) -> None:
        for tap in list(self._taps):
            try:
                tap(now_s, direction, data)
            # whoever listens in costs neither the device nor the tick
            except Exception:
                self._taps.remove(tap)


class DatagramLine(DeviceLine):
    """The same over a port that keeps datagrams apart."""

    def __init__(self, name: str, protocol: str, port: Datagrams, counts: Counts) -> None:
        super().__init__(name, protocol, port, counts)
        self._datagrams = port

    def read_each(self, now_s: float) -> list[bytes]:
        """The datagrams that have arrived since the last call, oldest first."""
        found = self._datagrams.read_each()
        for data in found:
            self._tell(now_s, "<", data)
        return found
