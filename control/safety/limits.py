"""Which time-outs and thresholds do the safety rules use? Each has its unit in its name; the
defaults are the published table.

No other module of this package contains a number that decides."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Holds the limits at which flow stops, the state changes or an alarm is raised.

    Raises ValueError, one line naming key, value and what is allowed, when a value is not a
    finite number of at least zero or a pair is the wrong way round."""

    # Speed and movement. Flow starts at or above the first speed, and stops below the second; a
    # sensor moves at or above the second.
    start_speed_mps: float = 0.5
    stop_speed_mps: float = 0.3
    # GNSS and wheel must both move (to calibrate: both stand); False only where one of them is
    # not fitted.
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
    wheel_silent_s: float = 0.8
    # GNSS above this speed while the wheel stands is a wheel fault.
    wheel_fault_speed_mps: float = 0.5
    # The fault must last this long: a GNSS speed arrives up to 1 s late.
    wheel_fault_s: float = 0.5
    # Work without a wheel needs ten GNSS epochs a second.
    gnss_alone_period_s: float = 0.12
    # An undecided contradiction of wheel and GNSS leads to held; wheels spin for 1 to 4 s.
    speeds_differ_s: float = 6.0
    # A larger change of course across a standstill means reversing.
    reverse_flip_deg: float = 120.0
    # From this GNSS speed on its course is trusted.
    course_speed_mps: float = 0.2
    # Devices. GNSS is silent after the larger of a time and a number of epochs.
    drive_silent_s: float = 0.5
    gnss_silent_s: float = 0.5
    gnss_silent_periods: float = 2.5
    # A longer observed period counts as this.
    gnss_period_max_s: float = 2.0
    ndvi_silent_s: float = 2.0
    heads_min: int = 4
    # Dense wheat reads 0.93 at most: when all heads read more, they are covered or wet.
    heads_full_ndvi: float = 0.95
    heads_full_s: float = 2.0
    scale_silent_s: float = 2.0
    console_hold_s: float = 2.0
    console_off_s: float = 60.0
    # Commanded to stop (`standstill_monitor`). A slower shaft stands: six standard deviations of
    # the nominal encoder's 0.3 r/min.
    shaft_stands_rpm: float = 2.0
    # A drive may be later than the machine model by this.
    stand_settle_s: float = 0.15
    # After this time a shaft that only slows down is an alarm too.
    run_down_max_s: float = 5.0
    # The shaft must turn for so long, without a break and without slowing down.
    stand_confirm_s: float = 0.5
    # A gate within this distance of its place stands: 30 times the sensor's noise.
    gate_stands_mm: float = 3.0
    # Time of a valve to close: at most 2 s in a machine file, and the delay of the board's line.
    valve_closes_s: float = 3.0
    # Following their set-points at work (`work_watch`). A difference from the model, in % of the
    # set-point, that no trim can correct.
    drive_far_percent: float = 20.0
    # It is a fault after this time, in which slow motors (0.5 s) arrive.
    drive_far_s: float = 2.0
    # A smaller difference, trim included, that the gate may compensate.
    shaft_off_percent: float = 5.0
    # It is an alarm after this time: the trim (5 s) corrects 10 % in twice its time constant.
    shaft_off_s: float = 10.0
    # 15 standard deviations of the sensor, more than half of the usual play (2 mm).
    gate_off_mm: float = 1.5
    # It is an alarm after this time: the trim corrects 3 mm in 3.5 s.
    gate_off_s: float = 2.0
    # Rate. Errors are relative to the larger of the target and this.
    rate_floor_kg_ha: float = 50.0
    rate_amber_percent: float = 10.0
    rate_amber_s: float = 3.0
    rate_red_percent: float = 20.0
    rate_red_s: float = 2.0
    # The product's absolute limit; more for this long leads to held.
    rate_max_kg_ha: float = 1000.0
    rate_max_s: float = 1.0
    # Time beyond the machine's range until the alarm. A machine that starts or stops at
    # 0.5 m/s2 passes the speeds at which its gate cannot close further in 2 s.
    beyond_range_s: float = 3.0
    # Hopper. A larger trim by the scale is an alarm.
    trimmed_percent: float = 5.0
    hopper_empty_kg: float = 0.5
    hopper_low_kg: float = 30.0
    # Empty and low end this far above their limit, and must last this long.
    hopper_clear_kg: float = 1.0
    hopper_confirm_s: float = 1.0
    # Calibrating begins below the first speed by wheel and GNSS; above the second it is a fault.
    calibrate_speed_mps: float = 0.1
    calibrate_fault_speed_mps: float = 0.2
    # Longest run.
    calibrate_max_s: float = 120.0
    # Hold-to-run: the order must be repeated sooner than this.
    calibrate_confirm_s: float = 0.5
    # An alarm ends when its cause has been away this long.
    alarm_clear_s: float = 1.0

    def __post_init__(self) -> None:
        _refuse_bad_numbers(self)
        _refuse_order(self, "stop_speed_mps", "start_speed_mps")
        _refuse_order(self, "launch_speed_mps", "start_speed_mps")
        _refuse_order(self, "calibrate_speed_mps", "calibrate_fault_speed_mps")
        _refuse_order(self, "rate_amber_percent", "rate_red_percent")
        _refuse_order(self, "console_hold_s", "console_off_s")
        _refuse_order(self, "stand_settle_s", "run_down_max_s")


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Holds the limits of every command to the drives. Raises ValueError as `SafetyLimits` does."""

    # Slowest turning; 0 (stopped) is always allowed.
    shaft_min_rpm: float = 10.0
    shaft_max_rpm: float = 100.0
    opening_min_mm: float = 0.0
    opening_max_mm: float = 60.0

    def __post_init__(self) -> None:
        _refuse_bad_numbers(self)
        _refuse_order(self, "shaft_min_rpm", "shaft_max_rpm")
        _refuse_order(self, "opening_min_mm", "opening_max_mm")


def _refuse_bad_numbers(limits: SafetyLimits | DriveLimits) -> None:
    for field in fields(limits):
        value = getattr(limits, field.name)
        if not (isfinite(value) and value >= 0):
            raise ValueError(f"{field.name} is {value}; allowed is a finite number of at least 0")


def _refuse_order(limits: SafetyLimits | DriveLimits, lower: str, upper: str) -> None:
    low, high = getattr(limits, lower), getattr(limits, upper)
    if low > high:
        raise ValueError(f"{lower} is {low}; allowed is at most {upper}, {high}")
