"""Logs of others, which hold a command and what answered it in other rows than ours: in simulated work, rewritten."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from control.diagnosis.runs.channels import hopper_channel
from control.diagnosis.runs.diagnose import diagnose_run
from control.diagnosis.runs.hypothesis import schedule, stages_of
from control.diagnosis.runs.log import Clean, gate
from control.diagnosis.runs.row_order import COMMANDS, in_order
from control.diagnosis.runs.stages import run_data
from control.machine.over_log import MOST_STEP_S
from drivers.files.config import load
from drivers.files.kinds import MACHINE

Columns = dict[str, np.ndarray]
ANSWERS = ("shaft_rpm", "opening_mm")
MODEL = load("huanghai", MACHINE).model
STEPS_S = (0.05, 1.0)


def every(columns: Columns, step_s: float) -> Columns:
    """Every so many rows, with the digits that a log prints."""
    return {name: np.round(column[::round(step_s / 0.05)], 8) for name, column in columns.items()}


def late(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][:1], log[name][:-1]] for name in ANSWERS}}


def in_one_row(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][1:], log[name][-1:]] for name in ANSWERS}}


def in_force(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][:1], log[name][:-1]] for name in COMMANDS}}


def as_said(log: Columns) -> Clean:
    return in_order(gate(log), MODEL)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_log_in_our_order_stays_as_it_is(work: Columns, step_s: float) -> None:
    log = every(work, step_s)
    seen = as_said(log)
    assert seen.findings == gate(log).findings
    assert all(np.array_equal(seen.columns[name], log[name]) for name in (*ANSWERS, *COMMANDS))


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize(("rewritten", "said"), [(late, "read a row late"), (in_one_row, "with what answered it"),
                                                 (in_force, "under which it was read")])
def test_rows_of_others_are_put_in_order_and_said(work: Columns, rewritten: Callable[[Columns], Columns], said: str,
                                                  step_s: float) -> None:
    log = every(work, step_s)
    seen = as_said(rewritten(log))
    off = {name: np.mean(seen.columns[name][2:-2] != log[name][2:-2]) for name in (*ANSWERS, *COMMANDS)}
    by = {name: np.mean(seen.columns[name][2:-2] != np.roll(log[name], -1)[2:-2]) for name in (*ANSWERS, *COMMANDS)}
    assert not any(off.values()) or not any(by.values()), "commands and answers stand to each other as ours"
    if step_s == 1.0:
        assert any(said in finding for finding in seen.findings), "the scale tells which of them was moved"


@pytest.mark.exam
def test_what_one_drive_answers_late_is_no_order_of_rows(work: Columns) -> None:
    slow = {**work, "shaft_rpm": np.r_[work["shaft_rpm"][:2], work["shaft_rpm"][:-2]]}
    assert as_said(slow).findings == gate(slow).findings
    found = diagnose_run(slow, MODEL)
    assert found.verdict != "none"
    assert {left.channel for left in found.unexplained} | {c.id.split(".")[0] for c in found.causes} == {"shaft"}


def test_nothing_is_wrong_with_a_machine_whose_logger_reads_a_row_late(work: Columns) -> None:
    found = diagnose_run(late(every(work, 1.0)), MODEL)
    assert found.verdict == "none"
    assert any("read a row late" in finding for finding in found.findings)


def test_the_scale_is_predicted_for_the_time_at_which_it_was_read(work: Columns) -> None:
    """One reading a second stands at the begin of its second: half a second of flow before the middle."""
    log = every({name: work[name] for name in ("time_s", *COMMANDS, *ANSWERS)}, 1.0)
    log["hopper_kg"] = (290.0 - np.cumsum(5.5e-3 * work["shaft_rpm"] * work["opening_mm"] / 60.0) * 0.05)[::20]
    data = run_data(gate(log), MODEL)
    left = hopper_channel(data.hopper, MODEL)
    off_kg = left.measured - left.predict(schedule(stages_of(MODEL), ()), MOST_STEP_S)
    assert np.allclose(data.hopper.read_at, 0.0)
    assert np.std(np.diff(off_kg)) < 0.02, "half a second of a flow of 0.05 to 0.4 kg/s makes 0.04 kg"
