"""What does a device state about itself? The cab file, the cab, `topdress devices`, `topdress
decode` and the tests take it from here.

A device is a module of this folder with a `DEVICE`: its section of the cab file, its decoder
and the measurements that its messages give.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, Field
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.datagrams import validate_line_url
from topdress.drivers.devices.lines import LineDecoder

if TYPE_CHECKING:
    # The simulated plant is not loaded with the devices, so that the console starts quickly.
    from topdress.control.simulation.plant import SensorReadings

# Ports of a device that is no program.
SERIAL_PORT = "a serial port or socket://HOST:PORT"
LineUrl = Annotated[str, AfterValidator(validate_line_url)]
Baud = Annotated[int, Field(ge=300, le=4_000_000)]
Record = dict[str, float | int | str | None]


class LineConfig(FrozenModel):
    """Describes where a device is connected."""

    port: LineUrl
    baud: Baud = 115200


@dataclass(frozen=True, kw_only=True)
class OpenLine:
    """Defines one line of a device: where it is, and what is done with its bytes.

    Parameters
    ----------
    name : name on the page Devices and in captures.
    protocol : protocol on that page.
    url, baud : where the line is; without a baud rate it carries datagrams.
    decoder : has `feed(data, time_s)` and `counts`.
    find_measurements : the fields of `Measurements` that one message sets.
    find_state : the fields that are set in every tick, at a time.
    begin : called at every connection; returns the bytes to send.
    close : called when the cab closes.
    """

    name: str
    protocol: str
    url: str
    baud: int | None
    decoder: Any
    find_measurements: Callable[[Any], Mapping[str, Any]]
    find_state: Callable[[float], Mapping[str, Any]] = lambda now_s: {}
    begin: Callable[[], bytes] = lambda: b""
    close: Callable[[], None] = lambda: None


@dataclass(frozen=True, kw_only=True)
class Device:
    """Defines a device of the cab.

    Parameters
    ----------
    section : name of its section of the cab file.
    title : name on the screen, an English text in `N_` of `control.signals`.
    config : model of the section.
    open_lines : the lines of a section.
    sole : measurements that no other device of the machine gives where this device is fitted.
    rank : place among the devices, which are read in this order.
    """

    section: str
    title: str
    config: type[FrozenModel]
    open_lines: Callable[[Any], Sequence[OpenLine]]
    sole: tuple[str, ...] = ()
    rank: int = 100


def _open_no_line(section: Any) -> Sequence[OpenLine]:
    return ()


@dataclass(frozen=True, kw_only=True)
class LineDevice(Device):
    """Defines a device with one line of one protocol. Its section names the line.

    Parameters
    ----------
    protocol : protocol on the page Devices.
    heard_as : name of the protocol in `topdress devices`; empty means the section.
    make_decoder : returns a decoder for a section; None for a line without a cab file.
    find_measurements : the fields of `Measurements` that one message sets.
    make_record : the columns of one message in `topdress decode`; None: not decoded there.
    make_example : forty messages as the virtual device sends them.
    make_message : the bytes that the virtual machine sends every `interval_s` for the readings of
        its sensors; None: the virtual machine has no such line.
    """

    protocol: str
    config: type[LineConfig]
    make_decoder: Callable[[Any], LineDecoder[Any]]
    find_measurements: Callable[[Any], Mapping[str, Any]]
    make_example: Callable[[], bytes]
    make_record: Callable[[Any], Record] | None = None
    make_message: Callable[[SensorReadings], bytes] | None = None
    interval_s: float = 0.5
    heard_as: str = ""
    open_lines: Callable[[Any], Sequence[OpenLine]] = _open_no_line

    def __post_init__(self) -> None:
        if self.open_lines is _open_no_line:
            object.__setattr__(self, "open_lines", lambda config: (self.make_line(config),))

    def make_line(self, config: LineConfig) -> OpenLine:
        """Returns the line of a section with its decoder."""
        return OpenLine(
            name=self.section,
            protocol=self.protocol,
            url=config.port,
            baud=config.baud,
            decoder=self.make_decoder(config),
            find_measurements=self.find_measurements,
        )


@dataclass(frozen=True, kw_only=True)
class Receiver:
    """Defines a source of fixes: a module of this folder with a `RECEIVER`.

    Parameters
    ----------
    protocol : name in cab files and in `topdress devices`.
    captured_as : name in `topdress decode`.
    make_decoder : returns a decoder; True for a line, False for a recording.
    port : a port that is allowed, or what it may be; with "udp://" no other port is.
    hello : bytes that request reports at every connection.
    """

    protocol: str
    captured_as: str
    make_decoder: Callable[[bool], Any]
    port: str = SERIAL_PORT
    hello: bytes = b""
