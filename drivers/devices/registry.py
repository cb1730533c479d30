"""Which devices are there? Modules of this folder declare a `DEVICE` or a `RECEIVER`."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

from topdress.drivers import devices
from topdress.drivers.devices.device import LineDevice, Receiver


def _list_declared(name: str) -> list[Any]:
    """Returns what the modules of this folder declare under a name."""
    modules = [one.name for one in pkgutil.iter_modules(devices.__path__)]
    found = (import_module(f"{devices.__name__}.{module}") for module in modules)
    return [getattr(module, name) for module in found if hasattr(module, name)]


@cache
def list_line_devices() -> tuple[LineDevice, ...]:
    """Returns the devices with a line of their own, by their sections."""
    return tuple(sorted(_list_declared("DEVICE"), key=lambda one: one.section))


@cache
def map_receivers() -> Mapping[str, Receiver]:
    """Returns the built-in sources of fixes by their protocols."""
    return {one.protocol: one for one in _list_declared("RECEIVER")}
