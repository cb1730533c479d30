"""What the channels of a group have left that is not noise, once its names, terms and
tolerances are off.

Asked last, before nothing is said to be there: whether it goes with a recorded variable. A
model, its noise and its forms may all miss a dependence: a drift takes up what a hand on the
brake does. Ranks ask for no form and mind no outlier.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, NamedTuple

import numpy as np
from topdress.control.diagnosis.effects import ROWS
from topdress.control.diagnosis.judgement.checks import (
    LEVEL,
    by_chance_taken,
    by_chance_together,
    estimate_noise_ratio,
    find_line_period_s,
    is_drift_excessive,
    is_noise_loud,
)
from topdress.control.diagnosis.judgement.evidence import make_evidence_problem, subtract_columns
from topdress.control.diagnosis.judgement.gaussian import Array
from topdress.control.diagnosis.judgement.noise import (
    Noise,
    calc_coefficient_strengths,
    coefficients,
    make_series_of,
)

from .channels import QUICK_S, ChannelSeries
from .selection import GroupResult
from .smooth import DOWNSTREAM
from .stages import RunData

# of the variance left, for an effect to be called the nearest
LIKE = 0.4
# of a drive's channel, the variable that its command is
OWN = {"shaft": "shaft_rpm", "gate": "opening_mm"}
# an answer is looked for up to 2^12 samples after its move, each time twice as far
LATEST = 12
# a rest may always drift; headings have no least and no most
NO_ORDER = frozenset({"time_s", "heading_deg"})


class Remains(NamedTuple):
    """What is left of one channel and is not noise."""

    channel: str
    why: Literal["drift", "line", "loud", "follows"]
    hint: str = ""  # the effect that comes nearest
    period_s: float | None = None
    rest: Array = np.empty(0)  # what is left: banded coefficients (m,)
    # of their sum of squares, by the machine file's noise
    expected: float = 0.0
    # recorded, that it goes with; asked where nothing else is said
    variable: str = ""

    @property
    def energy(self) -> float:
        return float(np.sum(self.rest**2))


def unknown_share(one: GroupResult, k: int, rest: Collection[Remains]) -> float:
    """Probability that part k stands for something else, where channels that it moves have more
    left than noise: of all that is no noise there, the share that the model with the part does
    not take away."""
    if not rest:
        return 0.0
    trace = one.search.columns.trace(one.found.parts, k).coefficients
    share = 0.0
    for each in rest:
        if each.channel in trace:
            without = float(np.sum((each.rest + trace[each.channel]) ** 2)) - each.expected
            share = max(
                share, min(1.0, max(0.0, each.energy - each.expected) / max(1e-300, without))
            )
    return share


def find_remains(one: GroupResult, read_off: Collection[str] = ()) -> list[Remains]:
    """What the channels of a group have left, once their named effects and tolerances are off,
    that is not noise.

    read_off : channels whose spells were taken out before the search: the short ones, unseen,
    leave a drift behind.
    """
    found, rest = list[Remains](), _calc_rest_of_channels(one)
    for channel in one.search.model.channels:
        if channel.copies > 1:
            continue
        name, left = channel.name, rest[channel.name]
        noise = (one.terms[-1].noise if one.terms else one.found.noise)[name]
        period_s = find_line_period_s(left, noise, channel.prior, channel.cut, channel.grid.step_s)
        # between its rows more was metered than they say
        walks = channel.prior.walk_sd > 0.0
        usual = channel.prior.fast_sd**2 * (1.0 + channel.prior.slow_share**2)
        expected = len(left) * (usual + channel.prior.floor_sd**2)
        if name not in read_off and not walks and is_drift_excessive(noise, channel.prior):
            found.append(
                Remains(
                    name, "drift", _find_nearest_effect(one, channel, left), None, left, expected
                )
            )
        elif is_noise_loud(noise, channel.prior, left):
            found.append(
                Remains(
                    name, "loud", _find_nearest_effect(one, channel, left), None, left, expected
                )
            )
        elif period_s is not None and period_s > QUICK_S:
            found.append(Remains(name, "line", "", period_s, left, expected))
        if not one.found.parts and not one.terms:
            variable = find_followed_variable(channel, left, noise, one.search.model.data)
            if not variable and follows_moves(channel, left, noise, one.search.model.data):
                variable = OWN[name]
            if found and found[-1].channel == name:
                found[-1] = found[-1]._replace(variable=variable)
            elif variable:
                found.append(Remains(name, "follows", "", None, left, expected, variable))
    return found


def describe_louder_channels(one: GroupResult, known: Collection[str]) -> list[str]:
    """Said of channels whose rest is more than the machine file's noise, though it looks like
    noise. known : those of which it is said that their rest is none."""
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
    """Banded coefficients (m,) by channel, with all taken off that the hypothesis can take up."""
    columns, parts = one.search.columns, one.found.parts
    base, banded = columns.of_hypothesis(parts), columns.model.banded_residual(parts)
    base = [*base, *(column for term in one.terms for column in term.columns)]
    sizes = make_evidence_problem(columns.model.channels, banded, base).sizes(
        np.arange(len(base)), one.found.noise
    )
    return subtract_columns(banded, base, sizes.b)


def _find_nearest_effect(one: GroupResult, channel: ChannelSeries, left: Array) -> str:
    """The effect whose trace is most like what is `left` of a channel (m,), noise apart; ""
    where none is like it."""
    best, like = "", LIKE
    for candidate in one.search.candidates:
        column = one.search.columns.of_candidate(one.found.parts, candidate.part).coefficients.get(
            channel.name
        )
        if column is None or not np.any(column):
            continue
        size = float(np.clip(left @ column / (column @ column), candidate.low, candidate.high))
        if ROWS[candidate.part.id].threshold:
            size = candidate.part.size
        share = 1.0 - float(np.sum((left - size * column) ** 2) / np.sum(left**2))
        if share > like:
            best, like = candidate.part.id, share
    return best


def find_followed_variable(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> str:
    """The recorded variable that the rest of a channel (banded coefficients (m,)) goes with; ""
    where none does, at the level of the other checks for all variables together.

    Both are whitened by the channel's noise, so that neighbouring samples say something each.
    What follows the channel's own reading is no cause of it (`DOWNSTREAM`); a scale adds up
    what a variable does to the flow.
    """
    stage, whiten = (
        channel.name,
        1.0
        / np.sqrt(
            calc_coefficient_strengths(noise, channel.prior, channel.cut, channel.grid.step_s)
        ),
    )
    if stage == "scale":
        stage = "flow"
    never = DOWNSTREAM.get(stage, frozenset()) | NO_ORDER
    left = make_series_of(rest * whiten, channel.cut)
    names = [
        name
        for name, values in data.variables.items()
        if name not in never and np.ptp(values) > 0.0
    ]
    best, found = LEVEL / max(1, len(names)), ""
    for name in names:
        values = np.interp(channel.grid.even_s, data.time_s, data.variables[name])
        values -= values.mean()
        moved = coefficients(np.cumsum(values) if stage == "flow" else values, channel.cut)
        by_chance = by_chance_together(left, make_series_of(moved * whiten, channel.cut), best)
        if by_chance < best:
            best, found = by_chance, name
    return found


def follows_moves(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> bool:
    """Whether the rest of a drive (banded coefficients (m,)) comes after the moves of its
    command, at the level of the other checks: what answers a command is no noise, however the
    drive answers it. Sums of the moves, over times that double, stand for any answer; both are
    whitened. Asked where there is more than the machine file's noise, and of readings in steps,
    with which no effect of the answers is tried."""
    drive = {"shaft": data.shaft, "gate": data.gate}.get(channel.name)
    if drive is None or drive.settled or not drive.moves_seen:
        return False
    if drive.step <= 0.0 and not estimate_noise_ratio(noise, channel.prior, rest):
        return False
    whiten = 1.0 / np.sqrt(
        calc_coefficient_strengths(noise, channel.prior, channel.cut, channel.grid.step_s)
    )
    asked = np.interp(channel.grid.even_s, drive.time_s, drive.command)
    sums = [
        asked,
        *(_delay_series(asked, 2**k) for k in range(LATEST) if 2 ** (k + 2) < len(asked)),
    ]
    # what moved between 2^k and 2^(k + 1) samples ago
    answers = np.diff(np.array(sums), axis=0)
    columns = np.array(
        [make_series_of(coefficients(one, channel.cut) * whiten, channel.cut) for one in answers]
    )
    return by_chance_taken(make_series_of(rest * whiten, channel.cut), columns) < LEVEL


def _delay_series(series: Array, samples: int) -> Array:
    """A series (m,) so many samples ago."""
    return np.concatenate((np.full(samples, series[0]), series[:-samples]))
