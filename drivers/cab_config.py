"""Which devices does a machine have, and where are they connected? The cab file lists them."""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, Field, create_model, model_validator
from topdress.control.frozen_model import FrozenModel
from topdress.drivers.datagrams import is_loopback, parse_udp_address
from topdress.drivers.devices.canopy_heads import FIELDS_OF_PROTOCOL, HeadFields, find_head_fields
from topdress.drivers.devices.device import SERIAL_PORT, Baud, LineConfig, LineUrl
from topdress.drivers.devices.registry import list_line_devices, map_receivers
from topdress.drivers.plugins import CALLABLE_TYPE, find_entry_points, find_plugin

# Largest number of canopy heads on one boom.
MAX_HEADS = 12
# UDP ports on which rate modules listen and to which they answer.
DEFAULT_MODULE_PORT, DEFAULT_CONSOLE_PORT = 28888, 29999
# Time without messages after which a rate module stops its own motor, s.
MODULE_TIMEOUT_S = 4.0

UdpPort = Annotated[int, Field(ge=1, le=65535)]
ControlType = Literal["valve", "combo_close", "motor", "motor_weights", "fan", "timed"]


def _validate_receiver(name: str) -> str:
    # Plug-ins add protocols that are not built in.
    found = None if name in map_receivers() else find_plugin("devices", name)
    if name not in map_receivers() and (found is None or found.is_a != CALLABLE_TYPE):
        raise ValueError(
            f"protocol {name!r}: allowed is one of "
            f"{', '.join((*map_receivers(), *find_entry_points('devices')))}"
        )
    return name


Receiver = Annotated[str, AfterValidator(_validate_receiver), Field(examples=list(map_receivers()))]


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


class HeadLayout(FrozenModel):
    """Assigns the fields of a head's line to NDVI and the second index. Field numbers begin at 1;
    `index_2: 0` means that the line has no second index."""

    fields: Annotated[int, Field(ge=1, le=40)]
    ndvi: Annotated[int, Field(ge=1, le=40)]
    index_2: Annotated[int, Field(ge=0, le=40)] = 0

    @model_validator(mode="after")
    def _check_field_numbers(self) -> Self:
        if max(self.ndvi, self.index_2) > self.fields:
            raise ValueError(
                f"ndvi {self.ndvi} and index_2 {self.index_2} must be at most fields {self.fields}"
            )
        return self


class HeadsConfig(FrozenModel):
    """Describes the canopy heads: one port each from left to right, or all on one
    multiplexed line."""

    protocol: str = "greenseeker"
    ports: Annotated[tuple[LineUrl, ...], Field(min_length=1, max_length=MAX_HEADS)]
    # None means the baud rate that the protocol defines.
    baud: Baud | None = None
    multiplexed: bool = False
    # The number of heads on a multiplexed line; separate ports are counted instead.
    heads: Annotated[int, Field(ge=1, le=MAX_HEADS)] = 6
    # None means the layout that the protocol defines.
    layout: HeadLayout | None = None
    # The index that determines the rate; `ndre` is the second index of the line.
    index: Literal["ndvi", "ndre"] = "ndvi"

    @model_validator(mode="after")
    def _check_heads(self) -> Self:
        if find_head_fields(self.protocol) is None and self.layout is None:
            raise ValueError(
                f"protocol {self.protocol!r}: allowed is one of {', '.join(FIELDS_OF_PROTOCOL)}, "
                "or any name together with a layout"
            )
        if self.multiplexed and len(self.ports) != 1:
            raise ValueError(f"ports: {len(self.ports)} given, a multiplexed line has 1")
        if self.index == "ndre" and (
            self.field_map.index_2_is != "ndre" if self.layout is None else self.layout.index_2 == 0
        ):
            able = ", ".join(
                name for name, known in FIELDS_OF_PROTOCOL.items() if known.index_2_is == "ndre"
            )
            raise ValueError(
                f"index ndre: heads of protocol {self.protocol} give NDVI: allowed with "
                f"{able}, or with a "
                "layout whose index_2 is NDRE"
            )
        return self

    @property
    def count(self) -> int:
        """Number of canopy heads."""
        return self.heads if self.multiplexed else len(self.ports)

    @property
    def field_map(self) -> HeadFields:
        """Fields of a line that hold NDVI and the second index."""
        if self.layout is not None:
            return HeadFields(self.layout.fields, self.layout.ndvi, self.layout.index_2)
        found = find_head_fields(self.protocol)
        assert found is not None, "_fits refuses it"
        return found


class BoardConfig(LineConfig):
    """Describes the slave board, the limits of its drives and the wheel whose pulses it counts."""

    max_shaft_rpm: Annotated[float, Field(gt=0, le=300)] = 100.0
    max_opening_mm: Annotated[float, Field(gt=0, le=100)] = 60.0
    wheel_circumference_m: Annotated[float, Field(gt=0, le=20)] = 2.50
    wheel_pulses_per_turn: Annotated[float, Field(ge=1, le=10000)] = 16.0
    # On a machine with a switch, silence of the switch means that the implement is lifted.
    work_switch: bool = False


class RateModuleConfig(FrozenModel):
    """Describes a rate module on UDP as the metering drive. Its unit is one turn of the metering
    shaft, so units per minute are r/min.

    `address`: the module's own address or the broadcast address of the subnet; None means
    192.168.1.(50 + module), the default of the modules. `listen`: this computer's own address in
    the network of the module, or 0.0.0.0 where the module answers to the whole subnet. `subnet`:
    network from which answers are accepted, such as 192.168.1.0/24; None means `address` alone.
    `fixed_opening_mm`: opening of a gate that is set by hand because the board does not move it.
    `valves`: whether the valves of the sections are wired to the relays of the module, from the
    second relay on; otherwise they are wired to the slave board.
    """

    address: str | None = None
    port: UdpPort = DEFAULT_MODULE_PORT
    listen: str = "127.0.0.1"
    subnet: str | None = None
    listen_port: UdpPort = DEFAULT_CONSOLE_PORT
    module: Annotated[int, Field(ge=0, le=15)] = 0
    sensor: Annotated[int, Field(ge=0, le=15)] = 0
    pulses_per_turn: Annotated[float, Field(ge=1, le=16777)]
    drive: ControlType = "motor"
    max_shaft_rpm: Annotated[float, Field(gt=0, le=300)] = 100.0
    fixed_opening_mm: Annotated[float, Field(gt=0, le=100)] | None = None
    work_switch: bool = False
    valves: bool = False

    @property
    def url(self) -> str:
        """URL with both addresses and the permitted senders:
        `udp://LISTEN:PORT?to=ADDRESS:PORT&from=NETWORK`."""
        senders = "" if self.subnet is None else f"&from={self.subnet}"
        return (
            f"udp://{self.listen}:{self.listen_port}?to={self.module_address}:{self.port}{senders}"
        )

    @property
    def module_address(self) -> str:
        """Address to which the datagrams are sent."""
        return self.address or f"192.168.1.{50 + self.module}"

    @model_validator(mode="after")
    def _check_senders(self) -> Self:
        if is_loopback(self.listen) != is_loopback(self.module_address):
            raise ValueError(
                f"listen {self.listen}: a module at {self.module_address} cannot be heard there: "
                "allowed is this "
                "computer's own address on the module's network, or 0.0.0.0"
            )
        if self.subnet is None and (
            self.module_address.endswith(".255") or not _is_address(self.module_address)
        ):
            raise ValueError(
                f"address {self.module_address} is not one module's: "
                "subnet is missing, from where answers are "
                "believed: allowed is a network, as 192.168.1.0/24"
            )
        if self.subnet is not None and not _is_network(self.subnet):
            raise ValueError(f"subnet {self.subnet}: allowed is a network, as 192.168.1.0/24")
        return self


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return is_loopback(text)
    return True


def _is_network(text: str) -> bool:
    try:
        ipaddress.ip_network(text)
    except ValueError:
        return False
    return True


class CabBase(FrozenModel):
    """Lists the devices of a machine and where they are plugged in; None means that a device is not
    fitted. Devices with a line of their own add their sections.

    `record_only`: nothing is sent to any drive; the work of another controller is only logged and
    mapped. `virtual`: `topdress serve-machine` is at the other end of the ports instead of a
    machine. The screens state this, and a job without a boundary gets the field of its simulated
    passes.
    """

    format: Literal["topdress-cab/1"] = "topdress-cab/1"
    title: str = ""
    virtual: bool = False
    record_only: bool = False
    gnss: GnssConfig | None = None
    heads: HeadsConfig | None = None
    board: BoardConfig | None = None
    rate_module: RateModuleConfig | None = None

    @model_validator(mode="after")
    def _check_metering(self) -> Self:
        module = self.rate_module
        if module is not None and (self.board is None) == (module.fixed_opening_mm is None):
            what = (
                "missing: a machine without a board has a gate set by hand, 0 to 100 mm"
                if self.board is None
                else "given, but the board moves the gate: leave one of them out"
            )
            raise ValueError(f"rate_module.fixed_opening_mm is {what}")
        return self

    @property
    def has_work_switch(self) -> bool:
        """Whether a device of this cab reports a work switch."""
        return any(part is not None and part.work_switch for part in (self.board, self.rate_module))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about these devices that the operator must know."""
        found = []
        if self.rate_module is not None:
            found.append(
                "rate_module: the module stops its motor by itself only after "
                f"{MODULE_TIMEOUT_S:g} s without "
                "the console (a slave board after 1 s): have the hard-wired stop within reach"
            )
        if self.record_only:
            return ("record only: no drive is commanded, what the machine does is logged",)
        if self.board is None and self.rate_module is None:
            found.append("no board and no rate_module: nothing can be spread")
        if not self.has_work_switch:
            found.append(
                "no work switch is fitted: flow stops by speed, field edge and operator only"
            )
        return tuple(found)


if TYPE_CHECKING:
    CabConfig = CabBase
else:
    CabConfig = create_model(
        "CabConfig",
        __base__=CabBase,
        __module__=__name__,
        __doc__=CabBase.__doc__,
        **{one.section: (one.config | None, None) for one in list_line_devices()},
    )
