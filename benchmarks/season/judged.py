"""What a season reported against its table of truth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from topdress.control.diagnosis.season.effect_timelines import SeasonCause, is_wearing
from truth import DAYS, MACHINES, OTHER_FLOW, OTHER_PRODUCT, PLANTED, PRODUCTS, Planted

# machines with an effect reported that was not planted, of all
MOST_STRANGE = 1
DATE_OFF_D = 3.0
SLOPE_OFF = 0.25  # share of a planted slope
MEAN_OFF = 0.2  # share of a planted size, and two half widths
# the generator's form is another: of one size at 100 r/min only
OTHER_FORM = ("flow.fill_falloff",)


def judge(courses: Sequence[SeasonCause], shared: Sequence[SeasonCause]) -> dict[str, bool]:
    """Every line of the table of truth with what was reported for it: whether it holds."""
    promises: dict[str, bool] = {}
    matched: set[tuple[str, str]] = set()
    for planted in PLANTED:
        course = _course(courses, planted)
        if course is None:
            promises[
                f"{planted.machine} {planted.name} {planted.begin:g} to {planted.end:g}: nothing"
            ] = False
            continue
        matched.add((course.level, course.effect))
        promises[
            f"{planted.machine} {planted.name} {planted.begin:g} to {planted.end:g} on days "
            f"{planted.first} to "
            f"{planted.last}: reported {_words(course)}"
        ] = _held(planted, course)
    products = [one for one in shared if one.factor == "product" and one.effect == "flow.gain"]
    size = sum(one.size if one.level == OTHER_PRODUCT else -one.size for one in products)
    half = max((one.half for one in products), default=0.0)
    promises[
        f"product {OTHER_PRODUCT} against {PRODUCTS[0]}: flow {OTHER_FLOW:+g} % planted, "
        f"reported {size:+.2f} +- "
        f"{half:.2f} %"
    ] = bool(products) and abs(size - OTHER_FLOW) < 2.0 * half
    others = [
        (one.factor, one.level, one.effect, round(one.size, 3))
        for one in shared
        if one not in products
    ]
    promises[f"nothing else is shared: reported {others}"] = not others
    strange = [one for one in courses if (one.level, one.effect) not in matched and _matters(one)]
    for one in strange:
        words = f"{one.level} {one.effect} {_words(one)}; alike {one.other_effects}"
        print(f"            strange: {words}")
    machines = {one.level for one in strange}
    promises[
        f"effects reported that were not planted: {len(strange)} on {len(machines)} of "
        f"{MACHINES} machines"
    ] = len(machines) <= MOST_STRANGE
    return promises


def _course(courses: Sequence[SeasonCause], planted: Planted) -> SeasonCause | None:
    """That of a planted effect, by its name or one that these logs cannot tell from it."""
    mine = [one for one in courses if one.level == planted.machine]
    named = [one for one in mine if one.effect == planted.name]
    return next(iter((*named, *(one for one in mine if planted.name in one.other_effects))), None)


def _matters(one: SeasonCause) -> bool:
    """Whether more is reported than what the machine's tolerances, and a product's level, leave
    open."""
    return any(
        abs(size) > 2.0 * half
        for piece in one.pieces
        for size, half in ((piece.begin, piece.begin_half), (piece.end, piece.end_half))
    )


def _held(planted: Planted, course: SeasonCause) -> bool:
    if planted.wears and not planted.repaired:
        last = course.pieces[-1]
        span = last.end_d - last.begin_d
        slope = (
            last.per_day if span > 0.6 * DAYS else (last.end - course.pieces[0].begin) / (DAYS - 1)
        )
        right = planted.effect in OTHER_FORM or abs(slope - planted.per_day) < SLOPE_OFF * abs(
            planted.per_day
        )
        return is_wearing(course) and right
    if planted.repaired:
        return any(abs(one - (planted.last + 0.5)) < DATE_OFF_D for one in _repaired_d(course))
    if planted.first > 0:
        return any(
            abs(one - (planted.first - 0.5)) < DATE_OFF_D for one in _breaks_d(course)
        ) and _size_held(planted.end, course.pieces[-1].end, course.pieces[-1].end_half)
    return _size_held(planted.end, course.size, course.half)


def _breaks_d(course: SeasonCause) -> list[float]:
    return [0.5 * (a.end_d + b.begin_d) for a, b in itertools.pairwise(course.pieces)]


def _repaired_d(course: SeasonCause) -> list[float]:
    return [change.time_d for change in course.changes if change.repair > 0.5]


def _size_held(truth: float, size: float, half: float) -> bool:
    return abs(size - truth) < 2.0 * half + MEAN_OFF * abs(truth)


def _words(course: SeasonCause) -> str:
    pieces = "; ".join(
        f"{piece.begin:+.2f} to {piece.end:+.2f} (+-{piece.end_half:.2f}) on days "
        f"{piece.begin_d:.0f} "
        f"to {piece.end_d:.0f}"
        for piece in course.pieces
    )
    repairs = "".join(f", repaired at {one:.1f}" for one in _repaired_d(course))
    return f"{course.effect} {pieces}{', wears' if is_wearing(course) else ''}{repairs}"
