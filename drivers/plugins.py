"""Which plug-ins do other packages add to topdress by entry points (CONTRIBUTING.md, "Plug-ins")?
They are searched for names and suffixes that are not built in.

    topdress.devices   NAME    -> `HeadFields` of a canopy head's line; or a receiver's decoder,
                                  made without arguments, with `counts`, `feed(data, time_s)` and
                                  `flush(time_s)`, both -> list[GnssFix]
    topdress.formats   SUFFIX  -> a function of a path that returns a GeoJSON FeatureCollection
    topdress.effects   NAME    -> `EffectPlugin`

Plug-ins run in a process of their own (`drivers.plugin_process`), never in the program's process.
Any failure there is a `PluginFault`.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Any, Literal, NamedTuple

Group = Literal["devices", "formats", "effects"]
# Type of a plug-in that is a function or class instead of a value.
CALLABLE_TYPE = "callable"


class EffectPlugin(NamedTuple):
    """Defines an effect as a term of the machine model (docs/terms.md).

    `simulate --effect NAME=SIZE` adds it to the simulated machine. A term that a diagnosis finds
    with the same target, functional form and variables gets its name. `term` is written as for
    `--term`, with {size}.
    """

    title: str
    term: str
    advice: str


class PluginFault(ValueError):
    """Reports a fault in the code of a plug-in, in one line that names the plug-in. `name` is the
    plug-in, `why` the reason without the name."""

    def __init__(self, group: Group, name: str, why: str) -> None:
        super().__init__(f"plug-in {name} of {find_package(group, name)}: {why}")
        self.name, self.why = name, why


class Plugin(NamedTuple):
    """Describes a plug-in. `is_a` is the name of its type or `CALLABLE_TYPE`; `values` holds
    its fields."""

    name: str
    is_a: str
    values: Mapping[str, Any]


def list_declared(package: ModuleType, name: str) -> list[Any]:
    """Returns what the modules of a package declare under a name: the built-in ones."""
    modules = [one.name for one in pkgutil.iter_modules(package.__path__)]
    found = (import_module(f"{package.__name__}.{module}") for module in modules)
    return [getattr(module, name) for module in found if hasattr(module, name)]


@cache
def find_entry_points(group: Group) -> dict[str, EntryPoint]:
    """Returns the entry points of a group by their names without loading any."""
    return {one.name: one for one in entry_points(group=f"topdress.{group}")}


def find_package(group: Group, name: str) -> str:
    """Returns the name of the package that adds a plug-in."""
    point = find_entry_points(group).get(name)
    if point is None:
        return "no package"
    return point.dist.name if point.dist is not None else point.value


def find_plugin(group: Group, name: str) -> Plugin | None:
    """Returns the plug-in with this name; None for an unknown name. Raises PluginFault where the
    plug-in cannot be loaded."""
    if name not in find_entry_points(group):
        return None
    found = _describe_once(group, name)
    if isinstance(found, PluginFault):
        raise found
    return found


@cache
def _describe_once(group: Group, name: str) -> Plugin | PluginFault:
    """Returns a plug-in's description from a cache, so that a hanging plug-in costs its time-out
    only once."""
    from topdress.drivers.plugin_process import describe_plugin

    try:
        return describe_plugin(group, name)
    except PluginFault as fault:
        return fault


def find_effect(name: str) -> EffectPlugin | None:
    """Returns the effect of a plug-in; None for an unknown name. Raises PluginFault."""
    found = find_plugin("effects", name)
    if found is None:
        return None
    try:
        made = EffectPlugin(**found.values)
        if all(isinstance(text, str) for text in made) and made.term.format(size="1"):
            return made
    except (TypeError, ValueError, LookupError, AttributeError):
        pass
    raise PluginFault("effects", name, f"is a {found.is_a}: allowed is an EffectPlugin of texts")


def list_effects() -> dict[str, EffectPlugin]:
    """Returns all effects that can be loaded."""
    found: dict[str, EffectPlugin] = {}
    for name in find_entry_points("effects"):
        with suppress(PluginFault):
            made = find_effect(name)
            if made is not None:
                found[name] = made
    return found


def has_format_plugin(suffix: str) -> bool:
    """Returns whether a plug-in reads files with this suffix, given with its point and in lower
    case."""
    return suffix[1:] in find_entry_points("formats")
