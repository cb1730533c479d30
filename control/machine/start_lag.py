"""How long does a start take as the lag rig measures it? From the command until the shaft turns,
and from there to the first granule.
"""

from __future__ import annotations

from math import log

import numpy as np
from topdress.control.machine.fall import Fall, calc_drop_s, find_start_drop_s
from topdress.control.machine.landing import calc_fall_times_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array
from topdress.control.machine.shaft import (
    BISECTION_STEPS,
    Shaft,
    calc_acceleration_rpm_s,
    calc_dead_time_s,
    calc_time_constant_s,
    follow_command,
)

# Time step of the simulated start, s.
START_STEP_S = 0.002
# Number of shaft speeds and of rounds of the fit in `set_carried_share`.
FIT_SPEEDS, FIT_ROUNDS = 7, 4
# Parameter changes for numerical slopes of the fit.
FIT_PROBES = {"start_more_s": 0.01, "start_more_s_per_rpm": 2e-4, "start_more_per_rpm": 2e-4}
# Threshold of the detector, r/min (lag paper, section 2.4.2).
DETECTION_RPM = 2.0


def calc_response_s(machine: Machine, shaft_rpm: float) -> float:
    """Returns the time from a start command for `shaft_rpm` until the standing shaft reaches 2
    r/min, s (lag paper, table 2).

    For a set-point below the threshold the threshold is half of the set-point.
    """
    shaft = machine.shaft
    tau_s = calc_time_constant_s(shaft)
    threshold = min(DETECTION_RPM, 0.5 * shaft_rpm)
    if shaft.second_order_s > 0.0:
        return calc_dead_time_s(shaft) + _calc_rise_s(shaft, shaft_rpm, threshold)
    ramp_to = max(0.0, shaft_rpm - shaft.acceleration_rpm_s * tau_s)
    rising = min(threshold, ramp_to) / shaft.acceleration_rpm_s
    if threshold > ramp_to:
        rising += tau_s * log((shaft_rpm - ramp_to) / (shaft_rpm - threshold))
    return calc_dead_time_s(shaft) + rising


def _calc_rise_s(shaft: Shaft, shaft_rpm: float, threshold: float) -> float:
    """Returns the time until a standing second-order shaft reaches a threshold below its target,
    s."""
    low, high = 0.0, START_STEP_S
    while follow_command(shaft, 0.0, 0.0, shaft_rpm, high)[0] < threshold:
        low, high = high, 2.0 * high
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (low + high)
        if follow_command(shaft, 0.0, 0.0, shaft_rpm, middle)[0] < threshold:
            low = middle
        else:
            high = middle
    return high


def calc_change_response_s(machine: Machine) -> float:
    """Returns the time from a command until a turning shaft changes its speed, s."""
    return calc_dead_time_s(machine.shaft)


def find_first_fall_s(machine: Machine, fall: Fall, shaft_rpm: float) -> float:
    """Returns the time from 2 r/min to the first granule on the ground, s: the rig's test simulated
    with the model (lag paper, table 3).

    If the stream carries everything, the first granule leaves as the shaft starts to turn, and the
    stream behind carries it along while the shaft accelerates. Otherwise a granule of the faster
    shaft may overtake the first. With the parameters of `fall` for the additional time of a start
    the result equals `find_start_drop_s`, within 4 ms from 10 to 70 r/min.
    """
    shaft, share = machine.shaft, fall.carried_share
    rpm, rate = min(DETECTION_RPM, 0.5 * shaft_rpm), 0.0
    speeds = []
    lasts_s = shaft_rpm / calc_acceleration_rpm_s(shaft) + 8.0 * (
        calc_time_constant_s(shaft) + shaft.second_order_s
    )
    for _ in range(round(lasts_s / START_STEP_S)):
        speeds.append(rpm)
        rpm, rate = follow_command(shaft, rpm, rate, shaft_rpm, START_STEP_S)
    drops: Array = np.asarray(
        [max(START_STEP_S, calc_drop_s(fall, n)) for n in [*speeds, shaft_rpm]], dtype=np.float64
    )
    released: Array = np.asarray(START_STEP_S * np.arange(len(drops)), dtype=np.float64)
    return float(np.min(released + calc_fall_times_s(released, drops, share)))


def set_carried_share(machine: Machine, carried_share: float) -> Machine:
    """Returns the machine whose stream determines this share of the pace in the tube, with
    unchanged starts.

    A rig that times starts cannot separate the two. For another share the running shaft's drop time
    is another line over shaft speed. For granules that fall singly, the lag paper's line of starts
    gives 1.79 - 0.0133 n s.

    Raises
    ------
    ValueError : the share is outside 0 to 1.
    """
    if not 0.0 <= carried_share <= 1.0:
        raise ValueError(f"carried_share {carried_share:g}: allowed 0 to 1")
    if carried_share == machine.fall.carried_share:
        return machine
    return refit_start(
        machine.model_copy(update={"fall": machine.fall._replace(carried_share=carried_share)})
    )


def refit_start(machine: Machine) -> Machine:
    """Returns the machine with the running shaft's drop time fitted so that its starts equal
    `find_start_drop_s`.

    The fit is least squares of `find_first_fall_s` over the line's range, by Gauss-Newton.
    """
    parts = (
        ("start_more_per_rpm",)
        if machine.fall.carried_share >= 1.0
        else ("start_more_s", "start_more_s_per_rpm")
    )
    fall = machine.fall._replace(start_more_s=0.0, start_more_s_per_rpm=0.0, start_more_per_rpm=0.0)
    speeds = np.linspace(fall.valid_from_rpm, fall.valid_to_rpm, FIT_SPEEDS).tolist()
    line = np.array([find_start_drop_s(fall, n) for n in speeds])

    def off(p: Fall) -> Array:
        return np.asarray(
            [find_first_fall_s(machine, p, n) for n in speeds] - line, dtype=np.float64
        )

    for _ in range(FIT_ROUNDS):
        here = off(fall)
        slopes = np.column_stack(
            [
                (off(_add_to_part(fall, part, FIT_PROBES[part])) - here) / FIT_PROBES[part]
                for part in parts
            ]
        )
        for part, step in zip(
            parts, np.linalg.lstsq(slopes, -here, rcond=None)[0].tolist(), strict=True
        ):
            fall = _add_to_part(fall, part, step)
    return machine.model_copy(update={"fall": fall})


def _add_to_part(fall: Fall, part: str, step: float) -> Fall:
    value = float(getattr(fall, part)) + step
    return fall._replace(**{part: value if part == "start_more_s" else max(0.0, value)})


def find_start_lag_s(machine: Machine, shaft_rpm: float) -> float:
    """Returns the time from the command to the first granule on the ground for a standing shaft,
    s (lag paper, tables 1 and 4)."""
    return (
        calc_response_s(machine, shaft_rpm)
        + find_first_fall_s(machine, machine.fall, shaft_rpm)
        + machine.fall.first_fill_s
    )
