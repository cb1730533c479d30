"""Calibration: the hidden figures come back with intervals, the range is kept, nothing is
overwritten."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from topdress.control.calibration import (
    BenchTable,
    WheelLog,
    check_heads,
    fit_flow,
    fit_lag,
    fit_wheel,
)
from topdress.control.calibration.tube_fit import settle_tube
from topdress.control.geodesy import TangentPlane
from topdress.control.machine.fall import calc_drop_s, find_paper_lag_s
from topdress.control.machine.machine import Adopted, Machine, add_effect
from topdress.control.machine.start_lag import calc_response_s, find_first_fall_s
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND as MACHINE_FILES

from tests.command import topdress

MACHINE = Machine(adopted=(Adopted(id="shaft.gain", size=1.0), Adopted(id="flow.gain", size=5.0)))


def catch(
    slope: float,
    offset: float,
    lost: float,
    *,
    seed: int = 1,
    sd: float = 0.003,
    openings: tuple[float, ...] = (8, 20, 40),
    speeds: tuple[float, ...] = (20, 60, 100),
) -> BenchTable:
    rng = np.random.default_rng(seed)
    opening, rpm = (a.ravel() for a in np.meshgrid(openings, speeds))
    opening, rpm = np.tile(opening, 3).astype(float), np.tile(rpm, 3).astype(float)
    turns = rpm / 60.0 * 45.0
    mass = (slope * opening + offset) * (1 - lost / 100 * (rpm / 100) ** 3) * turns / 1000
    mass = mass * (1 + sd * rng.standard_normal(len(rpm)))
    return BenchTable(
        "catch",
        {
            "shaft_rpm": rpm,
            "opening_mm": opening,
            "duration_s": np.full(len(rpm), 45.0),
            "mass_kg": mass,
        },
        path="barn/catch.csv",
    )


def lag(
    intercept: float,
    slope: float,
    *,
    speeds: tuple[float, ...] = (10, 20, 30, 40, 50, 60, 70, 90),
    sd: float = 0.02,
    seed: int = 1,
    column: str = "lag_s",
) -> BenchTable:
    rng = np.random.default_rng(seed)
    rpm = np.tile(np.array(speeds, float), 4)
    times = (
        intercept + slope * rpm + np.where(rpm > 75, 0.3, 0.0) + sd * rng.standard_normal(len(rpm))
    )
    return BenchTable("lag", {"shaft_rpm": rpm, column: times}, path="barn/lag.csv")


def test_flow_comes_back_with_intervals_that_hold_it() -> None:
    inside = np.zeros(3)
    for seed in range(60):
        machine, fit = fit_flow(catch(5.9, 6.0, 8.0, seed=seed), MACHINE)
        assert fit.zero_offset_g_rev is not None and fit.fill_falloff_percent is not None
        for k, (found, true) in enumerate(
            zip(
                (fit.grams_per_rev_mm, fit.zero_offset_g_rev, fit.fill_falloff_percent),
                (5.9, 6.0, 8.0),
                strict=True,
            )
        ):
            inside[k] += found.low <= true <= found.high
        assert machine.flow.grams_per_rev_mm == fit.grams_per_rev_mm.value
        assert machine.flow.fill_falloff_percent == fit.fill_falloff_percent.value
    assert np.all(inside >= 46) and np.all(inside < 60)  # 90 % of 60 is 54


def test_terms_that_are_not_there_do_not_enter() -> None:
    entered = 0
    for seed in range(60):
        machine, fit = fit_flow(catch(5.5, 0.0, 0.0, seed=seed), MACHINE)
        entered += fit.zero_offset_g_rev is not None or fit.fill_falloff_percent is not None
        if fit.zero_offset_g_rev is None:
            assert machine.flow.zero_offset_g_rev == 0.0
    assert entered <= 5


def test_one_opening_or_one_speed_is_enough_for_what_it_can_show() -> None:
    _, fit = fit_flow(catch(6.1, 0.0, 0.0, openings=(25,), speeds=(70,)), MACHINE)
    assert fit.grams_per_rev_mm.value == pytest.approx(6.1, rel=0.004)
    assert (
        sum("one opening only" in note or "one shaft speed only" in note for note in fit.notes) == 2
    )


def test_outlets_caught_one_by_one_add_up() -> None:
    table = catch(5.5, 0.0, 0.0)
    columns = dict(table.columns) | {
        "mass_kg": table.columns["mass_kg"] / 6.0,
        "outlet": np.ones(table.rows),
    }
    assert fit_flow(BenchTable("catch", columns), MACHINE)[
        1
    ].grams_per_rev_mm.value == pytest.approx(5.5, rel=0.01)


def test_flow_provenance_is_written_and_the_old_machine_untouched() -> None:
    before = MACHINE.model_dump()
    machine, fit = fit_flow(
        catch(5.9, 6.0, 8.0), add_effect(MACHINE, "flow.gain", 5.0), date="2026-05-04"
    )
    assert MACHINE.model_dump() == before
    assert machine.flow.gain_percent == 0.0
    assert [one.id for one in machine.adopted] == [
        "shaft.gain",
        "flow.grams_per_rev_mm",
        "flow.zero_offset",
        "flow.fill_falloff",
    ]
    assert machine.adopted[1].data == "barn/catch.csv"
    assert machine.adopted[1].date == "2026-05-04"
    assert machine.adopted[1].valid == {"shaft_rpm": (20.0, 100.0), "opening_mm": (8.0, 40.0)}
    assert "catch.csv" in machine.title
    assert fit.rows_used == 27


@pytest.mark.exam
def test_lag_line_comes_back_and_rows_beyond_its_range_do_not_bend_it() -> None:
    lines = [fit_lag(lag(2.4, -0.009, seed=seed), MACHINE)[1] for seed in range(60)]
    assert (
        46
        <= sum(line.slope_s_per_rpm.low < -0.009 < line.slope_s_per_rpm.high for line in lines)
        < 60
    )
    assert 46 <= sum(line.intercept_s.low < 2.4 < line.intercept_s.high for line in lines) < 60
    machine, line = fit_lag(lag(2.4, -0.009), MACHINE)
    assert (line.from_rpm, line.to_rpm, line.rows_used) == (10.0, 70.0, 28)
    assert (machine.fall.valid_from_rpm, machine.fall.valid_to_rpm) == (10.0, 70.0)
    assert machine.fall.intercept_s == pytest.approx(line.intercept_s.value - 0.383, abs=1e-3)
    (note,) = (note for note in line.notes if "90 r/min" in note)
    off = 2.4 - 0.009 * 90.0 + 0.3 - (line.intercept_s.value + line.slope_s_per_rpm.value * 90.0)
    said_off, said_before = (float(said) for said in re.findall(r"([+-]?[0-9]+\.[0-9]{3}) s", note))
    assert said_off == pytest.approx(off, abs=0.03), "the mean of four rows that scatter by 0.02 s"
    assert said_before == pytest.approx(find_paper_lag_s(90.0), abs=0.002), (
        "the machine file before is the paper's"
    )


def test_lag_line_is_not_extrapolated() -> None:
    _, line = fit_lag(lag(2.4, -0.009), MACHINE)
    assert line.calc_lag_s(40.0) == pytest.approx(2.04, abs=0.02)
    for outside in (5.0, 71.0, 100.0):
        with pytest.raises(ValueError, match="holds from 10 to 70"):
            line.calc_lag_s(outside)


def test_drop_times_go_in_as_they_are() -> None:
    machine, line = fit_lag(lag(1.9, -0.008, column="drop_s"), MACHINE)
    assert machine.fall.intercept_s == line.intercept_s.value


def test_a_lag_offset_in_the_machine_is_taken_up_by_the_line() -> None:
    machine, _ = fit_lag(lag(2.4, -0.009), add_effect(MACHINE, "lag.offset", 0.2))
    assert machine.fall.offset_s == 0.0


def test_response_of_the_nominal_machine_is_the_papers() -> None:
    for rpm in (10.0, 40.0, 100.0):
        assert calc_response_s(MACHINE, rpm) == pytest.approx(0.383, abs=0.0015)
    assert calc_response_s(add_effect(MACHINE, "shaft.dead_time", 0.1), 40.0) == pytest.approx(
        0.483, abs=0.0015
    )


@pytest.mark.parametrize(
    ("table", "named"),
    [
        (catch(5.5, 0, 0), "a lag fit needs a lag table"),
        (lag(2.4, -0.009, speeds=(10, 20)), "at least 3 are needed"),
        (lag(0.38, 0.0, column="response_s"), "needs lag_s, drop_s or lag_m"),
    ],
)
def test_tables_that_give_no_line_are_refused(table: BenchTable, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        fit_lag(table, MACHINE)


def test_labels_must_be_chosen() -> None:
    table = lag(2.4, -0.009)
    label = np.array(["rig", "field"] * (table.rows // 2))
    labelled = BenchTable("lag", table.columns, "source", "t.csv", label)
    with pytest.raises(ValueError, match="say which rows to fit: field, rig"):
        fit_lag(labelled, MACHINE)
    with pytest.raises(ValueError, match="allowed field, rig"):
        fit_lag(labelled, MACHINE, label="barn")
    assert fit_lag(labelled, MACHINE, label="rig")[1].rows_used <= table.rows // 2
    with pytest.raises(ValueError, match="label 'rig': the table has no label column"):
        fit_lag(table, MACHINE, label="rig")


def test_a_range_that_falls_is_refused_with_the_range_in_force() -> None:
    with pytest.raises(ValueError, match="from 200 to 70 r/min: allowed is a range that rises"):
        fit_lag(lag(2.2, -0.008), MACHINE, from_rpm=200.0)


# --- A step between two rates at the rig says what starts cannot: whether the stream carries
# what falls --------------

SHIPPED = Machine()


def half_way_s(singly: bool) -> float:
    """A rig of our own: granules leave a shaft that goes from 40 to 80 r/min, the plate counts
    them. Drop times of the referee's line where each falls singly, else of the lag paper's
    running shaft."""
    step_s = 0.002
    lands: list[float] = []
    weights: list[float] = []
    times = np.arange(-3.0, 4.0, step_s)
    rise = np.where(
        times < 0.15, 200.0 * np.maximum(0.0, times), 40.0 - 10.0 * np.exp(-(times - 0.15) / 0.05)
    )
    # at most 200 r/min per s, and to the end with a time constant of 0.05 s
    rpm = 40.0 + rise
    drop = 1.7916 - 0.01331 * rpm if singly else 1.8288 - 0.0083 * rpm - 1.69e-3 * 0.0083 * rpm**2
    way = np.concatenate([[0.0], np.cumsum(step_s / drop[:-1])])
    for k, t in enumerate(times):
        at = t + drop[k] if singly else float(np.interp(way[k] + 1.0, way, times, right=np.nan))
        if np.isfinite(at):
            lands.append(at)
            weights.append(rpm[k])
    counted, edges = np.histogram(lands, np.arange(-1.0, 2.6, 0.01), weights=weights)
    level = counted / np.median(counted[edges[:-1] < -0.2]) * 40.0
    best = np.argmin(np.cumsum(level - 60.0))
    return float(edges[best + 1])


def lag_table(drop_s: float, rows: int = 10, scatter_s: float = 0.03) -> BenchTable:
    drops = drop_s + scatter_s * np.random.default_rng(3).standard_normal(rows)
    return BenchTable(
        "lag",
        {"before_rpm": np.full(rows, 40.0), "shaft_rpm": np.full(rows, 80.0), "drop_s": drops},
        path="steps.csv",
    )


def test_ten_steps_tell_the_two_apart() -> None:
    carried, _ = settle_tube(lag_table(half_way_s(singly=False)), SHIPPED)
    singly, fit = settle_tube(lag_table(half_way_s(singly=True)), SHIPPED)
    assert not SHIPPED.is_tube_measured, "what ships was measured by starts alone"
    assert carried.is_tube_measured and carried.fall.carried_share >= 0.8
    assert singly.is_tube_measured and singly.fall.carried_share <= 0.4
    assert fit.rows_used == 10 and fit.sd < 0.2 and fit.settles
    assert singly.adopted[-1].id == "fall.carried_share" and singly.adopted[-1].high <= 0.7


@pytest.mark.exam
def test_few_or_foreign_rows_settle_nothing() -> None:
    with pytest.raises(
        ValueError, match=r"steps.csv: 2 rows of a change between two rates .* at least 3"
    ):
        settle_tube(lag_table(0.9, rows=2), SHIPPED)
    with pytest.raises(
        ValueError, match=r"steps.csv: column drop_s: .* off the nearest that any tube gives"
    ):
        settle_tube(lag_table(2.6), SHIPPED)
    wide, fit = settle_tube(lag_table(0.95, rows=3, scatter_s=0.4), SHIPPED)
    assert not fit.settles and not wide.is_tube_measured


def test_calibrate_lag_takes_a_table_of_steps(tmp_path: Path) -> None:
    drop = half_way_s(singly=True)
    rows = "".join(f"40,80,{k},{drop + 0.01 * (k % 3 - 1):.3f}\n" for k in range(10))
    (tmp_path / "steps.csv").write_text(
        "before_rpm,shaft_rpm,replicate,drop_s\n" + rows, encoding="utf-8"
    )
    out = tmp_path / "mine.yaml"
    result = topdress("calibrate", "lag", tmp_path / "steps.csv", "--out", out)
    assert result.exit_code == 0, result.output
    assert "tube: 10 changes between two rates" in result.output
    mine = load_config(str(out), MACHINE_FILES).model
    assert (
        mine.is_tube_measured
        and mine.fall.carried_share <= 0.4
        and mine.fall.intercept_s == pytest.approx(1.8288)
    )


def test_a_table_of_starts_says_what_is_missing(tmp_path: Path) -> None:
    rows = "".join(
        f"{n},{1.8288 - 0.0083 * n + 0.01 * k:.3f}\n" for n in (10, 30, 50, 70) for k in (-1, 0, 1)
    )
    (tmp_path / "starts.csv").write_text("shaft_rpm,drop_s\n" + rows, encoding="utf-8")
    result = topdress("calibrate", "lag", tmp_path / "starts.csv", "--out", tmp_path / "mine.yaml")
    assert (
        result.exit_code == 0
        and "a step from 40 to 80 r/min at the rig, ten times" in result.output
    )
    result = topdress("diagnose", tmp_path / "starts.csv")
    assert "a step from 40 to 80 r/min at the rig, ten times" in result.output, result.output


# --- Calibrations from run logs, and the lag rig's ramp: hidden figures come back in their
# intervals, doubts are said.

WORN = Machine(
    adopted=(
        Adopted(id="speed.wheel_radius", size=1.0),
        Adopted(id="canopy.head_fouled", size=-3.0),
    )
)
PLANE = TangentPlane(34.28, 119.88)


def drive(
    circumference_m: float,
    *,
    slip_percent: float = 0.0,
    idle_s: float = 150.0,
    work_s: float = 200.0,
    seed: int = 1,
    quality: float = 4.0,
    place_sd_m: float = 0.02,
) -> WheelLog:
    """North, idle and then at work, at about 1.5 m/s and 20 rows a second, wheel counted by
    2.50 m; fixes at 10 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, idle_s + work_s, 0.05)
    speed = 1.5 + 0.2 * np.sin(time / 7.0)
    flowing = time >= idle_s
    north = np.cumsum(speed) * 0.05
    wheel = speed * 2.5 / circumference_m * (1.0 + slip_percent / 100.0 * flowing)
    wheel += 0.02 * rng.standard_normal(len(time))
    fix = np.arange(len(time)) // 2 * 2
    noise = place_sd_m * rng.standard_normal((len(time), 2))
    lat, lon = (
        np.array([PLANE.convert_to_deg(noise[k, 0], north[k] + noise[k, 1]) for k in fix[::2]])
        .repeat(2, axis=0)
        .T
    )
    return WheelLog(time, lat, lon, np.full(len(time), quality), wheel, flowing)


def test_the_circumference_comes_back_within_its_interval_and_slip_apart() -> None:
    inside = slip_inside = 0
    for seed in range(20):
        machine, fit = fit_wheel(
            drive(2.43, slip_percent=6.0, seed=seed), WORN, 2.5, "farm/run.csv"
        )
        inside += fit.circumference_m.low <= 2.43 <= fit.circumference_m.high
        assert fit.slip_percent is not None and not fit.at_work
        slip_inside += fit.slip_percent.low <= 6.0 <= fit.slip_percent.high
        assert machine.speed.wheel_circumference_m == fit.circumference_m.value
        assert fit.circumference_m.high - fit.circumference_m.low < 0.01
    assert inside >= 15 and slip_inside >= 15  # 90 % of 20 is 18
    assert [r.id for r in machine.adopted] == ["canopy.head_fouled", "speed.wheel_circumference_m"]
    assert machine.adopted[1].data == "farm/run.csv" and "wheel from run.csv" in machine.title


def test_way_at_work_alone_holds_the_slip_and_says_so() -> None:
    _, fit = fit_wheel(drive(2.5, slip_percent=6.0, idle_s=30.0), WORN, 2.5, "run.csv")
    assert fit.at_work and "slip under load" in fit.notes[0]
    assert fit.circumference_m.value == pytest.approx(2.5 / 1.06, rel=2e-3)


def test_poor_fixes_are_said_and_too_little_way_is_refused() -> None:
    _, fit = fit_wheel(drive(2.5, quality=2.0), WORN, 2.5, "run.csv")
    assert "fix quality down to 2" in fit.notes[0]
    with pytest.raises(
        ValueError, match=r"run\.csv: \d+ straight stretches of 10 m.*at least 5 and 100 m"
    ):
        fit_wheel(drive(2.5, idle_s=20.0, work_s=20.0), WORN, 2.5, "run.csv")
    blind = drive(2.5)._replace(lat_deg=np.full(7000, np.nan))
    with pytest.raises(ValueError, match="both are needed"):
        fit_wheel(blind, WORN, 2.5, "run.csv")


def test_curves_are_no_straight_way() -> None:
    log = drive(2.5)
    angle = np.cumsum(1.5 * np.ones(len(log.time_s))) * 0.05 / 15.0
    lat, lon = np.array([PLANE.convert_to_deg(15.0 * np.sin(a), 15.0 * np.cos(a)) for a in angle]).T
    with pytest.raises(ValueError, match="0 straight stretches"):
        fit_wheel(log._replace(lat_deg=lat, lon_deg=lon), WORN, 2.5, "run.csv")


def ndvi(
    gains: dict[int, float], *, seconds: float = 300.0, seed: int = 1, spread: float = 0.05
) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.5)
    canopy = 0.5 + spread * np.sin(time / 5.0) + 0.03 * rng.standard_normal(len(time))
    values = canopy[:, None] + 0.02 * rng.standard_normal((len(time), 6))
    for head, percent in gains.items():
        values[:, head - 1] *= 1.0 + percent / 100.0
    return np.repeat(time, 2) + np.tile([0.0, 0.25], len(time)), np.repeat(values, 2, axis=0)


def test_fouled_heads_are_named_with_their_gain_and_clean_ones_never() -> None:
    false = 0
    for seed in range(40):
        time, values = ndvi({}, seed=seed)
        machine, fit = check_heads(time, values, WORN, "run.csv")
        false += any(head.fouled for head in fit.heads)
        assert machine.heads.fouled_percent == 0.0 or false
    assert false <= 1
    time, values = ndvi({2: -6.0})
    machine, fit = check_heads(time, values, WORN, "run.csv", date="2026-05-01")
    assert [head.number for head in fit.heads if head.fouled] == [2]
    worst = fit.heads[1].gain_percent
    assert worst.low <= -6.0 <= worst.high and fit.heads[1].samples == 600
    assert (machine.heads.fouled_head, machine.heads.fouled_percent) == (
        2.0,
        pytest.approx(worst.value, abs=1e-3),
    )
    assert [(r.id, r.member) for r in machine.adopted] == [
        ("speed.wheel_radius", None),
        ("canopy.head_fouled", 2),
    ]


def test_two_fouled_heads_do_not_blame_the_others() -> None:
    time, values = ndvi({1: -9.0, 6: -7.0})
    machine, fit = check_heads(time, values, WORN, "run.csv")
    assert [head.number for head in fit.heads if head.fouled] == [1, 6]
    assert machine.heads.fouled_head == 1.0
    assert any("heads 1, 6 are fouled" in note for note in fit.notes)


def test_gain_and_offset_are_told_apart_only_on_a_canopy_that_varies() -> None:
    time, values = ndvi({}, spread=0.2)
    values[:, 3] += 0.05
    _, fit = check_heads(time, values, WORN, "run.csv")
    assert fit.heads[3].fouled and fit.heads[3].slope == pytest.approx(1.0, abs=0.05)
    assert fit.heads[3].offset == pytest.approx(0.05, abs=0.02)
    noise = 0.01 * np.random.default_rng(1).standard_normal((400, 6))
    _, even = check_heads(time[:400], 0.5 + noise, WORN, "run.csv")
    assert even.heads[0].slope is None and any("too even" in note for note in even.notes)


def test_silent_heads_and_short_logs_are_said() -> None:
    time, values = ndvi({})
    values[:, 5] = np.nan
    _, fit = check_heads(time, values, WORN, "run.csv")
    assert fit.silent == (6,) and "head 6 is silent" in fit.notes
    with pytest.raises(ValueError, match=r"run\.csv: 40 s of readings"):
        check_heads(time[:156], values[:156], WORN, "run.csv")
    values[:, :4] = np.nan
    with pytest.raises(ValueError, match="1 heads with readings: at least 3"):
        check_heads(time, values, WORN, "run.csv")


SPEEDS_RPM = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0)


def rig_table(machine: Machine, sd: float = 0.01, responses: bool = True) -> BenchTable:
    rng = np.random.default_rng(2)
    rpm = np.repeat(SPEEDS_RPM, 10)
    first = {n: find_first_fall_s(machine, machine.fall, n) for n in SPEEDS_RPM}
    columns = {
        "shaft_rpm": rpm,
        "drop_s": np.array([first[n] for n in rpm]) + sd * rng.standard_normal(len(rpm)),
    }
    if responses:
        columns["response_s"] = np.full(len(rpm), 0.383)
    return BenchTable("lag", columns, path="rig.csv")


def test_a_lag_rigs_drop_times_give_the_line_of_a_start_with_and_without_a_response_column() -> (
    None
):
    true = Machine()
    before = true.model_copy(
        update={"fall": true.fall._replace(intercept_s=1.5, slope_s_per_rpm=-0.004)}
    )
    both, _ = fit_lag(rig_table(true), before)
    alone, _ = fit_lag(rig_table(true, responses=False), before)
    assert both.fall == alone.fall
    assert both.fall.intercept_s == pytest.approx(1.8288, abs=0.015)
    assert both.fall.slope_s_per_rpm == pytest.approx(-0.0083, abs=3e-4)


def test_a_calibrated_machine_played_through_the_rigs_test_gives_the_line_again() -> None:
    before = Machine(
        fall=Machine().fall._replace(
            intercept_s=1.5, slope_s_per_rpm=-0.004, start_more_per_rpm=0.0
        )
    )
    machine, line = fit_lag(rig_table(Machine(), sd=0.0), before)
    off = [find_first_fall_s(machine, machine.fall, n) - line.calc_lag_s(n) for n in SPEEDS_RPM]
    assert np.sqrt(np.mean(np.square(off))) < 0.003
    assert calc_drop_s(machine.fall, 70.0) == pytest.approx(
        calc_drop_s(Machine().fall, 70.0), abs=0.01
    )


def test_a_drop_that_hardly_depends_on_shaft_speed_is_the_same_for_a_start() -> None:
    flat = Machine().fall._replace(slope_s_per_rpm=0.0)
    assert find_first_fall_s(Machine(), flat, 70.0) == pytest.approx(1.8288, abs=1e-9)
    assert calc_drop_s(flat, 70.0) == pytest.approx(1.8288)
    machine, _ = fit_lag(rig_table(Machine(fall=flat), sd=0.0), Machine())
    assert calc_drop_s(machine.fall, 70.0) == pytest.approx(1.8288, abs=1e-6)


@pytest.mark.exam
def test_the_commands_write_new_machine_files_with_provenance(tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    done = topdress(
        "simulate",
        "--seconds",
        "200",
        "--out",
        log,
        "--effect",
        "speed.wheel_radius=2",
        "--effect",
        "canopy.head_fouled=-7.5#5",
    )
    assert done.exit_code == 0, done.output
    for what, said, record in (
        ("wheel", "wheel circumference, m", "speed.wheel_circumference_m"),
        ("heads", "head 5  off by -7.", "canopy.head_fouled"),
    ):
        out = tmp_path / f"{what}.yaml"
        result = topdress("calibrate", what, log, "--out", out)
        assert result.exit_code == 0, result.output
        assert said in result.output
        machine = yaml.safe_load(out.read_text())
        assert [(r["id"], r["data"], len(r["sha256"])) for r in machine["adopted"]] == [
            (record, str(log), 64)
        ]
        again = topdress("calibrate", what, log, "--out", out)
        assert again.exit_code == 2 and "nothing is overwritten" in again.output
    assert machine["heads"]["fouled_head"] == 5.0
