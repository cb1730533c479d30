"""What a diagnosis keeps of a log of a million rows: its columns once, and none that it does
not read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from topdress.console.cli import diagnose
from topdress.control.diagnosis.dataframe_input import read_columns
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.log import UNREAD_COLUMNS, clean_run_log
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS
from topdress.control.machine.machine import Machine
from topdress.drivers.files.read_log import read_log

from tests.diagnosis.logs import speeds

ROWS = 2400


@pytest.fixture(scope="module")
def printed() -> dict[str, np.ndarray]:
    """Numbers as a log prints them; the wheel reads 2 % more than the ground speed."""
    time_s = np.round(0.1 * np.arange(ROWS), 3)
    return {
        name: np.round(column, 4)
        for name, column in speeds(1, time_s, 1.3 + 0.2 * np.sin(time_s / 7.0), 1.02).items()
    }


def test_readings_as_a_log_prints_them_are_not_copied(printed) -> None:
    given = read_columns(printed)
    clean = clean_run_log(given)
    assert all(np.shares_memory(given[name], printed[name]) for name in printed)
    assert all(
        np.shares_memory(clean.columns[name], printed[name])
        for name in ("speed_mps", "wheel_speed_mps")
    )


def test_what_is_put_right_is_a_copy(printed) -> None:
    spoilt = printed["speed_mps"].copy()
    spoilt[7], spoilt[8], spoilt[9] = 1e12, -0.0, 1.23456789123
    before = spoilt.copy()
    clean = clean_run_log(printed | {"speed_mps": spoilt})
    assert np.array_equal(spoilt, before) and np.signbit(spoilt[8])
    found = clean.columns["speed_mps"]
    assert np.isnan(found[7]) and not np.signbit(found[8]) and found[9] == 1.23456789


@pytest.mark.exam
def test_arrays_that_cannot_be_written_and_columns_that_are_not_read_change_no_answer(
    printed,
) -> None:
    answer, rng = diagnose_run(printed, Machine()).to_json(), np.random.default_rng(3)
    locked = {name: values.copy() for name, values in printed.items()}
    for values in locked.values():
        values.setflags(write=False)
    assert diagnose_run(locked, Machine()).to_json() == answer
    more = {
        name: np.full(ROWS, "text", object) if name in TEXT_COLUMNS else rng.normal(5.0, 2.0, ROWS)
        for name in sorted(UNREAD_COLUMNS)
    }
    assert UNREAD_COLUMNS < set(COLUMNS) and not UNREAD_COLUMNS & {"state", "events", "time_s"}
    assert diagnose_run(printed | more, Machine()).to_json() == answer


def written(path: Path, step_s: float, unit: float = 1.0) -> Path:
    rows = [
        f"{unit * step_s * k:.3f},"
        f"2026-03-20T08:{int(step_s * k) // 60:02d}:{step_s * k % 60:06.3f}Z,{50 + k % 3}.0"
        for k in range(60)
    ]
    path.write_text("\n".join(["time_s,utc,shaft_rpm", *rows]) + "\n")
    return path


def test_texts_that_nobody_reads_are_not_read(tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv", 0.1)
    whole, part = read_log(log), read_log(log, without=("utc",))
    assert "utc" in whole.columns and "utc" not in part.columns
    assert part.findings == whole.findings and np.array_equal(part.time_s, whole.time_s)
    assert set(diagnose._read_log_columns(log, Machine())[0]) == {"time_s", "shaft_rpm"}


def test_times_in_milliseconds_are_told_by_a_column_that_is_else_not_read(tmp_path: Path) -> None:
    log = written(tmp_path / "log.csv", 0.1, unit=1000.0)
    part = read_log(log, without=("utc",))
    assert part.step_s == pytest.approx(0.1) and part.findings == read_log(log).findings
