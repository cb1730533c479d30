"""The second timetable: what case number k hides among all classes (see classes.py), a fair
mixture of any length.

Cases are dealt from packs, one pack for each half of the programmes in turn, as in plan.py; ids
(and classes of terms) round and round in shuffled order. A third of the cases has nothing
hidden.
"""

from __future__ import annotations

from functools import cache

from .cases import TABLE_KINDS
from .classes import CLASSES
from .nominal import IDS, OUTSIDE
from .plan import Wanted, dealt, in_turn
from .terms import CLASSES as TERMS

PACK_OF = {
    "none": 9,
    "healthy_fast": 1,
    "healthy_coarse": 4,
    "healthy_sparse": 2,
    "healthy_loud": 3,
    "healthy_foreign": 2,
    "healthy_columns": 1,
    "healthy_loop": 1,
    "single": 3,
    "pair": 2,
    "lookalike": 2,
    "outside": 1,
    "table": 3,
    "onset": 4,
    "growth": 4,
    "temporary": 2,
    "coarse": 3,
    "sparse": 1,
    "foreign": 2,
    "loud": 1,
    "triple": 2,
    "loop": 1,
    "column": 4,
    "term": 6,
}
PACK = tuple(c for c, n in PACK_OF.items() for _ in range(n))


def wanted(number: int, seed: int) -> Wanted:
    """What case `number` of the examination `seed` is to hide, and in what log."""
    category, half, turn = dealt(PACK, number, seed, 17)
    if category == "table":
        return Wanted("single", TABLE_KINDS, ())
    ids = _ids(category)
    if not ids:
        return Wanted(category, ("run",), ())
    return Wanted(
        category, ("run",), (in_turn(ids, turn, seed, half, (sorted(PACK_OF).index(category), 18)),)
    )


@cache
def _ids(category: str) -> tuple[str, ...]:
    if category in CLASSES:
        return TERMS[:-1] if category == "term" else CLASSES[category] or ()
    if category == "single":
        return tuple(i for i, k in IDS.items() if "run" in k.seen)
    return tuple(OUTSIDE) if category == "outside" else ()
