"""What makes a stage parameter an effect, and which effects does the catalogue contain?"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_type_hints

# Figures of the machine file, multiplied with each other, that a size may be a share of.
SHAFT_RANGE = ("limits.shaft_high_rpm",)
OPENING_RANGE = ("limits.opening_high_mm",)
SLEW_RATE = ("gate.slew_mm_s",)
HOPPER_CAPACITY = ("flow.full_kg",)
# Mass of a revolution at full opening.
FULL_REVOLUTION = ("flow.grams_per_rev_mm", *OPENING_RANGE)
# Mass of a second at full opening and full speed.
FULL_FLOW = (*FULL_REVOLUTION, *SHAFT_RANGE)


@dataclass(frozen=True)
class Effect:
    """Marks a stage parameter as an effect. The parameter's default is its neutral value.

    The bounds of its size are those of its field. Where the size `scales_with` figures of the
    machine, `bounds` are those of the nominal machine, and so are the sizes tried; the field's
    are what no machine exceeds."""

    id: str  # public contract, e.g. "shaft.dead_band"
    # may name a figure of its stages, e.g. "% lost at {flow.full_rpm:g} r/min"
    unit: str
    title: str
    physics: str  # one sentence
    # where such a thing is described, or how its size is known
    source: str
    # kinds of data that can show it: run, catch, lag, place, weigh, heads, ...
    seen_in: tuple[str, ...]
    advice: str  # maintenance
    # the experiment that tells it from its look-alikes
    separate: str
    # sizes tried; several where the effect is a threshold (slope 0 at neutral)
    probes: tuple[float, ...] = (0.1,)
    # its size is the time at which it begins; the parameter is then set to 1
    onset_only: bool = False
    # the parameter that says which head or outlet (1-based, 0 = none)
    member_field: str = ""
    bounds: tuple[float, float] | None = None  # of the parameter, on the nominal machine
    # figures of the machine file that the size is a share of
    scales_with: tuple[str, ...] = ()
    # the unit before figures are put in; the catalogue fills it
    unit_form: str = ""
    # For the owner: what a positive size does, a negative one, and one below -100 %; {size}
    # unsigned.
    says: tuple[str, ...] = ()

    def choose_sentence(self, size: float) -> str:
        """Returns what the machine does, for its owner; `{size}` is to be filled in."""
        return self.says[min(len(self.says) - 1, 0 if size >= 0.0 else 2 if size < -100.0 else 1)]


class CatalogueEntry(NamedTuple):
    """Holds one catalogued effect: its parameter, its neutral value and its range on the nominal
    machine."""

    stage: str  # name of the stage in the machine, e.g. "flow"
    field: str
    neutral: float
    low: float
    high: float
    effect: Effect


def _find_bounds(marks: Iterable[Any]) -> tuple[float, float]:
    low, high = -math.inf, math.inf
    for mark in marks:
        for part in getattr(mark, "metadata", ()):
            low = getattr(part, "ge", low)
            high = getattr(part, "le", high)
    return low, high


def make_catalogue(stages: dict[str, Any]) -> dict[str, CatalogueEntry]:
    """Returns every effect of the stages by id, read from their annotated parameters. There is
    no second list."""
    nominal = {name: stage() for name, stage in stages.items()}
    found: dict[str, CatalogueEntry] = {}
    for name, stage in stages.items():
        for field, hint in get_type_hints(stage, include_extras=True).items():
            marks = getattr(hint, "__metadata__", ())
            for mark in marks:
                if isinstance(mark, Effect):
                    low, high = mark.bounds or _find_bounds(marks)
                    effect = replace(mark, unit=mark.unit.format(**nominal), unit_form=mark.unit)
                    found[mark.id] = CatalogueEntry(
                        name, field, stage._field_defaults[field], low, high, effect
                    )
    return found
