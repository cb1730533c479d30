"""Examines the residual of a group after its named effects, terms and tolerances for structure that
is not noise.

The last test is whether the residual depends on a recorded variable. A model, its noise and its
forms may all miss a dependence: a drift absorbs the dependence on a hand brake. Rank correlation
needs no functional form and is insensitive to outliers.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, NamedTuple

import numpy as np
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.checks import (
    FALSE_ALARM_PROB,
    calc_correlation_p,
    calc_fit_p,
    estimate_noise_ratio,
    find_line_period,
    is_drift_excessive,
    is_noise_loud,
)
from topdress.control.diagnosis.judgement.evidence import make_evidence_problem, subtract_columns
from topdress.control.diagnosis.judgement.gaussian import Array
from topdress.control.diagnosis.judgement.noise import (
    Noise,
    calc_coefficient_variances,
    calc_coefficients,
    make_series,
)

from .channels import MAX_NOISE_PERIOD_S, ChannelSeries
from .selection import GroupResult
from .smooth import DOWNSTREAM_VARIABLES
from .stages import RunData

# Minimum explained share of the residual variance for an effect to be called the nearest.
MIN_SIMILARITY = 0.4
# Variable that is the command of a drive's channel.
COMMAND_VARIABLES = {"shaft": "shaft_rpm", "gate": "opening_mm"}
# Answers up to 2^12 samples after a move are tested, in windows that double.
MAX_DELAY_EXPONENT = 12
# Excluded variables: a residual may always drift with time, and a heading has no order.
UNORDERED_VARIABLES = frozenset({"time_s", "heading_deg"})


class ResidualStructure(NamedTuple):
    """Residual structure of one channel that is not noise."""

    channel: str
    why: Literal["drift", "line", "loud", "follows"]
    # Id of the effect with the most similar trace.
    hint: str = ""
    period_s: float | None = None
    # The residual: banded coefficients (m,).
    rest: Array = np.empty(0)
    # Expected sum of squares of the residual, by the machine file's noise.
    expected: float = 0.0
    # Recorded variable on which the residual depends; tested only where nothing else was found.
    variable: str = ""

    @property
    def energy(self) -> float:
        return float(np.sum(self.rest**2))


def calc_unknown_prob(one: GroupResult, k: int, rest: Collection[ResidualStructure]) -> float:
    """Return the probability that effect k is another cause, where channels that it changes have
    structure in their residual.

    The probability is the share of that structure which the model with the effect does not remove.
    """
    if not rest:
        return 0.0
    trace = one.search.columns.make_effect_column(one.found.parts, k).coefficients
    share = 0.0
    for each in rest:
        if each.channel in trace:
            without = float(np.sum((each.rest + trace[each.channel]) ** 2)) - each.expected
            share = max(
                share, min(1.0, max(0.0, each.energy - each.expected) / max(1e-300, without))
            )
    return share


def find_residual_structure(
    one: GroupResult, read_off: Collection[str] = ()
) -> list[ResidualStructure]:
    """Return the residual structure of a group's channels, after named effects and tolerances.

    read_off : channels whose spells were removed before the search, because undetected short spells
    leave a drift.
    """
    found, rest = list[ResidualStructure](), _calc_rest_of_channels(one)
    for channel in one.search.model.channels:
        if channel.copies > 1:
            continue
        name, left = channel.name, rest[channel.name]
        noise = (one.terms[-1].noise if one.terms else one.found.noise)[name]
        period_s = find_line_period(left, noise, channel.prior, channel.cut, channel.grid.step_s)
        # The unobserved metering between rows is a random walk, which looks like a drift.
        walks = channel.prior.walk_sd > 0.0
        usual = channel.prior.fast_sd**2 * (1.0 + channel.prior.slow_share**2)
        expected = len(left) * (usual + channel.prior.floor_sd**2)
        if name not in read_off and not walks and is_drift_excessive(noise, channel.prior):
            found.append(
                ResidualStructure(
                    name, "drift", _find_nearest_effect(one, channel, left), None, left, expected
                )
            )
        elif is_noise_loud(noise, channel.prior, left):
            found.append(
                ResidualStructure(
                    name, "loud", _find_nearest_effect(one, channel, left), None, left, expected
                )
            )
        elif period_s is not None and period_s > MAX_NOISE_PERIOD_S:
            found.append(ResidualStructure(name, "line", "", period_s, left, expected))
        if not one.found.parts and not one.terms:
            variable = find_followed_variable(channel, left, noise, one.search.model.data)
            if not variable and depends_on_moves(channel, left, noise, one.search.model.data):
                variable = COMMAND_VARIABLES[name]
            if found and found[-1].channel == name:
                found[-1] = found[-1]._replace(variable=variable)
            elif variable:
                found.append(ResidualStructure(name, "follows", "", None, left, expected, variable))
    return found


def describe_louder_channels(one: GroupResult, known: Collection[str]) -> list[str]:
    """Return findings about channels with a residual that looks like noise but exceeds the machine
    file's noise. known : channels whose residual was already reported."""
    said, rest = list[str](), _calc_rest_of_channels(one)
    for channel in (channel for channel in one.search.model.channels if channel.name not in known):
        noise = (one.terms[-1].noise if one.terms else one.found.noise)[channel.name]
        times = (
            0.0
            if channel.copies > 1 or channel.prior.walk_sd > 0.0
            else estimate_noise_ratio(noise, channel.prior, rest[channel.name])
        )
        if times:
            said.append(
                f"{channel.name}: what is left is {times:.2g} times the machine file's noise "
                f"({channel.prior.fast_sd:.3g} {channel.unit}), more than such a figure is "
                "off by itself: "
                "where the sensor is so loud, the machine file should say so"
            )
    return said


def _calc_rest_of_channels(one: GroupResult) -> dict[str, Array]:
    """Return the banded residual coefficients (m,) by channel, after removal of everything that the
    hypothesis can absorb."""
    columns, parts = one.search.columns, one.found.parts
    base, banded = columns.list_columns(parts), columns.model.calc_banded_residual(parts)
    base = [*base, *(column for term in one.terms for column in term.columns)]
    sizes = make_evidence_problem(columns.model.channels, banded, base).fit_sizes(
        np.arange(len(base)), one.found.noise
    )
    return subtract_columns(banded, base, sizes.b)


def _find_nearest_effect(one: GroupResult, channel: ChannelSeries, left: Array) -> str:
    """Return the effect whose trace is most similar to the residual `left` of a channel (m,), apart
    from noise; "" where none is similar."""
    best, like = "", MIN_SIMILARITY
    for candidate in one.search.candidates:
        column = one.search.columns.make_candidate_column(
            one.found.parts, candidate.part
        ).coefficients.get(channel.name)
        if column is None or not np.any(column):
            continue
        size = float(np.clip(left @ column / (column @ column), candidate.low, candidate.high))
        if EFFECT_ROWS[candidate.part.id].threshold:
            size = candidate.part.size
        share = 1.0 - float(np.sum((left - size * column) ** 2) / np.sum(left**2))
        if share > like:
            best, like = candidate.part.id, share
    return best


def find_followed_variable(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> str:
    """Return the recorded variable on which a channel's residual (banded coefficients (m,))
    depends; "" where there is none.

    All variables together have the significance level of the other checks. Both series are whitened
    by the channel's noise, so that neighbouring samples are independent. A variable downstream of
    the channel's own reading is no cause (`DOWNSTREAM_VARIABLES`). A scale accumulates a variable's
    effect on the flow.
    """
    stage, whiten = (
        channel.name,
        1.0
        / np.sqrt(
            calc_coefficient_variances(noise, channel.prior, channel.cut, channel.grid.step_s)
        ),
    )
    if stage == "scale":
        stage = "flow"
    never = DOWNSTREAM_VARIABLES.get(stage, frozenset()) | UNORDERED_VARIABLES
    plain = channel.cut._replace(weights=None)
    left = make_series(rest * whiten, plain)
    names = [
        name
        for name, values in data.variables.items()
        if name not in never and np.ptp(values) > 0.0
    ]
    best, found = FALSE_ALARM_PROB / max(1, len(names)), ""
    for name in names:
        values = np.interp(channel.grid.even_s, data.time_s, data.variables[name])
        values -= values.mean()
        moved = calc_coefficients(np.cumsum(values) if stage == "flow" else values, channel.cut)
        by_chance = calc_correlation_p(left, make_series(moved * whiten, plain), best)
        if by_chance < best:
            best, found = by_chance, name
    return found


def depends_on_moves(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> bool:
    """Tell whether a drive's residual (banded coefficients (m,)) follows the moves of its command,
    at the significance level of the other checks.

    A residual that answers a command is no noise. Sums of the moves over doubling time windows
    represent any answer; both series are whitened. The test is for a residual above the machine
    file's noise, and for quantised readings, on which no dynamic effect is tried.
    """
    drive = {"shaft": data.shaft, "gate": data.gate}.get(channel.name)
    if drive is None or drive.settled or not drive.moves_seen:
        return False
    if drive.step <= 0.0 and not estimate_noise_ratio(noise, channel.prior, rest):
        return False
    whiten = 1.0 / np.sqrt(
        calc_coefficient_variances(noise, channel.prior, channel.cut, channel.grid.step_s)
    )
    asked = np.interp(channel.grid.even_s, drive.time_s, drive.command)
    sums = [
        asked,
        *(
            _delay_series(asked, 2**k)
            for k in range(MAX_DELAY_EXPONENT)
            if 2 ** (k + 2) < len(asked)
        ),
    ]
    # Sums of the moves between 2^k and 2^(k + 1) samples ago.
    answers = np.diff(np.array(sums), axis=0)
    plain = channel.cut._replace(weights=None)
    columns = np.array(
        [make_series(calc_coefficients(one, channel.cut) * whiten, plain) for one in answers]
    )
    return calc_fit_p(make_series(rest * whiten, plain), columns) < FALSE_ALARM_PROB


def _delay_series(series: Array, samples: int) -> Array:
    """Delay a series (m,) by a number of samples."""
    return np.concatenate((np.full(samples, series[0]), series[:-samples]))
