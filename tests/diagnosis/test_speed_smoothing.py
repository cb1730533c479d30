"""A GNSS speed that comes late is found as late as it is, though the ground's speed is known by
noisy sensors alone."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from topdress.control.diagnosis.effects import SPEED_GNSS_LATENCY
from topdress.control.diagnosis.runs.channels import make_channels
from topdress.control.diagnosis.runs.diagnose import diagnose_run
from topdress.control.diagnosis.runs.hypothesis import EffectInstance, list_stages, make_schedule
from topdress.control.diagnosis.runs.log import clean_run_log
from topdress.control.diagnosis.runs.speed_and_heads import _measure_delay_s
from topdress.control.diagnosis.runs.stages import make_run_data
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

# of the delay: from gentle driving it is known to some 10 %
SHARE = 0.2
STEP_S = 0.025
# of a wheel's speed, m/s: five times its quick noise
WANDERS = {"slow_sd": 0.1, "slow_s": 3.0}


@pytest.mark.parametrize(
    "programme, wheel, late_s",
    [
        ("steady_rate", {}, 0.4),  # hardly changes its speed
        # changes it gently: smoothed over 3 s it was 0.63 s
        ("sine_speed", {}, 0.8),
        # starts and stops: smoothed over 12 s it would be 0.5 s
        ("stop_and_go", {}, 0.4),
        # the mean of both speeds held what the wheel wanders, which passed for a delay
        ("sine_speed", WANDERS, 0.0),
        ("sine_speed", WANDERS, 0.8),
    ],
)
def test_a_delay_is_neither_short_nor_made_up_by_the_noise_of_the_speed(
    hidden: SimpleNamespace, programme: str, wheel: dict[str, float], late_s: float
) -> None:
    machine = load_config("huanghai", MACHINE_KIND).model
    driven = next(one for one in hidden.programmes.PROGRAMMES if one.name == programme)
    plant = hidden.plant.Plant(hidden.programmes.drive(driven._replace(minutes=(15.0, 16.0)), 5))
    noises = hidden.noise.noises("ar1", plant.drive.row_s, np.random.default_rng(3))
    noises["wheel"] = noises["wheel"]._replace(**wheel)
    late = hidden.nominal.Effect("speed.gnss_latency", late_s)
    columns = hidden.runlog.columns(plant, hidden.nominal.Physics(), (late,), noises, 5)
    speed = make_channels(make_run_data(clean_run_log(columns), machine), machine)["speed"]

    def left(size: float) -> float:
        parts = (EffectInstance(SPEED_GNSS_LATENCY.id, size),)
        return float(
            np.var(
                speed.measured
                - speed.predict(make_schedule(list_stages(machine), parts), MAX_MODEL_STEP_S)
            )
        )

    found = min(np.arange(0.0, 1.5, STEP_S).tolist(), key=left)
    assert found == pytest.approx(late_s, rel=SHARE, abs=2.0 * STEP_S)


@pytest.mark.exam
def test_plateaus_of_speed_show_the_whole_latency() -> None:
    """Of a machine that hardly ever changes its speed, the noise of both sensors in their mean
    made a delay of 0.6 s look like one of 0.4 s."""
    machine = load_config("huanghai", MACHINE_KIND).model
    rng, late_s = np.random.default_rng(0), 0.6
    time_s = np.arange(0.0, 900.0, 0.1)
    at_s = np.sort(np.concatenate((np.arange(0.0, 900.0, 30.0), np.arange(1.0, 900.0, 30.0))))
    speed = np.interp(time_s, at_s[1:-1], np.repeat(rng.uniform(1.0, 2.0, 29), 2))
    gnss = np.interp(time_s - late_s, time_s, speed) + rng.normal(0.0, 0.06, len(time_s))
    wheel = speed + rng.normal(0.0, 0.06, len(time_s))
    columns = {
        "time_s": time_s,
        "speed_mps": gnss,
        "wheel_speed_mps": wheel,
    }
    found = diagnose_run(columns, machine)
    (late,) = (one for one in found.causes if one.id == SPEED_GNSS_LATENCY.id)
    assert late.size.value == pytest.approx(late_s, abs=0.06)


@pytest.mark.parametrize("step_s", [0.05, 0.2, 1.0])
def test_no_delay_is_measured_in_noise_that_the_speeds_do_not_share(step_s: float) -> None:
    """A machine at one speed: at a row a second no row lies within the memory of the filter."""
    time_s, delays_s = np.arange(0.0, 1500.0 * min(1.0, 4.0 * step_s), step_s), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        gnss, wheel = (1.4 + rng.normal(0.0, sd, len(time_s)) for sd in (0.03, 0.02))
        delays_s.append(_measure_delay_s(time_s, gnss, wheel))
    assert sum(delay_s > 0.0 for delay_s in delays_s) <= 1, delays_s


@pytest.mark.parametrize("step_s", [0.1, 0.2, 1.0])
def test_the_delay_of_a_speed_that_changes_is_measured(step_s: float) -> None:
    rng, time_s = np.random.default_rng(1), np.arange(0.0, 900.0, step_s)
    levels = rng.uniform(0.8, 2.2, 200)

    def drive(at_s):
        return np.interp(at_s / 5.0, np.arange(200), levels)

    late_s = 2.0 * step_s if step_s < 1.0 else 1.0
    gnss = drive(time_s - late_s) + rng.normal(0.0, 0.03, len(time_s))
    wheel = drive(time_s) + rng.normal(0.0, 0.02, len(time_s))
    assert abs(_measure_delay_s(time_s, gnss, wheel) - late_s) < 0.3 * step_s
