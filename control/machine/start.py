"""A start as the lag rig measures it: from the command until the shaft turns, and from there to the first granule."""
from __future__ import annotations

from math import log

from control.machine.fall import Fall, drop_s
from control.machine.machine import Machine
from control.machine.shaft import approach

STEP_S = 0.002
TURNS_RPM = 2.0         # the detector's threshold (lag paper, section 2.4.2)


def response_s(machine: Machine, shaft_rpm: float) -> float:
    """Time from a start command for `shaft_rpm` until the standing shaft reaches 2 r/min, s (lag paper, table 2).

    A set-point below the threshold is reached at half its own value.
    """
    shaft = machine.shaft
    tau_s = shaft.time_constant_s + shaft.slow_s
    threshold = min(TURNS_RPM, 0.5 * shaft_rpm)
    ramp_to = max(0.0, shaft_rpm - shaft.acceleration_rpm_s * tau_s)
    rising = min(threshold, ramp_to) / shaft.acceleration_rpm_s
    if threshold > ramp_to:
        rising += tau_s * log((shaft_rpm - ramp_to) / (shaft_rpm - threshold))
    return shaft.dead_time_s + shaft.extra_dead_time_s + rising


def change_response_s(machine: Machine) -> float:
    """Time from a command until a shaft that turns already changes its speed, s."""
    return machine.shaft.dead_time_s + machine.shaft.extra_dead_time_s


def first_fall_s(machine: Machine, fall: Fall, shaft_rpm: float) -> float:
    """From 2 r/min to the first granule on the ground, s: the rig's test played through the model (lag paper, table 3).

    The first granule leaves as the shaft begins to turn, and is carried along by the stream behind it while the shaft
    speeds up. With `start_more_per_rpm` fitted it is `start_drop_s`, within 4 ms from 10 to 70 r/min.
    """
    shaft = machine.shaft
    tau_s = shaft.time_constant_s + shaft.slow_s
    rpm, at_s, way = min(TURNS_RPM, 0.5 * shaft_rpm), 0.0, 0.0
    lasts_s = shaft_rpm / shaft.acceleration_rpm_s + 8.0 * tau_s
    while at_s < lasts_s:
        drop = max(drop_s(fall, rpm), STEP_S)
        if way + STEP_S / drop >= 1.0:
            return at_s + (1.0 - way) * drop
        way += STEP_S / drop
        rpm = approach(rpm, shaft_rpm, tau_s, shaft.acceleration_rpm_s, STEP_S)
        at_s += STEP_S
    return at_s + (1.0 - way) * drop_s(fall, shaft_rpm)


def start_lag_s(machine: Machine, shaft_rpm: float) -> float:
    """From the command to the first granule on the ground out of a standing shaft, s (lag paper, tables 1 and 4)."""
    return response_s(machine, shaft_rpm) + first_fall_s(machine, machine.fall, shaft_rpm) + machine.fall.first_fill_s
