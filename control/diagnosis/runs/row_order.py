"""Which row of a foreign log holds a command, and which what answered it.

A run log of ours holds in row k what was read at its time, and the command given then. Others write a command with what
answered it in one row, or the command under which a row was read, or the readings a row late. Seen as ours, such a log
has two drives that answer a row too early or too late, both by the same row: no fault of one drive does that. Where one
drive moves alone, nothing is moved, as a dead time may look the same: unless rows are further apart than any dead time.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import GATE_SLOW
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S

from .channels import ChannelSeries, channels
from .hypothesis import EffectInstance, Schedule, schedule, stages_of
from .log import Clean
from .stages import run_data

Array = npt.NDArray[np.float64]

DRIVES = ("shaft", "gate")
COMMANDS = ("shaft_rpm_cmd", "opening_mm_cmd")
ANSWERS = ("shaft_rpm", "opening_mm")
ALONE_S = 0.5               # between rows: a drive that moves alone is that late or early for its rows' sake only
LEAST_EVIDENCE = 30.0       # of each drive, in units of the log-likelihood: what is moved must be beyond doubt
NEARER = 0.2                # of what the opposite move loses: then the drives are 3/4 of a row off at least
MEDIAN_OF_SQUARES = 0.4549      # of a standard normal variable
ROWS = 10_000               # from the beginning on: a logger keeps its order
FAR_SD = 6.0                # a residual counts as so many robust s.d. at most: one stop of a drive is no order of rows


class Move(NamedTuple):
    """Columns that are moved by `rows` (positive: down, to later rows), and what that is in words."""

    columns: tuple[str, ...]
    rows: int
    said: str


READ_LATE = Move(ANSWERS, -1, "shaft and opening are read a row late: their readings are moved a row up")
IN_ONE_ROW = Move(ANSWERS, 1, "a row holds a command with what answered it: readings of shaft and opening are moved a "
                  "row down")
IN_FORCE = Move(COMMANDS, -1, "a row holds the command under which it was read, not the next one: commands are moved a "
                "row up")
COMMAND_LATE = Move(COMMANDS, 1, "commands stand a row before they are given: they are moved a row down")
WAYS = ((READ_LATE, COMMAND_LATE), (IN_ONE_ROW, IN_FORCE))      # each pair is the same to the drives


def in_order(log: Clean, machine: Machine) -> Clean:
    """The log with commands and answers in the rows that ours have them in, and what was moved among its findings."""
    return moved(log, order_of(log, machine))


def moved(log: Clean, move: Move | None) -> Clean:
    """A log with some of its columns moved, and that among its findings; None: as it is."""
    return log if move is None else _moved(log, move)


def order_of(log: Clean, machine: Machine) -> Move | None:
    """What must be moved for a log to have its rows in our order; None: nothing."""
    some, nominal = _beginning(log), schedule(stages_of(machine), ())
    seen = _channels(some, machine)
    as_it_is = _residuals(seen, nominal)
    tried = [_moved(some, ways[0]) for ways in WAYS]
    left = [_residuals(_channels(one, machine), nominal) for one in tried]
    by_way = [_gains(as_it_is, one) for one in left]
    telling = [drive for drive in DRIVES if max(abs(gains.get(drive, 0.0)) for gains in by_way) > LEAST_EVIDENCE]
    alone = log.step_s >= ALONE_S
    if len(telling) < (1 if alone else 2):
        return None
    best = int(np.argmax([sum(gains.values()) for gains in by_way]))
    further = _gains(left[best], _residuals(_channels(_moved(tried[best], WAYS[best][0]), machine), nominal))
    if not _so_far(by_way[best], by_way[1 - best], further, (telling,) if alone else [[drive] for drive in telling]):
        return None
    if not alone and _slow_gate_gain(as_it_is, seen, machine) > by_way[best]["gate"]:
        return None
    scales = [_residuals(_channels(_moved(some, way), machine), nominal, ("scale",)) for way in WAYS[best]]
    # Rough is what a flow leaves that comes too early or late; a level adds nothing.
    rough = [float(np.mean(np.square(np.diff(one.get("scale", np.zeros(2)))))) for one in scales]
    return WAYS[best][int(np.argmin(rough))]


def _so_far(gains: dict[str, float], opposite: dict[str, float], further: dict[str, float],
            each: Iterable[Sequence[str]]) -> bool:
    """Whether drives are a row off: beyond a tolerance of theirs, and no further off, as by a fault of their own."""
    for drives in each:
        gain, against, more = (sum(one.get(drive, 0.0) for drive in drives) for one in (gains, opposite, further))
        if gain < max(LEAST_EVIDENCE, -NEARER * against) or more > 0.0:
            return False
    return True


def _beginning(log: Clean) -> Clean:
    return log._replace(time_s=log.time_s[:ROWS], events=log.events[:ROWS], state=log.state[:ROWS],
                        columns={name: column[:ROWS] for name, column in log.columns.items()},
                        further={name: column[:ROWS] for name, column in log.further.items()})


def _moved(log: Clean, move: Move) -> Clean:
    columns = dict(log.columns)
    for name in move.columns:
        at = np.clip(np.arange(len(log.time_s)) - move.rows, 0, len(log.time_s) - 1)
        columns[name] = log.columns[name][at]
    return log._replace(columns=columns, findings=(*log.findings, move.said))


def _channels(log: Clean, machine: Machine) -> Mapping[str, ChannelSeries]:
    return channels(run_data(log, machine), machine)


def _residuals(seen: Mapping[str, ChannelSeries], plan: Schedule, words: Sequence[str] = DRIVES) -> dict[str, Array]:
    """What a machine leaves of these channels, where they are seen."""
    return {word: seen[word].measured - seen[word].predict(plan, MOST_STEP_S) for word in words if word in seen}


def _slow_gate_gain(as_it_is: dict[str, Array], seen: Mapping[str, ChannelSeries], machine: Machine) -> float:
    """What a gate that slews too slowly gains at most: with a shaft that is late by itself it looks like rows."""
    plans = [schedule(stages_of(machine), (EffectInstance(GATE_SLOW.id, size),)) for size in GATE_SLOW.trial_sizes]
    return max(_gains(as_it_is, _residuals(seen, plan, ("gate",))).get("gate", 0.0) for plan in plans)


def _gains(before: dict[str, Array], after: dict[str, Array]) -> dict[str, float]:
    """What each drive that is judged gains, in log-likelihood."""
    return {drive: _gain(np.square(before[drive]), np.square(after[drive]))
            for drive in DRIVES if drive in before and drive in after}


def _gain(before: Array, after: Array) -> float:
    """Of squares of Gaussian residuals with a variance of their own; far ones are drawn in.

    A few rows may be judged in one of them alone: means are compared.
    """
    far = FAR_SD ** 2 * float(min(np.median(before), np.median(after))) / MEDIAN_OF_SQUARES
    if far <= 0.0:
        return 0.0
    was, now = (float(np.mean(np.minimum(squares, far))) for squares in (before, after))
    return 0.5 * min(len(before), len(after)) * float(np.log(was / now))
