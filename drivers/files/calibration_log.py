"""What do the calibrations from a run log read from it?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from topdress.control.calibration.wheel_fit import WheelLog
from topdress.control.machine.machine import Machine
from topdress.drivers.files.read_log import RunLog

# Columns of the canopy heads; a machine has up to six.
HEAD_COLUMNS = tuple(f"ndvi_{number}" for number in range(1, 7))
# Shaft speed above which material flows, r/min.
TURNING_RPM = 1.0


# Returns what the calibration of the wheel needs: times, places, speeds, and where material flows.
def read_wheel_log(log: RunLog) -> WheelLog:
    rpm = log.numbers("shaft_rpm")
    # A shaft without a sensor follows its command.
    if not log.has("shaft_rpm"):
        rpm = log.numbers("shaft_rpm_cmd")
    return WheelLog(
        log.time_s,
        log.numbers("lat_deg"),
        log.numbers("lon_deg"),
        log.numbers("fix_quality"),
        log.numbers("wheel_speed_mps"),
        np.nan_to_num(rpm, nan=0.0) > TURNING_RPM,
    )


def read_head_columns(log: RunLog) -> NDArray[np.float64]:
    """Returns NDVI (n, heads) of the columns that the log has."""
    return np.column_stack([log.numbers(name) for name in HEAD_COLUMNS])


def find_wheel_circumference(log: RunLog, machine: Machine) -> float:
    """Returns the wheel circumference, m, with which the log's wheel speed was counted: of the
    log's own machine, else of this machine."""
    own = log.meta.machine if log.meta is not None else None
    speed = own.get("speed") if own is not None else None
    found = speed.get("wheel_circumference_m") if isinstance(speed, dict) else None
    return float(found) if isinstance(found, int | float) else machine.speed.wheel_circumference_m
