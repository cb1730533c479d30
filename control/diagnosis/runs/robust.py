"""Transforms heavy-tailed noise so that least squares gives the result of a robust fit.

The method uses the pseudo-values of an M-estimate: with psi the score of Student's t, least squares
on (fit + psi / mean slope of psi) gives the M-estimate and its variance (Huber & Ronchetti 2009,
Robust Statistics, 7.8). Only deviations from the local median are transformed, so a structure of
many samples is unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter, uniform_filter1d
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    make_evidence_problem,
    subtract_columns,
)
from topdress.control.diagnosis.judgement.noise import calc_coefficients, make_series
from topdress.control.machine.compiled import run_memory

from .channels import ChannelSeries
from .columns import HypothesisColumns
from .hypothesis import Hypothesis
from .stages import RunData

Array = npt.NDArray[np.float64]

# Degrees of freedom of Student's t for the pseudo-values (`find_tail_excess`).
FREEDOM = 3.0
# Median of the absolute value of t with three degrees of freedom.
MEDIAN_TO_SCALE = 0.7649
# Number of samples of the local median.
MEDIAN_SAMPLES = 15
# Number of samples of a slow wave: slower waves are not correlation of the fast noise.
SLOW_SAMPLES = 201
# Minimum ratio of variances for tails to be treated.
MIN_VARIANCE_RATIO = 1.2
# Minimum number of samples for an estimate of the tails.
MIN_SAMPLES = 400

# Deviation from which a lone reading is an outlier and is limited, s.d. (`limit_outliers`).
OUTLIER_SD = 4.5
# Share of OUTLIER_SD from which a neighbour shows that a reading is not alone.
NEIGHBOUR_SHARE = 0.7
# Time after a command in which a drive has answered, s.
ANSWER_TIME_S = 2.0
# Weight of a sample while a drive answers: nothing is corrected there, and Student's t with three
# degrees of freedom has twice the variance of its pseudo-values (3 against 1.5, in squared scales).
ANSWERING_WEIGHT = 2.0**-0.5


def find_tail_excess(left: Array, free: npt.NDArray[np.bool_]) -> Array:
    """Return the correction of a residual (m,) for heavy tails; zeros where the tails are not
    heavy.

    free : samples that may be changed (m,); the others keep their values.
    """
    nothing = np.zeros(len(left))
    if free.sum() < MIN_SAMPLES:
        return nothing
    memory = _calc_neighbour_correlation(left, free)
    local = median_filter(left, MEDIAN_SAMPLES)
    off = left - local
    fresh = off - memory * np.concatenate(([0.0], off[:-1]))
    scale = float(np.median(np.abs(fresh[free]))) / MEDIAN_TO_SCALE
    if scale <= 0.0:
        return nothing
    square, far = fresh**2, FREEDOM * scale**2
    score = (FREEDOM + 1.0) * fresh / (far + square)
    slope = float(np.mean(((FREEDOM + 1.0) * (far - square) / (far + square) ** 2)[free]))
    if slope <= 0.0:
        return nothing
    drawn_in = score / slope
    if np.var(fresh[free]) < MIN_VARIANCE_RATIO * np.var(drawn_in[free]):
        return nothing
    return np.asarray(run_memory(memory, np.where(free, fresh - drawn_in, 0.0)))


def _calc_neighbour_correlation(left: Array, free: npt.NDArray[np.bool_]) -> float:
    """Return the correlation of neighbouring samples, without slow waves and outliers."""
    fast = left - uniform_filter1d(left, SLOW_SAMPLES)
    reach = 2.5 * 1.4826 * float(np.median(np.abs(fast[free])))
    calm = np.clip(fast, -reach, reach)
    both = free[1:] & free[:-1]
    total = float(np.sum(calm[1:][both] ** 2))
    return (
        float(np.clip(np.sum(calm[1:][both] * calm[:-1][both]) / total, 0.0, 0.95))
        if total > 0.0
        else 0.0
    )


def limit_outliers(columns: HypothesisColumns, parts: Hypothesis, more: Sequence[Column]) -> None:
    """Limit lone readings far off the richest fit; steady or repeated deviations are left
    unchanged.

    more : columns of possible further effects, each with the prior spread of its size; deviations
    that they explain are no outliers.
    """
    model = columns.model
    every = [*columns.list_columns(parts), *more]
    left = model.calc_residual(parts)
    data = {
        c.name: calc_coefficients(left[c.name] + model.drawn_in[c.name], c.cut)
        for c in model.channels
    }
    sizes = make_evidence_problem(model.channels, data, every).fit_sizes(
        np.arange(len(every)), model.noise
    )
    rest = subtract_columns(data, every, sizes.b)
    for channel in model.channels:
        series = make_series(rest[channel.name], channel.cut)
        free = _find_rest_samples(channel, model.data)
        lone, tails = _find_lone_outliers(series), np.zeros(len(series))
        for begin, end in channel.cut.bounds if free.any() else ():
            tails[begin:end] = find_tail_excess((series - lone)[begin:end], free[begin:end])
        model.drawn_in[channel.name] = lone + tails
        # Without a correction, the samples of both states of the drive have one variance.
        model.set_weights(
            channel.name, np.where(free, 1.0, ANSWERING_WEIGHT) if tails.any() else None
        )


def _find_lone_outliers(left: Array) -> Array:
    """Return the excess of single readings beyond OUTLIER_SD where their neighbours do not
    deviate."""
    sd = 1.4826 * float(np.median(np.abs(left - np.median(left))))
    size = np.abs(left - np.median(left))
    neighbour = np.maximum(np.append(size[1:], 0.0), np.insert(size[:-1], 0, 0.0))
    lone = (size > OUTLIER_SD * sd) & (neighbour < NEIGHBOUR_SHARE * OUTLIER_SD * sd)
    return np.where(lone, left - np.sign(left) * OUTLIER_SD * sd, 0.0)


def _find_rest_samples(channel: ChannelSeries, data: RunData) -> npt.NDArray[np.bool_]:
    """Return the samples whose deviations can only be noise: no drive answers a command there."""
    free = np.full(len(channel.measured), channel.name != "scale")
    drive = {"shaft": data.shaft, "gate": data.gate}.get(channel.name)
    if drive is not None:
        changes = np.concatenate(
            ([-np.inf], drive.time_s[1:][np.diff(drive.command) != 0.0], [np.inf])
        )
        after = np.searchsorted(changes, channel.grid.even_s, side="right")
        free &= (channel.grid.even_s - changes[after - 1] > ANSWER_TIME_S) & (
            changes[np.minimum(after, len(changes) - 1)] - channel.grid.even_s > channel.grid.step_s
        )
    return free
