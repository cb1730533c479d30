"""What a stage parameter needs to be an effect, and the catalogue that is read off the stages."""
from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, get_type_hints


@dataclass(frozen=True)
class Effect:
    """Marks a stage parameter as an effect. The parameter's default is its neutral value."""

    id: str                              # public contract, e.g. "shaft.dead_band"
    unit: str
    title: str
    physics: str                         # one sentence
    source: str                          # where such a thing is described, or how its size is known
    seen_in: tuple[str, ...]             # kinds of data that can show it: run, catch, lag, place, weigh, heads, ...
    advice: str                          # maintenance
    separate: str                        # the experiment that tells it from its look-alikes
    probes: tuple[float, ...] = (0.1,)   # sizes tried; several where the effect is a threshold (slope 0 at neutral)
    onset_only: bool = False             # its size is the time at which it begins; the parameter is then set to 1
    member_field: str = ""               # the parameter that says which head or outlet (1-based, 0 = none)


class Entry(NamedTuple):
    """One catalogued effect: where it lives, its neutral value and the range its size may take."""

    stage: str                           # name of the stage in the machine, e.g. "flow"
    field: str
    neutral: float
    low: float
    high: float
    effect: Effect


def _bounds(marks: Iterable[Any]) -> tuple[float, float]:
    low, high = -math.inf, math.inf
    for mark in marks:
        for part in getattr(mark, "metadata", ()):
            low = getattr(part, "ge", low)
            high = getattr(part, "le", high)
    return low, high


def catalogue(stages: dict[str, Any]) -> dict[str, Entry]:
    """Every effect of the stages by id, read off their annotated parameters. There is no second list."""
    found: dict[str, Entry] = {}
    for name, stage in stages.items():
        for field, hint in get_type_hints(stage, include_extras=True).items():
            marks = getattr(hint, "__metadata__", ())
            for mark in marks:
                if isinstance(mark, Effect):
                    low, high = _bounds(marks)
                    found[mark.id] = Entry(name, field, stage._field_defaults[field], low, high, mark)
    return found
