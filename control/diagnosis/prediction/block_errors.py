"""Calculates the error of a machine file on blocks of a log to which its numbers were not fitted.

The influence of a block's rows on a number follows from the slopes at the file itself: without the
block least squares would give another value, and the number is changed by that difference (the
one-step jackknife: Miller, Biometrika 61, 1974, 1). No number is refitted, so the file itself is
judged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import find_size_range
from topdress.control.machine.machine import CATALOGUE, Machine, add_effect, list_effect_sizes
from topdress.control.machine.term_forms import Form
from topdress.control.machine.terms import Term

from .log_prediction import LogPredictor

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]

# Number of blocks of a log: each is longer than the correlation time of the noise.
BLOCK_COUNT = 8
# Relative change of a number for its slope.
SLOPE_STEP_OF_NUMBER = 0.02
# Ridge as a share of a number's information: it fixes a direction in which two numbers are
# interchangeable.
RIDGE_OF_INFORMATION = 1e-9
# Tolerance in standard errors: matrix products differ by this between processors.
ROUNDING_TOLERANCE = 1e-9
SATURATION_ENDS_KEY = "ends"
# Coefficients of a term that the term is linear in.
LINEAR_COEFFICIENTS = ("slope", "bend", "below", "above", "sine", "cosine", "level")


class MachineFileNumber(NamedTuple):
    """One number of a machine file. turned : returns the file with another value of the number."""

    name: str
    value: float
    step: float
    low: float
    high: float
    turned: Callable[[Machine, float], Machine]


class BlockErrors(NamedTuple):
    """Errors of a machine file on a log. rms : by channel, of the whole log.

    blocks : by channel, the mean square error of each block (BLOCK_COUNT,), with the numbers as
    they would be without the block. sd : standard deviations of the numbers, by these differences.
    """

    rms: dict[str, float]
    blocks: dict[str, Array]
    sd: tuple[float, ...] = ()


def list_added_numbers(machine: Machine, was: Machine) -> list[MachineFileNumber]:
    """Return the numbers that a file has in addition to another: sizes of effects, coefficients of
    terms."""
    before, known = list_effect_sizes(was), set(was.terms)
    found = [
        make_effect_number(name, machine, size)
        for name, size in list_effect_sizes(machine).items()
        if size != before.get(name)
    ]
    return found + [
        number for term in machine.terms if term not in known for number in list_term_numbers(term)
    ]


def make_effect_number(name: str, machine: Machine, size: float) -> MachineFileNumber:
    entry = CATALOGUE[name]
    stage = getattr(machine, entry.stage)
    member = int(getattr(stage, entry.effect.member_field)) if entry.effect.member_field else None
    low, high = find_size_range(
        name,
        machine.model_copy(update={entry.stage: stage._replace(**{entry.field: entry.neutral})}),
    )
    return MachineFileNumber(
        name,
        size - entry.neutral,
        SLOPE_STEP_OF_NUMBER * abs(size - entry.neutral),
        low,
        high,
        lambda of, value: add_effect(of, name, min(high, max(low, value)), member),
    )


def list_term_numbers(term: Term) -> list[MachineFileNumber]:
    """Return the numbers of a term: its linear coefficients, or the values of a table."""
    spread = max(map(abs, term.values), default=0.0)
    knee = (
        [
            _make_number(
                term,
                SATURATION_ENDS_KEY,
                term.coefficients["high_end"],
                SLOPE_STEP_OF_NUMBER * term.coefficients["high_end"],
            )
        ]
        if is_knee_term(term)
        else []
    )
    return (
        knee
        + [
            _make_number(term, name, value, SLOPE_STEP_OF_NUMBER * abs(value))
            for name, value in term.coefficients.items()
            if name in LINEAR_COEFFICIENTS and value != 0.0
        ]
        + [
            _make_number(term, k, value, SLOPE_STEP_OF_NUMBER * spread)
            for k, value in enumerate(term.values)
            if spread > 0.0
        ]
    )


def is_knee_term(term: Term) -> bool:
    """Tell whether a term changes the slope of a curve beyond the same value in both directions."""
    return (
        term.form is Form.DEAD_ZONE
        and term.coefficients["low_end"] == -term.coefficients["high_end"]
    )


def _make_number(term: Term, which: str | int, value: float, step: float) -> MachineFileNumber:
    def turned(machine: Machine, to: float) -> Machine:
        terms = tuple(
            _change_coefficient(one, which, to) if one.id == term.id else one
            for one in machine.terms
        )
        return machine.model_copy(update={"terms": terms})

    return MachineFileNumber(
        f"{term.id}.{which}",
        value,
        step,
        1e-6 if which == SATURATION_ENDS_KEY else -np.inf,
        np.inf,
        turned,
    )


def _change_coefficient(term: Term, which: str | int, to: float) -> Term:
    if which == SATURATION_ENDS_KEY:
        return term.model_copy(
            update={"coefficients": {**term.coefficients, "low_end": -to, "high_end": to}}
        )
    if isinstance(which, str):
        return term.model_copy(update={"coefficients": {**term.coefficients, which: to}})
    return term.model_copy(update={"values": (*term.values[:which], to, *term.values[which + 1 :])})


def calc_errors_by_channel(
    on_log: LogPredictor, machine: Machine, channels: Sequence[str]
) -> dict[str, Array]:
    """Return measured minus predicted, by channel."""
    predicted = on_log.predict(machine, channels)
    return {name: on_log.calc_errors(name, predicted[name]) for name in channels}


def calc_number_slopes(
    on_log: LogPredictor,
    machine: Machine,
    channels: Sequence[str],
    numbers: Sequence[MachineFileNumber],
    left: dict[str, Array],
) -> dict[str, Array]:
    """Return the change of the prediction for one unit of each number, by channel: (m, numbers)."""
    columns: dict[str, list[Array]] = {name: [] for name in channels}
    for number in numbers:
        to = (
            number.value + number.step
            if number.value + number.step <= number.high
            else number.value - number.step
        )
        moved = calc_errors_by_channel(on_log, number.turned(machine, to), channels)
        for name in channels:
            columns[name].append((left[name] - moved[name]) / (to - number.value))
    return {
        name: np.array(several).reshape(len(several), len(left[name])).T
        for name, several in columns.items()
    }


def calc_block_errors(
    on_log: LogPredictor,
    machine: Machine,
    channels: Sequence[str],
    numbers: Sequence[MachineFileNumber],
    usual: dict[str, float] | None = None,
    over: str = "",
) -> BlockErrors:
    """Calculate the errors of a machine file on a log's channels.

    usual : mean square errors by which channels are weighed; by default the file's own. over :
    recorded variable whose ranges are the blocks, in place of stretches of time: a few levels, all
    present in every stretch, say nothing about the values between them.
    """
    left = calc_errors_by_channel(on_log, machine, channels)
    square = {name: float(np.mean(one**2)) if len(one) else 0.0 for name, one in left.items()}
    rms = {name: float(np.sqrt(one)) for name, one in square.items()}
    cuts = {
        name: split_by_ranges(on_log.align_with_errors(name, over, len(one)))
        if over
        else cut_into_blocks(len(one))
        for name, one in left.items()
    }
    if not numbers:
        return BlockErrors(
            rms, {name: average_by_block(left[name], cuts[name]) for name in channels}
        )
    columns = calc_number_slopes(on_log, machine, channels, numbers, left)
    weight = {
        name: 1.0 / max(1e-300, (usual or square)[name] * max(1, len(left[name])))
        for name in channels
    }
    scale = (
        np.sqrt(sum(weight[name] * np.sum(columns[name] ** 2, axis=0) for name in channels))
        + 1e-150
    )
    each = [
        (
            sum(
                weight[name] * (x := columns[name][cuts[name][b]] / scale).T @ x
                for name in channels
            ),
            sum(
                weight[name] * (columns[name][cuts[name][b]] / scale).T @ left[name][cuts[name][b]]
                for name in channels
            ),
        )
        for b in range(len(cuts[channels[0]]))
    ]
    ridge = RIDGE_OF_INFORMATION * np.eye(len(numbers))
    normal, right = sum(n for n, _ in each), sum(r for _, r in each)
    whole = np.linalg.solve(normal + ridge, right)
    blocks: dict[str, list[float]] = {name: [] for name in channels}
    moves = []
    value, low, high = np.array([(number.value, number.low, number.high) for number in numbers]).T
    for b, (n, r) in enumerate(each):
        move = (np.linalg.solve(normal - n + ridge, right - r) - whole) / scale
        move = np.clip(value + move, low, high) - value
        moves.append(move)
        for name in channels:
            piece = left[name][cuts[name][b]] - columns[name][cuts[name][b]] @ move
            blocks[name].append(float(np.mean(piece**2)) if len(piece) else 0.0)
    spread = np.array(moves) - np.mean(moves, axis=0)
    sd = np.sqrt((len(each) - 1.0) / len(each) * np.sum(spread**2, axis=0))
    return BlockErrors(
        rms, {name: np.array(several) for name, several in blocks.items()}, tuple(sd.tolist())
    )


def cut_into_blocks(count: int) -> list[Rows]:
    """Return equal stretches of a series: blocks of time, or pieces of a staircase."""
    edges = np.linspace(0, count, BLOCK_COUNT + 1).astype(int).tolist()
    return [np.arange(a, b) for a, b in pairwise(edges)]


def split_by_ranges(values: Array) -> list[Rows]:
    """Return the samples of each range of a variable (m,), with each level in one range: as many
    ranges as blocks, or fewer for fewer levels."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BLOCK_COUNT + 1)[1:-1]))
    within = np.searchsorted(edges, values, side="right")
    return [np.flatnonzero(within == k) for k in range(len(edges) + 1)]


def average_by_block(left: Array, cuts: Sequence[Rows]) -> Array:
    """Return the mean squares of errors (m,) by block (blocks,)."""
    return np.array([float(np.mean(left[cut] ** 2)) if len(cut) else 0.0 for cut in cuts])


def calc_gain_by_block(one: BlockErrors, other: BlockErrors, usual: dict[str, float]) -> Array:
    """Return the difference of one file's error to another's, block by block (BLOCK_COUNT,), as a
    share of the usual error; channels are combined."""
    return np.asarray(
        sum(
            (other.blocks[name] - one.blocks[name]) / max(1e-300, usual[name])
            for name in one.blocks
        )
    )


def is_surely_positive(gain: Array, errors: float = 1.0) -> bool:
    """Tell whether a gain over blocks exceeds zero by a number of standard errors; by default one
    (Breiman, Friedman, Olshen and Stone, Classification and Regression Trees, 1984, 3.4.3).

    Where only a single block contributes, its mean is one standard error to the last bit, and
    counts.
    """
    return bool(
        gain.mean()
        > (1.0 - ROUNDING_TOLERANCE) * errors * np.std(gain, ddof=1) / np.sqrt(len(gain))
    )
