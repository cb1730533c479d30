"""Shaft and gate of a log: each drive's command and read-back, and which rows tell what it did."""

from __future__ import annotations

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
from .inputs import FINE_LOG_S, STOPPED_RPM, LogRows, make_log_rows, make_term_inputs
from .log import MIN_ROWS, MIN_SETTLED, Clean

Array = npt.NDArray[np.float64]

# of the drives at the beginning, at most: their past is not in the log ...
SETTLE_S = 3.0
# ... nor is it seen after so many times what they take to answer: exp(-10)
SETTLES = 2.0 * SETTLING_TAUS
# of the rows, before which commands may be missing: more, and no move is known
MAX_LOST = 0.1
LATE_ROWS = 0.01  # of the rows missing, and as many ...
# ... off whole steps by so much of one: the computer was late, also with what it wrote ...
OFF_STEP = 0.02
# ... by any time up to a row, 1 / sqrt(12) of one (1 s.d.)
STAMP_SHARE = 0.29
# r/min and mm are those of the nominal machine: a share of another's range.
# commands this close are the same: a third of the noise of a reading
SAME_RPM, SAME_MM = 0.1, 0.05
# a shaft that was commanded to stand still is read below this, noise and all
STILL_READ_RPM = 1.5 * STOPPED_RPM
# after the command to stop: the smoothed reading has forgotten that it turned
STILL_AFTER_S = SMOOTH_S
# after a command, a drive has answered it; after a gap, if not in ...
ANSWERS_S = 1.0
# ... times what a drive of the machine file takes for its way: one half as fast has, too
SLOWER = 2.0
# of a reading's noise: a drive that is read further away has moved (1e-9 by chance)
LEAPS_SD = 6.0
# of the readings, that repeat the one before: more, and their digits end above their noise
REPEATS_SELDOM = 0.1
# of the reading's noise: further below 0 a shaft truly turns backwards (1e-9 by chance)
READ_BACKWARDS_SD = 6.0


class Drive(NamedTuple):
    """Shaft or gate: command to read-back, at the log's own rows."""

    name: str
    time_s: Array  # in the log
    clock_s: Array  # as the model is run
    command: Array
    measured: Array
    loads_mm: Array  # opening by which the shaft is loaded in a row
    supply_v: Array
    grid: Grid
    # in which its readings come, where that is coarser than the log is written ...
    step: float = 0.0
    steps_from_s: float | None = None  # ... from then on, or all along
    # most rows tell what was commanded, also while the drive moves: no settled answers do
    moves_seen: bool = True
    settled: bool = False  # each row is the settled answer to its command
    # rows in which it moves, of a computer that was late
    left_out: int = 0
    # of the machine file's terms: % of the shaft, mm of the gate
    more: Array | float = 0.0
    more_rpm: Array | float = 0.0


def read_whole_drives(log: Clean, machine: Machine) -> dict[str, Drive]:
    """Shaft and gate of a log, by name, at every row even of a long log that is otherwise
    looked at in windows."""
    every = make_log_rows(log, machine)
    more = sum_over_log(
        machine.terms, make_term_inputs(log, every, machine), every.time_s, run_term
    )
    return read_drives(log, every._replace(more=more), machine, whole=True)


def read_drives(log: Clean, every: LogRows, machine: Machine, whole: bool) -> dict[str, Drive]:
    c, found, still_rpm = log.columns, {}, scale_nominal(machine, SHAFT_RANGE) * STILL_READ_RPM
    if "shaft" in log.stages:
        since = every.time_s - np.maximum.accumulate(
            np.where(every.command_rpm != 0.0, every.time_s, -np.inf)
        )
        read = smooth_series(
            bridge_gaps(every.time_s, c["shaft_rpm"], np.zeros(len(every.time_s))), log.step_s
        )
        # for a while: single readings would be a choice
        still = (since > STILL_AFTER_S) & (np.abs(read) < still_rpm)
        # A shaft that stands as it was commanded tells nothing, and its reading has none of the
        # noise of a turning one.
        sure = ~still & _find_settled_rows(
            every,
            every.command_rpm,
            scale_nominal(machine, SHAFT_RANGE) * SAME_RPM,
            machine.shaft.dead_time_s + SETTLING_TAUS * machine.shaft.time_constant_s,
            calc_acceleration_rpm_s(machine.shaft),
        )
        sure &= ~against_the_way(every.time_s, every.command_rpm, c["shaft_rpm"], machine)
        sure &= ~turns_at_zero(every.time_s, every.command_rpm, c["shaft_rpm"], machine)
        settle_s = min(
            SETTLE_S, SETTLES * (machine.shaft.dead_time_s + machine.shaft.time_constant_s)
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
            least=MIN_SETTLED if log.held else MIN_ROWS,
        )
    if "gate" in log.stages:
        sure = _find_settled_rows(
            every,
            every.command_mm,
            scale_nominal(machine, OPENING_RANGE) * SAME_MM,
            machine.gate.dead_time_s,
            machine.gate.slew_mm_s,
        )
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


def against_the_way(
    time_s: Array, command_rpm: Array, read_rpm: Array, machine: Machine
) -> npt.NDArray[np.bool_]:
    """Rows that ask a shaft to turn backwards, or read it so, though its machine file says that
    it turns one way, and those in which it may still run down from that: (n,). None of them is
    judged."""
    if machine.shaft.one_way <= 0.0:
        return np.zeros(len(time_s), bool)
    stopped_rpm = scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM
    noise_rpm = READ_BACKWARDS_SD * machine.noise.shaft_rpm
    back = (command_rpm < -stopped_rpm) | (read_rpm < -max(stopped_rpm, noise_rpm))
    last = np.maximum.accumulate(np.where(back, time_s, -np.inf))
    return np.asarray(time_s - last <= SETTLES * machine.shaft.time_constant_s)


def turns_at_zero(
    time_s: Array, command_rpm: Array, read_rpm: Array, machine: Machine
) -> npt.NDArray[np.bool_]:
    """Rows that command a shaft 0, at which it turns though its machine file says that this
    stops it, and those in which it may still remember that: (n,). None of them is judged, of a
    shaft in open loop: one that holds its speed has run away."""
    shaft, at_zero = machine.shaft, command_rpm == 0.0
    rests = at_zero & find_rows_at_rest(
        time_s, command_rpm, read_rpm, shaft.dead_time_s + SETTLING_TAUS * shaft.time_constant_s
    )
    least_rpm = max(
        scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM,
        READ_BACKWARDS_SD * machine.noise.shaft_rpm,
    )
    if (
        shaft.zero_stops <= 0.0
        or shaft.regulated > 0.0
        or rests.sum() < MIN_SETTLED
        or not float(np.median(np.abs(read_rpm[rests]))) > least_rpm
    ):
        return np.zeros(len(time_s), bool)
    last = np.maximum.accumulate(np.where(at_zero, time_s, -np.inf))
    return np.asarray(time_s - last <= shaft.dead_time_s + SETTLES * shaft.time_constant_s)


def read_off_zero(drive: Drive | None, machine: Machine) -> ZeroOffset:
    """How a shaft stands to a command of 0."""
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
    """Rows whose drive has answered every command that can have been given since the row
    before: (n,).

    Where commands may be missing from the log, a row is sure when its command and those of all
    rows within the time of an answer are the same, the row before them included: any command
    between two equal ones had no reason. Across a gap of a fine log a whole way may have been
    commanded at once, at any time in the gap; in a log of rows far apart every row may hide a
    command, and one that goes on in the same way as its neighbours is the rule. dead_s : what a
    drive takes however short its way is; per_s : how much of the way it goes in a second.
    """
    if not every.lost.any():
        return np.ones(len(command), bool)
    way = np.nan_to_num(np.abs(np.diff(command, prepend=command[0])))
    answers_s = (
        np.maximum(ANSWERS_S, SLOWER * (dead_s + way / per_s))
        if every.step_s <= FINE_LOG_S
        else ANSWERS_S
    )
    unsure_until = np.where((way > same) & every.lost, every.time_s + answers_s, -np.inf)
    return np.asarray(every.time_s >= np.maximum.accumulate(unsure_until))


def _is_computer_late(every: LogRows) -> bool:
    """Whether a computer did not keep up: rows are missing, and the others do not stand in
    whole steps, as they do where a logger only lost some."""
    steps = np.diff(every.time_s) / every.step_s
    return (
        every.step_s <= FINE_LOG_S
        and float(np.mean(every.lost)) > LATE_ROWS
        and float(np.mean(np.abs(steps - np.round(steps)) > OFF_STEP)) > LATE_ROWS
    )


def _find_quick_rows(every: LogRows, measured: Array, noise: float) -> npt.NDArray[np.bool_]:
    """Rows of a late computer in which a drive moves by more than its reading's noise in the
    time by which a row may be late: what is read there says when it was read, not what the
    drive did. (n,)"""
    time, known = every.time_s, np.isfinite(measured)
    if not known.any() or not _is_computer_late(every):
        return np.zeros(len(measured), bool)
    rate = np.abs(np.gradient(np.interp(time, time[known], measured[known]), time))
    # its neighbours as well
    return np.asarray(maximum_filter1d(rate, 3) * STAMP_SHARE * every.step_s > noise)


def repeated_in_motion(measured: Array, noise: float) -> npt.NDArray[np.bool_]:
    """Rows that repeat the reading before to the last digit while the drive moves: by more than
    `noise` (1 s.d. of a reading) leaves open to what was read before, and from it to what is
    read next. (n,)

    A reading lost on its way is held so: for a while the drive seems slow or late. Where
    readings repeat often, they are coarse, or the sensor is slower than the log.
    """
    found, known = np.zeros(len(measured), bool), np.flatnonzero(np.isfinite(measured))
    values = measured[known]
    again = np.concatenate(([False], values[1:] == values[:-1]))
    if not again.any() or np.mean(again) > REPEATS_SELDOM:
        return found
    run = np.cumsum(~again) - 1
    leaps = np.abs(np.diff(values[~again])) > LEAPS_SD * noise
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
    """None where hardly a row can be judged. noise : of a reading (1 s.d.). settled : a row
    holds a settled answer. least : rows that can be judged."""
    time = every.time_s
    pick, clock, since = (
        (np.arange(len(time)), time, time - time[0])
        if whole
        else select_windows(time, every.step_s)
    )
    quick = _find_quick_rows(every, measured, noise)[pick]
    # each row of a staircase is an answer of its own
    held = repeated_in_motion(measured, noise) & (not settled)
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
        grid,
        moves_seen=bool(np.mean(every.lost) < MAX_LOST) and not quick.any() and not settled,
        settled=settled,
        left_out=int(np.sum(quick)),
        more=0.0 if more is None else more[pick],
        more_rpm=0.0 if more_rpm is None or name != "shaft" else more_rpm[pick],
    )
