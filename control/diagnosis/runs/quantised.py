"""A shaft speed that is read in steps: whole steps are read off the log and taken back, others
show as a saw-tooth.

Rounding moves the mean reading by up to half a step, at a speed that hardly changes for good;
what is left of whole steps then serves the shaft's and the flow's stage as any other reading.
With noise on top of the steps the readings lie anywhere: there the step is found by the
saw-tooth that rounding leaves over the true speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr
from topdress.control.diagnosis import effects
from topdress.control.diagnosis.judgement.prior import SAID
from topdress.control.machine.effect import SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import make_drive_channel
from .drives import read_whole_drives
from .hypothesis import EffectInstance, list_stages, make_schedule
from .intermittent import ReadOff, find_prior_odds
from .log import MIN_ROWS, Clean
from .model import GroupModel
from .search import Candidate

Array = npt.NDArray[np.float64]

# r/min are those of the nominal machine, but for the digits of a log: a share of another's range.
MIN_STEP_RPM = 0.45  # finer steps are how an ordinary log is written
# of the readings of such an encoder: one in 200 was taken while it counted
ON_STEPS = 0.995
WRITTEN_RPM = 0.001  # digits of a log
# of a step: counts over a time that a clock keeps to a per cent
JITTER = 0.01
# of the largest gap between two readings: those of two steps are further apart
APART = 0.05
# of the smallest gap between two readings, that a step may be
PARTS = (1.0, 2.0, 3.0)
# of a log, that are tried: an encoder may begin to read in steps
TAILS = (1.0, 0.6, 0.3, 0.12)
# times the noise before rounding: a longer step is not averaged out; within half of it the
# speed that was asked for is known better than the one that was read
DITHERED = 2.0
# times the machine file's: a grid of 10 %
NOISE_TRIED = np.exp(np.linspace(np.log(0.3), np.log(3.0), 24))
SAW_TOOTH_BIN_RPM = 0.02
# a grid of a turn of the phase in 100 r/min
STEPS_TRIED_RPM = np.exp(np.arange(np.log(0.6), np.log(8.0), 5e-4))
FROM_RPM = 5.0  # a saw-tooth is looked for above this speed
# of a reading: some were taken while the shaft changed its speed
MIN_CHANCE = 1e-3


class ReadingSteps(NamedTuple):
    """Readings that are whole numbers of one step, from the first of these rows on."""

    step_rpm: float
    sd_rpm: float
    log_odds: float  # posterior, against steps by chance
    first: int = 0


def steps_to_the_end(
    readings_rpm: Array, min_step_rpm: float = MIN_STEP_RPM
) -> ReadingSteps | None:
    """The step of which every reading (n,) is a whole number, from some row to the last; None
    where there is none.

    An encoder that lost its fine track within the log reads in steps from then on.
    """
    for share in TAILS:
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
    """Row from which readings are quantised: the likeliest, where those before are on steps by
    chance only."""
    turning = np.isfinite(readings_rpm) & (readings_rpm > min_step_rpm)
    by_chance = _calc_chance_of_step(step_rpm)
    on = np.log(ON_STEPS / by_chance), np.log((1.0 - ON_STEPS) / (1.0 - by_chance))
    speaks = np.where(
        turning,
        np.where(_calc_step_offset(readings_rpm, step_rpm) < _calc_near_share(step_rpm), *on),
        0.0,
    )
    return int(np.argmax(np.cumsum(speaks[::-1])[::-1]))


def _calc_near_share(step_rpm: float) -> float:
    return 0.6 * WRITTEN_RPM + JITTER * step_rpm


def _calc_chance_of_step(step_rpm: float) -> float:
    """Chance that a reading without steps lies on one."""
    return min(0.5, 2.0 * _calc_near_share(step_rpm) / step_rpm)


def _calc_step_offset(readings_rpm: Array, step_rpm: float) -> Array:
    """How far readings are from the next whole step."""
    return np.abs(readings_rpm - step_rpm * np.round(readings_rpm / step_rpm))


def find_reading_step(
    readings_rpm: Array, min_step_rpm: float = MIN_STEP_RPM
) -> ReadingSteps | None:
    """The step of which every reading (n,) above zero is a whole number; None where they lie on
    no such steps.

    Readings that are alike are one fact, and one of them sets the step: each other one lies on
    it by chance.
    """
    turning = readings_rpm[np.isfinite(readings_rpm) & (readings_rpm > min_step_rpm)]
    kinds = _list_distinct_readings(turning)
    gaps = np.diff(kinds)
    for parts in PARTS if len(gaps) else ():
        step = float(gaps.min()) / parts
        if step < min_step_rpm:
            return None
        for _ in range(5):
            number = np.round(turning / step)
            step = float((turning @ number) / (number @ number))
        evidence = -(len(kinds) - 1.0) * float(np.log(_calc_chance_of_step(step))) - float(
            np.log(len(PARTS) * len(TAILS))
        )
        odds = evidence + find_prior_odds(EffectInstance(effects.SHAFT_COARSE_ENCODER.id, step))
        if (
            odds > SAID
            and np.mean(_calc_step_offset(turning, step) < _calc_near_share(step)) >= ON_STEPS
        ):
            return ReadingSteps(step, WRITTEN_RPM / float(np.max(number)), odds)
    return None


def _list_distinct_readings(turning: Array) -> Array:
    """The different readings, those that a clock's jitter sets apart (counts over a time that
    varies) taken as one."""
    kinds = np.unique(np.round(turning / WRITTEN_RPM).astype(np.int64)) * WRITTEN_RPM
    if len(kinds) < 2:
        return np.asarray(kinds, np.float64)
    gaps = np.diff(kinds)
    together = np.split(kinds, np.flatnonzero(gaps > APART * gaps.max()) + 1)
    return np.array([float(np.mean(one)) for one in together], np.float64)


def rounding_error(true_rpm: Array, step_rpm: float, noise_rpm: float) -> Array:
    """Mean of (rounded - true) over readings of `true_rpm` (n,) whose noise is rounded with
    them."""
    most = int(np.max(true_rpm, initial=0.0) / step_rpm) + 3
    mean = np.zeros(len(true_rpm))
    for k in range(1, most + 1):
        mean += step_rpm * ndtr((true_rpm - (k - 0.5) * step_rpm) / noise_rpm)
    return np.where(true_rpm > step_rpm, mean - true_rpm, 0.0)


def _find_steady_rows(readings_rpm: Array, rpm: Array, step_rpm: float) -> npt.NDArray[np.bool_]:
    """Rows (n,) in which the shaft turns about as fast as it should: no start, no stop."""
    return (
        np.isfinite(readings_rpm) & (rpm > step_rpm) & (np.abs(readings_rpm - rpm) < 1.5 * step_rpm)
    )


def ratio_before(readings_rpm: Array, asked_rpm: Array, step_rpm: float) -> float:
    """Turned over asked speed in rows (n,) that are not read in steps; 1 where there are too few.

    A shaft that is held at few speeds does not average its rounding out: its own readings do
    not say it afterwards.
    """
    steady = _find_steady_rows(readings_rpm, asked_rpm, step_rpm)
    if steady.sum() < MIN_ROWS:
        return 1.0
    return float(np.median(readings_rpm[steady] / asked_rpm[steady]))


def noise_before_rounding(
    readings_rpm: Array, true_rpm: Array, step_rpm: float, usual_rpm: float
) -> float:
    """The noise (1 s.d.) under which readings (n,) rounded to steps are most probable at their
    true speeds (n,)."""
    steady = _find_steady_rows(readings_rpm, true_rpm, step_rpm)
    up = readings_rpm[steady] + 0.5 * step_rpm - true_rpm[steady]
    tried = usual_rpm * NOISE_TRIED

    def log_likelihood(noise: float) -> float:
        share = ndtr(up / noise) - ndtr((up - step_rpm) / noise)
        return float(np.sum(np.log(np.maximum(share, MIN_CHANCE))))

    return float(max(tried, key=log_likelihood)) if steady.any() else usual_rpm


class WithoutSteps(NamedTuple):
    """A log whose shaft speeds were read in steps. taken_back : the mean error of rounding
    taken off them. turned : the speeds at which the flow is predicted. seen : the effect that
    it was."""

    taken_back: Clean
    turned: Clean
    seen: ReadOff


def without_steps(log: Clean, machine: Machine) -> WithoutSteps | None:
    """None where the shaft's speed is not read in steps."""
    if "shaft" not in log.stages:
        return None
    readings = log.columns["shaft_rpm"]
    steps = steps_to_the_end(readings, scale_nominal(machine, SHAFT_RANGE) * MIN_STEP_RPM)
    if steps is None:
        return None
    channel = make_drive_channel(read_whole_drives(log, machine)["shaft"], machine)
    asked = np.interp(
        log.time_s,
        channel.grid.even_s,
        channel.predict(make_schedule(list_stages(machine), ()), MAX_MODEL_STEP_S),
    )
    there = slice(steps.first, None)
    true = asked[there] * ratio_before(
        readings[: steps.first], asked[: steps.first], steps.step_rpm
    )
    noise = noise_before_rounding(readings[there], true, steps.step_rpm, machine.noise.shaft_rpm)
    read_rpm = readings.copy()
    read_rpm[there] -= rounding_error(true, steps.step_rpm, noise)
    turned_rpm = read_rpm
    if steps.step_rpm > DITHERED * noise:
        off = readings[there] - true
        turned_rpm = readings.copy()
        turned_rpm[there] = true + np.sign(off) * np.maximum(
            np.abs(off) - 0.5 * steps.step_rpm, 0.0
        )
    onset_s = float(log.time_s[steps.first]) if steps.first else None
    part = EffectInstance(effects.SHAFT_COARSE_ENCODER.id, steps.step_rpm, onset_s)
    return WithoutSteps(
        log._replace(columns={**log.columns, "shaft_rpm": read_rpm}),
        log._replace(columns={**log.columns, "shaft_rpm": turned_rpm}),
        ReadOff(part, steps.sd_rpm, steps.log_odds),
    )


def encoder_steps(model: GroupModel) -> list[Candidate]:
    """The step whose saw-tooth fits best, where there is one; looked for among speeds above
    FROM_RPM."""
    if "shaft" not in model.names or model.data.shaft is None or model.data.shaft.step > 0.0:
        return []
    scale, predicted = scale_nominal(model.machine, SHAFT_RANGE), model.predicted(())["shaft"]
    left = model.residual(())["shaft"]
    on = predicted > scale * FROM_RPM
    if on.sum() < MIN_ROWS:
        return []
    speed, wrong = predicted[on], left[on]
    wrong = np.clip(wrong, *np.percentile(wrong, (0.5, 99.5)))
    bin_rpm, steps_rpm = scale * SAW_TOOTH_BIN_RPM, scale * STEPS_TRIED_RPM
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
    # the price of all those tried
    if 0.5 * best_score - float(np.log(len(steps_rpm))) + find_prior_odds(seen) <= SAID:
        return []
    return [Candidate(seen, best, best)]
