"""A drive that changes its speed by a ramp: named with its size, not called slow; one without a ramp has none."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis import diagnose_run, extend
from control.machine.machine import Machine

FULL_RPM, STEP_S, TAU_S = 1000.0, 0.05, 0.05


def _machine() -> Machine:
    return Machine.model_validate({
        "stages": ["shaft"], "noise": {"shaft_rpm": 3.0}, "limits": {"shaft_low_rpm": 0, "shaft_high_rpm": FULL_RPM},
        "shaft": {"full_rpm": FULL_RPM, "acceleration_rpm_s": 1e6, "time_constant_s": TAU_S, "dead_time_s": 0}})


def _log(seed: int, ramp_s: float, slow_s: float = 0.0) -> dict[str, np.ndarray]:
    """Steps of all sizes, each held for three seconds; by an even ramp and a first order, in fine steps."""
    rng, fine = np.random.default_rng(seed), 50
    command = np.repeat(rng.uniform(50.0, 950.0, 60).round(), 60)
    speed, read = command[0], []
    most = FULL_RPM / ramp_s * STEP_S / fine if ramp_s > 0.0 else np.inf
    for asked in command:
        read.append(speed)
        for _ in range(fine):
            speed += float(np.clip((asked - speed) * STEP_S / fine / (TAU_S + slow_s), -most, most))
    return {"time_s": STEP_S * np.arange(len(command)), "shaft_rpm_cmd": command,
            "shaft_rpm": np.array(read) + 3.0 * rng.standard_normal(len(command))}


@pytest.mark.parametrize("ramp_s", [0.6, 2.0])
def test_a_ramp_is_named_with_its_size(ramp_s: float) -> None:
    found = diagnose_run(_log(3, ramp_s), _machine())
    ramp = next(one for one in found.causes if one.id == "shaft.ramp")
    assert found.verdict == "named" and ramp.probability > 0.9
    assert ramp.size.value == pytest.approx(ramp_s, rel=0.05)
    assert extend(_machine(), found).shaft.ramp_s == pytest.approx(ramp_s, rel=0.05)


@pytest.mark.parametrize(("slow_s", "names"), [(0.0, set()), (0.2, {"shaft.slow"})])
def test_what_has_no_ramp_is_not_said_to_have_one(slow_s: float, names: set[str]) -> None:
    found = diagnose_run(_log(4, 0.0, slow_s), _machine())
    assert {one.id for one in found.causes} == names
