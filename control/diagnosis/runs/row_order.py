"""Which row of a foreign log holds a command, and which what answered it.

A run log of ours holds in row k what was read at its time, and the command given then. Others
write a command with what answered it in one row, or the command under which a row was read, or
the readings a row late. Seen as ours, such a log has drives that answer a row too early or too
late. A drive is early by itself where it answers quicker than its data sheet says, at once at
most. What makes one late is a fault of that drive, and not of the other by the same row: where
one moves alone and late, nothing is moved, as a dead time may look the same: unless rows are
further apart than any dead time.

What a drive's dead time may be off within its tolerance is no order of rows, and hides none:
each drive is held against an order with the dead time that fits it best.
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

from .channels import ChannelSeries, make_channels
from .hypothesis import EffectInstance, Schedule, list_stages, make_schedule
from .log import Clean
from .nominal_values import HALVINGS, MAX_OFFSET_SD
from .stages import make_run_data

Array = npt.NDArray[np.float64]

DRIVES = ("shaft", "gate")
COMMANDS = ("shaft_rpm_cmd", "opening_mm_cmd")
ANSWERS = ("shaft_rpm", "opening_mm")
# between rows: a drive that moves alone is that late or early for its rows' sake only
ALONE_S = 0.5
# of each drive, in units of the log-likelihood: what is moved must be beyond doubt
LEAST_EVIDENCE = 30.0
# of what the opposite move loses: then the drives are 3/4 of a row off at least
NEARER = 0.2
MEDIAN_OF_SQUARES = 0.4549  # of a standard normal variable
ROWS = 10_000  # from the beginning on: a logger keeps its order
# times its slew: a gate that is there within a row
AT_ONCE = 100.0
# a residual counts as so many robust s.d. at most: one stop of a drive is no order of rows
FAR_SD = 6.0


class Settled(NamedTuple):
    """A drive with a dead time of its own: squares of what is left of it (m,), what its prior
    costs, and how many s.d. of the tolerance it is off."""

    squares: Array
    cost: float
    by_sd: float


class Move(NamedTuple):
    """Columns that are moved by `rows` (positive: down, to later rows), and what that is in
    words."""

    columns: tuple[str, ...]
    rows: int
    said: str


READ_LATE = Move(
    ANSWERS, -1, "shaft and opening are read a row late: their readings are moved a row up"
)
IN_ONE_ROW = Move(
    ANSWERS,
    1,
    "a row holds a command with what answered it: readings of shaft and opening are moved a "
    "row down",
)
IN_FORCE = Move(
    COMMANDS,
    -1,
    "a row holds the command under which it was read, not the next one: commands are moved a "
    "row up",
)
COMMAND_LATE = Move(
    COMMANDS, 1, "commands stand a row before they are given: they are moved a row down"
)
# each pair is the same to the drives
LATE, EARLY = (READ_LATE, COMMAND_LATE), (IN_ONE_ROW, IN_FORCE)
WAYS = (LATE, EARLY)


def order_log_rows(log: Clean, machine: Machine) -> Clean:
    """The log with commands and answers in the rows that ours have them in, and what was moved
    among its findings."""
    return move_log_columns(log, find_row_order(log, machine))


def move_log_columns(log: Clean, move: Move | None) -> Clean:
    """A log with some of its columns moved, and that among its findings; None: as it is."""
    return log if move is None else _shift_columns(log, move)


def find_row_order(log: Clean, machine: Machine) -> Move | None:
    """What must be moved for a log to have its rows in our order; None: nothing."""
    some, nominal = _cut_beginning(log), make_schedule(list_stages(machine), ())
    seen = _make_order_channels(some, machine)
    as_it_is = _calc_order_residuals(seen, nominal)
    tried = [_shift_columns(some, ways[0]) for ways in WAYS]
    left = [_calc_order_residuals(_make_order_channels(one, machine), nominal) for one in tried]
    by_way = [_calc_gain_by_drive(as_it_is, one) for one in left]
    best = int(np.argmax([sum(gains.values()) for gains in by_way]))
    early, alone = WAYS[best] is EARLY, log.step_s >= ALONE_S
    telling = [
        drive
        for drive in DRIVES
        if max(abs(gains.get(drive, 0.0)) for gains in by_way) > LEAST_EVIDENCE
    ]
    if len(telling) < (1 if alone or early else 2):
        return None
    further = _calc_gain_by_drive(
        left[best],
        _calc_order_residuals(
            _make_order_channels(_shift_columns(tried[best], WAYS[best][0]), machine), nominal
        ),
    )
    gain, opposite, more = (
        sum(one.get(drive, 0.0) for drive in telling)
        for one in (by_way[best], by_way[1 - best], further)
    )
    # no further off, as by a fault
    if gain < max(LEAST_EVIDENCE, -NEARER * opposite) or more > 0.0:
        return None
    if not alone and not _beyond_tolerance(
        seen, _make_order_channels(tried[best], machine), early, machine
    ):
        return None
    scales = [
        _calc_order_residuals(
            _make_order_channels(_shift_columns(some, way), machine), nominal, ("scale",)
        )
        for way in WAYS[best]
    ]
    # Rough is what a flow leaves that comes too early or late; a level adds nothing.
    rough = [float(np.mean(np.square(np.diff(one.get("scale", np.zeros(2)))))) for one in scales]
    return WAYS[best][int(np.argmin(rough))]


def _beyond_tolerance(
    seen: Mapping[str, ChannelSeries],
    moved: Mapping[str, ChannelSeries],
    early: bool,
    machine: Machine,
) -> bool:
    """Whether the drives are surely a row off, with any dead time within its tolerance. Early:
    more so than drives that follow at once. Late: the gate must be, more so than by slewing too
    slowly, and the shaft lose no more by the move than a tolerance costs."""
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
        return sum(gains.values()) > LEAST_EVIDENCE
    return gains["shaft"] > -0.5 * MAX_OFFSET_SD**2 and gains["gate"] > max(
        LEAST_EVIDENCE, _slow_gate_gain(by_itself[0]["gate"].squares, seen, machine)
    )


def _drop_drive_lags(machine: Machine) -> Machine:
    """The same with drives that are there as soon as their dead time is over."""
    return machine.model_copy(
        update={
            "shaft": machine.shaft._replace(time_constant_s=MIN_TIME_CONSTANT_S),
            "gate": machine.gate._replace(slew_mm_s=AT_ONCE * machine.gate.slew_mm_s),
        }
    )


def _settle_drives(seen: Mapping[str, ChannelSeries], machine: Machine) -> dict[str, Settled]:
    """Each drive with the dead time, within its tolerance, that leaves least of it."""
    return {drive: _climb_dead_time(seen, drive, machine) for drive in DRIVES if drive in seen}


def _climb_dead_time(seen: Mapping[str, ChannelSeries], drive: str, machine: Machine) -> Settled:
    def off(by_sd: float) -> Settled:
        dead_time_s = getattr(machine, drive).dead_time_s + by_sd * machine.tolerance.dead_time_s
        plan = make_schedule(list_stages(machine).put(drive, dead_time_s=max(0.0, dead_time_s)), ())
        return Settled(
            np.square(_calc_order_residuals(seen, plan, (drive,))[drive]), 0.5 * by_sd**2, by_sd
        )

    first = off(0.0)
    return climb_to_best(
        first,
        lambda one: _calc_likelihood_gain(first.squares, one.squares) - one.cost,
        lambda one, step: [
            off(by_sd)
            for by_sd in (one.by_sd - step, one.by_sd + step)
            if abs(by_sd) <= MAX_OFFSET_SD
        ],
        [0.5**k for k in range(HALVINGS)],
    )


def _cut_beginning(log: Clean) -> Clean:
    return log._replace(
        time_s=log.time_s[:ROWS],
        events=log.events[:ROWS],
        state=log.state[:ROWS],
        columns={name: column[:ROWS] for name, column in log.columns.items()},
        further={name: column[:ROWS] for name, column in log.further.items()},
    )


def _shift_columns(log: Clean, move: Move) -> Clean:
    columns = dict(log.columns)
    for name in move.columns:
        at = np.clip(np.arange(len(log.time_s)) - move.rows, 0, len(log.time_s) - 1)
        columns[name] = log.columns[name][at]
    return log._replace(columns=columns, findings=(*log.findings, move.said))


def _make_order_channels(log: Clean, machine: Machine) -> Mapping[str, ChannelSeries]:
    return make_channels(make_run_data(log, machine), machine)


def _calc_order_residuals(
    seen: Mapping[str, ChannelSeries], plan: Schedule, words: Sequence[str] = DRIVES
) -> dict[str, Array]:
    """What a machine leaves of these channels, where they are seen."""
    return {
        word: seen[word].measured - seen[word].predict(plan, MAX_MODEL_STEP_S)
        for word in words
        if word in seen
    }


def _slow_gate_gain(before: Array, seen: Mapping[str, ChannelSeries], machine: Machine) -> float:
    """What a gate that slews too slowly gains at most over squares `before` (m,): with a shaft
    that is late by itself it looks like rows."""
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
    """What each drive that is judged gains, in log-likelihood."""
    return {
        drive: _calc_likelihood_gain(np.square(before[drive]), np.square(after[drive]))
        for drive in DRIVES
        if drive in before and drive in after
    }


def _calc_likelihood_gain(before: Array, after: Array) -> float:
    """Of squares of Gaussian residuals with a variance of their own; far ones are drawn in.

    A few rows may be judged in one of them alone: means are compared.
    """
    far = FAR_SD**2 * float(min(np.median(before), np.median(after))) / MEDIAN_OF_SQUARES
    if far <= 0.0:
        return 0.0
    was, now = (float(np.mean(np.minimum(squares, far))) for squares in (before, after))
    return 0.5 * min(len(before), len(after)) * float(np.log(was / now))
