"""What makes a stage parameter an effect, and which effects does the catalogue contain?"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_type_hints

# Machine file numbers whose product scales a size: the highest shaft speed.
SHAFT_RANGE = ("limits.shaft_high_rpm",)
OPENING_RANGE = ("limits.opening_high_mm",)
LONGEST_ANSWER = ("limits.longest_answer_s",)
SLEW_RATE = ("gate.slew_mm_s",)
HOPPER_CAPACITY = ("flow.full_kg",)
# The product is the mass of a revolution at full opening.
FULL_REVOLUTION = ("flow.grams_per_rev_mm", *OPENING_RANGE)
# The product is the mass of a second at full opening and full speed.
FULL_FLOW = (*FULL_REVOLUTION, *SHAFT_RANGE)


@dataclass(frozen=True)
class Effect:
    """Marks a stage parameter as an effect. The parameter's default is its neutral value.

    The bounds of the effect's size are those of its field. Where the size `scales_with` numbers of
    the machine, `bounds` and the trial sizes are those of the nominal machine, and the field's
    bounds are those of any machine.
    """

    # Id of the effect, a public contract, e.g. "shaft.dead_band".
    id: str
    # Unit of the size, which may refer to a number of the stages, e.g. "% lost at {flow.full_rpm:g}
    # r/min".
    unit: str
    title: str
    # Physical cause in one sentence.
    physics: str
    # Reference that describes the effect, or gives its size.
    source: str
    # Kinds of data that can show the effect: run, catch, lag, place, weigh, heads, ...
    seen_in: tuple[str, ...]
    # Advice for maintenance.
    advice: str
    # Experiment that separates the effect from similar effects.
    separate: str
    # Trial sizes; several for a threshold effect, whose slope is 0 at neutral.
    probes: tuple[float, ...] = (0.1,)
    # Whether the size is the onset time; the parameter is then set to 1.
    onset_only: bool = False
    # Name of the parameter with the affected head or outlet (1-based, 0 for none).
    member_field: str = ""
    # Bounds of the parameter on the nominal machine.
    bounds: tuple[float, float] | None = None
    # Numbers of the machine file whose product scales the size.
    scales_with: tuple[str, ...] = ()
    # Unit before numbers are inserted; the catalogue fills this field.
    unit_form: str = ""
    # Sentences for the owner: the consequence of a positive size, of a negative size, and of a size
    # below -100 %; {size} is unsigned.
    says: tuple[str, ...] = ()

    def choose_sentence(self, size: float) -> str:
        """Returns the sentence for the owner about the consequence of a size; `{size}` is a
        placeholder."""
        return self.says[min(len(self.says) - 1, 0 if size >= 0.0 else 2 if size < -100.0 else 1)]


class CatalogueEntry(NamedTuple):
    """Holds one catalogued effect: its parameter, its neutral value and its range on the nominal
    machine."""

    # Name of the stage in the machine, e.g. "flow".
    stage: str
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
    """Returns all effects of the stages by id, read from their annotated parameters.

    The annotations are the only list of effects.
    """
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
