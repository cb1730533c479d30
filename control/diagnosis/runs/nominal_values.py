"""Fits nominal values within their tolerances, so that slopes are taken at the best fit."""

from __future__ import annotations

from functools import cache

import numpy as np
from topdress.control.diagnosis.effects import EFFECT_ROWS, find_size_range
from topdress.control.diagnosis.judgement.evidence import (
    ColumnRole,
    fit_amplitudes_and_noise,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.noise import calc_coefficients
from topdress.control.diagnosis.judgement.prior import SIZE_ERROR
from topdress.control.machine.machine import Machine

from .channels import ChannelSeries
from .columns import HypothesisColumns
from .hypothesis import EffectInstance, Hypothesis
from .model import Nuisance, calc_equivalent_sd, find_replaced_nominals, find_tolerance

# Maximum number of rounds of the fit.
MAX_ROUNDS = 4
# Trial shares of the step that the slopes suggest, until one gains.
STEP_SHARES = (1.0, 0.4, 0.15)
# Maximum offset in tolerances: the prior ends there, and a larger offset is an effect.
MAX_OFFSET_SD = 3.0
# Minimum step in tolerances: a smaller step is not worth a run of the model.
MIN_STEP_SD = 0.05
# Minimum gain in log-likelihood for a further round.
MIN_GAIN = 0.5
# Dead time and slew: the nominal values on which the end of a move depends.
TIMING_FIELDS = ("dead_time_s", "slew_mm_s")
# Number of halvings of a tolerance in the search for a timing value: down to a thirtieth.
TIMING_HALVING_COUNT = 5
# Minimum gain in log-likelihood for a timing value to be changed.
MIN_TIME_GAIN = 2.0


def settle_nominal_values(columns: HypothesisColumns, parts: Hypothesis) -> Hypothesis:
    """Set the model's nominal values to their best fit together with a hypothesis, and return the
    refitted hypothesis.

    The effects' sizes are refitted as well, because a size and a tolerance may be interchangeable.
    Values that an effect of the hypothesis replaces keep the machine file's value.
    """
    _try_time_grid(columns, parts)
    model, best = columns.model, _calc_rest_likelihood(columns, parts)
    for _ in range(MAX_ROUNDS):
        before = dict(model.offsets)
        steps, sizes = _find_wanted_steps(columns, parts)
        if all(abs(size) < MIN_STEP_SD * n.sd for n, size in steps):
            break
        tried = parts
        for share in STEP_SHARES:
            model.set_offsets(
                {
                    n.key: float(
                        np.clip(
                            before.get(n.key, 0.0) + share * size,
                            -MAX_OFFSET_SD * n.sd,
                            MAX_OFFSET_SD * n.sd,
                        )
                    )
                    for n, size in steps
                }
            )
            tried = tuple(
                _grow_effect(part, share * sizes.get(k, 0.0), model.machine)
                for k, part in enumerate(parts)
            )
            now = _calc_rest_likelihood(columns, tried)
            if now > best:
                break
        if now <= best:
            model.set_offsets(before)
            break
        gained, best, parts = now - best, now, tried
        if gained < MIN_GAIN:
            break
    return parts


def _find_wanted_steps(
    columns: HypothesisColumns, parts: Hypothesis
) -> tuple[list[tuple[Nuisance, float]], dict[int, float]]:
    """Return the fitted step of each nominal value and of each effect's size (by index)."""
    model = columns.model
    p, count = columns.compress_hypothesis(parts)
    amplitude = fit_amplitudes_and_noise(p, np.arange(count), model.noise, rounds=3).amplitude
    of_value = {
        label.name: float(amplitude[k])
        for k, label in enumerate(p.labels)
        if label.role is ColumnRole.TOLERANCE
    }
    of_part = {
        label.part: float(amplitude[k])
        for k, label in enumerate(p.labels)
        if label.role is ColumnRole.SLOPE
    }
    return [
        (n, of_value.get(n.key, -model.offsets.get(n.key, 0.0))) for _, n in model.nuisances
    ], of_part


def _calc_rest_likelihood(columns: HypothesisColumns, parts: Hypothesis) -> float:
    """Return the log-likelihood with the nominal values exactly at their current values."""
    model = columns.model
    kept = [
        c
        for c in columns.list_fixed_columns(parts)
        if c.label.role not in (ColumnRole.TOLERANCE, ColumnRole.TRAIT)
    ]
    p = make_evidence_problem(model.channels, model.calc_banded_residual(parts), kept)
    value = fit_amplitudes_and_noise(p, np.arange(len(kept)), model.noise, rounds=2).log_likelihood
    for _, n in model.nuisances:
        value -= 0.5 * (model.offsets.get(n.key, 0.0) / n.sd) ** 2
    return value


def _try_time_grid(columns: HypothesisColumns, parts: Hypothesis) -> None:
    """Set dead times and slew rates to the best value of a grid.

    A move shorter than a row ends before it is read, or has not started, so the likelihood has
    kinks and slopes mislead.
    """
    moved = find_replaced_nominals(parts)
    for channel, n in columns.model.nuisances:
        if n.field in TIMING_FIELDS and n.key not in moved:
            _move_time_value(columns, parts, channel, n)


def _move_time_value(
    columns: HypothesisColumns, parts: Hypothesis, channel: ChannelSeries, n: Nuisance
) -> None:
    model, name = columns.model, channel.name
    kept = [
        c
        for c in columns.list_fixed_columns(parts)
        if name in c.coefficients
        and not (c.label.role is ColumnRole.TOLERANCE and c.label.name == n.key)
    ]
    places = np.arange(len(kept))

    @cache
    def value(off: float) -> float:
        base = model.base.replace_fields(n.stage, **{n.field: float(model.find_nominal(n) + off)})
        left = channel.measured - model.drawn_in[name] - model.run_model(parts, base, (name,))[name]
        p = make_evidence_problem([channel], {name: calc_coefficients(left, channel.cut)}, kept)
        return (
            fit_amplitudes_and_noise(p, places, model.noise, rounds=2).log_likelihood
            - 0.5 * (off / n.sd) ** 2
        )

    now = model.offsets.get(n.key, 0.0)
    best = climb_to_best(
        now,
        value,
        lambda off, step: [
            off + far * step
            for far in ((-2.0, -1.0, 1.0, 2.0) if step == n.sd else (-1.0, 1.0))
            if abs(off + far * step) <= MAX_OFFSET_SD * n.sd
        ],
        [n.sd * 0.5**halvings for halvings in range(TIMING_HALVING_COUNT + 1)],
        again=False,
    )
    if value(best) > value(now) + MIN_TIME_GAIN:
        model.set_offsets({**model.offsets, n.key: best})


def calc_total_sd(part: EffectInstance, sd: float, machine: Machine) -> float:
    """Return the s.d. of the error of an effect's size, errors of the model included. sd : as
    fitted.

    The tolerance of the nominal value that an effect changes is open together with its size, but
    where it begins within the log: the rows before have the tolerance alone. The resolution of the
    times on which a size depends is added.
    """
    tolerance = find_tolerance(part.id, machine) if part.onset_s is None else 0.0
    timing = calc_timing_sd(part.id, machine)
    return SIZE_ERROR * float(np.sqrt(sd**2 + tolerance**2 + timing**2))


def calc_excess_sd(part: EffectInstance, sd: float, machine: Machine) -> float:
    """Return the s.d. of the share of an effect's size that a healthy machine does not have. sd :
    as fitted.

    A healthy machine may have a size up to its tolerance, or up to its motor's electrical time
    constant (`calc_equivalent_sd`).
    """
    healthy = calc_equivalent_sd(part.id, machine) if part.onset_s is None else 0.0
    timing = calc_timing_sd(part.id, machine)
    return SIZE_ERROR * float(np.sqrt(sd**2 + healthy**2 + timing**2))


def calc_timing_sd(effect_id: str, machine: Machine) -> float:
    """Return the standard deviation of the time search that an effect of nearly the same form
    depends on; 0 where there is none.

    A size that is fitted together with such a time is known no better, however long the log.
    """
    row = EFFECT_ROWS[effect_id]
    return max(
        (
            find_tolerance(one, machine) / 2.0**TIMING_HALVING_COUNT
            for one in row.siblings
            if EFFECT_ROWS[one].moves in TIMING_FIELDS
        ),
        default=0.0,
    )


def _grow_effect(part: EffectInstance, by: float, machine: Machine) -> EffectInstance:
    low, high = find_size_range(part.id, machine)
    return part._replace(size=min(high, max(low, part.size + float(by))))
