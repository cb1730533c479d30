"""Reads shaft and gate from a log: each drive's command and reading, and the rows that show the
drive's behaviour.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d
from topdress.control.calibration.first_machine import (
    NO_ZERO_OFFSET,
    SETTLING_TAUS,
    ZeroOffset,
    find_rows_at_rest,
    find_zero_offset,
)
from topdress.control.machine.compiled import run_term
from topdress.control.machine.effect import OPENING_RANGE, SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.shaft import calc_acceleration_rpm_s
from topdress.control.machine.term_sums import sum_over_log

from .grid import SMOOTH_S, Grid, bridge_gaps, make_grid, select_windows, smooth_series
from .inputs import MAX_FINE_STEP_S, STOPPED_RPM, LogRows, make_log_rows, make_term_inputs
from .log import MIN_ROWS, MIN_SETTLED_ROWS, CleanLog

Array = npt.NDArray[np.float64]

# Maximum time at the start of a log that is left out for the drives, s: their history is not in the
# log.
SETTLE_S = 3.0
# The start state is forgotten after this multiple of a drive's settling time: exp(-10).
START_SETTLE_TAUS = 2.0 * SETTLING_TAUS
# Maximum share of rows before which commands may be missing; with more, no move is known.
MAX_LOST_SHARE = 0.1
# Share of missing rows from which a computer may have been late.
MIN_LATE_SHARE = 0.01
# Deviation of the row times from whole steps, as a share of a step, from which the computer was
# late, also when it wrote the rows.
MIN_STEP_ERROR = 0.02
# Standard deviation of a late row's time, as a share of a row: a uniform delay of up to a row, 1 /
# sqrt(12).
STAMP_SD_SHARE = 0.29
# Commands that differ by less are equal: a third of a reading's noise. r/min and mm are those of
# the nominal machine, and are scaled to the range of another machine.
EQUAL_COMMAND_RPM, EQUAL_COMMAND_MM = 0.1, 0.05
# A shaft that was commanded to stand reads below this, noise included.
STILL_READ_RPM = 1.5 * STOPPED_RPM
# Time after the command to stop, s, in which the smoothed reading forgets the rotation.
STILL_AFTER_S = SMOOTH_S
# Time in which a drive has answered a command, s, if the machine file does not say more.
ANSWERS_S = 1.0
# Multiple of the travel time by the machine file: a drive of half the speed has answered as well.
TRAVEL_MARGIN = 2.0
# Multiple of the reading's standard deviation from which a drive has moved (1e-9 by chance).
MIN_MOVE_SD = 6.0
# Maximum share of readings that repeat the reading before; with more, the digits are coarser than
# the noise.
MAX_REPEAT_SHARE = 0.1
# Multiple of the reading's standard deviation: a shaft that reads further below 0 turns backwards
# (1e-9 by chance).
MIN_REVERSE_SD = 6.0


class Drive(NamedTuple):
    """Command and reading of the shaft or the gate, at the log's own rows."""

    name: str
    # Time in the log, s.
    time_s: Array
    # Time axis on which the model runs, s.
    clock_s: Array
    command: Array
    measured: Array
    # Opening that loads the shaft in a row, mm.
    loads_mm: Array
    supply_v: Array
    pitch_deg: Array
    grid: Grid
    # Step of the readings where it is coarser than the log's digits, else 0.
    step: float = 0.0
    # Time from which the readings have this step, s; None for the whole log.
    steps_from_s: float | None = None
    # Whether most rows show the command also while the drive moves; rows of settled answers do not.
    moves_seen: bool = True
    # Whether each row is the settled answer to its command.
    settled: bool = False
    # Number of moving rows that are left out because the computer was late.
    left_out: int = 0
    # Sum of the machine file's terms: % for the shaft, mm for the gate.
    more: Array | float = 0.0
    more_rpm: Array | float = 0.0


def read_whole_drives(log: CleanLog, machine: Machine) -> dict[str, Drive]:
    """Return shaft and gate of a log, by name, at every row, also of a long log that is otherwise
    examined in windows."""
    every = make_log_rows(log, machine)
    more = sum_over_log(
        machine.terms, make_term_inputs(log, every, machine), every.time_s, run_term
    )
    return read_drives(log, every._replace(more=more), machine, whole=True)


def read_drives(log: CleanLog, every: LogRows, machine: Machine, whole: bool) -> dict[str, Drive]:
    c, found = log.columns, {}
    if "shaft" in log.stages:
        unsure = _find_unsure_shaft_rows(log, every, machine)
        sure = ~np.any(list(unsure.values()), axis=0)
        settle_s = min(
            SETTLE_S,
            START_SETTLE_TAUS * (machine.shaft.dead_time_s + machine.shaft.time_constant_s),
        )
        settled = log.held and every.step_s > SETTLING_TAUS * (
            machine.shaft.dead_time_s + machine.shaft.time_constant_s
        )
        found["shaft"] = _make_drive(
            "shaft",
            every,
            every.command_rpm,
            c["shaft_rpm"],
            sure,
            whole=whole,
            noise=machine.noise.shaft_rpm,
            settle_s=settle_s,
            settled=settled,
            least=MIN_SETTLED_ROWS if log.held else MIN_ROWS,
        )
    if "gate" in log.stages:
        sure = ~np.any(list(_find_unsure_gate_rows(every, machine).values()), axis=0)
        found["gate"] = _make_drive(
            "gate",
            every,
            every.command_mm,
            c["opening_mm"],
            sure,
            whole=whole,
            noise=machine.noise.opening_mm,
        )
    return {name: drive for name, drive in found.items() if drive is not None}


class LeftReason(Enum):
    """Why a row of a drive is not judged."""

    UNREAD = "unread"
    STANDS = "stands"
    LOST = "lost"
    REVERSE = "reverse"
    REPEATED = "repeated"


LeftRows = dict[LeftReason, npt.NDArray[np.bool_]]


def list_left_rows(log: CleanLog, machine: Machine) -> dict[str, LeftRows]:
    """Return the rows of shaft and gate that are not judged, by reason: (n,) each; a row counts for
    the first reason that it has."""
    every, c = make_log_rows(log, machine), log.columns
    found = {}
    for name, reading, noise in (
        ("shaft", c["shaft_rpm"], machine.noise.shaft_rpm),
        ("gate", c["opening_mm"], machine.noise.opening_mm),
    ):
        if name not in log.stages:
            continue
        left = {
            LeftReason.UNREAD: ~np.isfinite(reading),
            **(
                _find_unsure_shaft_rows(log, every, machine)
                if name == "shaft"
                else _find_unsure_gate_rows(every, machine)
            ),
            LeftReason.REPEATED: find_repeated_rows(reading, noise),
        }
        before = np.zeros(len(reading), bool)
        for why, rows in left.items():
            left[why] = rows & ~before
            before |= rows
        found[name] = left
    return found


def _find_unsure_shaft_rows(log: CleanLog, every: LogRows, machine: Machine) -> LeftRows:
    c, still_rpm = log.columns, scale_nominal(machine, SHAFT_RANGE) * STILL_READ_RPM
    since = every.time_s - np.maximum.accumulate(
        np.where(every.command_rpm != 0.0, every.time_s, -np.inf)
    )
    read = smooth_series(
        bridge_gaps(every.time_s, c["shaft_rpm"], np.zeros(len(every.time_s))), log.step_s
    )
    return {
        # The shaft must stand for a while, because a selection of single readings would be biased.
        # A shaft that stands as commanded shows nothing, and its reading lacks the noise of a
        # turning shaft.
        LeftReason.STANDS: (since > STILL_AFTER_S) & (np.abs(read) < still_rpm),
        LeftReason.LOST: ~_find_settled_rows(
            every,
            every.command_rpm,
            scale_nominal(machine, SHAFT_RANGE) * EQUAL_COMMAND_RPM,
            machine.shaft.dead_time_s + SETTLING_TAUS * machine.shaft.time_constant_s,
            calc_acceleration_rpm_s(machine.shaft),
        ),
        LeftReason.REVERSE: find_reverse_rows(
            every.time_s, every.command_rpm, c["shaft_rpm"], machine
        )
        | find_zero_command_rotation(every.time_s, every.command_rpm, c["shaft_rpm"], machine),
    }


def _find_unsure_gate_rows(every: LogRows, machine: Machine) -> LeftRows:
    return {
        LeftReason.LOST: ~_find_settled_rows(
            every,
            every.command_mm,
            scale_nominal(machine, OPENING_RANGE) * EQUAL_COMMAND_MM,
            machine.gate.dead_time_s,
            machine.gate.slew_mm_s,
        )
    }


def find_reverse_rows(
    time_s: Array, command_rpm: Array, read_rpm: Array, machine: Machine
) -> npt.NDArray[np.bool_]:
    """Return the rows that command or read reverse rotation, though the machine file allows one
    direction only: (n,).

    Rows in which the shaft may still decelerate from reverse rotation are included. None of these
    rows is judged.
    """
    if machine.shaft.one_way <= 0.0:
        return np.zeros(len(time_s), bool)
    stopped_rpm = scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM
    noise_rpm = MIN_REVERSE_SD * machine.noise.shaft_rpm
    back = (command_rpm < -stopped_rpm) | (read_rpm < -max(stopped_rpm, noise_rpm))
    last = np.maximum.accumulate(np.where(back, time_s, -np.inf))
    return np.asarray(time_s - last <= START_SETTLE_TAUS * machine.shaft.time_constant_s)


def find_zero_command_rotation(
    time_s: Array, command_rpm: Array, read_rpm: Array, machine: Machine
) -> npt.NDArray[np.bool_]:
    """Return the rows in which a shaft turns at a command of 0, though its machine file says that 0
    stops it: (n,).

    Rows that may still be affected by such a rotation are included. None of these rows of an
    open-loop shaft is judged; a shaft with speed control has run away in these rows.
    """
    shaft, at_zero = machine.shaft, command_rpm == 0.0
    rests = at_zero & find_rows_at_rest(
        time_s, command_rpm, read_rpm, shaft.dead_time_s + SETTLING_TAUS * shaft.time_constant_s
    )
    least_rpm = max(
        scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM,
        MIN_REVERSE_SD * machine.noise.shaft_rpm,
    )
    if (
        shaft.zero_stops <= 0.0
        or shaft.regulated > 0.0
        or rests.sum() < MIN_SETTLED_ROWS
        or not float(np.median(np.abs(read_rpm[rests]))) > least_rpm
    ):
        return np.zeros(len(time_s), bool)
    last = np.maximum.accumulate(np.where(at_zero, time_s, -np.inf))
    return np.asarray(
        time_s - last <= shaft.dead_time_s + START_SETTLE_TAUS * shaft.time_constant_s
    )


def measure_zero_offset(drive: Drive | None, machine: Machine) -> ZeroOffset:
    """Return how a shaft responds to a command of 0."""
    if drive is None:
        return NO_ZERO_OFFSET
    answers_s = (
        0.0
        if drive.settled
        else machine.shaft.dead_time_s + SETTLING_TAUS * machine.shaft.time_constant_s
    )
    return find_zero_offset(
        drive.time_s, drive.command, drive.measured, answers_s, machine.noise.shaft_rpm
    )


def _find_settled_rows(
    every: LogRows, command: Array, same: float, dead_s: float, per_s: float
) -> npt.NDArray[np.bool_]:
    """Return the rows whose drive has answered every command that can have been given since the row
    before: (n,).

    Where commands may be missing from the log, a row is valid when its command equals those of all
    rows within the answer time, including the row before them: a further command between two equal
    commands is unlikely. In a gap of a fine log, a whole travel may have been commanded at any
    time. In a log of sparse rows every row may hide a command; a command that continues the trend
    of its neighbours is then accepted. dead_s : fixed part of a drive's answer time, s; per_s :
    share of the range that a drive travels in a second.
    """
    if not every.lost.any():
        return np.ones(len(command), bool)
    way = np.nan_to_num(np.abs(np.diff(command, prepend=command[0])))
    answers_s = (
        np.maximum(ANSWERS_S, TRAVEL_MARGIN * (dead_s + way / per_s))
        if every.step_s <= MAX_FINE_STEP_S
        else ANSWERS_S
    )
    unsure_until = np.where((way > same) & every.lost, every.time_s + answers_s, -np.inf)
    return np.asarray(every.time_s >= np.maximum.accumulate(unsure_until))


def _is_computer_late(every: LogRows) -> bool:
    """Tell whether a computer was late: rows are missing and the others are off whole steps. A
    logger that only lost rows keeps whole steps."""
    steps = np.diff(every.time_s) / every.step_s
    return (
        every.step_s <= MAX_FINE_STEP_S
        and float(np.mean(every.lost)) > MIN_LATE_SHARE
        and float(np.mean(np.abs(steps - np.round(steps)) > MIN_STEP_ERROR)) > MIN_LATE_SHARE
    )


def _find_quick_rows(every: LogRows, measured: Array, noise: float) -> npt.NDArray[np.bool_]:
    """Return the rows of a late computer in which a drive moves by more than the noise within the
    possible delay: (n,).

    Such a reading shows when it was read, not how the drive moved.
    """
    time, known = every.time_s, np.isfinite(measured)
    if not known.any() or not _is_computer_late(every):
        return np.zeros(len(measured), bool)
    rate = np.abs(np.gradient(np.interp(time, time[known], measured[known]), time))
    # The neighbouring rows are included.
    return np.asarray(maximum_filter1d(rate, 3) * STAMP_SD_SHARE * every.step_s > noise)


def find_repeated_rows(measured: Array, noise: float) -> npt.NDArray[np.bool_]:
    """Return the rows that repeat the reading before to the last digit while the drive moves: (n,).

    The drive moves when the readings before and after differ by more than `noise` (1 s.d. of a
    reading) explains. The sensor driver repeats the last reading when a reading is lost, so the
    drive would seem slow or late. Where readings repeat often, the readings are coarse, or the
    sensor is slower than the log, and no row is returned.
    """
    found, known = np.zeros(len(measured), bool), np.flatnonzero(np.isfinite(measured))
    values = measured[known]
    again = np.concatenate(([False], values[1:] == values[:-1]))
    if not again.any() or np.mean(again) > MAX_REPEAT_SHARE:
        return found
    run = np.cumsum(~again) - 1
    leaps = np.abs(np.diff(values[~again])) > MIN_MOVE_SD * noise
    moves = np.concatenate(([False], leaps)) & np.concatenate((leaps, [False]))
    found[known] = again & moves[run]
    return found


def _make_drive(
    name: str,
    every: LogRows,
    command: Array,
    measured: Array,
    sure: npt.NDArray[np.bool_],
    *,
    whole: bool,
    noise: float,
    settle_s: float = SETTLE_S,
    settled: bool = False,
    least: int = MIN_ROWS,
) -> Drive | None:
    """Build a drive, or return None where hardly a row can be judged.

    noise : 1 s.d. of a reading. settled : whether a row holds a settled answer. least : minimum
    number of valid rows.
    """
    time = every.time_s
    pick, clock, since = (
        (np.arange(len(time)), time, time - time[0])
        if whole
        else select_windows(time, every.step_s)
    )
    quick = _find_quick_rows(every, measured, noise)[pick]
    # Rows of a staircase of settings are answers of their own, so equal readings are no lost
    # readings there.
    held = find_repeated_rows(measured, noise) & (not settled)
    known = np.isfinite(measured[pick]) & (since >= settle_s) & sure[pick] & ~quick & ~held[pick]
    if known.sum() < least:
        return None
    grid = make_grid(time[pick], known, every.step_s, clock)
    more, more_rpm = (
        every.more.get("shaft_percent" if name == "shaft" else "gate_mm"),
        every.more.get("shaft_rpm"),
    )
    return Drive(
        name,
        time[pick],
        clock,
        command[pick],
        measured[pick],
        every.loads_mm[pick],
        every.supply_v[pick],
        every.pitch_deg[pick],
        grid,
        moves_seen=bool(np.mean(every.lost) < MAX_LOST_SHARE) and not quick.any() and not settled,
        settled=settled,
        left_out=int(np.sum(quick)),
        more=0.0 if more is None else more[pick],
        more_rpm=0.0 if more_rpm is None or name != "shaft" else more_rpm[pick],
    )
