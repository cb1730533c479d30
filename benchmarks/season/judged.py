"""What a season reported against its table of truth."""
from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from season.truth import (
    DAYS,
    FIRST_DAY,
    MACHINES,
    NEVER_REFILLS,
    OTHER_FLOW,
    OTHER_PRODUCT,
    PLANTED,
    PRODUCTS,
    Planted,
)

from control.diagnosis.season.courses import Course, Shared, wears
from control.diagnosis.season.owner import Low, MachineSeason

MOST_STRANGE = 1            # machines with an effect reported that was not planted, of all
DATE_OFF_D = 3.0
SLOPE_OFF = 0.25            # share of a planted slope
MEAN_OFF = 0.2              # share of a planted size, and two half widths
KG_OFF, KG_OFF_PERCENT = 0.2, 0.3       # share of the kilograms spread wrongly, and % of what was applied
OTHER_FORM = ("flow.fill_falloff",)     # the generator's form is another: of one size at 100 r/min only


class Reported(NamedTuple):
    """names: effects that single logs named, by machine, with in how many logs. first_d: day 0 in `courses`' days."""

    courses: Sequence[Course]
    shared: Sequence[Shared]
    low: Sequence[Low] | None
    first_d: float = dt.datetime.fromisoformat(f"{FIRST_DAY}T08:00:00+00:00").timestamp() / 86_400.0


class Checks:
    """Promises, kept or not."""

    def __init__(self) -> None:
        self.failed: list[str] = []

    def that(self, kept: bool, said: str) -> None:
        print(("  kept      " if kept else "  NOT KEPT  ") + said, flush=True)
        if not kept:
            self.failed.append(said)


def judge(reported: Reported, checks: Checks) -> None:
    """Every line of the table of truth, then what was reported for it."""
    own = [one for one in PLANTED]
    matched: set[tuple[str, str]] = set()
    for planted in own:
        course = _course(reported, planted)
        if course is None:
            checks.that(False, f"{planted.machine} {planted.name} {planted.begin:g} to {planted.end:g}: nothing")
            continue
        matched.add((course.machine, course.effect))
        checks.that(*_held(planted, course, reported.first_d))
    products = [one for one in reported.shared if one.factor == "product" and one.effect == "flow.gain"]
    size = sum(one.size if one.level == OTHER_PRODUCT else -one.size for one in products)
    half = max((one.half for one in products), default=0.0)
    checks.that(bool(products) and abs(size - OTHER_FLOW) < 2.0 * half,
                f"product {OTHER_PRODUCT} against {PRODUCTS[0]}: flow {OTHER_FLOW:+g} % planted, reported {size:+.2f} "
                f"+- {half:.2f} %")
    others = [one for one in reported.shared if one not in products]
    words = [(one.factor, one.level, one.effect, round(one.size, 3)) for one in others]
    checks.that(not others, f"nothing else is shared: reported {words}")
    if reported.low is not None:
        checks.that([one.operator for one in reported.low] == [NEVER_REFILLS],
                    f"{NEVER_REFILLS} lets the hopper run low: reported {[one.operator for one in reported.low]}")
    strange = [one for one in reported.courses if (one.machine, one.effect) not in matched and _matters(one)]
    for one in strange:
        print(f"            strange: {one.machine} {one.effect} {_words(one, reported.first_d)}; alike {one.alike}")
    checks.that(len({one.machine for one in strange}) <= MOST_STRANGE,
                f"effects reported that were not planted: {len(strange)} on {len({one.machine for one in strange})} of "
                f"{MACHINES} machines")


def _course(reported: Reported, planted: Planted) -> Course | None:
    """That of a planted effect, by its name or one that these logs cannot tell from it."""
    mine = [one for one in reported.courses if one.machine == planted.machine]
    named = [one for one in mine if one.effect == planted.name]
    return next(iter((*named, *(one for one in mine if planted.name in one.alike))), None)


def _matters(one: Course) -> bool:
    """Whether more is reported than what the machine's tolerances, and a product's level, leave open."""
    return any(abs(size) > 2.0 * half for piece in one.pieces
               for size, half in ((piece.begin, piece.begin_half), (piece.end, piece.end_half)))


def _held(planted: Planted, course: Course, first_d: float) -> tuple[bool, str]:
    said = (f"{planted.machine} {planted.name} {planted.begin:g} to {planted.end:g} on days {planted.first} to "
            f"{planted.last}: reported {_words(course, first_d)}")
    if planted.wears and not planted.repaired:
        last = course.pieces[-1]
        span = last.end_d - last.begin_d
        slope = last.per_day if span > 0.6 * DAYS else (last.end - course.pieces[0].begin) / (DAYS - 1)
        right = planted.effect in OTHER_FORM or abs(slope - planted.per_day) < SLOPE_OFF * abs(planted.per_day)
        return wears(course) and right, said
    if planted.repaired:
        dates = [one - first_d for one in _repaired_d(course)]
        return any(abs(one - (planted.last + 0.5)) < DATE_OFF_D for one in dates), said
    if planted.first > 0:
        dates = [one - first_d for one in course.breaks_d]
        return any(abs(one - (planted.first - 0.5)) < DATE_OFF_D for one in dates) and _size_held(
            planted.end, course.pieces[-1].end, course.pieces[-1].end_half), said
    return _size_held(planted.end, course.mean, course.mean_half), said


def _repaired_d(course: Course) -> list[float]:
    return [change.time_d for change in course.changes if change.repair > 0.5]


def _size_held(truth: float, size: float, half: float) -> bool:
    return abs(size - truth) < 2.0 * half + MEAN_OFF * abs(truth)


def _words(course: Course, first_d: float) -> str:
    pieces = "; ".join(f"{piece.begin:+.2f} to {piece.end:+.2f} (+-{piece.end_half:.2f}) on days "
                       f"{piece.begin_d - first_d:.0f} to {piece.end_d - first_d:.0f}" for piece in course.pieces)
    repairs = "".join(f", repaired at {one - first_d:.1f}" for one in _repaired_d(course))
    return f"{course.effect} {pieces}{', wears' if wears(course) else ''}{repairs}"


def kilograms(machines: Sequence[MachineSeason], truth: Mapping[str, float], checks: Checks) -> None:
    """truth: kilograms spread wrongly by machine, from the generator's own flow."""
    off = {}
    for one in machines:
        if one.machine in truth and abs(one.wrong_kg - truth[one.machine]) > (
                KG_OFF * truth[one.machine] + KG_OFF_PERCENT / 100.0 * one.applied_kg):
            off[one.machine] = (round(one.wrong_kg, 1), round(truth[one.machine], 1))
        if one.machine in truth:
            print(f"            {one.machine}: {one.wrong_kg:.1f} kg spread wrongly of {one.applied_kg:.0f}, by the "
                  f"truth {truth[one.machine]:.1f}")
    checks.that(not off, f"kilograms spread wrongly by {len(truth)} machines on which only the flow is off; off: {off}")
