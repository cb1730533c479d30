"""The shaft's response time as the lag detector measures it: from the command until the shaft turns."""
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


def ramp_s(machine: Machine, fall: Fall, shaft_rpm: float) -> float:
    """How much later the first granule of a standing start lands than the drop time at the set-point says, s.

    A lag rig counts the drop from 2 r/min on, while the shaft still speeds up: the first granule to land is one
    released at the end of the ramp where the drop falls faster with speed than the ramp takes (eq 6: 0.34 s at
    70 r/min and 200 r/min per s), else one released at its begin.
    """
    shaft = machine.shaft
    tau_s = shaft.time_constant_s + shaft.slow_s
    rpm, at_s, lands_s = min(TURNS_RPM, 0.5 * shaft_rpm), 0.0, float("inf")
    lasts_s = shaft_rpm / shaft.acceleration_rpm_s + 8.0 * tau_s
    while at_s < lasts_s:
        lands_s = min(lands_s, at_s + drop_s(fall, rpm))
        rpm = approach(rpm, shaft_rpm, tau_s, shaft.acceleration_rpm_s, STEP_S)
        at_s += STEP_S
    return lands_s - drop_s(fall, shaft_rpm)
