"""What the calibrations from a run log read of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from topdress.control.calibration.wheel_fit import WheelLog
from topdress.control.machine.machine import Machine
from topdress.drivers.files.read_log import RunLog

HEADS = tuple(f"ndvi_{number}" for number in range(1, 7))
TURNS_RPM = 1.0  # a shaft that turns faster gives material


def wheel_columns(log: RunLog) -> WheelLog:
    rpm = log.numbers("shaft_rpm")
    if not log.has("shaft_rpm"):
        rpm = log.numbers("shaft_rpm_cmd")
    return WheelLog(
        log.time_s,
        log.numbers("lat_deg"),
        log.numbers("lon_deg"),
        log.numbers("fix_quality"),
        log.numbers("wheel_speed_mps"),
        np.nan_to_num(rpm, nan=0.0) > TURNS_RPM,
    )


def heads_columns(log: RunLog) -> NDArray[np.float64]:
    """NDVI (n, heads) of the columns that the log has."""
    return np.column_stack([log.numbers(name) for name in HEADS])


def counted_by(log: RunLog, machine: Machine) -> float:
    """The wheel circumference by which the log's wheel speed was counted, m: of the log's own
    machine, else of this."""
    own = log.meta.machine if log.meta is not None else None
    speed = own.get("speed") if own is not None else None
    found = speed.get("wheel_circumference_m") if isinstance(speed, dict) else None
    return float(found) if isinstance(found, int | float) else machine.speed.wheel_circumference_m
