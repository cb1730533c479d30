"""Reads how hard the drives worked in a log, in time bins, with the speed and the material load of
each bin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import minimum_filter1d
from topdress.control.machine.effect import HOPPER_CAPACITY, SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal

from .grid import Grid, bridge_gaps, make_grid
from .inputs import WORKING_RPM, LogRows
from .log import MIN_ROWS, CleanLog

Array = npt.NDArray[np.float64]

# Channels of the metering shaft's effort and of the gate's effort.
EFFORT_CHANNELS = ("effort", "gate_effort")
# Bin length, s: a drive's own control loop oscillates for some tenths of a second, so finer bins
# add no information.
BIN_S = 0.5
# Window over which speed and acceleration are estimated from noisy readings, s.
SLOPE_WINDOW_S = 0.3
# Time after a start and before a stop that is left out, s: breakaway friction and integrator
# windup.
EDGE_TIME_S = 0.2
# Maximum change of speed within SLOPE_WINDOW_S, as a share of the shaft's range: with more, the
# readings' lag matters.
MAX_CHANGE_SHARE = 0.02
# Minimum share of the rows of a bin in which the drive moves.
MIN_MOVING_SHARE = 0.5
# Minimum speed of the gate as a share of its fastest: a slower speed is mostly noise.
MIN_SPEED_SHARE = 0.1
# Maximum time step of a log for the gate, s: its moves take a second or two.
MAX_GATE_STEP_S = 0.25


class DriveEffort(NamedTuple):
    """Effort of a drive: arrays (n,) over the rows in which the drive certainly moves, and bins
    (m,) of BIN_S that contain such rows."""

    # Name of the channel: `effort` (metering shaft) or `gate_effort`.
    name: str
    time_s: Array
    # Speed in r/min, or mm/s.
    speed: Array
    speed_per_s: Array
    opening_mm: Array
    pitch_deg: Array
    # Filled share of the hopper.
    share_full: Array
    # Nominal supply voltage divided by the supply voltage.
    supply_share: Array
    measured: Array
    refilled: bool
    # Bin index of each row.
    bins: npt.NDArray[np.int64]
    # Number of rows of each bin, 0 for a bin that is left out.
    members: Array
    # Middle of each bin, s.
    middle_s: Array
    grid: Grid

    @property
    def rows_per_bin(self) -> float:
        return float(np.mean(self.members[self.members > 0]))

    def remove_bins(self, bins: npt.NDArray[np.bool_]) -> DriveEffort:
        """Return the effort without some bins, (m,)."""
        members = np.where(bins, 0.0, self.members)
        return self._replace(
            members=members, grid=make_grid(self.middle_s, members > 0, self.grid.step_s)
        )

    def bin_row_means(self, rows: Array) -> Array:
        """Return the mean over the rows of each bin, NaN for a bin that is left out: (m,)."""
        sums = np.bincount(self.bins, weights=rows, minlength=len(self.members))
        return np.asarray(
            np.divide(sums, self.members, out=np.full(len(sums), np.nan), where=self.members > 0)
        )


def read_efforts(log: CleanLog, every: LogRows, machine: Machine) -> tuple[DriveEffort, ...]:
    """Return the efforts of all drives that log their effort and moved, and the inputs of their
    models."""
    found = [
        read_drive_effort(name, log, every, machine)
        for name in EFFORT_CHANNELS
        if name in log.stages and not list_missing_inputs(name, log, machine)
    ]
    return tuple(one for one in found if one is not None)


def list_missing_inputs(name: str, log: CleanLog, machine: Machine) -> list[str]:
    """Return the columns on which the effort of a drive depends and that a log has not: without
    the opening, a load that changes looks like friction."""
    needed = ("opening_mm_cmd", "opening_mm") if name == "effort" and machine.effort.load else ()
    return [] if not needed or any(map(log.has_column, needed)) else ["opening_mm"]


def read_drive_effort(
    name: str, log: CleanLog, every: LogRows, machine: Machine
) -> DriveEffort | None:
    """Return the effort of one drive; None where the drive hardly moves."""
    time, step_s = every.time_s, every.step_s
    rows = max(5, 2 * round(0.5 * SLOPE_WINDOW_S / step_s) + 1)
    if len(time) <= rows or (name == "gate_effort" and step_s > MAX_GATE_STEP_S):
        return None
    if name == "effort":
        speed, per_s = (
            _fit_local_polynomial(every.shaft_rpm, rows, step_s, 1, nth) for nth in (0, 1)
        )
        speed = speed if step_s < SLOPE_WINDOW_S else every.shaft_rpm
        least = scale_nominal(machine, SHAFT_RANGE) * WORKING_RPM
        even = np.abs(per_s) * SLOPE_WINDOW_S < MAX_CHANGE_SHARE * machine.limits.shaft_high_rpm
        column = log.columns["shaft_effort"]
    else:
        speed, per_s = (
            _fit_local_polynomial(every.opening_mm, rows, step_s, 2, nth) for nth in (1, 2)
        )
        least, even = MIN_SPEED_SHARE * machine.gate.slew_mm_s, np.ones(len(time), bool)
        column = log.columns["gate_effort"]
    near = 2 * max(1, round(EDGE_TIME_S / step_s)) + 1
    moving = minimum_filter1d((np.abs(speed) > least).astype(np.int8), near) > 0
    gapped = np.diff(time, prepend=time[0]) > rows * step_s
    used = moving & even & np.isfinite(column) & ~gapped
    if used.sum() < MIN_ROWS:
        return None
    width = max(BIN_S, step_s)
    bins = np.floor((time[used] - time[0]) / width).astype(np.int64)
    members = np.bincount(bins).astype(np.float64)
    # Bins in which the drive hardly moved are left out.
    members[members < MIN_MOVING_SHARE * members.max()] = 0.0
    hopper = bridge_gaps(time, log.columns["hopper_kg"], np.full(len(time), machine.flow.full_kg))
    supply = np.maximum(1.0, every.supply_v[used])
    middle = time[0] + width * (np.arange(len(members)) + 0.5)
    rises = np.diff(hopper) > scale_nominal(machine, HOPPER_CAPACITY) * 3.0
    return DriveEffort(
        name,
        time[used],
        speed[used],
        per_s[used],
        every.opening_mm[used],
        every.pitch_deg[used],
        np.clip(hopper[used] / machine.flow.full_kg, 0.01, 1.0),
        machine.shaft.nominal_supply_v / supply,
        np.abs(column[used]),
        bool(rises.any()),
        bins,
        members,
        middle,
        make_grid(middle, members > 0, width),
    )


def _fit_local_polynomial(series: Array, rows: int, step_s: float, degree: int, nth: int) -> Array:
    """Return value, slope or curvature (nth: 0, 1, 2) of a series (n,) by least squares over `rows`
    around each sample (Savitzky and Golay, Anal. Chem. 36, 1964, 1627)."""
    half = rows // 2
    weights = np.linalg.pinv(
        np.vander(step_s * np.arange(-half, half + 1), degree + 1, increasing=True)
    )[nth]
    return np.convolve(np.pad(series, half, mode="edge"), weights[::-1], "valid") * (
        2.0 if nth == 2 else 1.0
    )
