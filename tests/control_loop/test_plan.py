"""The pair of a tick: which strategy moves what, limits; told speeds believed as they came true."""

from __future__ import annotations

import datetime as dt
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.control.machine.fall import calc_drop_s
from topdress.control.machine.landing import calc_fall_times_s
from topdress.control.machine.machine import Machine, Tolerance
from topdress.control.machine.start_lag import set_carried_share
from topdress.control.metering.inverse_model import Conditions, calc_flow_kg_s
from topdress.control.metering.pair_planner import PairPlanner
from topdress.control.metering.strategies import DrivePair, find_pair
from topdress.control.orders import Strategy
from topdress.control.readings import (
    AnnouncedSpeeds,
    GnssFix,
    Measurements,
    Reading,
    drop_impossible,
)
from topdress.control.sensing import SpeedForecast, SpeedForecaster
from topdress.control.sensing.speed_forecast import QUICK_TAU_S, SpeedFilter
from topdress.control.simulation.assembly import make_control_loop
from topdress.drivers.files.run_setup import load_setup

DT_S = 0.05
# a lag test between two rates said so
CARRIES = Machine(tolerance=Tolerance(carried_share=0.05))
SINGLY = set_carried_share(CARRIES, 0.0)


def planned(
    strategy: Strategy, speeds: list[float], rate: float = 300.0, machine: Machine | None = None
) -> list[DrivePair]:
    """Pairs tick by tick, at speeds that are expected to stay."""
    machine = machine or CARRIES
    setting, pairs = PairPlanner(machine, strategy), []
    for k, mps in enumerate(speeds):
        pairs.append(
            setting.plan_pair(
                rate, SpeedForecast(mps, 0.0).predict_speed_mps, DT_S * k, DT_S, 20.0, Conditions()
            )
        )
        setting.record_command(pairs[-1])
    return pairs


def test_opening_first_leaves_the_shaft_alone_and_speed_first_the_gate() -> None:
    speeds = [1.0] * 60 + [1.4] * 60
    assert {p.shaft_rpm for p in planned(Strategy.OPENING_FIRST, speeds)} == {70.0}
    assert planned(Strategy.BALANCED, speeds) == planned(Strategy.OPENING_FIRST, speeds), (
        "a word of older files"
    )
    assert {p.opening_mm for p in planned(Strategy.SPEED_FIRST, speeds)} == {25.0}


def test_the_page_of_control_by_hand_has_the_figures_of_the_code() -> None:
    machine, page = (
        SETUP.machine,
        (Path(__file__).parents[2] / "docs" / "control.md").read_text(encoding="utf-8"),
    )
    lag_s = machine.gate.dead_time_s + 0.5 * DT_S + calc_drop_s(machine.fall, 70.0)
    mps = SpeedForecast(1.25, 0.5).predict_speed_mps(lag_s)
    openings = [planned(Strategy.OPENING_FIRST, [one])[0].opening_mm for one in (1.25, mps)]
    settled = (
        PairPlanner(machine, Strategy.SPEED_FIRST)
        .find_settled_pair(0.09, 25.0, Conditions())
        .shaft_rpm
    )
    exact = [
        find_pair(machine, Strategy.OPENING_FIRST, 300.0 * 2.4 * one / 10_000.0, 20.0).opening_mm
        for one in (1.25, mps)
    ]
    for text in (
        f"= {lag_s:.3f} s at 70",
        f"{mps:.2f} m/s in 1.30 s",
        f"| {1.25 * lag_s:.2f} m |",
        f"| {settled:.2f} r/min |",
        f"| {exact[0]:.2f} mm; {exact[1]:.2f} mm at {mps:.2f} m/s |",
        f"| {openings[0]:.1f} mm |",
    ):
        assert text in page
    assert openings == [pytest.approx(one, abs=0.05) for one in exact]


def test_where_granules_fall_singly_speed_first_lands_the_step_as_a_step() -> None:
    """Later granules come down sooner: a shaft that jumps would land a heap of them."""
    pairs = planned(Strategy.SPEED_FIRST, [1.0] * 60 + [1.3] * 120, machine=SINGLY)
    jumped = [pairs[0].shaft_rpm] * 60 + [pairs[-1].shaft_rpm] * 120
    time_s = DT_S * np.arange(len(pairs))

    def landed_share(rpm: list[float]) -> float:
        """Most that lands in a quarter of a second, as a share of what is wanted in the end."""
        fine_s, n = np.arange(0.0, 8.0, 0.005), np.array(rpm)
        smooth = np.interp(fine_s, time_s, n)
        lands = fine_s + calc_fall_times_s(
            fine_s, np.array([calc_drop_s(SINGLY.fall, x) for x in smooth.tolist()]), 0.0
        )
        mass, _ = np.histogram(lands, np.arange(2.0, 7.0, 0.25), weights=smooth)
        return float(mass.max() / (50.0 * n[-1]))

    assert landed_share([p.shaft_rpm for p in pairs]) < 1.04 and landed_share(jumped) > 1.3


@pytest.mark.parametrize("machine", [Machine(), CARRIES, SINGLY])
def test_an_abrupt_change_of_the_rate_is_the_gate_s_and_the_shaft_takes_over_slowly(
    machine: Machine,
) -> None:
    setting = PairPlanner(machine, Strategy.SPEED_FIRST)
    pairs, rate = [], 450.0
    for k in range(1400):
        if k == 100:
            setting.record_rate_change(450.0, 150.0)
            rate = 150.0
        setting.return_opening(DT_S)
        pairs.append(
            setting.plan_pair(
                rate, SpeedForecast(1.25, 0.0).predict_speed_mps, DT_S * k, DT_S, 25.0, Conditions()
            )
        )
        setting.record_command(pairs[-1])
    before, at, after = pairs[99], pairs[101], pairs[-1]
    assert before.opening_mm == 25.0 and at.opening_mm == pytest.approx(25.0 / 3.0, abs=0.3)
    assert at.shaft_rpm == pytest.approx(before.shaft_rpm, rel=0.03)
    assert after.opening_mm == 25.0 and after.shaft_rpm == pytest.approx(
        before.shaft_rpm / 3.0, rel=0.03
    )
    flows = [calc_flow_kg_s(machine, p.shaft_rpm, p.opening_mm) for p in pairs[105:]]
    assert min(flows) > 0.97 * flows[-1] and max(flows) < 1.03 * flows[-1]
    assert setting.find_gate_change_mm(300.0, 320.0) is None, "a small change is the shaft's"
    assert PairPlanner(machine, Strategy.OPENING_FIRST).find_gate_change_mm(450.0, 150.0) is None


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(list(Strategy)),
    st.lists(st.floats(0.0, 8.0), min_size=3, max_size=60),
    st.floats(0.0, 1000.0),
    st.sampled_from([Machine(), CARRIES, SINGLY]),
)
def test_no_plan_leaves_the_limits(
    strategy: Strategy, speeds: list[float], rate: float, machine: Machine
) -> None:
    limits = Machine().limits
    for pair in planned(strategy, speeds, rate, machine):
        if pair.shaft_rpm > 0.0:
            assert limits.shaft_low_rpm <= pair.shaft_rpm <= limits.shaft_high_rpm
            assert limits.opening_low_mm <= pair.opening_mm <= limits.opening_high_mm


def drive(
    forecaster: SpeedForecaster, speeds: list[float], told: list[AnnouncedSpeeds | None]
) -> list[SpeedForecast]:
    made, before = [], speeds[0]
    for k, (mps, one) in enumerate(zip(speeds, told, strict=True)):
        made.append(forecaster.forecast_speed(DT_S * k, mps, (mps - before) / DT_S, DT_S, one))
        before = mps
    return made


def ramps(times: int) -> tuple[list[float], list[AnnouncedSpeeds]]:
    """From 1 to 2 m/s and back with 0.5 m/s2, again and again, each told two seconds ahead."""
    speeds, told, mps = [], [], 1.0
    for k in range(times * 160):
        aim = 2.0 if (k // 80) % 2 else 1.0
        left_s = (80 - k % 80) * DT_S
        mps += min(0.5 * DT_S, max(-0.5 * DT_S, aim - mps))
        speeds.append(mps)
        told.append(
            AnnouncedSpeeds(
                DT_S * k, ((0.0, aim), (left_s, 3.0 - aim)) if left_s < 2.0 else ((0.0, aim),)
            )
        )
    return speeds, told


def test_what_is_told_and_comes_true_is_believed() -> None:
    speeds, told = ramps(4)
    forecaster = SpeedForecaster()
    made = drive(forecaster, speeds, list(told))
    assert forecaster.reference_weight > 0.9
    at = 3 * 160 + 70  # half a second before it speeds up
    assert made[at].predict_speed_mps(1.3) == pytest.approx(speeds[at + 26], abs=0.06)
    assert made[at].predict_way_m(1.3) == pytest.approx(sum(speeds[at : at + 26]) * DT_S, abs=0.06)
    assert drive(SpeedForecaster(), speeds, [None] * len(speeds))[at].predict_speed_mps(
        1.3
    ) == pytest.approx(1.0, abs=0.02)


def test_what_is_told_and_does_not_come_true_is_not() -> None:
    _, told = ramps(4)
    forecaster = SpeedForecaster()
    made = drive(forecaster, [1.0] * len(told), list(told))
    assert forecaster.reference_weight < 0.1
    assert made[-1].predict_speed_mps(1.3) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("noise_mps", "most_mps"), [(0.0, 0.005), (0.02, 0.02), (0.06, 0.04)])
def test_what_counts_as_steady_follows_the_noise_of_the_wheel_and_a_change_is_still_seen(
    noise_mps: float, most_mps: float
) -> None:
    """A band for 0.02 m/s leaves 0.15 m/s of a forecast at 0.06, ten times what the gate leaves
    out."""
    rng, quick, forecaster, ahead = (
        np.random.default_rng(1),
        SpeedFilter(1.25),
        SpeedForecaster(),
        [],
    )
    for k in range(1400):
        mps = 1.25 + 0.5 * DT_S * max(0, k - 1360)
        quick = quick.extrapolate(DT_S).take_sample(
            mps + noise_mps * float(rng.standard_normal()), DT_S, QUICK_TAU_S
        )
        ahead.append(
            forecaster.forecast_speed(
                DT_S * k, quick.speed_mps, quick.acceleration_mps2, DT_S
            ).predict_speed_mps(1.3)
        )
    assert float(np.std(ahead[800:1360])) < most_mps
    assert ahead[-1] > 1.25 + 0.5 * DT_S * 40 + 0.1, "2 s of 0.5 m/s2: it goes on"


def test_what_was_told_long_ago_says_nothing() -> None:
    old = AnnouncedSpeeds(0.0, ((0.0, 3.0),))
    made = drive(SpeedForecaster(), [1.0] * 100, [old] * 100)
    assert made[10].announced_mps and not made[-1].announced_mps


@pytest.mark.parametrize(
    "told",
    [
        AnnouncedSpeeds(0.0, ()),
        AnnouncedSpeeds(nan, ((0.0, 1.0),)),
        AnnouncedSpeeds(0.0, ((0.0, inf),)),
        AnnouncedSpeeds(0.0, ((0.0, nan),)),
        AnnouncedSpeeds(0.0, ((1.0, 1.0),)),
        AnnouncedSpeeds(0.0, ((0.0, 1.0), (0.0, 2.0))),
        AnnouncedSpeeds(0.0, ((0.0, 1.0),), 0.0),
        AnnouncedSpeeds(0.0, ((0.0, 1.0), (nan, 2.0))),
        AnnouncedSpeeds(0.0, ((0.0, 1.0),), nan),
    ],
)
def test_told_speeds_that_cannot_be_are_never_heard(told: AnnouncedSpeeds) -> None:
    assert drop_impossible(Measurements(1.0, speed_told=told)).speed_told is None


# --- How long a log row holds a value that no longer comes: the published times, as the loop
# writes them -------------

SETUP = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
PUBLISHED_S = {
    "shaft_rpm": 0.5,
    "opening_mm": 0.5,
    "wheel_speed_mps": 1.0,
    "pitch_deg": 1.0,
    "roll_deg": 1.0,
    "hopper_kg": 2.0,
    "supply_v": 2.0,
    "ndvi_1": 1.25,
    "lat_deg": 1.0,
}


@pytest.mark.parametrize("column", PUBLISHED_S)
def test_a_value_stands_for_its_time_and_then_the_cell_is_empty(column: str) -> None:
    heard = Reading(1.0, 100.0)
    said = (
        {"gnss": GnssFix(100.0, 34.28, 119.88, 4, speed_mps=1.0, heading_deg=0.0)}
        if column == "lat_deg"
        else ({"ndvi": (heard,) * 6} if column == "ndvi_1" else {column: heard})
    )
    loop = make_control_loop(SETUP.machine, SETUP.crop, SETUP.rule, SETUP.job)
    held_s = PUBLISHED_S[column]
    for age_s, stands in ((0.0, True), (held_s - 0.01, True), (held_s + 0.01, False)):
        row = loop.run_tick(Measurements(100.0 + age_s, **said)).row  # type: ignore[arg-type]
        assert (getattr(row, column) is not None) is stands
