"""Which receiver or program gives the position? This module defines its section of the cab file;
each protocol has a file with a `RECEIVER`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, model_validator
from topdress.control.signals import N_
from topdress.drivers.datagrams import parse_udp_address
from topdress.drivers.devices.device import SERIAL_PORT, Device, LineConfig, OpenLine
from topdress.drivers.devices.registry import map_receivers
from topdress.drivers.plugins import CALLABLE_TYPE, find_entry_points, find_plugin


def _validate_receiver(name: str) -> str:
    # Plug-ins add protocols that are not built in.
    found = None if name in map_receivers() else find_plugin("devices", name)
    if name not in map_receivers() and (found is None or found.is_a != CALLABLE_TYPE):
        raise ValueError(
            f"protocol {name!r}: allowed is one of "
            f"{', '.join((*map_receivers(), *find_entry_points('devices')))}"
        )
    return name


def _add_examples(schema: dict[str, Any]) -> None:
    # The receivers are listed for the schema only: at import not all of them are declared.
    schema["examples"] = list(map_receivers())


Receiver = Annotated[
    str, AfterValidator(_validate_receiver), Field(json_schema_extra=_add_examples)
]


class GnssConfig(LineConfig):
    """Describes a receiver, or a program that passes on a receiver's position.

    `nmea0183`: a serial line or `socket://`. `gpsd`: `socket://HOST:2947`. `agopengps`:
    `udp://127.0.0.1:17777`, the address at which this program listens; any address other than
    loopback names the permitted sender: `?from=ADDRESS`.
    """

    protocol: Receiver = "nmea0183"

    @model_validator(mode="after")
    def _check_address(self) -> Self:
        receiver = map_receivers().get(self.protocol)
        wanted = SERIAL_PORT if receiver is None else receiver.port
        if wanted.startswith("udp://") != self.port.startswith("udp://"):
            raise ValueError(f"port {self.port}: allowed with {self.protocol} is {wanted}")
        if self.port.startswith("udp://") and parse_udp_address(self.port).senders is None:
            raise ValueError(
                f"port {self.port}: anybody on that network could say where the machine is: "
                "allowed is "
                "udp://127.0.0.1:PORT, or ?from=ADDRESS with the one that is believed"
            )
        return self


def open_fix_source(config: GnssConfig) -> Sequence[OpenLine]:
    """Returns the line of a receiver or program; gpsd is asked to report at every connection."""
    receiver = map_receivers().get(config.protocol)
    if receiver is None:
        from topdress.drivers.plugin_process import PluginReceiver

        plugin = PluginReceiver(config.protocol)
        decoder, hello, close = plugin, b"", plugin.close
    else:
        decoder, hello, close = receiver.make_decoder(True), receiver.hello, lambda: None
    return (
        OpenLine(
            name="gnss",
            protocol=config.protocol,
            url=config.port,
            baud=config.baud,
            decoder=decoder,
            find_measurements=lambda fix: {"gnss": fix},
            begin=lambda: hello,
            close=close,
        ),
    )


DEVICE = Device(
    section="gnss",
    title=N_("GNSS"),
    config=GnssConfig,
    open_lines=open_fix_source,
    rank=1,
)
