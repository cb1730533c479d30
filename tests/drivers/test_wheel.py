"""Wheel speed from pulses and the board's clock."""
from __future__ import annotations

import pytest

from drivers.devices.wheel import WheelGeometry, WheelSpeed

WAY_M = 0.15625


def drive(wheel: WheelSpeed, speed_mps: float, seconds: float, start_us: int = 1_000_000, pulses: int = 1,
          status_hz: int = 20) -> list[float | None]:
    """Exact pulses at a constant speed, told at the status rate; the first one falls at `start_us`."""
    found = []
    for tick in range(int(seconds * status_hz)):
        now_s = tick / status_hz
        done = int(now_s * speed_mps / WAY_M + 1e-9)
        at_us = start_us + round(done * WAY_M / speed_mps * 1e6) if speed_mps else start_us
        found.append(wheel.update((start_us + round(now_s * 1e6)) % 2**32, (pulses + done) % 2**32, at_us % 2**32))
    return found


@pytest.mark.parametrize("speed_mps", [0.3, 1.25, 5.0, 12.0])
def test_constant_speed_is_met_once_two_pulses_have_come(speed_mps):
    found = drive(WheelSpeed(WheelGeometry(2.50, 16)), speed_mps, 4.0)
    assert found[20:] == [pytest.approx(speed_mps, rel=1e-4)] * 60


def test_circumference_and_pulses_per_turn_count():
    assert drive(WheelSpeed(WheelGeometry(5.0, 8)), 1.25, 4.0)[-1] == pytest.approx(5.0, rel=1e-4)


def test_no_pulse_for_eight_tenths_of_a_second_is_standstill_and_the_speed_falls_before():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 2.0)                                     # last pulse: number 16, at 2.875 s
    after = [wheel.update(2_875_000 + ms * 1000, 16, 2_875_000) for ms in (100, 200, 400, 799, 800)]
    assert after == [pytest.approx(1.25), pytest.approx(WAY_M / 0.2), pytest.approx(WAY_M / 0.4),
                     pytest.approx(WAY_M / 0.799), 0.0]


def test_both_counters_wrap():
    found = drive(WheelSpeed(WheelGeometry()), 1.25, 4.0, start_us=2**32 - 2_000_000, pulses=2**32 - 5)
    assert found[20:] == [pytest.approx(1.25, rel=1e-4)] * 60


def test_a_restarted_board_begins_anew():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 4.0, pulses=5000)
    found = drive(wheel, 1.25, 4.0, start_us=200_000)
    assert all(speed is not None and 0.0 <= speed <= 1.2501 for speed in found)
    assert found[-1] == pytest.approx(1.25, rel=1e-4)


def test_impossible_counts_are_no_speed():
    wheel = WheelSpeed(WheelGeometry())
    drive(wheel, 1.25, 2.0)
    assert wheel.update(3_050_000, 5000, 3_049_000) is None


def test_a_wheel_that_never_turned_stands():
    assert WheelSpeed(WheelGeometry()).update(100_000, 0, 0) == 0.0
