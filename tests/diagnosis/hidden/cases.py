"""The examination: cases with something hidden in them, or nothing, and the truth about each
for the scorer alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .classes import CLASSES, class_case
from .nominal import IDS, OUTSIDE, OUTSIDE_TABLES
from .programmes import SPLITS, Programme, chosen
from .run_cases import run_case
from .table_cases import table_case
from .terms import CLASSES as TERMS
from .truth import Columns, Made, Redriven, Share

TABLE_KINDS = ("lag", "catch", "heads", "place", "weigh")
CATEGORIES = ("none", "single", "pair", "lookalike", "outside")
SHARES = (0.32, 0.36, 0.12, 0.09, 0.11)


class Pair(NamedTuple):
    """Effects that some data cannot tell apart, and on what data."""

    ids: tuple[str, ...]
    kind: str
    suits: Callable[[Programme], bool] = lambda _: True


LOOKALIKES = (
    Pair(("flow.hopper_head", "flow.moisture_drift", "scale.drift"), "run", lambda p: not p.refill),
    Pair(("flow.gain", "scale.gain"), "run", lambda p: not p.refill),
    Pair(
        ("speed.wheel_slip", "speed.wheel_radius"),
        "run",
        lambda p: not p.headlands and p.ground == "flat",
    ),
    Pair(("speed.missed_pulses", "speed.wheel_radius"), "run"),
    Pair(("flow.batch", "flow.blocked_outlet"), "run", lambda p: p.refill),
    Pair(
        ("flow.gain", "flow.zero_offset", "speed.wheel_slip", "speed.wheel_radius", "scale.gain"),
        "weigh",
    ),
    Pair(("place.lever_arm", "place.latency"), "place"),
    Pair(("lag.offset", "shaft.dead_time"), "lag"),
)


class Case(NamedTuple):
    """`columns`: what the diagnosis gets. `truth`: what only the scorer may know (plain words
    and numbers).

    `gain_share`: given an answer's causes, the share of the error removable by the truth that
    they remove (1 = all).
    """

    name: str
    kind: str  # run, lag, catch, weigh, heads, place
    columns: Columns
    truth: dict[str, Any]
    gain_share: Share
    # of most runs: the same machine on a changed drive
    redriven: Redriven | None = None


def cases(
    count: int,
    seed: int = 1,
    programmes: str = "all",
    start: int = 0,
    categories: Sequence[str] = CATEGORIES,
    kinds: Sequence[str] | None = None,
    ids: Sequence[str] | None = None,
) -> Iterator[Case]:
    """Yields `count` cases from number `start` on. Case k is the same whatever is asked for
    beside it.

    programmes: tuning, unseen or all. categories, kinds (run, lag, ...), ids: only such cases
    are made. Raises ValueError on an unknown word.
    """
    chosen(programmes)
    for given, known in (
        (categories, (*CATEGORIES, *CLASSES)),
        (ids or (), (*IDS, *OUTSIDE, *OUTSIDE_TABLES, *TERMS)),
    ):
        for word in given:
            if word not in known:
                raise ValueError(f"{word!r} is not one of {', '.join(known)}")
    for k in range(start, start + count):
        yield one(k, seed, programmes, tuple(categories), tuple(kinds or ()), tuple(ids or ()))


def one(
    number: int,
    seed: int,
    programmes: str = "all",
    categories: tuple[str, ...] = CATEGORIES,
    kinds: tuple[str, ...] = (),
    ids: tuple[str, ...] = (),
    minutes: tuple[float, float] | None = None,
) -> Case:
    """Case `number`; tries again with other draws until one fits what is asked for.

    minutes: runs last between these, instead of as long as their programmes say.
    """
    shares = np.array([SHARES[CATEGORIES.index(c)] if c in CATEGORIES else 0.1 for c in categories])
    category = str(
        np.random.default_rng([seed, number, 0]).choice(list(categories), p=shares / shares.sum())
    )
    split = programmes if programmes != "all" else SPLITS[number % 2]
    for attempt in range(400):
        draws = [seed, number, attempt, 1]
        if category in CLASSES:
            rng = np.random.default_rng([*draws, list(CLASSES).index(category)])
            made = class_case(category, ids, split, rng, minutes)
        else:
            made = _make(category, split, np.random.default_rng(draws), kinds, ids, minutes)
        if made is not None:
            kind, columns, truth, share, redriven = made
            name = f"case-{seed}-{number:05d}"
            return Case(
                name,
                kind,
                columns,
                {
                    "case": name,
                    "number": number,
                    "seed": seed,
                    "category": category,
                    "split": split,
                    "data_kind": kind,
                    **truth,
                },
                share,
                redriven,
            )
    raise ValueError(
        f"case {number}: nothing fits categories {categories}, kinds {kinds}, ids {ids}"
    )


def _make(
    category: str,
    split: str,
    rng: np.random.Generator,
    kinds: tuple[str, ...],
    ids: tuple[str, ...],
    minutes: tuple[float, float] | None,
) -> Made | None:
    """One draw; None where it is not what was asked for, or does not work out."""
    on_table = {"none": 0.25, "pair": 0.2, "outside": 0.0}.get(category, 0.3)
    if category == "outside" and kinds and "run" not in kinds:
        on_table = 1.0
    kind = "table" if rng.random() < on_table else "run"
    wanted: tuple[str, ...] = ()
    suits: Callable[[Programme], bool] = _any_programme
    if category == "lookalike":
        group = LOOKALIKES[int(rng.integers(len(LOOKALIKES)))]
        wanted, kind, suits = (str(rng.choice(group.ids)),), group.kind, group.suits
    elif category in ("single", "pair"):
        pool = [i for i in IDS if _seen(i, kind)]
        first = [i for i in pool if not ids or i in ids]
        if not first:
            return None
        wanted = (str(rng.choice(first)),)
        if category == "pair":
            wanted = (*wanted, str(rng.choice([i for i in pool if i not in wanted])))
        if kind == "table":
            kind = str(rng.choice([s for s in IDS[wanted[0]].seen if s != "run"]))
    elif kind == "table":
        kind = str(rng.choice(TABLE_KINDS))
    if (kinds and kind not in kinds) or (ids and wanted and not set(ids) & set(wanted)):
        return None
    if kind == "run":
        return run_case(category, wanted, split, rng, suits, ids, minutes)
    return table_case(category, wanted, kind, split, rng, ids)


def _seen(name: str, kind: str) -> bool:
    return any((s == "run") == (kind == "run") for s in IDS[name].seen)


def _any_programme(_: Programme) -> bool:
    return True
