"""Which columns does a calibration need from a run log?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from topdress.control.calibration.wheel_fit import WheelLog
from topdress.control.machine.machine import Machine
from topdress.drivers.files.read_log import RunLog

# Columns of the canopy heads; a run log has six of them.
HEAD_COLUMNS = tuple(f"ndvi_{number}" for number in range(1, 7))
# Shaft speed above which material flows, r/min.
MIN_FLOWING_SHAFT_RPM = 1.0


def read_wheel_log(log: RunLog) -> WheelLog:
    """Returns the data for the calibration of the wheel: times, positions, speeds, and where
    material flows."""
    rpm = log.numbers("shaft_rpm")
    # The command replaces the reading of a shaft without a sensor.
    if not log.has("shaft_rpm"):
        rpm = log.numbers("shaft_rpm_cmd")
    return WheelLog(
        log.time_s,
        log.numbers("lat_deg"),
        log.numbers("lon_deg"),
        log.numbers("fix_quality"),
        log.numbers("wheel_speed_mps"),
        np.nan_to_num(rpm, nan=0.0) > MIN_FLOWING_SHAFT_RPM,
    )


def read_head_columns(log: RunLog) -> NDArray[np.float64]:
    """Returns NDVI with shape (n, heads) from the columns that the log has."""
    return np.column_stack([log.numbers(name) for name in HEAD_COLUMNS])


def find_wheel_circumference(log: RunLog, machine: Machine) -> float:
    """Returns the wheel circumference, m, by which the log's wheel speed was computed: from the
    log's own machine, otherwise from this machine."""
    own = log.meta.machine if log.meta is not None else None
    speed = own.get("speed") if own is not None else None
    found = speed.get("wheel_circumference_m") if isinstance(speed, dict) else None
    return float(found) if isinstance(found, int | float) else machine.speed.wheel_circumference_m
