"""What the data gate leaves out, and that it says so."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from topdress.control.diagnosis.result import Cause, FieldCost, Size
from topdress.control.diagnosis.runs.channels import make_hopper_channel
from topdress.control.diagnosis.runs.compared import compared
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.drives import find_repeated_rows
from topdress.control.diagnosis.runs.findings import (
    note_faults_between_rows,
    note_left_ranges,
    note_other_dynamics,
    note_unread_efforts,
    note_unsure_drives,
)
from topdress.control.diagnosis.runs.hypothesis import list_stages, make_schedule
from topdress.control.diagnosis.runs.log import CleanLog, clean_run_log
from topdress.control.diagnosis.runs.row_order import COMMANDS, order_log_rows
from topdress.control.diagnosis.runs.stages import make_run_data
from topdress.control.machine.machine import Adopted, Limits, Machine, Noise, Shaft, Tolerance
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from tests.diagnosis.logs import HUANGHAI, Columns, settled, stairs_work, taken

ROWS = 400
DRIVE_ALONE = Machine(stages=("shaft",))


def columns(speed_mps):
    rng = np.random.default_rng(1)
    heads = {f"ndvi_{k}": rng.normal(0.5, 0.01, ROWS) for k in range(1, 7)}
    return {
        "time_s": 0.1 * np.arange(ROWS),
        "speed_mps": speed_mps,
        "wheel_speed_mps": np.zeros(ROWS),
        "shaft_rpm_cmd": np.full(ROWS, 50.0),
        "shaft_rpm": rng.normal(50.0, 0.3, ROWS),
    } | heads


# An outlier of the receiver is no journey.
@pytest.mark.parametrize(
    ("speed_mps", "stages"),
    [
        pytest.param(
            np.where(
                np.arange(ROWS) == 77, 4.0, np.abs(np.random.default_rng(2).normal(0.0, 0.02, ROWS))
            ),
            ("shaft",),
            id="stood all the time",
        ),
        pytest.param(
            np.where(np.arange(ROWS) < 60, 1.3, 0.0),
            ("shaft", "speed", "heads"),
            id="stood for most of it",
        ),
    ],
)
def test_a_machine_that_stood_shows_nothing_of_speeds_and_heads(speed_mps, stages):
    clean = clean_run_log(columns(speed_mps))
    assert clean.stages == stages
    assert any("stood all the time" in text for text in clean.findings) is (stages == ("shaft",))


def test_a_shaft_that_turns_for_single_doses_is_not_judged():
    """Its set-point is 0 in every row: a healthy planter was a shaft that turns by itself."""
    log = stairs_work()
    columns = {**log, "events": np.full(len(log["time_s"]), "", object)}
    assert {"shaft", "flow", "scale"} <= set(clean_run_log(columns).stages)
    columns["events"][300] = "dose 120"
    found = clean_run_log(columns)
    assert not {"shaft", "flow", "scale"} & set(found.stages) and "gate" in found.stages
    assert any("single doses" in finding for finding in found.findings)


def test_a_shaft_that_never_turned_is_not_judged():
    still = {
        "time_s": 0.02 * np.arange(ROWS),
        "shaft_rpm_cmd": np.where(np.arange(ROWS) < 100, 0.0, 120.0),
        "shaft_rpm": np.zeros(ROWS),
    }
    found = diagnose_run(still, Machine(id="wheel", stages=("shaft",)))
    assert found.verdict == "not_judged" and not found.terms and found.fitted is None
    assert any(
        "0 in every row, though up to 120 r/min were commanded" in said for said in found.findings
    )
    # it was not asked to turn
    assert "shaft" in clean_run_log(still | {"shaft_rpm_cmd": np.zeros(ROWS)}).stages


def test_rows_against_the_way_are_counted_where_files_are_compared_and_said_so():
    command = np.where(np.arange(ROWS) % 200 < 100, 300.0, -300.0)
    log = {
        "time_s": 0.02 * np.arange(ROWS),
        "shaft_rpm_cmd": command,
        "shaft_rpm": command + np.random.default_rng(5).normal(0.0, 1.0, ROWS),
    }
    file = Machine(
        id="wheel",
        stages=("shaft",),
        shaft=Shaft(one_way=1.0, full_rpm=400.0),
        limits=Limits(shaft_low_rpm=0.0, shaft_high_rpm=400.0),
    )
    found = compared(log, file, file)
    said = next(one for one in found.findings if "turn backwards" in one)
    assert (
        found.channels[0].old > 100.0
        and "counted as errors of the file" in said
        and "left out" not in said
    )


def test_a_short_log_far_from_its_prediction_is_not_called_healthy():
    """A tenth of a second, in which a motor runs up to nearly twice its command: no noise of a
    sensor is that."""
    time_s = 0.00225 * np.arange(48)
    rng = np.random.default_rng(3)
    log = {
        "time_s": time_s,
        "shaft_rpm_cmd": np.full(48, 225.0),
        "shaft_rpm": 385.0 * (1.0 - np.exp(-time_s / 0.025)) + rng.normal(0.0, 9.0, 48),
    }
    sheet = Machine(
        id="wheel",
        stages=("shaft",),
        noise=Noise(shaft_rpm=9.7),
        shaft=Shaft(
            full_rpm=400.0,
            dead_time_s=0.0,
            time_constant_s=0.001,
            acceleration_rpm_s=1e6,
            one_way=1.0,
        ),
        limits=Limits(shaft_low_rpm=0.0, shaft_high_rpm=400.0),
        tolerance=Tolerance(shaft_percent=0.5, dead_time_s=0.01, time_constant_s=0.015),
    )
    assert diagnose_run(log, sheet).verdict != "none"


def test_small_faults_of_the_drives_are_doubted_where_commands_may_be_lost():
    clean = clean_run_log(columns(np.full(ROWS, 1.3)))  # ten rows a second
    said = note_faults_between_rows(clean, {"gate.slow", "flow.gain"})
    assert len(said) == 1 and said[0].startswith("gate.slow: rows come every 0.1 s")
    assert note_faults_between_rows(clean, {"flow.gain"}) == []
    every_tick = clean._replace(step_s=0.05, time_s=0.05 * np.arange(ROWS))
    assert note_faults_between_rows(every_tick, {"gate.slow"}) == []
    holed = every_tick._replace(time_s=np.delete(every_tick.time_s, np.arange(5, ROWS, 20)))
    assert "5 % of the rows are missing" in note_faults_between_rows(holed, {"gate.slow"})[0]


@pytest.mark.parametrize(
    ("volts", "most_rpm", "left"),
    [
        (14.1, 90.0, ""),
        (18.0, 90.0, "supply_v 14 to 14, here 18 to 18"),
        (14.0, 150.0, "shaft_rpm"),
    ],
)
def test_a_log_beyond_what_a_file_was_adopted_from_is_said(
    volts: float, most_rpm: float, left: str
) -> None:
    commands = np.repeat(np.linspace(20.0, most_rpm, 10), 40)
    commands[:120] = 0.0  # the shaft stands, which is no set-point beyond the range
    log = columns(np.full(ROWS, 1.3)) | {
        "shaft_rpm_cmd": np.tile(commands, 2)[:ROWS],
        "supply_v": np.full(ROWS, volts),
        "x_count": np.arange(1000.0, 1000.0 + ROWS),
    }
    known = {"shaft_rpm": (20.0, 90.0), "supply_v": (14.0, 14.0), "x_count": (0.0, 400.0)}
    machine = Machine(adopted=(Adopted(id="shaft.gain", size=2.0, valid=known),))
    said = note_left_ranges(make_run_data(clean_run_log(log), machine), machine)
    assert len(said) == bool(left) and left in "".join(said) and "x_count" not in "".join(said)
    assert note_left_ranges(make_run_data(clean_run_log(log), Machine()), Machine()) == []


@pytest.mark.parametrize(
    ("machine", "probability", "said"),
    [(DRIVE_ALONE, 0.95, 1), (DRIVE_ALONE, 0.6, 0), (Machine(), 0.95, 0)],
)
def test_times_that_are_not_the_files_call_for_a_new_file(
    machine: Machine, probability: float, said: int
) -> None:
    slow, gain = (
        Cause(name, Size(9.0, 8.0, 10.0, "s"), None, probability, (), None, "", FieldCost(0.0, 0.0))
        for name in ("shaft.slow", "shaft.gain")
    )
    found = note_other_dynamics((slow, gain), machine)
    assert len(found) == said and all(
        one.startswith("shaft.slow: the machine file's dynamics") for one in found
    )


def test_rows_that_are_not_judged_and_efforts_that_no_stage_reads_are_said() -> None:
    log = columns(np.full(ROWS, 1.3))
    log["shaft_rpm"][: ROWS // 5] = np.nan
    log |= {"shaft_effort": np.ones(ROWS), "gate_effort": np.full(ROWS, np.nan)}
    clean = clean_run_log(log)
    data = make_run_data(clean, Machine())._replace(efforts=())
    said = note_unsure_drives(clean, data, Machine())
    assert "stage shaft: 80 of 400 rows are not judged: its reading is unknown" in said
    (unread,) = note_unread_efforts(log, data)
    assert unread.startswith("column shaft_effort is read by no stage")


def test_readings_alike_to_their_last_printed_digit_are_one_reading() -> None:
    """What repeats, and in which steps, is evidence: it must not hang on the last bits of a
    float."""
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 60.0, 0.1)
    columns = {
        "time_s": time_s,
        "hopper_kg": np.round((280.0 - 0.1 * time_s) / 0.05) * 0.05,
        "speed_mps": np.repeat(np.round(1.3 + 0.02 * rng.standard_normal(120), 3), 5),
        "x_load": time_s // 7.0,
    }
    moved = {
        name: values + (1e-11 * rng.standard_normal(600) if name != "time_s" else 0.0)
        for name, values in columns.items()
    }
    one, other = clean_run_log(columns), clean_run_log(moved)
    for name in ("hopper_kg", "speed_mps"):
        assert np.array_equal(one.columns[name], other.columns[name]), name
    assert np.array_equal(one.further["x_load"], other.further["x_load"])
    huge = clean_run_log({**columns, "hopper_kg": np.full(600, 1e305)})
    assert np.isnan(huge.columns["hopper_kg"]).all() and any(
        "beyond 1e+09" in one for one in huge.findings
    )


# --- Logs of others, which hold a command and what answered it in other rows than ours
# --------------------------------

ANSWERS = ("shaft_rpm", "opening_mm")
WORK = stairs_work()
STEPS_S = (0.05, 1.0)


def every(columns: Columns, step_s: float) -> Columns:
    """Every so many rows, with the digits that a log prints."""
    return {name: np.round(column[:: round(step_s / 0.05)], 8) for name, column in columns.items()}


def late(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][:1], log[name][:-1]] for name in ANSWERS}}


def in_one_row(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][1:], log[name][-1:]] for name in ANSWERS}}


def in_force(log: Columns) -> Columns:
    return {**log, **{name: np.r_[log[name][:1], log[name][:-1]] for name in COMMANDS}}


def as_said(log: Columns) -> CleanLog:
    return order_log_rows(clean_run_log(log), HUANGHAI)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_log_in_our_order_stays_as_it_is(step_s: float) -> None:
    log = every(WORK, step_s)
    seen = as_said(log)
    assert seen.findings == clean_run_log(log).findings
    assert all(np.array_equal(seen.columns[name], log[name]) for name in (*ANSWERS, *COMMANDS))


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize(
    ("rewritten", "said"),
    [
        (late, "read a row late"),
        (in_one_row, "with what answered it"),
        (in_force, "under which it was read"),
    ],
)
def test_rows_of_others_are_put_in_order_and_said(
    rewritten: Callable[[Columns], Columns], said: str, step_s: float
) -> None:
    log = every(WORK, step_s)
    seen = as_said(rewritten(log))
    off = {
        name: np.mean(seen.columns[name][2:-2] != log[name][2:-2]) for name in (*ANSWERS, *COMMANDS)
    }
    by = {
        name: np.mean(seen.columns[name][2:-2] != np.roll(log[name], -1)[2:-2])
        for name in (*ANSWERS, *COMMANDS)
    }
    assert not any(off.values()) or not any(by.values()), (
        "commands and answers stand to each other as ours"
    )
    if step_s == 1.0:
        assert any(said in finding for finding in seen.findings), (
            "the scale tells which of them was moved"
        )


def test_a_shaft_half_a_row_late_within_its_tolerance_hides_no_order_of_rows() -> None:
    """Seen in rows of others it is half a row early: neither order fits it better, and the gate
    tells."""
    time_s = WORK["time_s"]
    # 25 ms by the file
    later = {**WORK, "shaft_rpm": np.interp(time_s - 0.045, time_s, WORK["shaft_rpm"])}
    assert as_said(later).findings == clean_run_log(later).findings
    assert any("moved a row" in finding for finding in as_said(in_force(later)).findings)


@pytest.mark.exam
def test_a_shaft_that_is_early_by_a_row_is_in_the_rows_of_others_and_one_that_is_late_may_be() -> (
    None
):
    """Nothing makes a drive early; where no gate moves, what is late is a dead time or the
    rows' order."""
    # 20 ms sooner than by the machine file
    time_s, read_rpm = WORK["time_s"], WORK["shaft_rpm"]
    early, slow = (
        {
            "time_s": time_s,
            "shaft_rpm_cmd": WORK["shaft_rpm_cmd"],
            "shaft_rpm": np.interp(time_s - late_s, time_s, read_rpm),
        }
        for late_s in (-0.05, 0.07)
    )
    assert any("moved a row down" in finding for finding in as_said(early).findings)
    # no slew: early as no row makes it
    quick = {
        "time_s": time_s,
        "opening_mm_cmd": WORK["opening_mm_cmd"],
        "opening_mm": np.r_[WORK["opening_mm_cmd"][:2], WORK["opening_mm_cmd"][:-2]]
        + 0.1 * np.random.default_rng(7).standard_normal(len(time_s)),
    }
    assert as_said(quick).findings == clean_run_log(quick).findings
    slow |= {name: WORK[name] for name in ("opening_mm_cmd", "opening_mm")}
    slow = taken(slow, slice(4000))  # 200 s
    found = diagnose_run(
        {name: slow[name] for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm")}, HUANGHAI
    )
    assert [(c.id, c.probability < 0.5, [r.id for r in c.rivals]) for c in found.causes] == [
        ("shaft.dead_time", True, ["unknown"])
    ]
    assert any("as late as a row is long" in finding for finding in found.findings)
    told = diagnose_run(slow, HUANGHAI)
    assert [(c.id, c.probability > 0.9) for c in told.causes] == [("shaft.dead_time", True)]


@pytest.mark.exam
def test_what_one_drive_answers_late_is_no_order_of_rows() -> None:
    slow = {**WORK, "shaft_rpm": np.r_[WORK["shaft_rpm"][:2], WORK["shaft_rpm"][:-2]]}
    assert as_said(slow).findings == clean_run_log(slow).findings
    found = diagnose_run(slow, HUANGHAI)
    assert found.verdict != "none"
    assert {left.channel for left in found.unexplained} | {
        c.id.split(".")[0] for c in found.causes
    } == {"shaft"}


def test_nothing_is_wrong_with_a_machine_whose_logger_reads_a_row_late() -> None:
    found = diagnose_run(late(every(WORK, 1.0)), HUANGHAI)
    assert found.verdict == "none"
    assert any("read a row late" in finding for finding in found.findings)


def test_a_reading_that_is_held_while_the_shaft_moves_is_none() -> None:
    """Twelve times two rows as it slows down: by such rows a healthy shaft was slow for a
    while, p 1.00."""
    command, time_s = np.repeat(np.tile([70.0, 30.0], 60), 40), 0.1 * np.arange(4800)
    rpm = np.interp(time_s - 0.4, time_s, command) + np.random.default_rng(4).normal(0.0, 0.3, 4800)
    ramp = np.interp(np.arange(9), [0, 8], [70.0, 30.0])
    for at in np.flatnonzero(np.diff(command) < 0.0)[20:32] + 1:
        rpm[at : at + 9] = ramp + np.random.default_rng(at).normal(0.0, 0.3, 9)
        rpm[at + 4 : at + 6] = rpm[at + 3]
    held = find_repeated_rows(rpm, 0.3)
    assert held.sum() == 24 and np.all(rpm[held] == rpm[np.flatnonzero(held) - 1])
    assert not find_repeated_rows(np.round(rpm), 0.3).any(), "a coarse reading is held by nothing"
    # a row a step, one read twice: each is an answer of its own
    asked_rpm = np.linspace(100.0, 600.0, 80)
    stairs = settled(asked_rpm, asked_rpm + np.random.default_rng(5).normal(0.0, 0.1, 80))
    stairs["shaft_rpm"][30] = stairs["shaft_rpm"][29]
    machine = Machine(
        id="wheel",
        stages=("shaft",),
        noise=Noise(shaft_rpm=0.3),
        shaft=Shaft(dead_time_s=0.02, time_constant_s=0.06),
    )
    clean = clean_run_log(stairs)
    assert find_repeated_rows(clean.columns["shaft_rpm"], 0.3).any()
    assert make_run_data(clean, machine).shaft.grid.rows.tolist().count(30) == 1


def test_the_scale_is_predicted_for_the_time_at_which_it_was_read() -> None:
    """One reading a second stands at the begin of its second: half a second of flow before the
    middle."""
    log = every({name: WORK[name] for name in ("time_s", *COMMANDS, *ANSWERS)}, 1.0)
    log["hopper_kg"] = (
        290.0 - np.cumsum(5.5e-3 * WORK["shaft_rpm"] * WORK["opening_mm"] / 60.0) * 0.05
    )[::20]
    data = make_run_data(clean_run_log(log), HUANGHAI)
    left = make_hopper_channel(data.hopper, HUANGHAI)
    off_kg = left.measured - left.predict(
        make_schedule(list_stages(HUANGHAI), ()), MAX_MODEL_STEP_S
    )
    assert np.allclose(data.hopper.read_at, 0.0)
    assert np.std(np.diff(off_kg)) < 0.02, (
        "half a second of a flow of 0.05 to 0.4 kg/s makes 0.04 kg"
    )


def test_a_speed_that_happens_to_be_a_sentinel_is_a_reading_where_the_others_come_near():
    """-99 r/min of a wheel that is driven either way; -9999 is no speed of it."""
    table = columns(np.full(ROWS, 1.2))
    table["shaft_rpm"] = np.linspace(-120.0, 120.0, ROWS).round()
    table["shaft_rpm"][7] = -9999.0
    clean = clean_run_log(table)
    assert np.sum(clean.columns["shaft_rpm"] == -99.0) >= 1
    assert np.isnan(clean.columns["shaft_rpm"][7])
    assert [text for text in clean.findings if "shaft_rpm:" in text] == [
        "column shaft_rpm: 1 value -9999 emptied: not known"
    ]


def test_a_notebook_s_times_and_units_are_mended_as_a_file_s_are():
    """Before, only the reader of files knew milliseconds, coarse times, clocks set back, places
    and percent."""
    time_s, speed_mps = 0.1 * np.arange(ROWS), np.full(ROWS, 1.2)
    way = np.random.default_rng(2).normal(0.0, 0.01, ROWS)
    plain = columns(speed_mps + way) | {
        "wheel_speed_mps": speed_mps - way,
        "time_s": time_s,
        "lat_deg": 34.0 + 1.2 * time_s / 111_200.0,
        "lon_deg": np.full(ROWS, 119.0),
    }
    good = clean_run_log(plain)
    for spoilt, word in (
        ({"time_s": 1.7e12 + 1000.0 * time_s}, "milliseconds"),
        (
            {
                "speed_mps": 3.6 * plain["speed_mps"],
                "wheel_speed_mps": 3.6 * plain["wheel_speed_mps"],
            },
            "in km/h",
        ),
        ({"ndvi_1": 100.0 * plain["ndvi_1"]}, "in percent"),
    ):
        clean = clean_run_log(plain | spoilt)
        assert any(word in text for text in clean.findings), (word, clean.findings)
        assert clean.step_s == pytest.approx(good.step_s, rel=1e-6) and clean.stages == good.stages
        assert all(
            np.allclose(clean.columns[name], good.columns[name], equal_nan=True)
            for name in good.columns
        )
    coarse = clean_run_log(plain | {"time_s": np.floor(time_s)})
    assert len(coarse.time_s) == ROWS and coarse.step_s == pytest.approx(0.1)
    back = clean_run_log(
        plain | {"time_s": time_s - np.where(np.arange(ROWS) < ROWS // 2, 0.0, 5.03)}
    )
    assert len(back.time_s) == ROWS - 50 and np.diff(back.time_s).min() > 0.05
