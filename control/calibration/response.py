"""The shaft's response time as the lag detector measures it: from the command until the shaft turns."""
from __future__ import annotations

from math import log

from control.machine.machine import Machine

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
