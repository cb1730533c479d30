"""A run log as the machine model's stages see it: inputs and measured outputs of each channel on an even time grid."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d, maximum_filter1d

from control.diagnosis.judgement.prior import ROBUST_SD
from control.machine.compiled import term_run
from control.machine.effect import HOPPER, OPENING_RANGE, SHAFT_RANGE
from control.machine.form import SHAFT_ANGLE
from control.machine.machine import Machine, of_nominal
from control.machine.term_sums import angle_over_log, commanded_over_log, dead_times_s, over_log
from control.machine.terms import COMMANDED_MM, COMMANDED_RPM
from control.recordings.speeds import MOVING_MPS

from .log import HEADS, MIN_ROWS, MIN_SETTLED, Clean

Array = npt.NDArray[np.float64]

MAX_ROWS = 100_000          # longer logs are looked at in windows, row by row ...
WINDOW_ROWS = 20_000        # ... of so many rows in all
WINDOWS = 5
EVERY_ROW = 20              # of the recorded variables are kept between the windows
HOPPER_STEP_S = 1.0         # the scale's noise remembers a second: finer rows of it say nothing more
MIN_BINS = 20               # of the scale: the flow is read off over windows of ten seconds, and two are no noise
MAX_BINS = 60_000           # of the scale: a longer log has longer bins
SETTLE_S = 3.0              # of the drives at the beginning, at most: their past is not in the log ...
ANSWERED = 5.0              # times that: it has settled, to a hundredth, where it was left alone with its command
SETTLES = 10.0              # ... nor is it seen after so many times what they take to answer
UNSEEN_CHANGE = 0.3         # (1 s.d.) of a change from row to row: it may have come early or late, 1 / sqrt(12)
UNSEEN_STEADY = 0.05        # of the rate itself: what control may have tried and taken back ...
LONG_GAP_S = 3.0            # of a gap, after which the level of the hopper is open by as much as it may have metered
UNSEEN_S = 2.0              # ... within so long, or in proportion
ASKED_AFTER_S = 2.0         # of a reading's gap: in a longer one the command is the better guess
FINE_LOG_S = 0.15           # rows closer than this hold every command that control gave
MAX_LOST = 0.1              # of the rows, before which commands may be missing: more, and no move is known
LATE_ROWS = 0.01            # of the rows missing, and as many ...
OFF_STEP = 0.02             # ... off whole steps by so much of one: the computer was late, also with what it wrote ...
STAMP_SHARE = 0.29          # ... by any time up to a row, 1 / sqrt(12) of one (1 s.d.)
SAME_RPM, SAME_MM = 0.1, 0.05       # commands this close are the same: a third of the noise of a reading
ANSWERS_S = 1.0             # after a command, a drive has answered it, if not in ...
SLOWER = 2.0                # ... times what a drive of the machine file takes for its way: one half as fast has, too
SMOOTH_S = 1.5              # of slowly varying sensors that serve as inputs
# r/min and kg are those of the nominal machine: a share of another's range.
STOPPED_RPM = 1.0           # a shaft read slower than this stands still: the reading cannot fall below 0
READ_BACKWARDS_SD = 6.0     # of the reading's noise: further below 0 a shaft truly turns backwards
STILL_READ_RPM = 1.5        # noise of a shaft that was commanded to stand still
STILL_AFTER_S = 1.5         # after the command to stop: it has run down by then
REFILL_KG = 3.0
REFILL_SD = 8.0             # of the scale's noise, at least: a large hopper's share is more, a small one's may be less
WORKING_RPM = 2.0
STATED_WITHIN_S = 120.0     # of a fill: an event so near belongs to it
MIN_READINGS_APART = 400    # readings from which two sensors' noises are told apart
SPEED_WINDOW_S = 3.0        # parabola through the speed: a tractor's acceleration is slower than its sensors' noise
MAX_BRIDGED_STEPS = 5.0     # a longer gap of a grid is left out ...
FORGETS_S = 1.0             # ... but for so long of two speeds: filters of receivers and wheels forget within a second,
                            # and what stopped braking is not what starts again in the next row


class Grid(NamedTuple):
    """From a log's rows to an even grid: short gaps are bridged by straight lines, in data and prediction alike.

    Long ones are left out: a line over them would make a long stretch of the noise of the two readings at its ends.
    """

    clock_s: Array              # of the known rows; a long log's windows follow each other without a gap
    rows: npt.NDArray[np.int64]
    even_clock_s: Array
    even_s: Array               # time in the log
    step_s: float
    as_is: bool                 # every row is known and evenly spaced

    def of(self, series: Array) -> Array:
        """Series over the log's rows (..., rows) on the grid (..., m)."""
        if self.as_is:
            return series[..., self.rows]
        if series.ndim == 1:
            return np.interp(self.even_clock_s, self.clock_s, series[self.rows])
        return np.array([np.interp(self.even_clock_s, self.clock_s, one[self.rows]) for one in series])


class Drive(NamedTuple):
    """Shaft or gate: command to read-back, at the log's own rows."""

    name: str
    time_s: Array               # in the log
    clock_s: Array              # as the model is run
    command: Array
    measured: Array
    opening_mm: Array
    supply_v: Array
    grid: Grid
    step: float = 0.0           # in which its readings come, where that is coarser than the log is written ...
    steps_from_s: float | None = None   # ... from then on, or all along
    moves_seen: bool = True     # most rows tell what was commanded, also while the drive moves: no settled answers do
    settled: bool = False        # each row is the settled answer to its command
    left_out: int = 0           # rows in which it moves, of a computer that was late
    more: Array | float = 0.0           # of the machine file's terms: % of the shaft, mm of the gate
    more_rpm: Array | float = 0.0


class Hopper(NamedTuple):
    """Flow and scale, in bins of HOPPER_STEP_S or the log's own step."""

    time_s: Array               # begin of each bin, and the end of the last: (m+1,)
    shaft_rpm: Array            # (m+1,), mean over the bin
    opening_mm: Array           # (m+1,), weighted with shaft speed
    pitch_deg: Array
    reading_kg: Array           # (m,), mean over the bin
    read_at: Array              # (m,), mean time of those readings, as a share of the bin
    refill_kg: Array            # (m+1,)
    start_kg: float
    jumps: tuple[int, ...]      # bins from which a refill counts
    written: tuple[bool, ...]      # whether the operator wrote down how much a refill was
    grid: Grid                  # over the m bins
    unseen: float = 0.0         # r/min x mm x s (1 s.d.), metered in a bin where no row says how
    gaps: tuple[tuple[int, float], ...] = ()    # bin at which a long gap ends, and the same of what it metered
    more_percent: Array | float = 0.0   # of the machine file's terms, mean over the bin weighted with what it metered
    more_kg_s: Array | float = 0.0
    more_kg: Array | float = 0.0        # (m,), of the reading


class Speed(NamedTuple):
    """Wheel against GNSS at the rows where GNSS is new."""

    time_s: Array
    true_mps: Array             # weighted mean of both, smoothed
    working: Array
    pitch_deg: Array
    wheel_mps: Array
    gnss_mps: Array
    grid: Grid
    more_percent: Array | float = 0.0   # of the machine file's terms
    unseen_percent: float = 0.0         # (1 s.d.) of the wheel's speed, missing in dips too short to be taken out


class Heads(NamedTuple):
    """Contrast of each head with the mean of all, at the rows where the heads are new."""

    time_s: Array
    ndvi: Array                 # (k, m)
    mean: Array                 # (m,)
    grid: Grid


class RunData(NamedTuple):
    duration_s: float
    rows: int
    variables: dict[str, Array]         # recorded variables over the log's rows (`known_rows`), gaps bridged
    time_s: Array                       # of those rows
    working: Array
    shaft: Drive | None
    gate: Drive | None
    hopper: Hopper | None
    speed: Speed | None
    heads: Heads | None
    inputs: dict[str, Array] = {}       # what terms are asked with (`terms.needed`), at `row_s`
    row_s: Array = np.empty(0)          # time of every row, of a long log of the `known_rows`


class _Rows(NamedTuple):
    """What several stages are given, at every row of the log: (n,) each, gaps bridged."""

    time_s: Array
    step_s: float
    command_rpm: Array
    command_mm: Array
    shaft_rpm: Array            # measured, where it is not the command
    opening_mm: Array
    supply_v: Array             # smoothed, as the pitch
    pitch_deg: Array
    working: Array              # 1 or 0: as the log says, else whether the shaft turns
    lost: npt.NDArray[np.bool_]         # rows before which commands may be missing from the log
    more: dict[str, Array] = {}         # what the machine file's terms add (`term_sums.over_log`)


def _rows(log: Clean, machine: Machine) -> _Rows:
    time, c = log.time_s, log.columns
    command_rpm, command_mm = _held(c["shaft_rpm_cmd"]), _held(c["opening_mm_cmd"])
    shaft_rpm = _bridged(time, c["shaft_rpm"], command_rpm, ASKED_AFTER_S)
    supply_v = _bridged(time, c["supply_v"], np.full(len(time), machine.shaft.nominal_supply_v))
    opening_mm = np.where(np.isfinite(command_mm), command_mm, machine.set_points.opening_mm)      # neutral
    turning = np.abs(np.nan_to_num(shaft_rpm)) > of_nominal(machine, SHAFT_RANGE) * WORKING_RPM
    working = np.where(np.isfinite(log.working), log.working, turning)
    return _Rows(time, log.step_s, command_rpm, command_mm, shaft_rpm,
                 _bridged(time, c["opening_mm"], opening_mm, ASKED_AFTER_S), _smooth(supply_v, log.step_s),
                 _smooth(_bridged(time, c["pitch_deg"], np.zeros(len(time))), log.step_s),
                 working.astype(np.float64), np.zeros(len(time), bool) if log.held else _lost(time, log.step_s))


def _lost(time: Array, step_s: float) -> npt.NDArray[np.bool_]:
    """Rows before which commands may have been given that no row holds: (n,)."""
    if step_s > FINE_LOG_S:
        return np.ones(len(time), bool)
    return np.diff(time, prepend=time[0]) > 1.5 * step_s


def run_data(log: Clean, machine: Machine) -> RunData:
    """Channels of a cleaned log; None where the log cannot show one."""
    every, c = _rows(log, machine), log.columns
    time = every.time_s
    inputs = term_inputs(log, every, machine)
    every = every._replace(more=over_log(machine.terms, inputs, time, term_run))
    variables = _variables(log, every)
    hopper = speed = heads = None
    driven = _drives(log, every, machine, whole=False)
    further = {name: _smooth(_bridged(time, series, series), log.step_s) for name, series in log.further.items()}
    if "flow" in log.stages:
        hopper = _hopper(every, c["hopper_kg"], _written(time, log.events), machine)
    if "speed" in log.stages:
        speed = _speed(every, c["speed_mps"], c["wheel_speed_mps"], machine)
        if speed is not None:
            variables["speed_mps"] = np.interp(time, speed.time_s, speed.true_mps)
    if "heads" in log.stages:
        heads = _heads(time, np.array([c[name] for name in HEADS]), _moves(c["speed_mps"], c["wheel_speed_mps"]))
    rows = known_rows(len(time))
    variables |= further
    return RunData(float(time[-1]), len(time), {name: series[rows] for name, series in variables.items()}, time[rows],
                   every.working[rows], driven.get("shaft"), driven.get("gate"), hopper, speed, heads,
                   {name: series[rows] for name, series in inputs.items()}, time[rows])


def term_inputs(log: Clean, every: _Rows, machine: Machine) -> dict[str, Array]:
    """What terms are asked with, at every row of a log (n,): readings, and the commands that the drives follow by now.

    What a log lacks is left out, and so are the terms over it.
    """
    time, found = every.time_s, {"time_s": every.time_s}
    for name, written, command, dead_s in zip(("shaft_rpm", "opening_mm"), (COMMANDED_RPM, COMMANDED_MM),
                                           (every.command_rpm, every.command_mm), dead_times_s(machine), strict=True):
        if np.isfinite(command).all():
            found[written] = commanded_over_log(command, time, dead_s)
        if log.has(name):
            found[name] = every.shaft_rpm if name == "shaft_rpm" else every.opening_mm
            if written not in found:
                found[written] = found[name]
    if log.has("shaft_rpm"):
        found[SHAFT_ANGLE] = angle_over_log(every.shaft_rpm, time)
    further = {name: _bridged(time, series, series) for name, series in log.further.items()}
    return found | _read_slowly(log, every) | further


def _read_slowly(log: Clean, every: _Rows) -> dict[str, Array]:
    """Readings of other sensors than the drives', smoothed, (n,) by name: their noise is no motion of the machine."""
    found = {name: series for name, series in (("supply_v", every.supply_v), ("pitch_deg", every.pitch_deg))
             if log.has(name)}
    for name in ("roll_deg", "hopper_kg", "speed_mps"):
        if log.has(name):
            found[name] = _smooth(_bridged(every.time_s, log.columns[name], np.zeros(len(every.time_s))), log.step_s)
    if log.has("heading_deg"):
        found["heading_deg"] = np.mod(_held(log.columns["heading_deg"]), 360.0)
    return found


def _variables(log: Clean, every: _Rows) -> dict[str, Array]:
    """The recorded variables that something may depend on, (n,) by name; commands in place of the drives' readings."""
    found = {"time_s": every.time_s}
    if "shaft" in log.stages or "flow" in log.stages:
        found["shaft_rpm"] = np.where(np.isfinite(every.command_rpm), every.command_rpm, every.shaft_rpm)
    if "gate" in log.stages or "flow" in log.stages:
        found["opening_mm"] = np.where(np.isfinite(every.command_mm), every.command_mm, every.opening_mm)
    return found | _read_slowly(log, every)


def _held(series: Array) -> Array:
    """Last known value; before the first, that one."""
    known = np.isfinite(series)
    if not known.any():
        return series
    at = np.maximum.accumulate(np.where(known, np.arange(len(series)), -1))
    return np.asarray(series[np.where(at < 0, np.argmax(known), at)])


def _bridged(time: Array, series: Array, instead: Array, longest_s: float = np.inf) -> Array:
    """A series with its gaps bridged by straight lines; `instead` in the longer ones, or where nothing is known."""
    known = np.isfinite(series)
    if not known.any():
        return instead
    bridged = np.interp(time, time[known], series[known])
    held = np.maximum.accumulate(np.where(known, np.arange(len(series)), -1))
    ahead = len(series) - 1 - np.maximum.accumulate(np.where(known[::-1], np.arange(len(series)), -1))[::-1]
    last, following = time[np.maximum(held, 0)], time[np.minimum(ahead, len(series) - 1)]
    gap_s = np.where((held < 0) | (ahead >= len(series)), np.inf, following - last)
    return np.where(~known & (gap_s > longest_s) & np.isfinite(instead), instead, bridged)


def _smooth(series: Array, step_s: float) -> Array:
    half = int(round(0.5 * SMOOTH_S / step_s))
    if half < 1:
        return series
    padded = np.concatenate((np.full(half, series[0]), series, np.full(half, series[-1])))
    total = np.concatenate(([0.0], np.cumsum(padded)))
    width = 2 * half + 1
    return np.asarray((total[width:] - total[:-width]) / width)


def joined(time: Array, step_s: float, seam_s: float = 0.0) -> Array:
    """The clock of readings at `time` (m,), long gaps left out but for a step, or `seam_s` where that is longer."""
    spans = np.diff(time)
    spans = np.where(spans > MAX_BRIDGED_STEPS * step_s, np.clip(seam_s, step_s, spans), spans)
    return np.asarray(time[0] + np.concatenate(([0.0], np.cumsum(spans))))


def _grid(time: Array, known: npt.NDArray[np.bool_], step_s: float, clock: Array | None = None,
          seam_s: float = 0.0) -> Grid:
    rows = np.flatnonzero(known)
    inner = (time if clock is None else clock)[rows]
    inner = joined(inner, step_s, seam_s)
    count = max(2, int(np.floor((inner[-1] - inner[0]) / step_s + 1e-6)) + 1)
    even = inner[0] + step_s * np.arange(count)
    as_is = count == len(rows) and bool(np.allclose(inner, even, atol=0.2 * step_s))
    there = np.interp(even, inner, time[rows])
    return Grid(inner, rows, even, there, step_s, as_is)


def whole_drives(log: Clean, machine: Machine) -> dict[str, Drive]:
    """Shaft and gate of a log, by name, at every row even of a long log that is otherwise looked at in windows."""
    every = _rows(log, machine)
    more = over_log(machine.terms, term_inputs(log, every, machine), every.time_s, term_run)
    return _drives(log, every._replace(more=more), machine, whole=True)


def _drives(log: Clean, every: _Rows, machine: Machine, whole: bool) -> dict[str, Drive]:
    c, found, still_rpm = log.columns, {}, of_nominal(machine, SHAFT_RANGE) * STILL_READ_RPM
    if "shaft" in log.stages:
        since = every.time_s - np.maximum.accumulate(np.where(every.command_rpm != 0.0, every.time_s, -np.inf))
        read = _smooth(_bridged(every.time_s, c["shaft_rpm"], np.zeros(len(every.time_s))), log.step_s)
        still = (since > STILL_AFTER_S) & (np.abs(read) < still_rpm)    # for a while: single readings would be a choice
        # A shaft that stands as it was commanded tells nothing, and its reading has none of the noise of a turning one.
        sure = ~still & _sure(every, every.command_rpm, of_nominal(machine, SHAFT_RANGE) * SAME_RPM,
                              machine.shaft.dead_time_s + ANSWERED * machine.shaft.time_constant_s,
                              machine.shaft.acceleration_rpm_s)
        sure &= ~against_the_way(every.time_s, every.command_rpm, c["shaft_rpm"], machine)
        settle_s = min(SETTLE_S, SETTLES * (machine.shaft.dead_time_s + machine.shaft.time_constant_s))
        settled = log.held and every.step_s > ANSWERED * (machine.shaft.dead_time_s + machine.shaft.time_constant_s)
        found["shaft"] = _drive("shaft", every, every.command_rpm, c["shaft_rpm"], sure, whole, machine.noise.shaft_rpm,
                                settle_s, settled, MIN_SETTLED if log.held else MIN_ROWS)
    if "gate" in log.stages:
        sure = _sure(every, every.command_mm, of_nominal(machine, OPENING_RANGE) * SAME_MM, machine.gate.dead_time_s,
                     machine.gate.slew_mm_s)
        found["gate"] = _drive("gate", every, every.command_mm, c["opening_mm"], sure, whole, machine.noise.opening_mm)
    return {name: drive for name, drive in found.items() if drive is not None}


def against_the_way(time_s: Array, command_rpm: Array, read_rpm: Array, machine: Machine) -> npt.NDArray[np.bool_]:
    """Rows that ask a shaft to turn backwards, or read it so, though its machine file says that it turns one way, and
    those in which it may still run down from that: (n,). None of them is judged."""
    if machine.shaft.one_way <= 0.0:
        return np.zeros(len(time_s), bool)
    stopped_rpm = of_nominal(machine, SHAFT_RANGE) * STOPPED_RPM
    noise_rpm = READ_BACKWARDS_SD * machine.noise.shaft_rpm
    back = (command_rpm < -stopped_rpm) | (read_rpm < -max(stopped_rpm, noise_rpm))
    last = np.maximum.accumulate(np.where(back, time_s, -np.inf))
    return np.asarray(time_s - last <= SETTLES * machine.shaft.time_constant_s)


def _sure(every: _Rows, command: Array, same: float, dead_s: float, per_s: float) -> npt.NDArray[np.bool_]:
    """Rows whose drive has answered every command that can have been given since the row before: (n,).

    Where commands may be missing from the log, a row is sure when its command and those of all rows within the time of
    an answer are the same, the row before them included: any command between two equal ones had no reason. dead_s :
    what a drive takes however short its way is; per_s : how much of the way it goes in a second.
    """
    if not every.lost.any():
        return np.ones(len(command), bool)
    way = np.nan_to_num(np.abs(np.diff(command, prepend=command[0])))
    answers_s = np.maximum(ANSWERS_S, SLOWER * (dead_s + way / per_s))
    unsure_until = np.where((way > same) & every.lost, every.time_s + answers_s, -np.inf)
    return np.asarray(every.time_s >= np.maximum.accumulate(unsure_until))


def _late(every: _Rows) -> bool:
    """Whether a computer did not keep up: rows are missing, and the others do not stand in whole steps, as they do
    where a logger only lost some."""
    steps = np.diff(every.time_s) / every.step_s
    return (every.step_s <= FINE_LOG_S and float(np.mean(every.lost)) > LATE_ROWS
            and float(np.mean(np.abs(steps - np.round(steps)) > OFF_STEP)) > LATE_ROWS)


def _quick(every: _Rows, measured: Array, noise: float) -> npt.NDArray[np.bool_]:
    """Rows of a late computer in which a drive moves by more than its reading's noise in the time by which a row may
    be late: what is read there says when it was read, not what the drive did. (n,)"""
    time, known = every.time_s, np.isfinite(measured)
    if not known.any() or not _late(every):
        return np.zeros(len(measured), bool)
    rate = np.abs(np.gradient(np.interp(time, time[known], measured[known]), time))
    return np.asarray(maximum_filter1d(rate, 3) * STAMP_SHARE * every.step_s > noise)      # its neighbours as well


def _drive(name: str, every: _Rows, command: Array, measured: Array, sure: npt.NDArray[np.bool_],
           whole: bool, noise: float, settle_s: float = SETTLE_S, settled: bool = False,
           least: int = MIN_ROWS) -> Drive | None:
    """None where hardly a row can be judged. noise : of a reading (1 s.d.). settled : a row holds a settled answer.
    least : rows that can be judged."""
    time = every.time_s
    pick, clock, since = (np.arange(len(time)), time, time - time[0]) if whole else _windows(time, every.step_s)
    quick = _quick(every, measured, noise)[pick]
    known = np.isfinite(measured[pick]) & (since >= settle_s) & sure[pick] & ~quick
    if known.sum() < least:
        return None
    grid = _grid(time[pick], known, every.step_s, clock)
    more, more_rpm = every.more.get("shaft_percent" if name == "shaft" else "gate_mm"), every.more.get("shaft_rpm")
    return Drive(name, time[pick], clock, command[pick], measured[pick], every.opening_mm[pick], every.supply_v[pick],
                 grid, moves_seen=bool(np.mean(every.lost) < MAX_LOST) and not quick.any() and not settled,
                 settled=settled, left_out=int(np.sum(quick)),
                 more=0.0 if more is None else more[pick],
                 more_rpm=0.0 if more_rpm is None or name != "shaft" else more_rpm[pick])


def _windows(time: Array, step_s: float) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Rows of a log that are looked at row by row, their clock without the gaps, and the time since their window began.

    A drive's answer to its command is as well known after twenty thousand rows as after a million.
    """
    rows = looked_at(len(time))
    if len(rows) == len(time):
        return rows, time, time - time[0]
    spans = np.diff(time[rows], prepend=time[rows[0]])
    seam = np.diff(rows, prepend=rows[0]) > 1
    clock = time[rows[0]] + np.cumsum(np.where(seam, step_s, spans))
    started = np.maximum.accumulate(np.where(seam, clock, clock[0]))
    return rows, clock, clock - started


def looked_at(count: int) -> npt.NDArray[np.int64]:
    """Which of `count` rows are looked at one by one: all, or WINDOWS even stretches of WINDOW_ROWS in all."""
    if count <= MAX_ROWS:
        return np.arange(count)
    each = WINDOW_ROWS // WINDOWS
    starts = np.linspace(0, count - each, WINDOWS).astype(np.int64)
    return (starts[:, None] + np.arange(each)).ravel()


def known_rows(count: int) -> npt.NDArray[np.int64]:
    """Rows at which the recorded variables are kept: all, or those looked at and every EVERY_ROW-th of the others."""
    rows = looked_at(count)
    return rows if len(rows) == count else np.union1d(rows, np.arange(0, count, EVERY_ROW))


def _hopper(every: _Rows, reading: Array, written: list[tuple[float, float]], machine: Machine) -> Hopper | None:
    """None where the scale was read in too few bins."""
    time = every.time_s
    width = max(HOPPER_STEP_S, every.step_s, float(np.ceil((time[-1] - time[0]) / MAX_BINS)))
    count = int(np.floor((time[-1] - time[0]) / width))
    edges = time[0] + width * np.arange(count + 1)
    turned, wide, level = _binned_inputs(every, edges, width, of_nominal(machine, SHAFT_RANGE) * STOPPED_RPM)
    known = np.isfinite(reading) & (time < edges[-1])
    bins = np.minimum(count - 1, np.floor((time[known] - time[0]) / width).astype(int))
    seen = np.bincount(bins, minlength=count)
    sums = np.bincount(bins, weights=reading[known], minlength=count)
    kg = np.where(seen > 0, sums / np.maximum(1, seen), np.nan)
    within = np.bincount(bins, weights=(time[known] - edges[bins]) / width, minlength=count)
    read_at = np.where(seen > 0, within / np.maximum(1, seen), 0.5)
    rise_kg = max(of_nominal(machine, HOPPER) * REFILL_KG, REFILL_SD * machine.noise.scale_kg)
    refill, jumps, hidden = _refills(kg, rise_kg)
    stated = []
    for jump in jumps:
        close = [amount for at, amount in written if abs(at - edges[jump]) < STATED_WITHIN_S]
        stated.append(bool(close))
        if close:
            refill[jump] = close[0]
    good = np.isfinite(kg) & ~hidden
    if good.sum() < MIN_BINS:
        return None
    return Hopper(edges, turned, wide, level, kg, read_at, np.append(refill, 0.0), float(np.median(kg[good][:10])),
                  jumps, tuple(stated), _grid(edges[:-1] + 0.5 * width, good, width),
                  *_unseen(every, edges, of_nominal(machine, SHAFT_RANGE) * STOPPED_RPM),
                  *_of_terms(every, edges))


def _of_terms(every: _Rows, edges: Array) -> tuple[Array | float, Array | float, Array | float]:
    """What the machine file's terms add in each bin: per cent of its flow, kg/s (m+1,), and kg of the reading (m,)."""
    more, time = every.more, every.time_s
    percent: Array | float = 0.0
    kg_s: Array | float = 0.0
    kg: Array | float = 0.0
    if "flow_percent" in more:
        percent = metered_mean(more["flow_percent"], every.shaft_rpm * every.opening_mm, time, edges)
    if "flow_kg_min" in more:
        kg_s = bin_mean(np.where(every.shaft_rpm > 0.0, more["flow_kg_min"], 0.0) / 60.0, time, edges)
    if "scale_kg" in more:
        kg = kg + bin_mean(more["scale_kg"], time, edges)[:-1]
    if "scale_kg_min" in more:
        run_away = np.concatenate(([0.0], np.cumsum(more["scale_kg_min"][:-1] / 60.0 * np.diff(time))))
        kg = kg + bin_mean(run_away, time, edges)[:-1]
    return percent, kg_s, kg


def bin_mean(series: Array, time: Array, edges: Array) -> Array:
    """Mean of a held series (rows,) over each bin, the last repeated: (m+1,)."""
    mean = _sums_in(time, np.diff(time) * series[:-1], edges) / np.diff(edges)
    return np.append(mean, mean[-1])


def metered_mean(series: Array, metered: Array, time: Array, edges: Array) -> Array:
    """The same weighted with what was metered meanwhile; plain where nothing was."""
    weight = bin_mean(np.maximum(metered, 0.0), time, edges)
    weighted = bin_mean(np.maximum(metered, 0.0) * series, time, edges)
    return np.where(weight > 0.0, weighted / np.where(weight > 0.0, weight, 1.0), bin_mean(series, time, edges))


def _unseen(every: _Rows, edges: Array, stopped_rpm: float) -> tuple[float, tuple[tuple[int, float], ...]]:
    """What may have been metered between rows, over a straight line from one to the next (`Hopper.unseen`, `gaps`)."""
    if not every.lost.any():
        return 0.0, ()
    rate = np.where(every.shaft_rpm < stopped_rpm, 0.0, every.shaft_rpm) * every.opening_mm
    spans, usual = np.diff(every.time_s), float(np.median(rate[rate > 0.0])) if (rate > 0.0).any() else 0.0
    steady = UNSEEN_STEADY * 0.5 * (rate[1:] + rate[:-1]) * np.minimum(1.0, spans / UNSEEN_S)
    off = np.where(every.lost[1:], (UNSEEN_CHANGE * np.abs(np.diff(rate)) + steady) * spans, 0.0)
    long = (spans > LONG_GAP_S) & (spans > MAX_BRIDGED_STEPS * every.step_s) & (usual > 0.0)
    ends = np.clip(np.searchsorted(edges, every.time_s[1:][long], side="right") - 1, 0, len(edges) - 2)
    gaps = tuple((int(end), float(span * usual)) for end, span in zip(ends, spans[long], strict=True))
    return float(np.sqrt(np.sum(off[~long] ** 2) / max(1, len(edges) - 1))), gaps


def _binned_inputs(every: _Rows, edges: Array, width: float, stopped_rpm: float) -> tuple[Array, Array, Array]:
    """Mean shaft speed, opening (weighted with it) and pitch in each bin, the last repeated: (m+1,) each."""
    time, spans, opening = every.time_s, np.diff(every.time_s), every.opening_mm
    rpm = np.where(every.shaft_rpm < stopped_rpm, 0.0, every.shaft_rpm)

    def mean(series: Array) -> Array:
        return _sums_in(time, spans * 0.5 * (series[1:] + series[:-1]), edges) / width
    turned, metered, plain, level = mean(rpm), mean(rpm * opening), mean(opening), mean(every.pitch_deg)
    turned = np.where(turned < stopped_rpm, 0.0, turned)
    wide = np.where(turned > 0.0, metered / np.where(turned > 0.0, turned, 1.0), plain)
    extend = np.append(np.arange(len(turned)), len(turned) - 1)
    return turned[extend], wide[extend], level[extend]


def _written(time: Array, events: npt.NDArray[Any]) -> list[tuple[float, float]]:
    """(time_s, kg) of the refills that the operator wrote down."""
    found: list[tuple[float, float]] = []
    for row in np.flatnonzero(events != ""):
        for word in str(events[row]).split(";"):
            parts = word.split()
            if len(parts) == 2 and parts[0] == "refill":
                try:
                    found.append((float(time[row]), float(parts[1])))
                except ValueError:
                    continue
            elif parts[:1] == ["refill_back"] and found:        # the one before was none
                found.pop()
    return found


def _sums_in(time: Array, amounts: Array, edges: Array) -> Array:
    """Sums of amounts per row interval, shared out over bins: (len(edges)-1,)."""
    total = np.concatenate(([0.0], np.cumsum(amounts)))
    return np.diff(np.interp(edges, time, total))


def _refills(kg: Array, rise_kg: float) -> tuple[Array, tuple[int, ...], npt.NDArray[np.bool_]]:
    """kg filled in by bin, the bins from which it counts, and the bins in which the reading is between two levels."""
    refill = np.zeros(len(kg))
    hidden = np.zeros(len(kg), bool)
    filled = _held(kg)
    ahead = 3
    rises = np.flatnonzero(filled[ahead:] - filled[:-ahead] > rise_kg)
    jumps: list[int] = []
    if len(rises):
        groups = np.split(rises, np.flatnonzero(np.diff(rises) > 10) + 1)
        for group in groups:
            begin, end = int(group[0]), min(len(kg) - 1, int(group[-1]) + ahead + 1)
            before = filled[max(0, begin - 5):begin + 1]
            after = filled[end:end + 6]
            at = min(len(kg) - 1, end)
            refill[at] = max(0.0, float(np.median(after)) - float(np.median(before)))
            hidden[begin:at + 1] = True
            jumps.append(at)
    return refill, tuple(jumps), hidden


def _speed(every: _Rows, gnss: Array, wheel: Array, machine: Machine) -> Speed | None:
    """Both speeds where they are new; None where they hardly ever are.

    The mean weighted with both sensors' precision is the one whose noise their difference knows nothing of.
    """
    time = every.time_s
    fresh = _fresh(gnss)
    known = np.isfinite(gnss) & np.isfinite(wheel) & fresh
    rows = looked_at(len(time))
    rows = rows[known[rows]]
    if len(rows) < MIN_ROWS:
        return None
    at = time[rows]
    step = float(np.median(np.diff(at)))
    wheel_there = wheel[rows]
    going = (gnss[rows] > MOVING_MPS) & (wheel_there > MOVING_MPS)
    ratio = float(np.median(wheel_there[going] / gnss[rows][going])) if going.any() else 1.0
    trust = _trust(gnss[rows], wheel_there / ratio, machine)
    both = (1.0 - trust) * gnss[rows] + trust * wheel_there / ratio
    window = min(len(both) - 1 + len(both) % 2, 2 * int(0.5 * SPEED_WINDOW_S / step) + 1)
    smooth = _smoothed(both, window) if window > 3 else both
    moving = smooth > MOVING_MPS
    grid = _grid(at, moving if moving.sum() > 0.2 * len(at) else np.ones(len(at), bool), step, seam_s=FORGETS_S)
    more = every.more.get("wheel_percent")
    return Speed(at, smooth, every.working[rows], every.pitch_deg[rows], wheel_there, gnss[rows], grid,
                 0.0 if more is None else more[rows])


def _trust(gnss: Array, wheel: Array, machine: Machine) -> float:
    """Weight of the wheel in the mean of both speeds: share of GNSS in the variance of their noise.

    Of what changes between two readings, the part that both have in common is the ground's; the rest is each one's own.
    """
    if len(gnss) < MIN_READINGS_APART:
        own = np.array([machine.noise.gnss_mps, machine.noise.wheel_mps]) ** 2 + 1e-12
    else:
        steps = np.diff(np.array([gnss, wheel]), axis=1)
        reach = 4.0 * ROBUST_SD * np.median(np.abs(steps), axis=1, keepdims=True) + 1e-9
        spread = np.cov(np.clip(steps, -reach, reach))
        own = np.maximum(np.diag(spread) - max(0.0, float(spread[0, 1])), 0.01 * np.diag(spread)) + 1e-12
    return float(own[0] / own.sum())


def _smoothed(values: Array, window: int) -> Array:
    """Quadratics fitted to every `window` (odd) neighbours, at their middle; at the ends those of the first and last
    window (Savitzky and Golay 1964, Anal. Chem. 36, 1627)."""
    reach = window // 2
    at = np.arange(-reach, reach + 1)
    weights = (3.0 * reach * (reach + 1) - 1.0 - 5.0 * at ** 2) * 3.0 / ((window - 2.0) * window * (window + 2.0))
    found = convolve1d(values, weights, mode="nearest")
    for end, ours in ((slice(0, window), slice(0, reach)), (slice(-window, None), slice(-reach, None))):
        quadratic = np.polynomial.polynomial.polyfit(at, values[end], 2)
        found[ours] = np.polynomial.polynomial.polyval(at[ours], quadratic)
    return np.asarray(found)


def _fresh(series: Array) -> npt.NDArray[np.bool_]:
    """Rows with a new value, where a sensor slower than the log is held between its readings."""
    changed = np.concatenate(([True], series[1:] != series[:-1]))
    known = np.isfinite(series)
    return changed if changed[known].mean() < 0.7 else np.ones(len(series), bool)


def _moves(gnss: Array, wheel: Array) -> npt.NDArray[np.bool_]:
    """Rows in which the machine moves, by either speed; all of them where no speed is known."""
    known = np.isfinite(gnss) | np.isfinite(wheel)
    return np.where(known, np.fmax(gnss, wheel) > MOVING_MPS, ~known.any())


def _heads(time: Array, ndvi: Array, moves: npt.NDArray[np.bool_]) -> Heads | None:
    """The heads while the machine moves: where it stands, each sees its own piece of canopy all the time, which is no
    trait of the head."""
    there = np.isfinite(ndvi).mean(axis=1) > 0.2
    ndvi = np.where(there[:, None], ndvi, np.nan)
    some = ndvi[there]
    known = np.isfinite(some).all(axis=0)
    changed = np.concatenate(([True], (some[:, 1:] != some[:, :-1]).any(axis=0)))
    rows = looked_at(ndvi.shape[1])
    rows = rows[(known & changed & moves)[rows]]
    if len(rows) < MIN_ROWS:
        return None
    at = time[rows]
    used = ndvi[:, rows]
    return Heads(at, used, np.nanmean(used, axis=0), _grid(at, np.ones(len(at), bool), float(np.median(np.diff(at)))))
