"""Whether what is left of a channel goes with a recorded variable: asked last, before nothing is said to be there.

A model, its noise and its forms may all miss a dependence: a drift takes up what a hand on the brake does. Ranks ask
for no form and mind no outlier.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement.checks import LEVEL, by_chance_taken, by_chance_together, times_louder
from control.diagnosis.judgement.noise import Noise, coefficients, series_of, strengths

from .channels import ChannelSeries
from .smooth import DOWNSTREAM
from .stages import RunData

Array = npt.NDArray[np.float64]

OWN = {"shaft": "shaft_rpm", "gate": "opening_mm"}      # of a drive's channel, the variable that its command is
LATEST = 12                 # an answer is looked for up to 2^12 samples after its move, each time twice as far
NO_ORDER = frozenset({"time_s", "heading_deg"})     # a rest may always drift; headings have no least and no most


def followed(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> str:
    """The recorded variable that the rest of a channel (banded coefficients (m,)) goes with; "" where none does, at the
    level of the other checks for all variables together.

    Both are whitened by the channel's noise, so that neighbouring samples say something each. What follows the
    channel's own reading is no cause of it (`DOWNSTREAM`); a scale adds up what a variable does to the flow.
    """
    stage, whiten = channel.name, 1.0 / np.sqrt(strengths(noise, channel.prior, channel.cut, channel.grid.step_s))
    if stage == "scale":
        stage = "flow"
    never = DOWNSTREAM.get(stage, frozenset()) | NO_ORDER
    left = series_of(rest * whiten, channel.cut)
    names = [name for name, values in data.variables.items() if name not in never and np.ptp(values) > 0.0]
    best, found = LEVEL / max(1, len(names)), ""
    for name in names:
        values = np.interp(channel.grid.even_s, data.time_s, data.variables[name])
        values -= values.mean()
        moved = coefficients(np.cumsum(values) if stage == "flow" else values, channel.cut)
        by_chance = by_chance_together(left, series_of(moved * whiten, channel.cut), best)
        if by_chance < best:
            best, found = by_chance, name
    return found


def follows_moves(channel: ChannelSeries, rest: Array, noise: Noise, data: RunData) -> bool:
    """Whether the rest of a drive (banded coefficients (m,)) comes after the moves of its command, at the level of the
    other checks: what answers a command is no noise, however the drive answers it. Sums of the moves, over times that
    double, stand for any answer; both are whitened. Asked where there is more than the machine file's noise, and of
    readings in steps, with which no effect of the answers is tried."""
    drive = {"shaft": data.shaft, "gate": data.gate}.get(channel.name)
    if drive is None or drive.settled or not drive.moves_seen:
        return False
    if drive.step <= 0.0 and not times_louder(noise, channel.prior, rest):
        return False
    whiten = 1.0 / np.sqrt(strengths(noise, channel.prior, channel.cut, channel.grid.step_s))
    asked = np.interp(channel.grid.even_s, drive.time_s, drive.command)
    sums = [asked, *(_before(asked, 2 ** k) for k in range(LATEST) if 2 ** (k + 2) < len(asked))]
    answers = np.diff(np.array(sums), axis=0)       # what moved between 2^k and 2^(k + 1) samples ago
    columns = np.array([series_of(coefficients(one, channel.cut) * whiten, channel.cut) for one in answers])
    return by_chance_taken(series_of(rest * whiten, channel.cut), columns) < LEVEL


def _before(series: Array, samples: int) -> Array:
    """A series (m,) so many samples ago."""
    return np.concatenate((np.full(samples, series[0]), series[:-samples]))
