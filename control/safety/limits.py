"""Which time-outs and thresholds do the safety rules use? Each has its unit in its name; the
defaults are the published table.

No other module of this package contains a number that decides."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from topdress.control.signals import VALID_FOR

# Share of the nominal supply below which the supply is low: 11.5 V of 13.5 V.
LOW_SUPPLY_SHARE = 0.85


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Holds the limits at which flow stops, the state changes or an alarm is raised.

    Raises ValueError, one line with key, value and allowed values, when a value is not a finite
    number of at least zero or a pair is in the wrong order.
    """

    # Flow starts at or above the first speed, m/s, and stops below the second; a sensor counts as
    # moving at or above the second.
    start_speed_mps: float = 0.5
    stop_speed_mps: float = 0.3
    # Whether GNSS and wheel must both move (to calibrate: both stand); False only where one of them
    # is not fitted.
    both_speeds_to_start: bool = True
    # With START held, flow begins from this speed on by both sensors.
    launch_speed_mps: float = 0.1
    # START counts as held while it is repeated sooner than this.
    launch_confirm_s: float = 0.5
    # Flow below start_speed_mps lasts at most this long.
    launch_max_s: float = 3.0
    # Below this speed the machine stands, also without news from the wheel.
    standstill_speed_mps: float = 0.1
    # Standing this long while working leads to held.
    standstill_hold_s: float = 10.0
    # Both speeds silent this long leads to held.
    speed_silent_s: float = 2.0
    # An older wheel reading is not used.
    wheel_silent_s: float = VALID_FOR["wheel_speed_mps"].safety_s
    # GNSS above this speed while the wheel stands is a wheel fault.
    wheel_fault_speed_mps: float = 0.5
    # The fault must last this long: a GNSS speed arrives up to 1 s late.
    wheel_fault_s: float = 0.5
    # Work without a wheel needs ten GNSS epochs a second.
    gnss_alone_period_s: float = 0.12
    # Time after which an undecided contradiction of wheel and GNSS leads to held, s; wheels spin
    # for 1 to 4 s.
    speeds_differ_s: float = 6.0
    # A larger change of course across a standstill, degrees, means reversing.
    reverse_flip_deg: float = 120.0
    # From this GNSS speed on its course is trusted.
    course_speed_mps: float = 0.2
    # Time after which a drive is silent, s. GNSS is silent after the larger of a time and a number
    # of epochs.
    drive_silent_s: float = VALID_FOR["shaft_rpm"].safety_s
    gnss_silent_s: float = VALID_FOR["lat_deg"].safety_s
    gnss_silent_periods: float = 2.5
    # A longer observed period counts as this.
    gnss_period_max_s: float = 2.0
    ndvi_silent_s: float = VALID_FOR["ndvi_1"].safety_s
    heads_min: int = 4
    # Dense wheat reads 0.93 at most: when all heads read more, they are covered or wet.
    heads_full_ndvi: float = 0.95
    heads_full_s: float = 2.0
    scale_silent_s: float = VALID_FOR["hopper_kg"].safety_s
    supply_silent_s: float = VALID_FOR["supply_v"].safety_s
    # Supply of a tractor of 12 V whose alternator no longer charges, V; of another machine
    # `LOW_SUPPLY_SHARE` of its nominal supply.
    supply_low_v: float = 11.5
    # Time after which a low supply is an alarm, s: longer than the start of an engine.
    supply_low_s: float = 5.0
    console_hold_s: float = 2.0
    console_off_s: float = 60.0
    # Speed below which a shaft stands, r/min: six standard deviations of the nominal encoder's 0.3
    # r/min (`standstill_monitor`).
    shaft_stands_rpm: float = 2.0
    # Maximum additional delay of a drive over the machine model, s.
    stand_settle_s: float = 0.15
    # Time after which a decelerating shaft is an alarm too, s.
    run_down_max_s: float = 5.0
    # Minimum time for which a shaft must turn, without a break and without deceleration, s.
    stand_confirm_s: float = 0.5
    # A gate within this distance of its place stands: 30 times the sensor's noise.
    gate_stands_mm: float = 3.0
    # Time of a valve to close: at most 2 s in a machine file, and the delay of the board's line.
    valve_closes_s: float = 3.0
    # Difference from the model, in % of the set-point, that no trim can correct (`work_watch`).
    drive_far_percent: float = 20.0
    # Time after which such a difference is a fault, s: slow motors (0.5 s) arrive within it.
    drive_far_s: float = 2.0
    # Smaller difference, trim included, that the gate may compensate, %.
    shaft_off_percent: float = 5.0
    # Time after which such a difference is an alarm, s: the trim (5 s) corrects 10 % in twice its
    # time constant.
    shaft_off_s: float = 10.0
    # Difference of the gate, mm: 15 standard deviations of the sensor, more than half of the usual
    # backlash (2 mm).
    gate_off_mm: float = 1.5
    # Time after which such a difference is an alarm, s: the trim corrects 3 mm in 3.5 s.
    gate_off_s: float = 2.0
    # Minimum reference of a relative rate error, kg/ha.
    rate_floor_kg_ha: float = 50.0
    rate_amber_percent: float = 10.0
    rate_amber_s: float = 3.0
    rate_red_percent: float = 20.0
    rate_red_s: float = 2.0
    # Absolute limit of the product, kg/ha; a rate above it for `rate_max_s` leads to held.
    rate_max_kg_ha: float = 1000.0
    rate_max_s: float = 1.0
    # Time beyond the machine's range until the alarm. A machine that starts or stops at
    # 0.5 m/s2 passes the speeds at which its gate cannot close further in 2 s.
    beyond_range_s: float = 3.0
    # Trim by the scale above which an alarm is raised, %.
    trimmed_percent: float = 5.0
    hopper_empty_kg: float = 0.5
    hopper_low_kg: float = 30.0
    # Hysteresis of the empty and low limits, kg; both conditions must last `hopper_confirm_s`.
    hopper_clear_kg: float = 1.0
    hopper_confirm_s: float = 1.0
    # Calibrating begins below the first speed by wheel and GNSS; above the second it is a fault.
    calibrate_speed_mps: float = 0.1
    calibrate_fault_speed_mps: float = 0.2
    # Maximum length of a calibrating run, s.
    calibrate_max_s: float = 120.0
    # Hold-to-run: the order must be repeated sooner than this.
    calibrate_confirm_s: float = 0.5
    # Time without a cause after which an alarm ends, s.
    alarm_clear_s: float = 1.0

    def __post_init__(self) -> None:
        _refuse_bad_numbers(self)
        _refuse_order(
            self,
            ("stop_speed_mps", "start_speed_mps"),
            ("launch_speed_mps", "start_speed_mps"),
            ("calibrate_speed_mps", "calibrate_fault_speed_mps"),
            ("rate_amber_percent", "rate_red_percent"),
            ("console_hold_s", "console_off_s"),
            ("stand_settle_s", "run_down_max_s"),
        )


def select_machine_limits(machine: object) -> dict[str, Any]:
    """Returns the limits that the `limits` of a machine file set, as arguments of
    `SafetyLimits`. Machines may differ in every limit that is a field of both."""
    return {
        field.name: value
        for field in fields(SafetyLimits)
        if (value := getattr(machine, field.name, None)) is not None
    }


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Holds the limits of every command to the drives. Raises ValueError as `SafetyLimits` does."""

    # Slowest turning speed, r/min; 0 (stopped) is always allowed.
    shaft_min_rpm: float = 10.0
    shaft_max_rpm: float = 100.0
    opening_min_mm: float = 0.0
    opening_max_mm: float = 60.0

    def __post_init__(self) -> None:
        _refuse_bad_numbers(self)
        _refuse_order(
            self, ("shaft_min_rpm", "shaft_max_rpm"), ("opening_min_mm", "opening_max_mm")
        )


def _refuse_bad_numbers(limits: SafetyLimits | DriveLimits) -> None:
    for field in fields(limits):
        value = getattr(limits, field.name)
        if not (isfinite(value) and value >= 0):
            raise ValueError(f"{field.name} is {value}; allowed is a finite number of at least 0")


def _refuse_order(limits: SafetyLimits | DriveLimits, *pairs: tuple[str, str]) -> None:
    for lower, upper in pairs:
        low, high = getattr(limits, lower), getattr(limits, upper)
        if low > high:
            raise ValueError(f"{lower} is {low}; allowed is at most {upper}, {high}")
