"""A seeded selection of the examination, for `make exam`: the diagnosis against hidden effects.

The whole examination is `python -m benchmarks diagnosis/run`. Only the tuning half is used here.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytestmark = pytest.mark.exam

REPO = Path(__file__).resolve().parents[2]
TABLES_SEED, SEED = 2024, 60231
STRONG_Z = 8.0
# of the runs here, so that all of them fit into the suite
MINUTES = (9.0, 13.0)
TABLES = ("lag", "catch", "heads", "place", "weigh")
# Runs: numbers of cases of SEED, for each the first with z >= 12. No answer to a case of this
# seed had been seen when they were picked, and none was dropped because of its answer. The
# bounds below are what was measured when they were written: where one says less than all, the
# diagnosis falls short there, and whoever mends it raises the bound.
EFFECTS = {
    "shaft": {
        "shaft.gain": 5,
        "shaft.slow": 41,
        "shaft.dead_time": 82,
        "shaft.dead_band": 120,
        "shaft.voltage_sag": 160,
        "shaft.load_droop": 200,
        "shaft.coarse_encoder": 240,
        "shaft.stall": 280,
    },
    "gate": {
        "gate.offset": 322,
        "gate.home_error": 361,
        "gate.backlash": 403,
        "gate.lost_steps": 440,
        "gate.slow": 483,
        "gate.stuck": 520,
    },
    "flow": {
        "flow.gain": 561,
        "flow.zero_offset": 601,
        "flow.fill_falloff": 641,
        "flow.hopper_head": 684,
        "flow.moisture_drift": 720,
        "flow.batch": 760,
        "flow.blocked_outlet": 800,
        "flow.bridging": 840,
        "flow.leak": 882,
        "flow.slope": 925,
    },
    "rest": {
        "speed.wheel_slip": 960,
        "speed.wheel_radius": 1001,
        "speed.missed_pulses": 1041,
        "speed.gnss_latency": 1082,
        "canopy.head_fouled": 1123,
        "scale.gain": 1161,
        "scale.drift": 1200,
        "scale.tilt": 1240,
    },
}
# Honestly named at least. Measured: 8 of 8, 6 of 6, 3 of 10, 5 of 8; of those that are all
# right one may be lost.
RIGHT = {"shaft": 7, "gate": 5, "flow": 3, "rest": 5}
HEALTHY = {
    "none": (2240, 2241),
    "healthy_coarse": (1600, 1601, 1602, 1603),
    "healthy_sparse": (1640,),
    "healthy_loud": (1680,),
    "healthy_foreign": (1720, 1721, 1722),
    "healthy_columns": (1760,),
    "healthy_loop": (1800,),
    "healthy_fast": (2400,),
}
# of 14 at most. Measured: two coarse logs, one with rows missing, one foreign
ALARMS = 4
NAMED = {
    "onset": (1840, 1841, 1842),
    "growth": (1880, 1881, 1882),
    "temporary": (1921, 1924),
    "coarse": (1962, 1965, 1968),
    "sparse": (2002,),
    "foreign": (2041, 2042, 2043),
    "loud": (2080,),
    "triple": (2123,),
    "loop": (2161,),
    "pair": (2287,),
    "lookalike": (2321,),
}
# Honestly named at least (of look-alikes: the true one is in the set), and with the truth named
# or among the rivals. Measured: just these. Of `triple` nothing is right; there, as in every
# class, nothing wrong may be sure.
NAMED_RIGHT = {
    "growth": 1,
    "coarse": 2,
    "sparse": 1,
    "foreign": 2,
    "loud": 1,
    "loop": 1,
    "pair": 1,
    "lookalike": 1,
}
# On ground as rough as it is now, no onset is sure, and each truth is among the names.
SAID_RIGHT = {"onset": 3, "temporary": 1}
NOTHING_RIGHT = {"triple"}
# measured: a slip that grows is called a wheel that grows
SURE_WRONG = {"growth": 1}
# of the same cases, the begin told within ONSET_S
BEGIN_RIGHT = {"onset": 2, "temporary": 1}
ONSET_S = 60.0
TERMS = {
    "variable": 1280,
    "product": 1320,
    "memory": 1360,
    "periodic": 1400,
    "dead_zone": 1441,
    "saturation": 1480,
    "side": 1520,
    "span": 1561,
}
TERM_STAGES, TERM_VARIABLES = 5, 4  # of 8 at least. Measured: just these
# of 8 a catalogued name with p >= 0.9, at most. Measured: dead zone, saturation
TERM_NAMES = 2
COLUMN_RIGHT = 2  # of 3. Measured: all; one may be lost
COLUMN, OUTSIDE = (2200, 2201, 2202), (2360,)


@pytest.fixture(scope="module")
def exam() -> Any:
    """exam.run(number, category, ids) and exam.table(number, category, kinds, ids) -> a mark,
    by this checkout."""
    paths = [str(Path(__file__).parent), str(REPO / "benchmarks" / "diagnosis")]
    sys.path[:0] = paths
    try:
        ask = importlib.import_module("ask")
        cases, score = (
            importlib.import_module("hidden.cases"),
            importlib.import_module("hidden.score"),
        )
        config = importlib.import_module("topdress.drivers.files.config")
        machine = config.load_config(
            "huanghai", importlib.import_module("topdress.drivers.files.config_kinds").MACHINE_KIND
        ).model

        def marked(case: Any) -> Any:
            return score.mark(
                case.truth, ask.diagnosis(case.kind, case.columns, machine, case.name)
            )

        def run(number: int, category: str, ids: tuple[str, ...] = ()) -> Any:
            return marked(cases.one(number, SEED, "tuning", (category,), ("run",), ids, MINUTES))

        def onset(number: int, seed: int, name: str) -> Any:
            return marked(cases.one(number, seed, "tuning", ("onset",), ("run",), (name,)))

        def table(
            number: int, category: str, kinds: tuple[str, ...] = TABLES, ids: tuple[str, ...] = ()
        ) -> Any:
            return marked(cases.one(number, TABLES_SEED, "tuning", (category,), kinds, ids))

        def first_strong(kind: str, name: str) -> Any:
            number = next(
                k
                for k in range(60)
                if cases.one(k, TABLES_SEED, "tuning", ("single",), (kind,), (name,)).truth[
                    "causes"
                ][0]["z"]
                >= STRONG_Z
            )
            return table(number, "single", (kind,), (name,))

        nominal = importlib.import_module("hidden.nominal")
        classes = importlib.import_module("hidden.classes")
        yield SimpleNamespace(
            run=run,
            onset=onset,
            table=table,
            sure=score.SURE,
            first_strong=first_strong,
            ids=nominal.IDS,
            classes=classes.CLASSES,
            terms=importlib.import_module("hidden.terms").CLASSES,
            on_tables=[
                (i, kind)
                for i, known in nominal.IDS.items()
                for kind in known.seen
                if kind not in ("run", "weigh")
            ],
            outside_on_tables=[(name, kind) for name, (kind, *_) in nominal.OUTSIDE_TABLES.items()],
        )
    finally:
        for path in paths:
            sys.path.remove(path)


def _said(marks: Iterable[Any]) -> str:
    return "; ".join(
        f"{m.truth['case']} "
        f"({'+'.join(c['id'] for c in m.truth['causes']) or m.truth['category']}, "
        f"z {m.z:.0f}): {m.answer} ({m.verdict})"
        for m in marks
    )


def test_every_effect_that_a_run_can_show_and_every_class_is_asked(exam: Any) -> None:
    asked = {name for group in EFFECTS.values() for name in group}
    assert asked == {i for i, known in exam.ids.items() if "run" in known.seen}
    assert set(TERMS) == {c for c in exam.terms if c != "column"}
    assert {*HEALTHY, *NAMED, "column", "term"} >= set(exam.classes)
    assert {*NAMED_RIGHT, *SAID_RIGHT} == set(NAMED) - NOTHING_RIGHT, (
        "every class has a floor that can be missed"
    )


def test_what_no_refit_bears_out_hides_nothing(exam: Any) -> None:
    """A scan had one late move of the gate ahead of a home error that began late; refitted it
    was nothing, and no name was left."""
    assert exam.onset(1, 90412, "gate.home_error").exact


@pytest.mark.parametrize("group", EFFECTS)
def test_effects_are_named(exam: Any, group: str) -> None:
    marks = [exam.run(number, "single", (name,)) for name, number in EFFECTS[group].items()]
    assert all(m.z >= STRONG_Z for m in marks), "the generator changed: pick the numbers anew"
    wrong = [m for m in marks if not m.honest]
    assert len(marks) - len(wrong) >= RIGHT[group], _said(wrong)


def test_silent_where_nothing_is_hidden(exam: Any) -> None:
    marks = [
        exam.run(number, category) for category, numbers in HEALTHY.items() for number in numbers
    ]
    alarms = [m for m in marks if m.false_alarm]
    assert len(alarms) <= ALARMS, _said(alarms)


@pytest.mark.parametrize("category", NAMED)
def test_classes_are_named(exam: Any, category: str) -> None:
    marks = [exam.run(number, category) for number in NAMED[category]]
    right = [m for m in marks if (m.in_set if category == "lookalike" else m.honest)]
    said = [m for m in marks if m.said_truth]
    begins = [m for m in marks if m.onset_error_s is not None and m.onset_error_s <= ONSET_S]
    found = {"right": len(right), "said": len(said), "begins": len(begins)}
    least = {"right": NAMED_RIGHT, "said": SAID_RIGHT, "begins": BEGIN_RIGHT}
    assert all(found[what] >= floors.get(category, 0) for what, floors in least.items()), (
        found,
        _said(marks),
    )
    sure = [m for m in marks if any(p >= exam.sure and not there for p, there in m.said)]
    assert len(sure) <= SURE_WRONG.get(category, 0), _said(sure)


def test_terms_are_placed_and_not_named(exam: Any) -> None:
    marks = [exam.run(number, "term", (kind,)) for kind, number in TERMS.items()]
    assert sum(bool(m.right_stage) for m in marks) >= TERM_STAGES, _said(marks)
    assert sum(bool(m.right_variable) for m in marks) >= TERM_VARIABLES, _said(marks)
    assert sum(bool(m.falsely_named) for m in marks) <= TERM_NAMES, _said(marks)


def test_further_columns_are_blamed_where_they_are_to_blame(exam: Any) -> None:
    marks = [exam.run(number, "column") for number in COLUMN]
    assert sum(bool(m.right_variable) for m in marks) >= COLUMN_RIGHT, _said(marks)
    assert not any(m.falsely_named for m in marks), _said(marks)


def test_what_no_catalogue_holds_is_not_named(exam: Any) -> None:
    marks = [exam.run(number, "outside") for number in OUTSIDE]
    assert not any(m.falsely_named for m in marks) and all(m.right_variable for m in marks), _said(
        marks
    )


def test_tables_are_silent_where_nothing_is_hidden(exam: Any) -> None:
    marks = [exam.table(k, "none") for k in range(24)]
    assert sum(m.false_alarm for m in marks) <= 1, _said(marks)


def test_every_effect_of_a_table_is_named(exam: Any) -> None:
    """The first case of each id and kind of table with z >= 8."""
    marks = [exam.first_strong(kind, name) for name, kind in exam.on_tables]
    assert len(marks) > 12
    assert sum(m.honest for m in marks) >= len(marks) - 1, _said([m for m in marks if not m.honest])


def test_what_no_catalogue_holds_is_not_named_on_tables(exam: Any) -> None:
    marks = [exam.table(0, "outside", (kind,), (name,)) for name, kind in exam.outside_on_tables]
    assert sum(bool(m.right_variable) for m in marks) >= len(marks) - 1, _said(marks)
    assert sum(bool(m.falsely_named) for m in marks) <= 1, _said(marks)
