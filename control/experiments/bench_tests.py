"""Which cheap tests can a farm make in its yard, and what would each read under a given machine?"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from topdress.control.experiments.experiment import Experiment, join_list
from topdress.control.experiments.setting_levels import (
    USUAL_SPEED_MPS,
    list_opening_levels,
    list_shaft_levels,
)
from topdress.control.machine.fall import find_start_drop_s
from topdress.control.machine.flow import calc_grams_per_rev
from topdress.control.machine.heads import HeadInput, read_head
from topdress.control.machine.machine import Machine
from topdress.control.machine.scale import ScaleInput, read_scale
from topdress.control.machine.speed import SpeedInput, make_speed_start, step_speed
from topdress.control.machine.start_lag import calc_response_s

Array = npt.NDArray[np.float64]

# Shaft speeds and openings of the tests on the nominal machine; other machines take the same shares
# of their ranges.
SHAFT_RPM = (10.0, 20.0, 40.0, 60.0, 70.0, 80.0, 100.0)
OPENING_MM = (10.0, 25.0, 40.0)
# Ground speeds that a tractor holds, m/s.
SLOW_TEST_MPS, FAST_TEST_MPS = 0.8, 1.8
# Standard deviation of the mean of five starts, timed by the encoder, s.
START_SD_S = 0.003
# Standard deviation of the mean of five lags, by the rig or by hand, s: half the scatter of a lag.
LAG_SD_S = 0.03
# Standard deviation of the mean of five lags measured as a distance, m.
LANDING_SD_M = 0.04
# Standard deviation of the mean of three weighed catches of a minute, as a share.
CATCH_SD_SHARE = 0.004
# Standard deviation of a catch of one outlet, and of a speed by tape and watch, as a share.
OUTLET_SD_SHARE = 0.006
# Standard deviation of a wheel's pulses over 100 m, as a share: one in 640, three times, and the
# tape.
WHEEL_SD_SHARE = 0.004
# Standard deviation of the mean of three readings of a hopper's scale, kg.
STANDING_SD_KG = 0.15
# Standard deviations of heads over panels, NDVI: one panel, the same one again, several.
PANEL_SD_NDVI, SAME_PANEL_SD_NDVI, SEVERAL_PANELS_SD_NDVI = 0.005, 0.002, 0.003
TEST_WEIGHT_KG = 100.0
WARM_UP_S = 3600.0


def _make_test(
    id_: str, plan: str, minutes: float, reads: Callable[[Machine], Array]
) -> Experiment[Array]:
    return Experiment(id_, plan, minutes, (plan,), reads)


def _calc_lag_s(m: Machine, rpm: float, start: float = 0.0, change: float = 0.0) -> float:
    fall = m.fall
    return (
        calc_response_s(m, rpm)
        + find_start_drop_s(fall, rpm)
        + start * fall.first_fill_s
        - 0.5 * change * fall.asymmetry_s
    )


def _calc_landing_m(m: Machine, rpm: float, speed_mps: float) -> float:
    return float(
        speed_mps
        * (1.0 + m.fall.speed_scale_percent / 100.0)
        * (_calc_lag_s(m, rpm) + m.fall.latency_s)
        + m.fall.lever_arm_m
    )


def predict_wheel_mps(machine: Machine, true_mps: float, working: float = 1.0) -> float:
    """Returns the wheel speed that a machine reads at a true speed on level ground, m/s."""
    _, out = step_speed(
        machine.speed, make_speed_start(true_mps), SpeedInput(true_mps, working), 0.05
    )
    return float(out.wheel_mps)


def _predict_wheel(m: Machine) -> Array:
    return (
        np.array(
            [
                predict_wheel_mps(m, USUAL_SPEED_MPS, working) / USUAL_SPEED_MPS
                for working in (0.0, 1.0)
            ]
        )
        / WHEEL_SD_SHARE
    )


def make_two_rates_test(machine: Machine) -> str:
    """Describes the test that shows whether the air stream in the tube carries the falling
    granules."""
    _, _, mid, _, _, fast, _ = _choose_settings(machine)[0]
    return (
        f"a step from {mid:g} to {fast:g} r/min at the rig, ten times: time from the "
        "shaft's change until the "
        "plate stands half-way between its two readings; as a table with before_rpm "
        f"{mid:g}, shaft_rpm {fast:g} "
        "and drop_s it is for topdress calibrate lag"
    )


def _choose_settings(machine: Machine) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Returns shaft speeds, r/min, and openings, mm, of the tests on this machine."""
    return list_shaft_levels(machine, SHAFT_RPM), list_opening_levels(machine, OPENING_MM)


def _list_lag_tests(machine: Machine) -> list[Experiment[Array]]:
    low, slow, mid, high, upper, _, full = _choose_settings(machine)[0]
    each, all_speeds = (low, mid, upper), (low, mid, upper, full)
    return [
        _make_test(
            "response_test",
            f"response test: 5 starts each at {join_list(each)} r/min, encoder only, time from "
            "command to turning shaft",
            10.0,
            lambda m: np.array([calc_response_s(m, n) for n in each]) / START_SD_S,
        ),
        _make_test(
            "lag_rig",
            "lag test with the rig, machine standing: 5 starts each at "
            f"{join_list(all_speeds)} r/min, "
            "times written down",
            20.0,
            lambda m: np.array([_calc_lag_s(m, n) for n in all_speeds]) / LAG_SD_S,
        ),
        _make_test(
            "measured_speed",
            "measure the ground speed of the lag test over 30 m with tape and watch, 3 times",
            10.0,
            lambda m: np.array([1.0 + m.fall.speed_scale_percent / 100.0]) / OUTLET_SD_SHARE,
        ),
        _make_test(
            "lag_two_speeds",
            f"lag test by distance at two measured ground speeds, {SLOW_TEST_MPS:g} and "
            f"{FAST_TEST_MPS:g} m/s, 5 times each at {mid:g} r/min",
            30.0,
            lambda m: (
                np.array([_calc_landing_m(m, mid, v) for v in (SLOW_TEST_MPS, FAST_TEST_MPS)])
                / LANDING_SD_M
            ),
        ),
        _make_test(
            "lag_empty_running",
            f"lag test at {mid:g} r/min from an empty tube and as a change from {slow:g} "
            "r/min while running, 5 times each",
            15.0,
            lambda m: np.array([_calc_lag_s(m, mid, 1.0), _calc_lag_s(m, mid)]) / LAG_SD_S,
        ),
        _make_test(
            "lag_up_down",
            f"lag test of equal steps up and down, {slow:g} to {high:g} r/min, 5 times each",
            15.0,
            lambda m: (
                np.array([_calc_lag_s(m, mid, 0.0, 1.0), _calc_lag_s(m, mid, 0.0, -1.0)]) / LAG_SD_S
            ),
        ),
    ]


def _list_catch_tests(machine: Machine) -> list[Experiment[Array]]:
    (_, slow, mid, high, _, _, full), (narrow, usual, wide) = _choose_settings(machine)
    g_rev_mm = machine.flow.grams_per_rev_mm

    def caught(m: Machine, rpm: float, mm: float) -> float:
        return float(calc_grams_per_rev(m.flow, rpm, mm)) / (g_rev_mm * mm)

    def outlets(m: Machine) -> list[float]:
        return [
            1.0 + (k == m.flow.uneven_outlet) * m.flow.uneven_percent / 100.0
            for k in range(1, m.geometry.outlets + 1)
        ]

    return [
        _make_test(
            "catch_openings",
            f"catch test on a bench balance at {mid:g} r/min with openings of {narrow:g} and "
            f"{wide:g} mm, 3 catches of 60 s each",
            20.0,
            lambda m: np.array([caught(m, mid, o) for o in (narrow, wide)]) / CATCH_SD_SHARE,
        ),
        _make_test(
            "catch_speeds",
            f"catch test on a bench balance at {usual:g} mm with {join_list((slow, high, full))} "
            "r/min, 3 catches of 60 s each",
            20.0,
            lambda m: np.array([caught(m, n, usual) for n in (slow, high, full)]) / CATCH_SD_SHARE,
        ),
        _make_test(
            "catch_outlets",
            f"catch test by outlet at {mid:g} r/min and {usual:g} mm, 3 catches of 60 s",
            25.0,
            lambda m: np.array(outlets(m)) / OUTLET_SD_SHARE,
        ),
    ]


def _list_sensor_tests(_: Machine) -> list[Experiment[Array]]:
    def heads(
        m: Machine, ndvi: Sequence[float], on_s: Sequence[float], which: Sequence[int] = (0,)
    ) -> Array:
        return np.array(
            [
                read_head(m.heads, HeadInput(value, float(head), after_s))
                for value in ndvi
                for after_s in on_s
                for head in which
            ]
        )

    return [
        _make_test(
            "static_weigh",
            f"static weigh: put a known weight of {TEST_WEIGHT_KG:g} kg on the hopper, 3 times",
            10.0,
            lambda m: (
                np.array([read_scale(m.scale, ScaleInput(TEST_WEIGHT_KG, 0.0))]) / STANDING_SD_KG
            ),
        ),
        _make_test(
            "wheel_pulses",
            "drive a taped 100 m out of work, count the wheel's pulses, 3 times",
            10.0,
            lambda m: _predict_wheel(m)[:1],
        ),
        _make_test(
            "wheel_in_work",
            "drive a taped 100 m out of work and again in work, count the wheel's pulses, "
            "3 times each",
            20.0,
            _predict_wheel,
        ),
        _make_test(
            "heads_one_panel",
            "hold all heads over one reference panel at NDVI 0.5, a quarter of an hour after "
            "switching on",
            10.0,
            lambda m: (
                heads(m, (0.5,), (WARM_UP_S / 4,), range(1, m.geometry.heads + 1)) / PANEL_SD_NDVI
            ),
        ),
        _make_test(
            "heads_warming_up",
            "read one panel 1, 5 and 20 minutes after switching on, all heads",
            25.0,
            lambda m: heads(m, (0.5,), (60.0, 300.0, 1200.0)) / SAME_PANEL_SD_NDVI,
        ),
        _make_test(
            "heads_three_panels",
            "warm heads over panels of NDVI 0.3, 0.6 and 0.8",
            15.0,
            lambda m: heads(m, (0.3, 0.6, 0.8), (WARM_UP_S,)) / SEVERAL_PANELS_SD_NDVI,
        ),
    ]


def list_bench_tests(machine: Machine) -> tuple[Experiment[Array], ...]:
    """Returns every test, at settings within this machine's ranges."""
    return (*_list_lag_tests(machine), *_list_catch_tests(machine), *_list_sensor_tests(machine))
