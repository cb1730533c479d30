"""The examination's timetable: what case number k hides, so that any number of cases is a fair
mixture.

Cases are dealt from packs of sixty, one pack for each half of the programmes in turn. Effects
are taken round and round in shuffled order, so that each is asked as often as the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from .cases import LOOKALIKES, TABLE_KINDS
from .nominal import IDS, OUTSIDE, OUTSIDE_TABLES

RUN_PACK = {"none": 11, "single": 12, "pair": 3, "lookalike": 3, "outside": 3}
TABLE_PACK = {"none": 9, "single": 11, "pair": 3, "lookalike": 3, "outside": 2}
PACK = tuple(("run", c) for c, n in RUN_PACK.items() for _ in range(n)) + tuple(
    ("table", c) for c, n in TABLE_PACK.items() for _ in range(n)
)
T = TypeVar("T")


class Wanted(NamedTuple):
    """Arguments of `cases.one`: category, kinds of data and ids that the case may have (empty:
    any)."""

    category: str
    kinds: tuple[str, ...]
    ids: tuple[str, ...]


def wanted(number: int, seed: int) -> Wanted:
    """What case `number` of the examination `seed` is to hide."""
    (data, category), half, turn = dealt(PACK, number, seed, 7)
    if category in ("none", "pair"):
        return Wanted(category, ("run",) if data == "run" else TABLE_KINDS, ())
    lists = {"single": _singles, "lookalike": _lookalikes, "outside": _outside}[category](data)
    kinds, ids = in_turn(lists, turn, seed, half, (len(lists), 8))
    return Wanted(category, kinds, ids)


def dealt(pack: Sequence[T], number: int, seed: int, salt: int) -> tuple[T, int, int]:
    """Entry `number` of packs that are shuffled for each half, which half, and how many like it
    were dealt to that."""
    nth, place = divmod(number, 2 * len(pack))
    half, place = place % 2, place // 2
    order = np.random.default_rng([seed, nth, half, salt]).permutation(len(pack))
    entry = pack[order[place]]
    return entry, half, nth * pack.count(entry) + sum(pack[k] == entry for k in order[:place])


def in_turn(some: Sequence[T], turn: int, seed: int, half: int, salts: tuple[int, int]) -> T:
    """Round and round, in another order each time."""
    lap, at = divmod(turn, len(some))
    return some[np.random.default_rng([seed, lap, half, *salts]).permutation(len(some))[at]]


Kinds = tuple[tuple[str, ...], tuple[str, ...]]


def _singles(data: str) -> list[Kinds]:
    return [
        ((kind,), (name,))
        for name, k in IDS.items()
        for kind in k.seen
        if (kind == "run") == (data == "run") and kind != "weigh"
    ]


def _lookalikes(data: str) -> list[Kinds]:
    return [
        ((group.kind,), (name,))
        for group in LOOKALIKES
        if (group.kind == "run") == (data == "run")
        for name in group.ids
    ]


def _outside(data: str) -> list[Kinds]:
    if data == "run":
        return [(("run",), (name,)) for name in OUTSIDE]
    return [((kind,), (name,)) for name, (kind, *_) in OUTSIDE_TABLES.items()]
