"""What does a device on a line of its own state about itself? The cab file, the cab, `topdress
devices`, `topdress decode` and the tests take it from here.

Such a device is a module of this folder with a `DEVICE`: its section of the cab file, its decoder
and the measurements that its messages give.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, Field
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.datagrams import validate_line_url
from topdress.drivers.devices.lines import LineDecoder

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
class LineDevice:
    """Defines a device that only its own line connects with the others.

    Parameters
    ----------
    section : name of its section of the cab file, on the page Devices and in captures.
    title : name on the screen, an English text in `N_` of `control.signals`.
    protocol : protocol on the page Devices.
    heard_as : name of the protocol in `topdress devices`; empty means the section.
    config : model of the section.
    make_decoder : returns a decoder for a section; None for a line without a cab file.
    find_measurements : the fields of `Measurements` that one message sets.
    make_record : the columns of one message in `topdress decode`; None: not decoded there.
    make_example : forty messages as the virtual device sends them.
    """

    section: str
    title: str
    protocol: str
    config: type[LineConfig]
    make_decoder: Callable[[Any], LineDecoder[Any]]
    find_measurements: Callable[[Any], Mapping[str, Any]]
    make_example: Callable[[], bytes]
    make_record: Callable[[Any], Record] | None = None
    heard_as: str = ""


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
