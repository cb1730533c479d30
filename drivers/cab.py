"""The cab: all ports and drivers of one machine, and what they say and are told once a tick."""
from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from control.readings import DriveCommand, GnssFix, Measurements, Reading
from drivers.devices.canopy_heads import PROTOCOLS, FieldMap, HeadDecoder
from drivers.devices.gnss import GnssDecoder
from drivers.devices.lines import Counts
from drivers.devices.slave_board import BoardReadings, DriveLimits, SlaveBoard
from drivers.devices.wheel import WheelGeometry
from drivers.ports import Clock, Port, open_port

MOST_HEADS = 12
RATE_OVER_S = 2.0           # a device silent for this long has rate 0

Baud = Annotated[int, Field(ge=300, le=4_000_000)]
Opener = Callable[[str, int, Clock], Port]


class _Config(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class GnssConfig(_Config):
    """A receiver that speaks NMEA 0183."""

    port: str
    baud: Baud = 115200


class HeadLayout(_Config):
    """Which field of a head's line means what; the first is 1, `index_2: 0` where there is none."""

    fields: Annotated[int, Field(ge=1, le=40)]
    ndvi: Annotated[int, Field(ge=1, le=40)]
    index_2: Annotated[int, Field(ge=0, le=40)] = 0

    @model_validator(mode="after")
    def _inside_the_line(self) -> Self:
        if max(self.ndvi, self.index_2) > self.fields:
            raise ValueError(f"ndvi {self.ndvi} and index_2 {self.index_2} must be at most fields {self.fields}")
        return self


class HeadsConfig(_Config):
    """The canopy heads: one port each, left to right, or all on one multiplexed line."""

    protocol: str = "greenseeker"
    ports: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_HEADS)]
    baud: Baud | None = None                    # None: the protocol's own
    multiplexed: bool = False
    heads: Annotated[int, Field(ge=1, le=MOST_HEADS)] = 6      # how many, where multiplexed
    layout: HeadLayout | None = None            # None: the protocol's own

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.protocol not in PROTOCOLS and self.layout is None:
            raise ValueError(f"protocol {self.protocol!r}: allowed is one of {', '.join(PROTOCOLS)}, "
                             "or any name together with a layout")
        if self.multiplexed and len(self.ports) != 1:
            raise ValueError(f"ports: {len(self.ports)} given, a multiplexed line has 1")
        return self

    @property
    def count(self) -> int:
        return self.heads if self.multiplexed else len(self.ports)

    @property
    def field_map(self) -> FieldMap:
        if self.layout is not None:
            return FieldMap(self.layout.fields, self.layout.ndvi, self.layout.index_2)
        return PROTOCOLS[self.protocol]


class BoardConfig(_Config):
    """The slave board, the limits of its drives and the wheel that it counts."""

    port: str
    baud: Baud = 115200
    max_shaft_rpm: Annotated[float, Field(gt=0, le=300)] = 100.0
    max_opening_mm: Annotated[float, Field(gt=0, le=100)] = 60.0
    wheel_circumference_m: Annotated[float, Field(gt=0, le=20)] = 2.50
    wheel_pulses_per_turn: Annotated[float, Field(ge=1, le=10000)] = 16.0


class CabConfig(_Config):
    """Which devices a machine has and where they are plugged in; None: not fitted."""

    gnss: GnssConfig | None = None
    heads: HeadsConfig | None = None
    board: BoardConfig | None = None


@dataclass(frozen=True, slots=True)
class DeviceStatus:
    """One device as the Devices screen lists it; the fields of `console.frame.DeviceView`."""

    name: str
    port: str
    protocol: str
    connected: bool
    age_s: float | None       # since the last accepted message
    rate_hz: float
    accepted: int
    rejected: int
    last_raw: str = ""


class _Line:
    """A port with the name, the counts and the rate of the device on it."""

    def __init__(self, name: str, protocol: str, port: Port, counts: Counts) -> None:
        self.name = name
        self.port = port
        self._protocol = protocol
        self._counts = counts
        self._times_s: deque[float] = deque(maxlen=64)

    def note(self, times_s: Iterable[float]) -> None:
        self._times_s.extend(times_s)

    def status(self, now_s: float) -> DeviceStatus:
        state = self.port.state()
        times_s = self._times_s
        age_s = now_s - times_s[-1] if times_s else None
        span_s = times_s[-1] - times_s[0] if times_s else 0.0
        lively = age_s is not None and age_s < RATE_OVER_S and span_s > 0.0
        last = state.last_lines()
        return DeviceStatus(
            self.name, self.port.name, self._protocol, state.connected, age_s,
            (len(times_s) - 1) / span_s if lively else 0.0,
            self._counts.accepted, self._counts.rejected_total, last[0] if last else state.last_error)


class Cab:
    """Owns the ports and drivers of one machine.

    `measure` and `command` are called once a tick by one thread; they never wait for a device.
    `refused_commands` counts the set-points that were not finite: in their place a stop was sent.
    """

    def __init__(self, config: CabConfig, clock: Clock, opener: Opener = open_port) -> None:
        self.refused_commands = 0
        self.board: BoardReadings | None = None      # the newest status line, flags included
        self._clock = clock
        self._fix: GnssFix | None = None
        self._ndvi: list[Reading | None] = [None] * (config.heads.count if config.heads else 0)
        self._readings: dict[str, Reading | None] = dict.fromkeys(BOARD_READINGS)
        self._gnss: tuple[_Line, GnssDecoder] | None = None
        self._heads: list[tuple[_Line, HeadDecoder]] = []
        self._drives: tuple[_Line, SlaveBoard] | None = None
        if config.gnss is not None:
            decoder = GnssDecoder()
            port = opener(config.gnss.port, config.gnss.baud, clock)
            self._gnss = _Line("gnss", "nmea0183", port, decoder.counts), decoder
        if config.heads is not None:
            self._heads = [_open_heads(config.heads, place, clock, opener) for place in range(len(config.heads.ports))]
        if config.board is not None:
            board = SlaveBoard(
                DriveLimits(config.board.max_shaft_rpm, config.board.max_opening_mm),
                WheelGeometry(config.board.wheel_circumference_m, config.board.wheel_pulses_per_turn))
            port = opener(config.board.port, config.board.baud, clock)
            self._drives = _Line("board", "slave-board/1", port, board.counts), board

    def measure(self, now_s: float) -> Measurements:
        """Read what has arrived and give the newest accepted value of everything, however old.

        Bytes are stamped `now_s`, the tick at which they are read: late by less than one tick.
        """
        if self._gnss is not None:
            self._read_gnss(*self._gnss, now_s)
        for line, decoder in self._heads:
            self._read_head(line, decoder, now_s)
        if self._drives is not None:
            self._read_board(*self._drives, now_s)
        return Measurements(now_s, gnss=self._fix, ndvi=tuple(self._ndvi), **self._readings,
                            work_switch=self.board.work_switch if self.board else None)

    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        """Send the set-points of this tick, which are also the heartbeat; without a board nothing happens.

        Not enabled, or no command: a stop. Set-points are cut to the drives' limits.
        """
        if self._drives is None:
            return
        line, board = self._drives
        try:
            data = board.command(command, enabled)
        except ValueError:
            self.refused_commands += 1
            data = board.command(None, False)
        line.port.write(data)

    def status(self, now_s: float) -> tuple[DeviceStatus, ...]:
        """Every device, in the order gnss, heads, board."""
        return tuple(line.status(now_s) for line in self._lines())

    def close(self) -> None:
        """Stop the drives and give the ports back."""
        self.command(self._clock(), None, False)
        for line in self._lines():
            line.port.close()

    def _lines(self) -> list[_Line]:
        lines = [line for line, _ in self._heads]
        if self._gnss is not None:
            lines.insert(0, self._gnss[0])
        if self._drives is not None:
            lines.append(self._drives[0])
        return lines

    def _read_gnss(self, line: _Line, decoder: GnssDecoder, now_s: float) -> None:
        data = line.port.read()
        fixes = decoder.feed(data, now_s) if data else []
        if fixes:
            self._fix = fixes[-1]
            line.note(fix.time_s for fix in fixes)

    def _read_head(self, line: _Line, decoder: HeadDecoder, now_s: float) -> None:
        data = line.port.read()
        samples = decoder.feed(data, now_s) if data else []
        for sample in samples:
            self._ndvi[sample.head - 1] = Reading(sample.ndvi, sample.time_s)
        line.note(sample.time_s for sample in samples)

    def _read_board(self, line: _Line, board: SlaveBoard, now_s: float) -> None:
        data = line.port.read()
        accepted = board.feed(data, now_s) if data else []
        for readings in accepted:
            self.board = readings
            for name in BOARD_READINGS:
                value = getattr(readings, name)
                if value is not None:
                    self._readings[name] = value
        line.note(readings.time_s for readings in accepted)


BOARD_READINGS = ("wheel_speed_mps", "shaft_rpm", "opening_mm", "hopper_kg", "supply_v", "pitch_deg", "roll_deg")


def _open_heads(config: HeadsConfig, place: int, clock: Clock, opener: Opener) -> tuple[_Line, HeadDecoder]:
    head = None if config.multiplexed else place + 1
    decoder = HeadDecoder(config.field_map, head=head, heads=config.count)
    port = opener(config.ports[place], config.baud or config.field_map.baud, clock)
    name = "heads" if config.multiplexed else f"head_{place + 1}"
    return _Line(name, config.protocol, port, decoder.counts), decoder
