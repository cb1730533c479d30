"""Every time-out and threshold of the safety rules, with its unit in its name. Defaults are the
published table.

Nothing else in this package holds a number that decides.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """When flow stops, when the state changes, when an alarm is raised.

    Raises ValueError, one line naming key, value and what is allowed, when a value is not a
    finite number of at least zero or a pair is the wrong way round.
    """

    # speed and movement
    start_speed_mps: float = 0.5  # flow starts at or above
    stop_speed_mps: float = 0.3  # flow stops below; a sensor "moves" at or above
    # GNSS and wheel must both move (to calibrate: both stand); False only where one is not
    # fitted
    both_speeds_to_start: bool = True
    # with START held: flow from here on, both sensors ...
    launch_speed_mps: float = 0.1
    # ... while START is repeated sooner than this ...
    launch_confirm_s: float = 0.5
    # ... and for at most so long below start_speed_mps
    launch_max_s: float = 3.0
    # below: standing, also without news from the wheel
    standstill_speed_mps: float = 0.1
    standstill_hold_s: float = 10.0  # standing this long while working: held
    speed_silent_s: float = 2.0  # both speeds silent this long: held
    wheel_silent_s: float = 0.8  # a wheel reading older than this says nothing
    # GNSS above this while the wheel stands: wheel fault ...
    wheel_fault_speed_mps: float = 0.5
    # ... once it lasts this long (a GNSS speed comes up to 1 s late)
    wheel_fault_s: float = 0.5
    # allowed to go on without a wheel: where GNSS speaks ten times a second
    gnss_alone_period_s: float = 0.12
    # wheel or GNSS is wrong, nothing says which: held. Wheels spin for 1 to 4 s
    speeds_differ_s: float = 6.0
    # course change across a standstill that means reversing
    reverse_flip_deg: float = 120.0
    course_speed_mps: float = 0.2  # GNSS speed from which its course is believed
    # devices
    drive_silent_s: float = 0.5
    gnss_silent_s: float = 0.5  # silent after the larger of this ...
    gnss_silent_periods: float = 2.5  # ... and this many epochs
    gnss_period_max_s: float = 2.0  # a longer observed period counts as this
    ndvi_silent_s: float = 2.0
    heads_min: int = 4
    # dense wheat reads 0.93 at most: all heads above are covered, or wet ...
    heads_full_ndvi: float = 0.95
    heads_full_s: float = 2.0  # ... once it lasts this long
    scale_silent_s: float = 2.0
    console_hold_s: float = 2.0
    console_off_s: float = 60.0
    # commanded to stop (`stand_watch`)
    # slower: standing. Six s.d. of the nominal encoder's 0.3 r/min
    shaft_stands_rpm: float = 2.0
    # the machine model says that it stands so long: a drive may be late by this
    stand_settle_s: float = 0.15
    # after this also a shaft that slows down turns on
    run_down_max_s: float = 5.0
    # the reading goes on so long, without a break and without slowing down
    stand_confirm_s: float = 0.5
    # a gate within this of where it was stands; 30 times the sensor's noise
    gate_stands_mm: float = 3.0
    # commanded to close: 2 s is most of a machine file, and the board's line
    valve_closes_s: float = 3.0
    # following their set-points at work (`work_watch`)
    # off the model by more, of the set-point: beyond what trims take up ...
    drive_far_percent: float = 20.0
    # ... for so long: a fault. Slow motors (0.5 s) are there by then
    drive_far_s: float = 2.0
    # off the model by more, its trim included: the gate may make up for it ...
    shaft_off_percent: float = 5.0
    # ... for so long: said. The trim takes 10 % off in two of its 5 s
    shaft_off_s: float = 10.0
    # 15 s.d. of its sensor, more than the half of usual play (2 mm) ...
    gate_off_mm: float = 1.5
    # ... for so long: said. The trim brings back 3 mm in 3.5 s
    gate_off_s: float = 2.0
    # rate
    # errors are relative to the larger of target and this
    rate_floor_kg_ha: float = 50.0
    rate_amber_percent: float = 10.0
    rate_amber_s: float = 3.0
    rate_red_percent: float = 20.0
    rate_red_s: float = 2.0
    rate_max_kg_ha: float = 1000.0  # the product's absolute limit
    rate_max_s: float = 1.0  # applied above it this long: held
    # Seconds beyond the machine's range until it is said. A machine that starts or stops at
    # 0.5 m/s2 passes the speeds at which its gate cannot close further in 2 s.
    beyond_range_s: float = 3.0
    # hopper
    trimmed_percent: float = 5.0  # the scale moves the flow by more: said
    hopper_empty_kg: float = 0.5
    hopper_low_kg: float = 30.0
    hopper_clear_kg: float = 1.0  # empty and low go this far above their limit
    hopper_confirm_s: float = 1.0  # empty and low must last this long
    # calibrating
    calibrate_speed_mps: float = 0.1  # to begin: wheel and GNSS below
    calibrate_fault_speed_mps: float = 0.2  # above, while calibrating: fault
    calibrate_max_s: float = 120.0  # one run
    # hold-to-run: the order must be repeated sooner than this
    calibrate_confirm_s: float = 0.5
    # alarms
    # an alarm goes when its cause has been away this long
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
    """What may ever be sent to the drives. Raises ValueError as `SafetyLimits` does."""

    shaft_min_rpm: float = 10.0  # slowest turning; 0 = stopped is always allowed
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
