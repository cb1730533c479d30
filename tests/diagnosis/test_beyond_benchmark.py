"""The benchmark beyond the catalogue is examined: other runs of a hidden machine, what a file
is worth there, forms."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from topdress.control.machine.machine import Machine
from topdress.control.machine.term_forms import Form

HERE = Path(__file__).parent
BENCHMARKS = HERE.parents[1] / "benchmarks" / "diagnosis"
MODULES = (
    "hidden.another_run",
    "hidden.cases",
    "hidden.terms",
    "beyond_other_run",
    "beyond_forms",
    "kept",
)


@pytest.fixture(scope="module")
def bench() -> Iterator[Any]:
    """Modules of generator and benchmark by their last name."""
    sys.path[:0] = [str(HERE), str(BENCHMARKS)]
    try:
        yield SimpleNamespace(
            **{name.split(".")[-1]: importlib.import_module(name) for name in MODULES}
        )
    finally:
        for path in (str(HERE), str(BENCHMARKS)):
            sys.path.remove(path)


@pytest.fixture(scope="module")
def case(bench: Any) -> Any:
    """A short run in which what the shaft loses depends on a column."""
    return bench.cases.one(3, 5, "tuning", ("column",), ("run",), ("column",), (5.0, 5.0))


@pytest.fixture(scope="module")
def other(bench: Any, case: Any) -> Any:
    return bench.another_run.another_run(case.redriven, case.truth, 1, True)


@pytest.mark.exam
def test_another_run_is_the_same_machine_on_another_drive(case: Any, other: Any) -> None:
    assert other.truth["programme"] != case.truth["programme"]
    assert other.truth["outside"] == case.truth["outside"]
    assert set(other.columns) == set(case.columns)
    assert len(other.columns["time_s"]) != len(case.columns["time_s"])
    changed = other.changed()
    stage = case.truth["outside"]["channel"]
    reading = {"flow": "scale", "speed": "wheel"}.get(stage, stage)
    assert np.std(changed.hidden[reading]) > 0.0
    assert np.std(changed.hidden["heads"]) == 0.0


@pytest.mark.exam
def test_the_truth_takes_everything_away_and_its_opposite_makes_it_worse(
    bench: Any, case: Any, other: Any
) -> None:
    machine, stage = Machine(), case.truth["outside"]["channel"]
    b = bench.beyond_other_run
    before = b.seen(other.columns, machine)
    truths = b.truths(
        other.columns, other.changed(), stage, before, b.tolerated(other.columns, machine)
    )
    own = next(t for t in truths if t.name == b.READING[stage])
    nothing, all_of_it, opposite = (
        b.worth(truths, {own.name: k * own.hidden}) for k in (0.0, 1.0, -1.0)
    )
    assert (nothing["share"], nothing["adopted"]) == (0.0, nothing["nominal"])
    assert all_of_it["share"] == pytest.approx(1.0)
    assert opposite["share"] == pytest.approx(-3.0, abs=0.2)
    elsewhere = next(t for t in truths if t.name not in (own.name, "scale"))
    assert (
        b.worth(truths, {elsewhere.name: np.sin(np.arange(len(elsewhere.hidden)))})["share"] < 0.0
    )
    half = b.worth(truths, {own.name: 0.5 * own.hidden})
    assert 0.7 < half["share"] < 0.8


def test_a_gain_within_the_tolerances_is_no_error_of_the_term(bench: Any) -> None:
    rows = np.arange(5000.0)
    hidden = 0.02 * np.sin(rows / 30.0)
    truth = bench.beyond_other_run.Truth("gate", 0.1, hidden, np.zeros(5000), np.full(5000, 0.01))
    assert bench.beyond_other_run.worth([truth], {"gate": hidden + 0.01})["share"] > 0.98
    assert bench.beyond_other_run.worth([truth], {"gate": hidden + 0.01})["adopted"] > 0.0


def test_every_hidden_form_has_its_family_among_the_published_forms(bench: Any) -> None:
    for kind in bench.terms.CLASSES:
        for form in range(12):
            assert bench.beyond_forms.family({"kind": kind, "form": form}) <= set(Form)


class Asked(NamedTuple):
    number: int


def test_what_is_done_is_not_done_again_and_a_cut_line_is(bench: Any, tmp_path: Path) -> None:
    seen: list[int] = []

    def examine(task: Asked) -> dict[str, Any]:
        seen.append(task.number)
        return {"number": task.number, "trouble": None}

    path = tmp_path / "kept.jsonl"
    kept, count = bench.kept.worked([Asked(1), Asked(2)], examine, path, 1, 1.0)
    assert (sorted(kept), count) == ([1, 2], 2)
    lines = path.read_text("utf-8").splitlines()
    path.write_text(lines[0] + "\n" + lines[1][:5] + "\n", "utf-8")
    kept, count = bench.kept.worked([Asked(1), Asked(2), Asked(3)], examine, path, 1, 1.0)
    assert (sorted(kept), count, seen) == ([1, 2, 3], 2, [1, 2, 2, 3])
    assert json.loads(path.read_text("utf-8").splitlines()[-1])["number"] == 3
