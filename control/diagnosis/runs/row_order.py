"""Detects whether a foreign log stores commands and answers in other rows than ours, and shifts its
columns.

Row k of our run log holds the readings at its time and the command given then. Other programs write
a command next to its answer, or the command under which a row was read, or the readings a row late.
In our convention, the drives of such a log answer a row too early or too late. A drive itself can
be early only by its data sheet's lag. Lateness may be a fault of a drive, but rarely of both drives
by the same row. Where a drive that moves alone is late, nothing is shifted, because a dead time
looks the same, unless rows are further apart than any dead time.

The tolerance of a drive's dead time is neither a row shift nor a disguise of one: each row order is
compared with the best-fitting dead time of each drive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import GATE_SLOW
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.machine.machine import Machine
from topdress.control.machine.shaft import MIN_TIME_CONSTANT_S
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import ChannelSeries, make_channels, make_drive_channel
from .drives import Drive
from .hypothesis import EffectInstance, Schedule, list_stages, make_schedule
from .log import CleanLog
from .nominal_values import MAX_OFFSET_SD, TIMING_HALVING_COUNT
from .stages import make_run_data

Array = npt.NDArray[np.float64]

DRIVES = ("shaft", "gate")
COMMANDS = ("shaft_rpm_cmd", "opening_mm_cmd")
ANSWERS = ("shaft_rpm", "opening_mm")
# Minimum row distance, s, at which the shift of a drive that moves alone must come from its rows.
MIN_SINGLE_STEP_S = 0.5
# Minimum gain of each drive in log-likelihood: a shift must be beyond doubt.
MIN_SHIFT_GAIN = 30.0
# Minimum gain as a share of the loss by the opposite shift: the drives are then off by 3/4 of a row
# at least.
MIN_GAIN_SHARE = 0.2
# Median of the square of a standard normal variable.
NORMAL_SQUARE_MEDIAN = 0.4549
# Number of rows that are examined, from the start: a logger does not change its row order.
MAX_EXAMINED_ROWS = 10_000
# Multiple of the gate's slew rate that represents a move within a row.
FAST_SLEW_RATIO = 100.0
# Maximum residual in robust standard deviations: a single stop of a drive is no row order.
MAX_RESIDUAL_SD = 6.0


class FittedDeadTime(NamedTuple):
    """A drive with its own fitted dead time: squared residuals (m,), log prior cost, and offset in
    standard deviations of the tolerance."""

    squares: Array
    cost: float
    by_sd: float


class ColumnShift(NamedTuple):
    """Shift of some columns by `rows` (positive: to later rows), and its description for the
    user."""

    columns: tuple[str, ...]
    rows: int
    said: str


READ_LATE = ColumnShift(
    ANSWERS, -1, "shaft and opening are read a row late: their readings are moved a row up"
)
IN_ONE_ROW = ColumnShift(
    ANSWERS,
    1,
    "a row holds a command with what answered it: readings of shaft and opening are moved a "
    "row down",
)
IN_FORCE = ColumnShift(
    COMMANDS,
    -1,
    "a row holds the command under which it was read, not the next one: commands are moved a "
    "row up",
)
COMMAND_LATE = ColumnShift(
    COMMANDS, 1, "commands stand a row before they are given: they are moved a row down"
)
# The drives cannot distinguish the two shifts of a pair.
LATE_SHIFTS, EARLY_SHIFTS = (READ_LATE, COMMAND_LATE), (IN_ONE_ROW, IN_FORCE)
SHIFT_PAIRS = (LATE_SHIFTS, EARLY_SHIFTS)


def order_log_rows(log: CleanLog, machine: Machine) -> CleanLog:
    """Return the log with commands and answers in the rows of our convention, and a finding about
    the shift."""
    return shift_log_columns(log, find_row_order(log, machine))


def shift_log_columns(log: CleanLog, move: ColumnShift | None) -> CleanLog:
    """Return a log with some columns shifted and a finding about the shift; unchanged for None."""
    return log if move is None else _shift_columns(log, move)


def find_row_order(log: CleanLog, machine: Machine) -> ColumnShift | None:
    """Return the shift that brings a log into our row order; None where no shift is needed."""
    some, nominal = _cut_beginning(log), make_schedule(list_stages(machine), ())
    seen = _make_order_channels(some, machine)
    as_it_is = _calc_order_residuals(seen, nominal)
    tried = [_shift_columns(some, ways[0]) for ways in SHIFT_PAIRS]
    left = [_calc_order_residuals(_make_order_channels(one, machine), nominal) for one in tried]
    by_way = [_calc_gain_by_drive(as_it_is, one) for one in left]
    best = int(np.argmax([sum(gains.values()) for gains in by_way]))
    early, alone = SHIFT_PAIRS[best] is EARLY_SHIFTS, log.step_s >= MIN_SINGLE_STEP_S
    telling = [
        drive
        for drive in DRIVES
        if max(abs(gains.get(drive, 0.0)) for gains in by_way) > MIN_SHIFT_GAIN
    ]
    if len(telling) < (1 if alone or early else 2):
        return None
    further = _calc_gain_by_drive(
        left[best],
        _calc_order_residuals(
            _make_order_channels(_shift_columns(tried[best], SHIFT_PAIRS[best][0]), machine),
            nominal,
        ),
    )
    gain, opposite, more = (
        sum(one.get(drive, 0.0) for drive in telling)
        for one in (by_way[best], by_way[1 - best], further)
    )
    # The remaining delay may be no longer, as it would be with a fault.
    if gain < max(MIN_SHIFT_GAIN, -MIN_GAIN_SHARE * opposite) or more > 0.0:
        return None
    if not alone and not _beyond_tolerance(
        seen, _make_order_channels(tried[best], machine), early, machine
    ):
        return None
    scales = [
        _calc_order_residuals(
            _make_order_channels(_shift_columns(some, way), machine), nominal, ("scale",)
        )
        for way in SHIFT_PAIRS[best]
    ]
    # Too early or too late a flow leaves a rough residual of the scale; a constant offset adds
    # nothing to its differences.
    rough = [float(np.mean(np.square(np.diff(one.get("scale", np.zeros(2)))))) for one in scales]
    return SHIFT_PAIRS[best][int(np.argmin(rough))]


def _beyond_tolerance(
    seen: Mapping[str, ChannelSeries],
    moved: Mapping[str, ChannelSeries],
    early: bool,
    machine: Machine,
) -> bool:
    """Tell whether the drives are off by a row at any dead time within its tolerance.

    Early drives must gain more than drives without lag would. Late drives: the gate must gain more
    than by a slower slew rate, and the shaft may lose no more than a tolerance costs.
    """
    now, by_itself = _settle_drives(moved, machine), [_settle_drives(seen, machine)]
    if early:
        by_itself.append(_settle_drives(seen, _drop_drive_lags(machine)))
    gains = {
        drive: min(
            _calc_likelihood_gain(was[drive].squares, one.squares) + was[drive].cost - one.cost
            for was in by_itself
        )
        for drive, one in now.items()
    }
    if early:
        return sum(gains.values()) > MIN_SHIFT_GAIN
    return gains["shaft"] > -0.5 * MAX_OFFSET_SD**2 and gains["gate"] > max(
        MIN_SHIFT_GAIN, _slow_gate_gain(by_itself[0]["gate"].squares, seen, machine)
    )


def _drop_drive_lags(machine: Machine) -> Machine:
    """Return the machine with drives that move immediately after their dead time."""
    return machine.model_copy(
        update={
            "shaft": machine.shaft._replace(time_constant_s=MIN_TIME_CONSTANT_S),
            "gate": machine.gate._replace(slew_mm_s=FAST_SLEW_RATIO * machine.gate.slew_mm_s),
        }
    )


def _settle_drives(
    seen: Mapping[str, ChannelSeries], machine: Machine
) -> dict[str, FittedDeadTime]:
    """Fit the dead time of each drive within its tolerance."""
    return {drive: _climb_dead_time(seen, drive, machine) for drive in DRIVES if drive in seen}


def _climb_dead_time(
    seen: Mapping[str, ChannelSeries], drive: str, machine: Machine
) -> FittedDeadTime:
    def fit_dead_time(by_sd: float) -> FittedDeadTime:
        dead_time_s = getattr(machine, drive).dead_time_s + by_sd * machine.tolerance.dead_time_s
        plan = make_schedule(
            list_stages(machine).replace_fields(drive, dead_time_s=max(0.0, dead_time_s)), ()
        )
        return FittedDeadTime(
            np.square(_calc_order_residuals(seen, plan, (drive,))[drive]), 0.5 * by_sd**2, by_sd
        )

    first = fit_dead_time(0.0)
    return climb_to_best(
        first,
        lambda one: _calc_likelihood_gain(first.squares, one.squares) - one.cost,
        lambda one, step: [
            fit_dead_time(by_sd)
            for by_sd in (one.by_sd - step, one.by_sd + step)
            if abs(by_sd) <= MAX_OFFSET_SD
        ],
        [0.5**k for k in range(TIMING_HALVING_COUNT)],
    )


def calc_late_gate_gain(gate: Drive, machine: Machine, late_s: float) -> float:
    """Return the gain in log-likelihood of a gate that answers `late_s` later than its data sheet
    says, each at the best dead time within its tolerance."""
    seen = {"gate": make_drive_channel(gate, machine)}
    delayed = machine.gate._replace(dead_time_s=machine.gate.dead_time_s + late_s)
    now, late = (
        _climb_dead_time(seen, "gate", one)
        for one in (machine, machine.model_copy(update={"gate": delayed}))
    )
    return _calc_likelihood_gain(now.squares, late.squares) + now.cost - late.cost


def _cut_beginning(log: CleanLog) -> CleanLog:
    return log._replace(
        time_s=log.time_s[:MAX_EXAMINED_ROWS],
        events=log.events[:MAX_EXAMINED_ROWS],
        state=log.state[:MAX_EXAMINED_ROWS],
        columns={name: column[:MAX_EXAMINED_ROWS] for name, column in log.columns.items()},
        further={name: column[:MAX_EXAMINED_ROWS] for name, column in log.further.items()},
    )


def _shift_columns(log: CleanLog, move: ColumnShift) -> CleanLog:
    columns = dict(log.columns)
    for name in move.columns:
        at = np.clip(np.arange(len(log.time_s)) - move.rows, 0, len(log.time_s) - 1)
        columns[name] = log.columns[name][at]
    return log._replace(columns=columns, findings=(*log.findings, move.said))


def _make_order_channels(log: CleanLog, machine: Machine) -> Mapping[str, ChannelSeries]:
    return make_channels(make_run_data(log, machine), machine)


def _calc_order_residuals(
    seen: Mapping[str, ChannelSeries], plan: Schedule, words: Sequence[str] = DRIVES
) -> dict[str, Array]:
    """Return the residuals of these channels where they are valid."""
    return {
        word: seen[word].measured - seen[word].predict(plan, MAX_MODEL_STEP_S)
        for word in words
        if word in seen
    }


def _slow_gate_gain(before: Array, seen: Mapping[str, ChannelSeries], machine: Machine) -> float:
    """Return the largest gain of a slower gate over squares `before` (m,): together with a late
    shaft, a slow gate looks like shifted rows."""
    plans = [
        make_schedule(list_stages(machine), (EffectInstance(GATE_SLOW.id, size),))
        for size in GATE_SLOW.trial_sizes
    ]
    return max(
        _calc_likelihood_gain(
            before, np.square(_calc_order_residuals(seen, plan, ("gate",))["gate"])
        )
        for plan in plans
    )


def _calc_gain_by_drive(before: dict[str, Array], after: dict[str, Array]) -> dict[str, float]:
    """Return the gain in log-likelihood of each judged drive."""
    return {
        drive: _calc_likelihood_gain(np.square(before[drive]), np.square(after[drive]))
        for drive in DRIVES
        if drive in before and drive in after
    }


def _calc_likelihood_gain(before: Array, after: Array) -> float:
    """Return the gain in log-likelihood from squares of Gaussian residuals with their own variance;
    outliers are limited.

    A few rows may be valid in only one of them, so means are compared.
    """
    far = (
        MAX_RESIDUAL_SD**2 * float(min(np.median(before), np.median(after))) / NORMAL_SQUARE_MEDIAN
    )
    if far <= 0.0:
        return 0.0
    was, now = (float(np.mean(np.minimum(squares, far))) for squares in (before, after))
    return 0.5 * min(len(before), len(after)) * float(np.log(was / now))
