"""Which command may be sent to a drive? The last check: only finite numbers inside the limits
pass.
"""

from __future__ import annotations

from math import isfinite

from topdress.control.readings import DoseOrder, DriveCommand
from topdress.control.safety.limits import DriveLimits

# Maximum angle of a dose, degrees.
MAX_DOSE_DEG = 3600.0


def limit_command(
    cmd: DriveCommand, limits: DriveLimits, flow_allowed: bool, opening_now_mm: float | None = None
) -> DriveCommand:
    """Returns the command that may be sent. Never raises.

    Without flow, or when either number is not finite, the shaft stops and the gate stays. A
    shaft speed below half the slowest turning becomes 0, between that and the slowest the
    slowest.

    Parameters
    ----------
    cmd : wanted command, r/min and mm.
    limits : of the drives.
    flow_allowed : whether material may flow.
    opening_now_mm : the gate's present set-point; None: the gate goes to the commanded opening
        if that is a number, else to `opening_min_mm`."""
    opening_mm = _clamp_opening(cmd.opening_mm, limits)
    if flow_allowed and opening_mm is not None and isfinite(cmd.shaft_rpm):
        return DriveCommand(_clamp_shaft(cmd.shaft_rpm, limits), opening_mm)
    staying_mm = None if opening_now_mm is None else _clamp_opening(opening_now_mm, limits)
    if staying_mm is None:
        staying_mm = limits.opening_min_mm if opening_mm is None else opening_mm
    return DriveCommand(0.0, staying_mm)


def limit_dose(dose: DoseOrder, limits: DriveLimits, flow_allowed: bool) -> DoseOrder | None:
    """Returns the dose that may be sent; None without flow, or for an angle or a speed that is
    not a number above 0. Never raises.

    The angle is at most 3600 degrees; the speed is cut to what the shaft may turn."""
    angle_deg, shaft_rpm = dose
    if not (
        flow_allowed
        and isfinite(angle_deg)
        and isfinite(shaft_rpm)
        and angle_deg > 0.0
        and shaft_rpm > 0.0
    ):
        return None
    return DoseOrder(
        min(angle_deg, MAX_DOSE_DEG),
        min(max(shaft_rpm, limits.shaft_min_rpm), limits.shaft_max_rpm),
    )


def limit_valves(valves: tuple[bool, ...], flow_allowed: bool) -> tuple[bool, ...]:
    """Returns the valves that may be opened. Closed is the safe state: without flow all are
    closed, and every value that is not True."""
    return tuple([flow_allowed is True and wanted is True for wanted in valves])


def _clamp_opening(opening_mm: float, limits: DriveLimits) -> float | None:
    if not isfinite(opening_mm):
        return None
    return min(max(opening_mm, limits.opening_min_mm), limits.opening_max_mm)


def _clamp_shaft(shaft_rpm: float, limits: DriveLimits) -> float:
    if shaft_rpm <= 0 or shaft_rpm < limits.shaft_min_rpm / 2:
        return 0.0
    return min(max(shaft_rpm, limits.shaft_min_rpm), limits.shaft_max_rpm)
