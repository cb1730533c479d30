"""Which first machine file of a single driven stage (pump, wheel, fan, conveyor) does a log
suggest?

The figures are where a diagnosis begins, not its result: they come from the owner's answers, and
these suggestions are the default answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.log_row import COMMANDS_HELD_EVENT

Array = npt.NDArray[np.float64]

MIN_ROWS = 10
# Share of rows with another command in a log that holds one settled answer in each row.
CHANGED_COMMAND_ROW_SHARE = 0.5
# Least distance of such rows, s.
SETTLED_STEP_S = 0.5
# Share of an answer that comes after the first row of its command: above it the drive had not
# settled.
MAX_LATE_ANSWER_SHARE = 0.5
# First digits of round full speeds.
ROUND_NUMBERS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 6.5, 7.0, 8.0, 10.0)
# Noise as a share of full speed where a log shows none.
DEFAULT_NOISE_OF_FULL_SPEED = 1e-3
# First candidate time, s, and the ratios of neighbouring candidates of time constant and dead time.
FIRST_TIME_S, TAU_RATIO, DEAD_RATIO = 0.005, 1.334, 1.454
# Longest candidates as a share of the log: a longer time does not settle within it.
TAU_SHARE, DEAD_SHARE = 0.5, 0.1
# Places between two neighbours of a grid.
FINE_GRID_PLACES = 9
# Rounds of refinement: 1/16 of a step of the first grid.
FINE_GRID_ROUNDS = 2
# Greatest number of rows from which the times are fitted.
MAX_FIT_ROWS = 4000


# Standard deviations of a reading's noise beyond which a drive turns (1e-9 by chance).
TURNING_SD = 6.0
# Standard deviations by which a drive's line must miss a standstill at 0 to be examined.
ZERO_OFFSET_SD = 3.0
# Share of settled rows that turn against their command; outliers are fewer.
MIN_OPPOSITE_TURN_ROW_SHARE = 0.01
# Share of the commands over which a drive's line is straight although it bends higher up.
STRAIGHT_COMMAND_SHARE = 1.0 / 3.0
# Commands below this share of the largest count as 0.
ZERO_OF_LARGEST_COMMAND = 0.02
# Time constants until a drive has settled, to exp(-5) < 0.01.
SETTLING_TAUS = 5.0


class MissingColumn(ValueError):
    """Reports a log without a command or without its reading."""


class ZeroOffset(NamedTuple):
    """Holds the straight line of a drive's settled readings over its commands.

    level_rpm, slope: speed at a command of 0, and for each r/min. off: the line misses 0, or
    falls. passed: commands lie on either side of the standstill, or the drive turns slower the
    higher its command is: a drive that only turns above some command has a dead zone."""

    level_rpm: float
    slope: float
    off: bool
    passed: bool


NO_ZERO_OFFSET = ZeroOffset(0.0, 1.0, False, False)


class NeutralPoint(NamedTuple):
    """Holds the command at which a drive stands, r/min. falls: it turns slower the higher its
    command is. zero_turns: it turns at a command of 0."""

    rpm: float
    falls: bool
    zero_turns: bool


class MachineSuggestion(NamedTuple):
    """Holds the suggestions of a log.

    full_rpm: r/min at the full command. settled: a row holds a command's settled answer.
    both_ways: it also turns backwards. noise_rpm: standard deviation of a reading, r/min.
    dead_s, tau_s: dead time and time constant, s; 0 for settled answers, None where the log does
    not show them. supply_v: median, None where there is none. neutral: the command of
    standstill, None where that is 0."""

    full_rpm: float
    settled: bool
    both_ways: bool
    noise_rpm: float
    dead_s: float | None
    tau_s: float | None
    supply_v: float | None
    neutral: NeutralPoint | None = None


def suggest_machine(columns: Mapping[str, npt.NDArray[Any]]) -> MachineSuggestion:
    """Returns the suggestions from a run log's columns (n,) with `time_s`, `shaft_rpm_cmd` and
    `shaft_rpm`.

    Raises
    ------
    ValueError : in one line, where a column is missing or has fewer than 10 rows."""
    time_s, command, reading = _select_known_rows(columns)
    events = columns.get("events", np.empty(0, object))
    held = any(COMMANDS_HELD_EVENT in str(text) for text in events)
    settled = (held or is_command_per_row(time_s, command)) and not is_still_moving(
        command, reading
    )
    most = float(np.max(np.abs(np.concatenate((command, reading)))))
    supply = np.asarray(columns.get("supply_v", np.empty(0)), np.float64)
    supply = supply[np.isfinite(supply)]
    dead_s, tau_s = (
        (0.0, 0.0) if settled else fit_response_times(time_s, command, reading) or (None, None)
    )
    noise_rpm = max(calc_reading_noise(command, reading), DEFAULT_NOISE_OF_FULL_SPEED * most)
    neutral = (
        None
        if dead_s is None or tau_s is None
        else find_neutral_point(time_s, command, reading, dead_s + SETTLING_TAUS * tau_s, noise_rpm)
    )
    return MachineSuggestion(
        round_up(most),
        settled,
        bool(np.any(command < 0.0)),
        noise_rpm,
        dead_s,
        tau_s,
        float(np.median(supply)) if len(supply) else None,
        neutral,
    )


def _select_known_rows(columns: Mapping[str, npt.NDArray[Any]]) -> tuple[Array, Array, Array]:
    """Returns time, held command and reading at the rows that have all three."""
    found = []
    for name in ("time_s", "shaft_rpm_cmd", "shaft_rpm"):
        if name not in columns:
            raise MissingColumn(
                f"column {name}: missing: a first machine file is made of a command and its reading"
            )
        found.append(np.asarray(columns[name], np.float64))
    known = np.isfinite(found).all(axis=0)
    if known.sum() < MIN_ROWS:
        raise ValueError(
            f"columns shaft_rpm_cmd, shaft_rpm: {int(known.sum())} rows hold both: allowed from "
            f"{MIN_ROWS} on"
        )
    time_s, command, reading = (one[known] for one in found)
    return time_s, command, reading


def find_rows_at_rest(
    time_s: Array, command: Array, reading: Array, answers_s: float
) -> npt.NDArray[np.bool_]:
    """Returns which rows (n,) have a reading whose command has not changed for the time of an
    answer."""
    changed = np.diff(command, prepend=command[0]) != 0.0
    since_s = time_s - np.maximum.accumulate(np.where(changed, time_s, time_s[0]))
    return np.isfinite(reading) & (since_s >= answers_s)


def find_zero_offset(
    time_s: Array, command: Array, reading: Array, answers_s: float, noise_rpm: float
) -> ZeroOffset:
    """Returns how a drive relates to a command of 0, from its rows (n,) at rest: by the line
    through them, and by readings with the opposite sign of their command."""
    rows = find_rows_at_rest(time_s, command, reading, answers_s)
    asked, read = command[rows], reading[rows]
    if rows.sum() < MIN_ROWS or np.ptp(asked) <= ZERO_OF_LARGEST_COMMAND * np.max(np.abs(asked)):
        return NO_ZERO_OFFSET
    slope, level_rpm = (float(one) for one in np.polyfit(asked, read, 1))
    against = np.mean(np.sign(asked) * read < -TURNING_SD * noise_rpm)
    passed = bool(slope < 0.0 or against > MIN_OPPOSITE_TURN_ROW_SHARE)
    way = 1.0 if asked.mean() > 0.0 else -1.0
    return ZeroOffset(
        level_rpm, slope, passed or way * level_rpm > ZERO_OFFSET_SD * noise_rpm, passed
    )


def find_neutral_point(
    time_s: Array, command: Array, reading: Array, answers_s: float, noise_rpm: float
) -> NeutralPoint | None:
    """Returns the command at which a drive stands, where its rows (n,) at rest show that it is
    not 0: half-way between where it begins to turn either way; else where its line meets a
    standstill, for a drive that falls or turns at 0."""
    of_zero = find_zero_offset(time_s, command, reading, answers_s, noise_rpm)
    if not of_zero.off:
        return None
    rows = find_rows_at_rest(time_s, command, reading, answers_s)
    asked, read = command[rows], reading[rows]
    zero = np.abs(asked) <= ZERO_OF_LARGEST_COMMAND * np.max(np.abs(asked))
    zero_turns = bool(zero.any() and np.median(np.abs(read[zero])) > TURNING_SD * noise_rpm)
    turns = [way * read > TURNING_SD * noise_rpm for way in (1.0, -1.0)]
    if of_zero.passed:
        parts = [one for one in turns if one.sum() >= MIN_ROWS and np.ptp(asked[one]) > 0.0]
    else:
        parts = (
            [np.abs(asked) <= np.quantile(np.abs(asked), STRAIGHT_COMMAND_SHARE)]
            if zero_turns
            else []
        )
    lines = [np.polyfit(asked[one], read[one], 1) for one in parts]
    found = [-float(level) / float(slope) for slope, level in lines if slope != 0.0]
    return NeutralPoint(float(np.mean(found)), of_zero.slope < 0.0, zero_turns) if found else None


def is_command_per_row(time_s: Array, command: Array) -> bool:
    """Returns whether nearly every row (n,) has another command, far apart in time: a staircase
    with a row for each step."""
    return bool(
        np.mean(np.diff(command) != 0.0) > CHANGED_COMMAND_ROW_SHARE
        and np.median(np.diff(time_s)) >= SETTLED_STEP_S
    )


def is_still_moving(command: Array, reading: Array) -> bool:
    """Returns whether a reading (n,) still moves in the rows after the first answer to a
    command: most of its answer to held commands comes later."""
    # The first row of each command that stays for the answer and a row after it.
    changed = np.flatnonzero(np.diff(command)) + 1
    held = np.diff(np.append(changed, len(command))) > 2
    first, last = changed[held], np.append(changed, len(command))[1:][held] - 1
    if not len(first):
        return False
    way = np.sign(command[first] - command[first - 1])
    at_once, in_all = (float(way @ (reading[to] - reading[first])) for to in (first + 1, last))
    return in_all - at_once > MAX_LATE_ANSWER_SHARE * in_all


def round_up(most: float) -> float:
    """Returns the next round number from `most` on: 637 becomes 650."""
    if most <= 0.0:
        return 100.0
    ten = 10.0 ** float(np.floor(np.log10(most)))
    return float(ten * next(one for one in ROUND_NUMBERS if one * ten >= most * (1.0 - 1e-9)))


def calc_reading_noise(command: Array, reading: Array) -> float:
    """Returns the standard deviation of a reading, r/min: the spread of its third differences
    while it turns, at least that of its steps.

    Repeated differences of neighbours remove whatever changes slowly (von Neumann et al., Ann.
    Math. Stat. 12, 1941). Third differences of white noise have 20 times its variance."""
    moves = np.diff(reading, 3)[(reading[3:] != 0.0) & (command[3:] == command[:-3])]
    spread = 1.4826 * float(np.median(np.abs(moves))) / np.sqrt(20.0) if len(moves) >= 4 else 0.0
    levels = np.diff(np.unique(reading))
    levels = levels[levels > 1e-9]
    step = float(np.percentile(levels, 5)) if len(levels) else 0.0
    return float(max(spread, step / np.sqrt(12.0)))


def fit_response_times(time_s: Array, command: Array, reading: Array) -> tuple[float, float] | None:
    """Returns the dead time and time constant, s, with which the reading follows its command
    best, whatever its gain and dead zone are.

    Least squares of the reading over the delayed, lagged command, its size, a constant and the
    initial speed, on a grid and on finer ones between the neighbours of the best. None where the
    command never moves, or where the longest time constant is the best: the log does not show
    it."""
    time_s, command, reading = time_s[:MAX_FIT_ROWS], command[:MAX_FIT_ROWS], reading[:MAX_FIT_ROWS]
    if np.ptp(command) == 0.0:
        return None
    lasts_s = float(time_s[-1] - time_s[0])
    deads_s, taus_s = (
        _list_candidate_times(DEAD_RATIO, DEAD_SHARE * lasts_s),
        _list_candidate_times(TAU_RATIO, TAU_SHARE * lasts_s),
    )
    dead_s, tau_s = _find_best_pair(deads_s, taus_s, time_s, command, reading)
    if tau_s == taus_s[-1]:
        return None
    for _ in range(FINE_GRID_ROUNDS):
        deads_s, taus_s = _refine_grid(dead_s, deads_s), _refine_grid(tau_s, taus_s)
        dead_s, tau_s = _find_best_pair(deads_s, taus_s, time_s, command, reading)
    return dead_s, tau_s


def _list_candidate_times(ratio: float, longest_s: float) -> Array:
    """Returns 0 and times that are each `ratio` longer than the one before, up to the longest."""
    count = max(1, int(np.log(max(1.0, longest_s / FIRST_TIME_S)) / np.log(ratio)))
    return np.concatenate(([0.0], FIRST_TIME_S * ratio ** np.arange(count)))


def _refine_grid(best: float, grid: Array) -> Array:
    """Returns finer places between the neighbours of a place of a grid."""
    k = int(np.argmin(np.abs(grid - best)))
    return np.linspace(grid[max(0, k - 1)], grid[min(len(grid) - 1, k + 1)], FINE_GRID_PLACES)


def _find_best_pair(
    deads_s: Array, taus_s: Array, time_s: Array, command: Array, reading: Array
) -> tuple[float, float]:
    """Returns the pair with the least squares; of equal ones the first."""
    best = (np.inf, 0.0, 0.0)
    for dead_s in deads_s:
        commanded = command[
            np.clip(np.searchsorted(time_s, time_s - dead_s, side="right") - 1, 0, len(time_s) - 1)
        ]
        for tau_s in taus_s:
            x = _filter_first_order(commanded, time_s, float(tau_s))
            # The speed before the log decays with the time constant.
            began = np.exp(-(time_s - time_s[0]) / max(float(tau_s), 1e-9))
            basis = np.column_stack(
                (
                    x,
                    np.sign(x) * np.minimum(np.abs(x), 0.1 * np.max(np.abs(x)) + 1e-9),
                    np.ones(len(x)),
                    began,
                )
            )
            left = reading - basis @ np.linalg.lstsq(basis, reading, rcond=None)[0]
            square = float(np.mean(np.square(left)))
            if square < best[0] * (1.0 - 1e-6):
                best = (square, float(dead_s), float(tau_s))
    return best[1], best[2]


def _filter_first_order(commanded: Array, time_s: Array, tau_s: float) -> Array:
    """Returns the first-order response to a held signal: (n,)."""
    if tau_s <= 0.0:
        return commanded
    keep = np.exp(-np.diff(time_s) / tau_s).tolist()
    found = commanded[:1].tolist()
    for goal, kept in zip(commanded.tolist(), keep, strict=False):
        found.append(goal + (found[-1] - goal) * kept)
    return np.array(found)
