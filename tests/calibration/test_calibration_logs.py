"""Calibrations from run logs, and the lag rig's ramp: hidden figures come back in their intervals, doubts are said."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from control.calibration import BenchTable, WheelLog, check_heads, fit_lag, fit_wheel
from control.geodesy import TangentPlane
from control.machine.fall import drop_s
from control.machine.machine import Adopted, Machine
from control.machine.start import first_fall_s
from tests.command import topdress

MACHINE = Machine(adopted=(Adopted(id="speed.wheel_radius", size=1.0), Adopted(id="canopy.head_fouled", size=-3.0)))
PLANE = TangentPlane(34.28, 119.88)


def drive(circumference_m: float, *, slip_percent: float = 0.0, idle_s: float = 150.0, work_s: float = 200.0,
          seed: int = 1, quality: float = 4.0, place_sd_m: float = 0.02) -> WheelLog:
    """North, idle and then at work, at about 1.5 m/s and 20 rows a second, wheel counted by 2.50 m; fixes at 10 Hz."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, idle_s + work_s, 0.05)
    speed = 1.5 + 0.2 * np.sin(time / 7.0)
    flowing = time >= idle_s
    north = np.cumsum(speed) * 0.05
    wheel = speed * 2.5 / circumference_m * (1.0 + slip_percent / 100.0 * flowing)
    wheel += 0.02 * rng.standard_normal(len(time))
    fix = np.arange(len(time)) // 2 * 2
    noise = place_sd_m * rng.standard_normal((len(time), 2))
    lat, lon = np.array([PLANE.to_deg(noise[k, 0], north[k] + noise[k, 1]) for k in fix[::2]]).repeat(2, axis=0).T
    return WheelLog(time, lat, lon, np.full(len(time), quality), wheel, flowing)


def test_the_circumference_comes_back_within_its_interval_and_slip_apart() -> None:
    inside = slip_inside = 0
    for seed in range(20):
        machine, fit = fit_wheel(drive(2.43, slip_percent=6.0, seed=seed), MACHINE, 2.5, "farm/run.csv")
        inside += fit.circumference_m.low <= 2.43 <= fit.circumference_m.high
        assert fit.slip_percent is not None and not fit.at_work
        slip_inside += fit.slip_percent.low <= 6.0 <= fit.slip_percent.high
        assert machine.speed.wheel_circumference_m == fit.circumference_m.value
        assert fit.circumference_m.high - fit.circumference_m.low < 0.01
    assert inside >= 15 and slip_inside >= 15                       # 90 % of 20 is 18
    assert [r.id for r in machine.adopted] == ["canopy.head_fouled", "speed.wheel_circumference_m"]
    assert machine.adopted[1].data == "farm/run.csv" and "wheel from run.csv" in machine.title


def test_way_at_work_alone_holds_the_slip_and_says_so() -> None:
    _, fit = fit_wheel(drive(2.5, slip_percent=6.0, idle_s=30.0), MACHINE, 2.5, "run.csv")
    assert fit.at_work and "slip under load" in fit.notes[0]
    assert fit.circumference_m.value == pytest.approx(2.5 / 1.06, rel=2e-3)


def test_poor_fixes_are_said_and_too_little_way_is_refused() -> None:
    _, fit = fit_wheel(drive(2.5, quality=2.0), MACHINE, 2.5, "run.csv")
    assert "fix quality down to 2" in fit.notes[0]
    with pytest.raises(ValueError, match=r"run\.csv: \d+ straight stretches of 10 m.*at least 5 and 100 m"):
        fit_wheel(drive(2.5, idle_s=20.0, work_s=20.0), MACHINE, 2.5, "run.csv")
    blind = drive(2.5)._replace(lat_deg=np.full(7000, np.nan))
    with pytest.raises(ValueError, match="both are needed"):
        fit_wheel(blind, MACHINE, 2.5, "run.csv")


def test_curves_are_no_straight_way() -> None:
    log = drive(2.5)
    angle = np.cumsum(1.5 * np.ones(len(log.time_s))) * 0.05 / 15.0
    lat, lon = np.array([PLANE.to_deg(15.0 * np.sin(a), 15.0 * np.cos(a)) for a in angle]).T
    with pytest.raises(ValueError, match="0 straight stretches"):
        fit_wheel(log._replace(lat_deg=lat, lon_deg=lon), MACHINE, 2.5, "run.csv")


def ndvi(gains: dict[int, float], *, seconds: float = 300.0, seed: int = 1, spread: float = 0.05) -> tuple[Any, Any]:
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
        machine, fit = check_heads(time, values, MACHINE, "run.csv")
        false += any(head.fouled for head in fit.heads)
        assert machine.heads.fouled_percent == 0.0 or false
    assert false <= 1
    time, values = ndvi({2: -6.0})
    machine, fit = check_heads(time, values, MACHINE, "run.csv", date="2026-05-01")
    assert [head.number for head in fit.heads if head.fouled] == [2]
    worst = fit.heads[1].gain_percent
    assert worst.low <= -6.0 <= worst.high and fit.heads[1].samples == 600
    assert (machine.heads.fouled_head, machine.heads.fouled_percent) == (2.0, pytest.approx(worst.value, abs=1e-3))
    assert [(r.id, r.member) for r in machine.adopted] == [("speed.wheel_radius", None), ("canopy.head_fouled", 2)]


def test_two_fouled_heads_do_not_blame_the_others() -> None:
    time, values = ndvi({1: -9.0, 6: -7.0})
    machine, fit = check_heads(time, values, MACHINE, "run.csv")
    assert [head.number for head in fit.heads if head.fouled] == [1, 6]
    assert machine.heads.fouled_head == 1.0
    assert any("heads 1, 6 are fouled" in note for note in fit.notes)


def test_gain_and_offset_are_told_apart_only_on_a_canopy_that_varies() -> None:
    time, values = ndvi({}, spread=0.2)
    values[:, 3] += 0.05
    _, fit = check_heads(time, values, MACHINE, "run.csv")
    assert fit.heads[3].fouled and fit.heads[3].slope == pytest.approx(1.0, abs=0.05)
    assert fit.heads[3].offset == pytest.approx(0.05, abs=0.02)
    noise = 0.01 * np.random.default_rng(1).standard_normal((400, 6))
    _, even = check_heads(time[:400], 0.5 + noise, MACHINE, "run.csv")
    assert even.heads[0].slope is None and any("too even" in note for note in even.notes)


def test_silent_heads_and_short_logs_are_said() -> None:
    time, values = ndvi({})
    values[:, 5] = np.nan
    _, fit = check_heads(time, values, MACHINE, "run.csv")
    assert fit.silent == (6,) and "head 6 is silent" in fit.notes
    with pytest.raises(ValueError, match=r"run\.csv: 40 s of readings"):
        check_heads(time[:156], values[:156], MACHINE, "run.csv")
    values[:, :4] = np.nan
    with pytest.raises(ValueError, match="1 heads with readings: at least 3"):
        check_heads(time, values, MACHINE, "run.csv")


SPEEDS_RPM = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0)


def rig_table(machine: Machine, sd: float = 0.01, responses: bool = True) -> BenchTable:
    rng = np.random.default_rng(2)
    rpm = np.repeat(SPEEDS_RPM, 10)
    first = {n: first_fall_s(machine, machine.fall, n) for n in SPEEDS_RPM}
    columns = {"shaft_rpm": rpm, "drop_s": np.array([first[n] for n in rpm]) + sd * rng.standard_normal(len(rpm))}
    if responses:
        columns["response_s"] = np.full(len(rpm), 0.383)
    return BenchTable("lag", columns, path="rig.csv")


def test_a_lag_rigs_drop_times_give_the_line_of_a_start_with_and_without_a_response_column() -> None:
    true = Machine()
    before = true.model_copy(update={"fall": true.fall._replace(intercept_s=1.5, slope_s_per_rpm=-0.004)})
    both, _ = fit_lag(rig_table(true), before)
    alone, _ = fit_lag(rig_table(true, responses=False), before)
    assert both.fall == alone.fall
    assert both.fall.intercept_s == pytest.approx(1.8288, abs=0.015)
    assert both.fall.slope_s_per_rpm == pytest.approx(-0.0083, abs=3e-4)


def test_a_calibrated_machine_played_through_the_rigs_test_gives_the_line_again() -> None:
    before = Machine(fall=Machine().fall._replace(intercept_s=1.5, slope_s_per_rpm=-0.004, start_more_per_rpm=0.0))
    machine, line = fit_lag(rig_table(Machine(), sd=0.0), before)
    off = [first_fall_s(machine, machine.fall, n) - line.lag_s(n) for n in SPEEDS_RPM]
    assert np.sqrt(np.mean(np.square(off))) < 0.003
    assert drop_s(machine.fall, 70.0) == pytest.approx(drop_s(Machine().fall, 70.0), abs=0.01)


def test_a_drop_that_hardly_depends_on_shaft_speed_is_the_same_for_a_start() -> None:
    flat = Machine().fall._replace(slope_s_per_rpm=0.0)
    assert first_fall_s(Machine(), flat, 70.0) == pytest.approx(1.8288, abs=1e-9)
    assert drop_s(flat, 70.0) == pytest.approx(1.8288)
    machine, _ = fit_lag(rig_table(Machine(fall=flat), sd=0.0), Machine())
    assert drop_s(machine.fall, 70.0) == pytest.approx(1.8288, abs=1e-6)


def test_the_commands_write_new_machine_files_with_provenance(tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    done = topdress("simulate", "--seconds", "200", "--out", log, "--effect", "speed.wheel_radius=2", "--effect",
                    "canopy.head_fouled=-7.5#5")
    assert done.exit_code == 0, done.output
    for what, said, record in (("wheel", "wheel circumference, m", "speed.wheel_circumference_m"),
                               ("heads", "head 5  off by -7.", "canopy.head_fouled")):
        out = tmp_path / f"{what}.yaml"
        result = topdress("calibrate", what, log, "--out", out)
        assert result.exit_code == 0, result.output
        assert said in result.output
        machine = yaml.safe_load(out.read_text())
        assert [(r["id"], r["data"], len(r["sha256"])) for r in machine["adopted"]] == [(record, str(log), 64)]
        again = topdress("calibrate", what, log, "--out", out)
        assert again.exit_code == 2 and "nothing is overwritten" in again.output
    assert machine["heads"]["fouled_head"] == 5.0
