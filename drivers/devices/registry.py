"""Which devices have a line of their own? They are the modules of this folder with a `DEVICE`."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module

from topdress.drivers import devices
from topdress.drivers.devices.device import LineDevice


@cache
def list_line_devices() -> tuple[LineDevice, ...]:
    """Returns the devices with a line of their own, by their sections."""
    names = [one.name for one in pkgutil.iter_modules(devices.__path__)]
    modules = (import_module(f"{devices.__name__}.{name}") for name in names)
    found = [module.DEVICE for module in modules if hasattr(module, "DEVICE")]
    return tuple(sorted(found, key=lambda one: one.section))
