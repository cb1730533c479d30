"""A drive that rings after a step, or answers through two time constants: found, said, adopted,
and no healthy one.

The logs are sums of step responses in closed form (Ogata, Modern Control Engineering, 2010,
5-3), none of the model's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from topdress.control.diagnosis.extend import extend
from topdress.control.diagnosis.runs.compared import compared
from topdress.control.diagnosis.runs.diagnose import diagnose_run, judge_run
from topdress.control.diagnosis.runs.hypothesis import EffectInstance
from topdress.control.machine.machine import list_effect_sizes
from topdress.drivers.files.config import load_config, save_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

from tests.diagnosis.logs import DRIVE, Columns

Array = npt.NDArray[np.float64]
Response = Callable[[Array], Array]
DEAD_S, ROW_S, HOLD_ROWS, NOISE_RPM = 0.02, 0.02, 50, 2.0


def rings(omega: float, damping: float) -> Response:
    """Natural frequency in rad/s, damping ratio below 1."""
    damped = omega * math.sqrt(1.0 - damping**2)
    return lambda t: (
        1.0
        - np.exp(-damping * omega * t)
        * (np.cos(damped * t) + damping * omega / damped * np.sin(damped * t))
    )


def two_lags(first_s: float, second_s: float) -> Response:
    return lambda t: (
        1.0
        - (first_s * np.exp(-t / first_s) - second_s * np.exp(-t / second_s)) / (first_s - second_s)
    )


def one_lag(tau_s: float) -> Response:
    return lambda t: 1.0 - np.exp(-t / tau_s)


def log_of(seed: int, response: Response, steps: int = 40) -> Columns:
    rng = np.random.default_rng(seed)
    asked = np.repeat(rng.uniform(60.0, 600.0, steps), HOLD_ROWS)
    time_s = ROW_S * np.arange(len(asked))
    rpm = np.full(len(asked), asked[0])
    for row in range(HOLD_ROWS, len(asked), HOLD_ROWS):
        rpm += (asked[row] - asked[row - 1]) * response(
            np.maximum(0.0, time_s - time_s[row] - DEAD_S)
        )
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": asked,
        "shaft_rpm": rpm + NOISE_RPM * rng.standard_normal(len(asked)),
    }


# T T2 s^2 + T s + 1: of a swing T = 2 z / w and T2 = 1 / (2 z w), of two lags T = a + b and T2
# = a b / (a + b).
CASES = {
    "rings": (rings(15.0, 0.25), 0.5 / 15.0 - 0.06, 2.0 / 15.0, 44.4),
    "rings slowly": (rings(6.0, 0.25), 0.5 / 6.0 - 0.06, 2.0 / 6.0, 44.4),
    "overshoots": (rings(12.0, 0.6), 0.1 - 0.06, 1.0 / 14.4, 9.5),
    "rings long": (rings(30.0, 0.1), 0.2 / 30.0 - 0.06, 5.0 / 30.0, 72.9),
    "two lags": (two_lags(0.2, 0.1), 0.24, 0.02 / 0.3, 0.0),
    "two short lags": (two_lags(0.06, 0.03), 0.03, 0.02, 0.0),
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exam] * (name not in ("rings", "two lags")))
        for name in CASES
    ],
)
@pytest.mark.exam
def test_it_is_named_with_its_size_said_and_the_file_with_it_predicts_another_recording(
    name: str, tmp_path: Any
) -> None:
    response, slow_s, second_s, overshoot_percent = CASES[name]
    found = diagnose_run(log_of(1, response), DRIVE)
    assert found.verdict == "named"
    sizes = {cause.id: cause.size for cause in found.causes}
    assert set(sizes) == {"shaft.slow", "shaft.second_order"}
    assert sizes["shaft.second_order"].low < second_s < sizes["shaft.second_order"].high
    assert sizes["shaft.slow"].low < slow_s < sizes["shaft.slow"].high
    assert sizes["shaft.second_order"].high - sizes["shaft.second_order"].low < 0.003
    assert next(
        cause for cause in found.causes if cause.id == "shaft.second_order"
    ).advice.startswith("Where it overshoots: lower the gains")
    said = next(one for one in found.findings if one.startswith("shaft.second_order"))
    if overshoot_percent:
        overshoot = re.search(r"overshoots by ([\d.]+) %", said)
        assert overshoot
        assert float(overshoot[1]) == pytest.approx(overshoot_percent, abs=1.0)
    else:
        assert "does not overshoot: two time constants" in said
    path = tmp_path / "adopted.yaml"
    save_config(path, extend(DRIVE, found), MACHINE_KIND)
    adopted = load_config(str(path), MACHINE_KIND).model
    assert set(list_effect_sizes(adopted)) == {"shaft.slow", "shaft.second_order"}
    asked = compared(log_of(2, response), DRIVE, adopted).channels[0]
    assert asked.new < 1.05 * NOISE_RPM < 0.2 * asked.old


@pytest.mark.parametrize(
    "seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.exam) for seed in range(6, 10))]
)
def test_a_healthy_drive_is_silent(seed: int) -> None:
    tau_s = 0.06 + 0.008 * float(np.random.default_rng(100 + seed).standard_normal())
    found = diagnose_run(log_of(seed, one_lag(tau_s)), DRIVE)
    assert (found.verdict, found.causes, found.terms) == ("none", (), ())


@pytest.mark.exam
def test_sizes_are_within_their_intervals_as_often_as_these_say() -> None:
    held = []
    for seed in range(3, 15):
        for response, second_s in (
            (rings(12.0, 0.6), 1.0 / 14.4),
            (two_lags(0.1, 0.04), 0.004 / 0.14),
        ):
            size = {
                cause.id: cause.size for cause in diagnose_run(log_of(seed, response), DRIVE).causes
            }["shaft.second_order"]
            held.append(size.low < second_s < size.high)
    assert sum(held) >= 19  # of 24 at 90 %: fewer in 5 of 100 tries


@pytest.mark.exam
def test_a_late_drive_of_another_time_constant_within_its_tolerance_is_late_and_nothing_else() -> (
    None
):
    """Moves come later with the dead time, and what the time constant's tolerance does comes
    with them."""
    late_s, tau_s = 0.3, 0.045
    log = log_of(1, lambda t: one_lag(tau_s)(np.maximum(0.0, t - late_s)))
    judged = judge_run(log, DRIVE)
    assert [cause.id for cause in judged.found.causes] == ["shaft.dead_time"]
    assert judged.found.causes[0].size.value == pytest.approx(late_s, abs=0.003)
    shaft = next(group for group in judged.groups if "shaft" in group.search.model.names)
    assert shaft.search.model.offsets["shaft.time_constant_s"] == pytest.approx(
        tau_s - 0.06, abs=0.003
    )


@pytest.mark.parametrize("sds", [1.0, 3.0])
def test_what_a_small_motor_has_by_nature_is_no_finding(sds: float) -> None:
    """Its electrical time constant, 4 % of the mechanical one (1 s.d.), which no data sheet's
    single one has in it."""
    found = diagnose_run(log_of(0, two_lags(0.06, 0.04 * 0.06 * sds)), DRIVE)
    assert (found.verdict, found.causes, found.terms) == ("none", (), ())


def test_a_dead_time_of_a_while_leaves_tolerances_where_they_are() -> None:
    """Their columns moved with it, and fitted what was left of the noise."""
    columns = judge_run(log_of(1, one_lag(0.06)), DRIVE).groups[0].search.columns
    for later, moved in (
        (EffectInstance("shaft.dead_time", 0.1), True),
        (EffectInstance("shaft.dead_time", 0.1, 10.0, until_s=12.0), False),
    ):
        lags = [
            next(
                c.coefficients["shaft"]
                for c in columns.list_fixed_columns(parts)
                if c.label.name.endswith("constant_s")
            )
            for parts in ((), (later,))
        ]
        assert np.array_equal(*lags) is not moved
