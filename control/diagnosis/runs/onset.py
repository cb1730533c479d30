"""Finds when an effect began: stops directly from the drives, other onsets on a grid that is then
refined.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_opening, median_filter, uniform_filter1d
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.prior import MIN_REPORT_LOG_ODDS
from topdress.control.machine.effect import OPENING_RANGE, SHAFT_RANGE
from topdress.control.machine.machine import CATALOGUE, scale_nominal

from .changepoint import EDGE_MARGIN_S
from .hypothesis import EffectInstance, Hypothesis, replace_part
from .intermittent import find_prior_odds
from .model import HALT_S, GroupModel
from .search import Candidate, FittedHypothesis, Search, find_log_likelihood

Array = npt.NDArray[np.float64]

# Number of samples of the median before a stop is searched for: a single outlier is no rotation.
MEDIAN_SAMPLES = 5
# Share of the predicted speed: a shaft that reads more obeys.
MIN_OBEYED_SHARE = 0.3
# Minimum command of a shaft that should turn, r/min, on the nominal machine.
TURNING_RPM = 5.0
# Minimum duration of standing or turning, s: a shorter episode is a normal start.
MIN_EPISODE_S = 0.25
# Maximum share of turning rows after a stop: occasional rotation is noise of the command.
MAX_OBEYED_SHARE = 0.1
# Minimum total time in which a drive disobeys, s.
MIN_DISOBEYED_S = 3.0
# Minimum deviation of the mean over a second, in standard deviations of a reading.
MIN_OFF_SD = 2.0
# Maximum distance of a stop from the last move, s: the last moves are smaller than the noise.
MAX_STOP_DISTANCE_S = 2.0
# Opening difference, mm, that weighs as much as MAX_STOP_DISTANCE_S, on the nominal machine.
STOP_SCALE_MM = 0.02
# Standard deviation of the time of a stop, s.
STOP_SD_S = 0.5

# Steps by which an onset is moved around the result of a scan, rows.
STEPS_ROWS = (32, 8, 2, 1)


def find_stopped_drives(model: GroupModel) -> list[Candidate]:
    """Return drives that stood still to the end of the log though commanded to move."""
    found: list[Candidate] = []
    predicted = model.predict(())
    for channel in model.channels:
        if channel.settled:
            # The last rows of a descending staircase are within a dead zone.
            continue
        if channel.name == "shaft":
            asked = predicted["shaft"] > scale_nominal(model.machine, SHAFT_RANGE) * TURNING_RPM
            obeyed = asked & (
                median_filter(channel.measured, MEDIAN_SAMPLES)
                > MIN_OBEYED_SHARE * predicted["shaft"]
            )
            at = _find_last_obeyed(asked, obeyed, channel.grid.step_s)
            effect = effects.SHAFT_STALL.id
        elif channel.name == "gate":
            least = int(np.ceil(MIN_DISOBEYED_S / channel.grid.step_s))
            at = _find_still_start(
                channel.measured, predicted["gate"], channel.prior.fast_sd, least
            )
            effect = effects.GATE_STUCK.id
            if at is not None:
                near_mm = scale_nominal(model.machine, OPENING_RANGE) * STOP_SCALE_MM
                at = _find_stuck_sample(
                    channel.measured, predicted["gate"], at, channel.grid.step_s, near_mm
                )
        else:
            continue
        if at is not None and at > 0:
            found.append(
                Candidate(EffectInstance(effect, 1.0, float(channel.grid.even_s[at])), 1.0, 1.0)
            )
    return found


def find_standing_onset(model: GroupModel) -> list[Candidate]:
    """Return the dead band of a shaft that turned at small commands and stands at them from some
    time on."""
    if "shaft" not in model.names:
        return []
    channel, asked = model.find_channel("shaft"), model.predict(())["shaft"]
    if channel.settled:
        return []
    rows = np.ones(max(3, round(MIN_EPISODE_S / channel.grid.step_s)), bool)
    commanded = asked > scale_nominal(model.machine, SHAFT_RANGE) * TURNING_RPM
    turns = median_filter(channel.measured, MEDIAN_SAMPLES) > MIN_OBEYED_SHARE * asked
    stood = np.flatnonzero(binary_opening(commanded & ~turns, rows))
    if not len(stood):
        return []
    size_rpm = float(asked[stood].max())
    obeyed = np.flatnonzero(binary_opening(commanded & turns & (asked < size_rpm), rows))
    before = obeyed[obeyed < stood[0]]
    if not len(before) or len(obeyed) > len(before) + MAX_OBEYED_SHARE * len(stood):
        return []
    onset_s = 0.5 * float(channel.grid.even_s[before[-1]] + channel.grid.even_s[stood[0]])
    return [
        Candidate(EffectInstance(effects.SHAFT_DEAD_BAND.id, size_rpm, onset_s), size_rpm, size_rpm)
    ]


def disobeys_after_stop(model: GroupModel, parts: Hypothesis, stop: EffectInstance) -> bool:
    """Tell whether a stopped drive still deviates from its command, well after its stop, once
    `parts` are included."""
    channel = model.find_channel(EFFECT_ROWS[stop.id].stage)
    second = max(1, round(1.0 / channel.grid.step_s))
    off = uniform_filter1d(channel.measured - model.predict(parts)[channel.name], second)
    later = channel.grid.even_s > float(stop.onset_s or 0.0) + HALT_S
    return (
        float(np.sum(np.abs(off[later]) > MIN_OFF_SD * channel.prior.fast_sd)) * channel.grid.step_s
        > MIN_DISOBEYED_S
    )


def _find_still_start(measured: Array, predicted: Array, noise: float, least: int) -> int | None:
    """Return the sample from which a constant predicts the readings better than the prediction
    does, to the end of the log; None where there is none.

    The gain must exceed the price of trying every sample; the search judges the stop again. Moves
    below the noise of a reading add up, so sums of squares from every sample to the end are
    compared. Each sum is around its own mean, because a gate with an offset from its command is not
    stuck.
    """
    count = np.arange(len(measured), 0, -1)
    ahead = np.cumsum(measured[::-1])[::-1]
    about_mean = np.cumsum((measured**2)[::-1])[::-1] - ahead**2 / count
    left = (measured - predicted)[::-1]
    about_model = (np.cumsum(left**2) - np.cumsum(left) ** 2 / np.arange(1, len(left) + 1))[::-1]
    better = (about_model - about_mean)[:-least] / noise**2
    least_gain = 2.0 * (
        MIN_REPORT_LOG_ODDS
        - find_prior_odds(EffectInstance(effects.GATE_STUCK.id, 1.0))
        + float(np.log(len(measured)))
    )
    if len(better) < 1 or float(better.max()) < least_gain:
        return None
    level = float(np.median(measured[int(np.argmax(better)) :]))
    gained = (
        np.cumsum(((measured - predicted) ** 2 - (measured - level) ** 2)[::-1])[::-1] / noise**2
    )
    at = int(np.argmax(gained[:-least]))
    # The end of a late move also speaks for a stop, but only briefly.
    return at if gained[min(at + least, len(gained) - 1)] > least_gain else None


def _find_stuck_sample(
    measured: Array, predicted: Array, at: int, step_s: float, near_mm: float
) -> int:
    """Return the sample near `at` at which the gate passed its final position: the gate stopped
    there."""
    level = float(np.median(measured[at:]))
    near = np.arange(
        max(0, at - round(MAX_STOP_DISTANCE_S / step_s)),
        min(len(measured), at + round(MAX_STOP_DISTANCE_S / step_s) + 1),
    )
    away = (
        np.abs(predicted[near] - level) / near_mm + np.abs(near - at) * step_s / MAX_STOP_DISTANCE_S
    )
    return int(near[np.argmin(away)])


def find_stop_interval(model: GroupModel, part: EffectInstance) -> tuple[float, float]:
    """Return the times between which a drive may have stopped, s: while the command equals the
    final position, the stop is invisible."""
    channel = model.find_channel(EFFECT_ROWS[part.id].stage)
    at_s = float(part.onset_s or 0.0)
    asked, even_s = model.predict(())[channel.name], channel.grid.even_s
    at = int(np.clip(np.searchsorted(even_s, at_s), 0, len(even_s) - 1))
    level = float(np.median(channel.measured[at:]))
    away = np.flatnonzero(np.abs(asked - level) > channel.prior.fast_sd)
    before, after = away[away < at], away[away > at]
    low = float(even_s[before[-1]]) if len(before) else float(even_s[0])
    high = float(even_s[after[0]]) if len(after) else float(even_s[-1])
    if at in away:
        low, high = at_s, at_s
    return min(low, at_s - STOP_SD_S), max(high, at_s + STOP_SD_S)


def _find_last_obeyed(
    asked: npt.NDArray[np.bool_], obeyed: npt.NDArray[np.bool_], step_s: float
) -> int | None:
    """Return the sample after the last at which the drive obeyed, where commands continued for long
    after that; else None."""
    did = np.flatnonzero(obeyed)
    last = int(did[-1]) if len(did) else 0
    return last + 1 if asked[last + 1 :].sum() * step_s > MIN_DISOBEYED_S else None


def refine_onsets(search: Search, found: FittedHypothesis) -> FittedHypothesis:
    """Move the onset and end of a hypothesis's last effect to their best fit, in decreasing steps
    down to a row.

    No other effect explains an edge that is off by a row.
    """
    model = search.model
    first_s, last_s = (
        float(model.data.time_s[0]) + EDGE_MARGIN_S,
        float(model.data.time_s[-1]) - EDGE_MARGIN_S,
    )
    row_s = min(channel.grid.step_s for channel in model.channels)

    def near(now: FittedHypothesis, rows: float) -> Iterator[FittedHypothesis]:
        for k, part in enumerate(now.parts):
            if part.onset_s is None or CATALOGUE[part.id].effect.onset_only:
                continue
            for by_s in (-rows * row_s, rows * row_s):
                ends = () if part.until_s is None else (part._replace(until_s=part.until_s + by_s),)
                for moved in (part._replace(onset_s=part.onset_s + by_s), *ends):
                    times = [t for t in (moved.onset_s, moved.until_s) if t is not None]
                    if times == sorted(set(times)) and times[0] >= first_s and times[-1] <= last_s:
                        yield search.refit_hypothesis(replace_part(now.parts, k, moved), now.noise)

    last = found.parts[-1]
    if last.onset_s is None or CATALOGUE[last.id].effect.onset_only:
        return found
    return climb_to_best(found, find_log_likelihood, near, STEPS_ROWS, again=False)
