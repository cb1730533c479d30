"""Handles a shaft speed that is read in steps: corrects whole steps of the log, and finds others by
their saw-tooth.

Rounding shifts the mean reading by up to half a step at a nearly constant speed. The corrected
readings then serve the stages of shaft and flow as any other reading. With noise on top of the
steps the readings are not whole steps; the saw-tooth of the rounding error over the true speed then
shows the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.judgement.prior import MIN_REPORT_LOG_ODDS
from topdress.control.machine.effect import SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import make_drive_channel
from .drives import read_whole_drives
from .hypothesis import EffectInstance, list_stages, make_schedule
from .intermittent import DirectDetection, find_prior_odds
from .log import MIN_ROWS, CleanLog
from .model import GroupModel
from .search import Candidate

Array = npt.NDArray[np.float64]

# Minimum step, r/min: finer steps are the digits of an ordinary log. r/min are those of the nominal
# machine, scaled to another machine's range (but not the digits of a log).
MIN_STEP_RPM = 0.45  # finer steps are how an ordinary log is written
# Minimum share of readings on whole steps: one in 200 may be read during a count.
MIN_ON_STEP_SHARE = 0.995
# Resolution of a log's digits, r/min.
LOG_RESOLUTION_RPM = 0.001
# Clock jitter of a counting interval, as a share of a step.
JITTER_SHARE = 0.01
# Share of the largest gap between two readings from which readings belong to different steps.
MIN_GAP_SHARE = 0.05
# Trial divisors of the smallest gap between two readings.
STEP_DIVISORS = (1.0, 2.0, 3.0)
# Trial shares at the end of a log: an encoder may begin to read in steps within the log.
TAIL_SHARES = (1.0, 0.6, 0.3, 0.12)
# Ratio of step to noise above which the noise does not average out the rounding. A reading within
# half a step of the command is then less accurate than the command.
MAX_DITHERED_RATIO = 2.0
# Trial noise levels, as multiples of the machine file's: a grid of 10 %.
TRIAL_NOISE_RATIOS = np.exp(np.linspace(np.log(0.3), np.log(3.0), 24))
# Bin width of the saw-tooth, r/min.
SAW_TOOTH_BIN_RPM = 0.02
# Trial steps, r/min: neighbours differ by a full phase over 100 r/min at most.
TRIAL_STEPS_RPM = np.exp(np.arange(np.log(0.6), np.log(8.0), 5e-4))
# Minimum speed for the saw-tooth search, r/min.
MIN_SAW_TOOTH_RPM = 5.0
# Minimum probability of a reading: some were taken while the shaft changed its speed.
MIN_READING_PROB = 1e-3


class ReadingSteps(NamedTuple):
    """Readings that are whole multiples of a step, from row `first` on."""

    step_rpm: float
    sd_rpm: float
    # Posterior log odds against whole multiples by chance.
    log_odds: float
    first: int = 0


def find_final_steps(
    readings_rpm: Array, min_step_rpm: float = MIN_STEP_RPM
) -> ReadingSteps | None:
    """Return the step of which every reading (n,) from some row to the last is a whole multiple;
    None where there is none.

    An encoder that loses its fine track within the log reads in steps from then on.
    """
    for share in TAIL_SHARES:
        begin = round((1.0 - share) * len(readings_rpm))
        steps = find_reading_step(readings_rpm[begin:], min_step_rpm)
        if steps is None:
            continue
        if begin == 0:
            return steps
        first = _find_first_quantised(readings_rpm, steps.step_rpm, min_step_rpm)
        steps = find_reading_step(readings_rpm[first:], min_step_rpm)
        if steps is not None:
            return steps._replace(first=first)
    return None


def _find_first_quantised(readings_rpm: Array, step_rpm: float, min_step_rpm: float) -> int:
    """Return the most likely row from which readings are quantised; readings before are on steps by
    chance only."""
    turning = np.isfinite(readings_rpm) & (readings_rpm > min_step_rpm)
    by_chance = _calc_chance_of_step(step_rpm)
    on = (
        np.log(MIN_ON_STEP_SHARE / by_chance),
        np.log((1.0 - MIN_ON_STEP_SHARE) / (1.0 - by_chance)),
    )
    speaks = np.where(
        turning,
        np.where(_calc_step_offset(readings_rpm, step_rpm) < _calc_near_share(step_rpm), *on),
        0.0,
    )
    return int(np.argmax(np.cumsum(speaks[::-1])[::-1]))


def _calc_near_share(step_rpm: float) -> float:
    return 0.6 * LOG_RESOLUTION_RPM + JITTER_SHARE * step_rpm


def _calc_chance_of_step(step_rpm: float) -> float:
    """Return the probability that an unquantised reading is on a step."""
    return min(0.5, 2.0 * _calc_near_share(step_rpm) / step_rpm)


def _calc_step_offset(readings_rpm: Array, step_rpm: float) -> Array:
    """Return the distance of readings to the nearest whole step."""
    return np.abs(readings_rpm - step_rpm * np.round(readings_rpm / step_rpm))


def find_reading_step(
    readings_rpm: Array, min_step_rpm: float = MIN_STEP_RPM
) -> ReadingSteps | None:
    """Return the step of which every reading (n,) above zero is a whole multiple; None where there
    is none.

    Equal readings count once, and a single reading sets the step; each further distinct reading is
    on a step by chance with a known probability.
    """
    turning = readings_rpm[np.isfinite(readings_rpm) & (readings_rpm > min_step_rpm)]
    kinds = _list_distinct_readings(turning)
    gaps = np.diff(kinds)
    for parts in STEP_DIVISORS if len(gaps) else ():
        step = float(gaps.min()) / parts
        # Whole multiples show where the readings span two of them.
        if not min_step_rpm <= step <= 0.5 * float(np.ptp(turning)):
            return None
        for _ in range(5):
            number = np.round(turning / step)
            step = float((turning @ number) / (number @ number))
        evidence = -(len(kinds) - 1.0) * float(np.log(_calc_chance_of_step(step))) - float(
            np.log(len(STEP_DIVISORS) * len(TAIL_SHARES))
        )
        odds = evidence + find_prior_odds(EffectInstance(effects.SHAFT_COARSE_ENCODER.id, step))
        if (
            odds > MIN_REPORT_LOG_ODDS
            and np.mean(_calc_step_offset(turning, step) < _calc_near_share(step))
            >= MIN_ON_STEP_SHARE
        ):
            return ReadingSteps(step, LOG_RESOLUTION_RPM / float(np.max(number)), odds)
    return None


def _list_distinct_readings(turning: Array) -> Array:
    """Return the distinct readings; readings that differ by clock jitter only (counts over a
    varying time) are merged."""
    kinds = np.unique(np.round(turning / LOG_RESOLUTION_RPM).astype(np.int64)) * LOG_RESOLUTION_RPM
    if len(kinds) < 2:
        return np.asarray(kinds, np.float64)
    gaps = np.diff(kinds)
    together = np.split(kinds, np.flatnonzero(gaps > MIN_GAP_SHARE * gaps.max()) + 1)
    return np.array([float(np.mean(one)) for one in together], np.float64)


def calc_rounding_error(true_rpm: Array, step_rpm: float, noise_rpm: float) -> Array:
    """Return the mean of (rounded - true) for readings at `true_rpm` (n,) with noise before
    rounding."""
    most = int(np.max(true_rpm, initial=0.0) / step_rpm) + 3
    mean = np.zeros(len(true_rpm))
    for k in range(1, most + 1):
        mean += step_rpm * ndtr((true_rpm - (k - 0.5) * step_rpm) / noise_rpm)
    return np.where(true_rpm > step_rpm, mean - true_rpm, 0.0)


def _find_steady_rows(readings_rpm: Array, rpm: Array, step_rpm: float) -> npt.NDArray[np.bool_]:
    """Return the rows (n,) in which the shaft turns at nearly the commanded speed: no start, no
    stop."""
    return (
        np.isfinite(readings_rpm) & (rpm > step_rpm) & (np.abs(readings_rpm - rpm) < 1.5 * step_rpm)
    )


def calc_speed_ratio(readings_rpm: Array, asked_rpm: Array, step_rpm: float) -> float:
    """Return the ratio of measured to commanded speed in rows (n,) without steps; 1 where there are
    too few.

    A shaft at few speeds does not average out its rounding, so its quantised readings do not show
    the ratio.
    """
    steady = _find_steady_rows(readings_rpm, asked_rpm, step_rpm)
    if steady.sum() < MIN_ROWS:
        return 1.0
    return float(np.median(readings_rpm[steady] / asked_rpm[steady]))


def fit_dither_noise(
    readings_rpm: Array, true_rpm: Array, step_rpm: float, usual_rpm: float
) -> float:
    """Return the noise (1 s.d.) under which readings (n,) rounded to steps are most probable at
    their true speeds (n,)."""
    steady = _find_steady_rows(readings_rpm, true_rpm, step_rpm)
    up = readings_rpm[steady] + 0.5 * step_rpm - true_rpm[steady]
    tried = usual_rpm * TRIAL_NOISE_RATIOS

    def log_likelihood(noise: float) -> float:
        share = ndtr(up / noise) - ndtr((up - step_rpm) / noise)
        return float(np.sum(np.log(np.maximum(share, MIN_READING_PROB))))

    return float(max(tried, key=log_likelihood)) if steady.any() else usual_rpm


class StepCorrection(NamedTuple):
    """A log whose shaft speeds were read in steps. taken_back : the log with corrected mean
    rounding error. turned : the log with the speeds for the flow prediction. seen : the detected
    effect."""

    taken_back: CleanLog
    turned: CleanLog
    seen: DirectDetection


def correct_steps(log: CleanLog, machine: Machine) -> StepCorrection | None:
    """Correct a quantised shaft speed; None where the shaft speed is not read in steps."""
    if "shaft" not in log.stages:
        return None
    readings = log.columns["shaft_rpm"]
    steps = find_final_steps(readings, scale_nominal(machine, SHAFT_RANGE) * MIN_STEP_RPM)
    if steps is None:
        return None
    channel = make_drive_channel(read_whole_drives(log, machine)["shaft"], machine)
    asked = np.interp(
        log.time_s,
        channel.grid.even_s,
        channel.predict(make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S),
    )
    there = slice(steps.first, None)
    true = asked[there] * calc_speed_ratio(
        readings[: steps.first], asked[: steps.first], steps.step_rpm
    )
    noise = fit_dither_noise(readings[there], true, steps.step_rpm, machine.noise.shaft_rpm)
    read_rpm = readings.copy()
    read_rpm[there] -= calc_rounding_error(true, steps.step_rpm, noise)
    turned_rpm = read_rpm
    if steps.step_rpm > MAX_DITHERED_RATIO * noise:
        off = readings[there] - true
        turned_rpm = readings.copy()
        turned_rpm[there] = true + np.sign(off) * np.maximum(
            np.abs(off) - 0.5 * steps.step_rpm, 0.0
        )
    onset_s = float(log.time_s[steps.first]) if steps.first else None
    part = EffectInstance(effects.SHAFT_COARSE_ENCODER.id, steps.step_rpm, onset_s)
    return StepCorrection(
        log._replace(columns={**log.columns, "shaft_rpm": read_rpm}),
        log._replace(columns={**log.columns, "shaft_rpm": turned_rpm}),
        DirectDetection(part, steps.sd_rpm, steps.log_odds),
    )


def find_encoder_steps(model: GroupModel) -> list[Candidate]:
    """Return the encoder step whose saw-tooth fits best, if any, from speeds above
    MIN_SAW_TOOTH_RPM."""
    if "shaft" not in model.names or model.data.shaft is None or model.data.shaft.step > 0.0:
        return []
    scale, predicted = scale_nominal(model.machine, SHAFT_RANGE), model.predict(())["shaft"]
    left = model.calc_residual(())["shaft"]
    on = predicted > scale * MIN_SAW_TOOTH_RPM
    if on.sum() < MIN_ROWS:
        return []
    speed, wrong = predicted[on], left[on]
    wrong = np.clip(wrong, *np.percentile(wrong, (0.5, 99.5)))
    bin_rpm, steps_rpm = scale * SAW_TOOTH_BIN_RPM, scale * TRIAL_STEPS_RPM
    # A saw-tooth shows where the speeds span two of its teeth.
    steps_rpm = steps_rpm[steps_rpm <= 0.5 * float(np.ptp(speed))]
    if not len(steps_rpm):
        return []
    cell = np.round(speed / bin_rpm).astype(np.int64)
    kinds, place, count = np.unique(cell, return_inverse=True, return_counts=True)
    total = np.bincount(place, weights=wrong - wrong.mean())
    centre = np.bincount(place, weights=speed) / count
    variance = float(np.var(wrong))
    best, best_score = 0.0, 0.0
    for part in np.array_split(steps_rpm, max(1, len(steps_rpm) * len(kinds) // 2_000_000)):
        saw = np.sin(2.0 * np.pi * centre / part[:, None])
        level = (saw * count).sum(axis=1, keepdims=True) / count.sum()
        saw = saw - level
        score = -(saw @ total) / np.sqrt(np.maximum(1e-9, variance * (saw**2 @ count)))
        k = int(np.argmax(score))
        if score[k] ** 2 > best_score and score[k] > 0.0:
            best, best_score = float(part[k]), float(score[k] ** 2)
    seen = EffectInstance(effects.SHAFT_COARSE_ENCODER.id, best)
    # The log of the number of trial steps is the price of the search.
    if (
        0.5 * best_score - float(np.log(len(steps_rpm))) + find_prior_odds(seen)
        <= MIN_REPORT_LOG_ODDS
    ):
        return []
    return [Candidate(seen, best, best)]
