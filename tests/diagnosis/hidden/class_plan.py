"""The second timetable: what case number k hides among all classes (see classes.py), a fair mixture of any length.

Cases are dealt from packs, one pack for each half of the programmes in turn, as in plan.py; ids (and classes of terms)
round and round in shuffled order. A third of the cases has nothing hidden.
"""
from __future__ import annotations

from functools import cache

import numpy as np

from .cases import TABLE_KINDS
from .classes import CLASSES
from .nominal import IDS, OUTSIDE
from .plan import Wanted
from .terms import CLASSES as TERMS

PACK_OF = {"none": 9, "healthy_fast": 1, "healthy_coarse": 4, "healthy_sparse": 2, "healthy_loud": 3,
           "healthy_foreign": 2, "healthy_columns": 1, "healthy_loop": 1,
           "single": 3, "pair": 2, "lookalike": 2, "outside": 1, "table": 3,
           "onset": 4, "growth": 4, "temporary": 2, "coarse": 3, "sparse": 1, "foreign": 2, "loud": 1, "triple": 2,
           "loop": 1, "column": 4, "term": 6}
PACK = tuple(c for c, n in PACK_OF.items() for _ in range(n))


def wanted(number: int, seed: int) -> Wanted:
    """What case `number` of the examination `seed` is to hide, and in what log."""
    pack, place = divmod(number, 2 * len(PACK))
    half, place = place % 2, place // 2
    order = np.random.default_rng([seed, pack, half, 17]).permutation(len(PACK))
    category = PACK[order[place]]
    if category == "table":
        return Wanted("single", TABLE_KINDS, ())
    ids = _ids(category)
    if not ids:
        return Wanted(category, ("run",), ())
    turn = pack * PACK_OF[category] + sum(PACK[k] == category for k in order[:place])
    lap, at = divmod(turn, len(ids))
    salt = sorted(PACK_OF).index(category)
    shuffled = np.random.default_rng([seed, lap, half, salt, 18]).permutation(len(ids))
    return Wanted(category, ("run",), (ids[shuffled[at]],))


@cache
def _ids(category: str) -> tuple[str, ...]:
    if category in CLASSES:
        return TERMS[:-1] if category == "term" else CLASSES[category] or ()
    if category == "single":
        return tuple(i for i, k in IDS.items() if "run" in k.seen)
    return tuple(OUTSIDE) if category == "outside" else ()
