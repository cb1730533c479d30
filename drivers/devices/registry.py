"""Which devices are there? Modules of this folder declare a `DEVICE` or a `RECEIVER`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from topdress.drivers import devices
from topdress.drivers.devices.device import Device, LineDevice, Receiver
from topdress.drivers.plugins import list_declared


@cache
def list_devices() -> tuple[Device, ...]:
    """Returns the devices in the order in which the cab reads them."""
    return tuple(sorted(list_declared(devices, "DEVICE"), key=lambda one: (one.rank, one.section)))


def list_line_devices() -> tuple[LineDevice, ...]:
    """Returns the devices with one line of one protocol."""
    return tuple(one for one in list_devices() if isinstance(one, LineDevice))


@cache
def map_receivers() -> Mapping[str, Receiver]:
    """Returns the built-in sources of fixes by their protocols."""
    return {one.protocol: one for one in list_declared(devices, "RECEIVER")}
