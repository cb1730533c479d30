"""Which effects does a simulated machine have that its controller does not know? Syntax:
`ID=SIZE[@ONSET_S][#MEMBER]`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from .machine import CATALOGUE, Machine, add_effect

_EFFECT_PATTERN = re.compile(
    r"(?P<id>[a-z_]+\.[a-z_]+)=(?P<size>[-+0-9.eE]+)(?:@(?P<onset>"
    r"[0-9.eE+]+))?(?:#(?P<member>\d+))?"
)


class InjectedEffect(NamedTuple):
    """Holds an effect of a simulated machine."""

    id: str
    size: float
    onset_s: float = 0.0
    member: int | None = None


def parse_planted(text: str) -> InjectedEffect:
    """Parses the value of an `--effect` option.

    Raises
    ------
    ValueError : in one plain line with the text, the mistake and the allowed values.
    """
    match = _EFFECT_PATTERN.fullmatch(text.strip())
    if match is None:
        raise ValueError(
            f"effect {text!r}: not understood: allowed ID=SIZE[@ONSET_S][#MEMBER], e.g. "
            "flow.gain=8 or "
            "canopy.head_fouled=-10@600#3"
        )
    effect_id = match["id"]
    if effect_id not in CATALOGUE:
        raise ValueError(
            f"effect {text!r}: unknown id {effect_id!r}: `topdress effects` lists the known ones"
        )
    try:
        size = float(match["size"])
        onset = float(match["onset"]) if match["onset"] else 0.0
    except ValueError:
        raise ValueError(f"effect {text!r}: SIZE and ONSET_S must be numbers") from None
    if CATALOGUE[effect_id].effect.onset_only:
        onset = onset or size
    return InjectedEffect(effect_id, size, onset, int(match["member"]) if match["member"] else None)


def schedule_effects(
    machine: Machine, planted: Sequence[InjectedEffect]
) -> list[tuple[float, Machine]]:
    """Returns machines with their start times, s, in the order in which they come into force; the
    first starts at 0.

    Raises
    ------
    ValueError : an effect is out of bounds.
    """
    stages: list[tuple[float, Machine]] = [(0.0, machine)]
    for effect in sorted(planted, key=lambda p: p.onset_s):
        changed = add_effect(stages[-1][1], effect.id, effect.size, effect.member)
        if effect.onset_s <= 0.0:
            stages[-1] = (0.0, changed)
        else:
            stages.append((effect.onset_s, changed))
    return stages
