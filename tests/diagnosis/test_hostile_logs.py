"""Logs that no logger should write: a diagnosis says what it cannot judge, and judges the rest."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from topdress.control.diagnosis.runs import diagnose
from topdress.control.diagnosis.runs.diagnose import diagnose_run, has_finite_numbers
from topdress.control.diagnosis.runs.log import (
    MAX_FURTHER_COLUMNS,
    MAX_NAME_LETTERS,
    clean_run_log,
    select_variables,
)
from topdress.control.diagnosis.runs.terms import _make_term_id
from topdress.control.machine.machine import Machine
from topdress.control.machine.terms import Term
from topdress.drivers.files.any_log import open_any_log

from tests.diagnosis.hostile.logs import hostile_log

# numbers of seed 1, seconds in all
QUICK = (2, 3, 4, 5, 6, 8, 16, 27, 33, 35, 41, 42, 45, 48, 50, 51, 54)
ROWS = 2400
RNG = np.random.default_rng(7)


# ten seconds
@pytest.mark.parametrize("number", [*QUICK, pytest.param(14, marks=pytest.mark.exam)])
def test_a_hostile_log_ends_in_a_result(number: int, tmp_path: Path) -> None:
    one = hostile_log(number)
    path = tmp_path / "log.csv"
    path.write_text(one.text, encoding="utf-8", newline="\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = diagnose_run(dict(open_any_log(path).columns), Machine())
    json.dumps(found.to_json(), allow_nan=False)
    assert not [text for text in found.findings if "please report" in text], (
        one.name,
        found.findings,
    )


def speeds(**more: np.ndarray) -> dict[str, np.ndarray]:
    """Four minutes of a wheel that reads 3 % more than the ground speed, and a shaft that does
    as it is told."""
    rng, time_s = np.random.default_rng(3), 0.1 * np.arange(ROWS)
    speed = 1.3 + 0.2 * np.sin(time_s / 7.0)
    command = np.repeat(rng.uniform(30.0, 90.0, ROWS // 50), 50)
    turned = np.concatenate((np.full(4, command[0]), command[:-4]))
    return {
        "time_s": time_s,
        "speed_mps": speed + rng.normal(0.0, 0.03, ROWS),
        "shaft_rpm_cmd": command,
        "wheel_speed_mps": 1.03 * speed + rng.normal(0.0, 0.02, ROWS),
        "shaft_rpm": turned + rng.normal(0.0, 0.3, ROWS),
    } | more


@pytest.mark.parametrize(
    ("value", "said"),
    [(np.inf, "infinite"), (-np.inf, "infinite"), (1e300, "beyond 1e+09"), (-1e12, "beyond 1e+09")],
)
def test_cells_that_no_machine_reads_are_left_out_and_said(value: float, said: str) -> None:
    columns = speeds()
    columns["speed_mps"][5:9] = value
    log = clean_run_log(columns)
    assert (
        np.isnan(log.columns["speed_mps"][5:9]).all()
        and np.isfinite(log.columns["speed_mps"][9:]).all()
    )
    assert f"column speed_mps: 4 cells {said}" in " ".join(log.findings)


def test_our_own_trouble_with_one_group_leaves_the_others_judged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before, the whole diagnosis ended in `Array must not contain infs or NaNs`."""
    judged = diagnose.judge_group

    def fails(search: Any) -> Any:
        if "shaft" in search.model.names:
            raise np.linalg.LinAlgError("Array must not contain infs or NaNs.")
        return judged(search)

    monkeypatch.setattr(diagnose, "judge_group", fails)
    found = diagnose_run(speeds(), Machine())
    assert {cause.id for cause in found.causes} <= {
        "speed.wheel_radius",
        "speed.wheel_slip",
    } and found.causes
    assert {row.channel for row in found.channels} == {"speed"}
    assert any(
        text.startswith(
            "shaft: left out: the program's own arithmetic fails on this log (LinAlgError at"
        )
        for text in found.findings
    )


@pytest.mark.exam
def test_numbers_that_are_none_are_left_out_of_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    report = diagnose.make_report

    def broken(data: Any, machine: Any, groups: Any, *rest: Any) -> Any:
        from dataclasses import replace

        found = report(data, machine, groups, *rest)
        return replace(
            found,
            channels=tuple(
                replace(row, rmse=float("nan")) if row.channel == "shaft" else row
                for row in found.channels
            ),
        )

    monkeypatch.setattr(diagnose, "make_report", broken)
    found = diagnose_run(speeds(), Machine())
    assert has_finite_numbers(found) and {row.channel for row in found.channels} == {"speed"}
    assert any(
        text.startswith("shaft: left out: the numbers of this log lead beyond")
        for text in found.findings
    )


def test_a_speed_that_is_the_same_in_every_row_and_a_scale_that_never_moves_are_not_read() -> None:
    found = diagnose_run(
        speeds(
            speed_mps=np.full(ROWS, 1.3),
            opening_mm=RNG.normal(25.0, 0.1, ROWS),
            hopper_kg=np.full(ROWS, 120.0),
        ),
        Machine(),
    )
    assert [row.channel for row in found.channels] == ["shaft"]
    said = " ".join(found.findings)
    assert "stage speed is left out: hardly a new reading" in said
    assert "column hopper_kg: 120 in every row" in said and "arithmetic" not in said


@pytest.mark.parametrize(
    "name", ["TractorFrontAxleHydraulicPressureSensorAfterSecondaryFilter" * 2, "压力"]
)
@pytest.mark.exam
def test_a_term_over_a_column_of_any_name(name: str) -> None:
    """Names of 90 letters ended in `1 validation error for Term`."""
    load = np.sin(np.arange(ROWS) / 40.0)
    columns = {key: values for key, values in speeds().items() if "speed" not in key} | {
        name: 40.0 + 10.0 * load
    }
    columns["shaft_rpm"] = columns["shaft_rpm"] * (1.0 + 0.05 * load)
    found = diagnose_run({key: values[: ROWS // 2] for key, values in columns.items()}, Machine())
    terms = [Term.model_validate(one.term) for one in found.terms]
    assert terms[0].over[0].name == name, found.findings
    assert len(terms[0].id) <= 80 and len(_make_term_id("flow.slope_" + "x" * 300)) <= 80


def test_what_is_no_further_column_is_left_out_and_said() -> None:
    some = RNG.normal(0.0, 1.0, ROWS)
    known = {"shaft_rpm": np.cumsum(some), "time_s": np.arange(float(ROWS))}
    kept = select_variables(
        {
            "n": np.arange(float(ROWS)),
            "rpm2": 9.55 * known["shaft_rpm"] + 3.0,
            "load": some,
            "load again": -2.0 * some,
            "": some + 1.0,
            "x" * (MAX_NAME_LETTERS + 1): some,
            "tiny": 1e-6 * some,
        },
        known,
    )
    assert list(kept.columns) == ["load"]
    said = " ".join(kept.said)
    assert "n, rpm2, load again left out: the same readings" in said
    assert "without a name" in said and "tiny left out: changing by less" in said


@pytest.mark.exam
def test_of_too_many_columns_those_that_go_with_a_reading_are_kept() -> None:
    """Two thousand columns: the pump's log took ten minutes and 24 GB before it was ended."""
    columns = speeds()
    load = np.sin(np.arange(ROWS) / 40.0)
    columns["wheel_speed_mps"] = columns["wheel_speed_mps"] * (1.0 + 0.06 * load)
    columns |= {f"signal {k}": RNG.normal(0.0, 1.0, ROWS).cumsum() for k in range(1990)}
    columns["signal 777"] = 40.0 + 10.0 * load + RNG.normal(0.0, 0.3, ROWS)
    log = clean_run_log(columns)
    assert len(log.further) == MAX_FURTHER_COLUMNS and "signal 777" in log.further
    assert any(
        f"the {MAX_FURTHER_COLUMNS} that go best with the readings are kept" in text
        for text in log.findings
    )


def test_rows_too_far_apart_are_asked_about() -> None:
    columns = speeds()
    columns["time_s"] = columns["time_s"] * 1e5
    with pytest.raises(
        ValueError, match=r"time_s: 2400 rows are 10,000 s apart, 23,990,000 s in all: allowed up"
    ):
        diagnose_run(columns, Machine())
