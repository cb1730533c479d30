"""What other packages add to topdress by entry points (CONTRIBUTING.md, "Plug-ins"): looked for
where a name or a suffix is none of ours, and loaded then.

    topdress.devices   NAME    -> `HeadFields` of a canopy head's line; or a receiver's decoder,
                               made without arguments,
                                  with `counts`, `feed(data, time_s)` and `flush(time_s)`, both ->
                                  list[GnssFix]
    topdress.formats   SUFFIX  -> a function of a path that gives a GeoJSON FeatureCollection, as
                       a dict
    topdress.effects   NAME    -> `EffectPlugin`
"""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, NamedTuple

from drivers.plain_text import one_line

Group = Literal["devices", "formats", "effects"]


class EffectPlugin(NamedTuple):
    """An effect as a term of the machine model (docs/terms.md): `simulate --effect NAME=SIZE`
    plants it, and a term that a diagnosis finds with the same action, form and variables is
    named by it. term: as of `--term`, with {size}.
    """

    title: str
    term: str
    advice: str


@cache
def names(group: Group) -> dict[str, EntryPoint]:
    return {one.name: one for one in entry_points(group=f"topdress.{group}")}


@cache
def plugged(group: Group, name: str) -> Any:
    """None: nobody adds it. Raises ValueError of one line where it cannot be loaded."""
    if name not in names(group):
        return None
    one = names(group)[name]
    try:
        return one.load()
    except Exception as error:  # another's code
        of = one.dist.name if one.dist is not None else one.value
        raise ValueError(
            f"plug-in {name} of {of}: not loaded: {type(error).__name__}: {one_line(str(error))}"
        ) from None


def effects() -> dict[str, EffectPlugin]:
    """All that can be loaded."""
    found: dict[str, EffectPlugin] = {}
    for name in names("effects"):
        with suppress(ValueError):
            found[name] = plugged("effects", name)
    return found


def format_of(suffix: str) -> Any:
    """`plugged` of the formats by a suffix with its point, in lower case."""
    return plugged("formats", suffix[1:])
