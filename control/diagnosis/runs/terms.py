"""Searches terms that a log shows beyond the catalogue: quantity, variables and functional form.

Forward selection over a dictionary of forms [1]_. Each form is tested on the residual whitened by
its channel's noise; the shapes of the best forms are refined, and these forms are refitted with the
noise. A term is reported where it is more likely than none, by the same score as effects.

References
----------
.. [1] Miller, Subset Selection in Regression, 2nd ed., 2002, ch. 3.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.judgement import prior
from topdress.control.diagnosis.judgement.evidence import (
    TWO_SIDED_90_QUANTILE,
    Column,
    ColumnLabel,
    ColumnRole,
    Fit,
    Problem,
    choose_better_fit,
    find_residual_power,
    fit_amplitudes_and_noise,
    limit_slow_noise,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.noise import Noise, calc_coefficients, make_series
from topdress.control.machine.compiled import run_term
from topdress.control.machine.term_form import TriedForm
from topdress.control.machine.term_forms import (
    SPAN_POSITION_COUNT,
    LostConstantForm,
    PeriodicForm,
    SpanForm,
)
from topdress.control.machine.term_sums import sum_over_log
from topdress.control.machine.terms import (
    TARGET_STAGES,
    TARGET_UNITS,
    Interval,
    Term,
    TermTarget,
    name_own_command,
)

from .dictionary import (
    CHANNEL_OF,
    FormCandidate,
    FormDictionary,
    FormVariables,
    TargetResponse,
    scan_dictionary,
)
from .held_out import fit_amplitudes, hold_out_blocks, list_held_out_errors
from .hypothesis import EffectInstance
from .search import FittedHypothesis, Search
from .stages import RunData
from .whitened import WhitenedResidual, calc_block_gain

Array = npt.NDArray[np.float64]
EightValues = tuple[float, float, float, float, float, float, float, float]

# Maximum number of terms of one group of channels.
MAX_TERMS = 2
# Minimum score for a refit; gains are in twice the log-likelihood, minus the penalty for ranking
# forms.
MIN_SCORE = 6.0
# Number of best forms of a scan whose noise is refitted too.
VERIFIED_COUNT = 4
# Number of best forms over a term's variable that are refitted under the noise with the term.
RETRIED_FORM_COUNT = 3
# Step sizes of the shape search, as shares of the first: the last two for a discontinuous form.
SHAPE_STEP_SHARES = (1.0, 0.5, 0.25, 0.12, 0.06)
# Share of the fast noise that represents a negligible drift.
NEGLIGIBLE_SHARE = 0.01
# Minimum distance of two knots of a form, as a share of the variable's spread.
MIN_KNOT_DISTANCE = 1e-3
# Maximum length of a term's id, letters; the rest is for a number where the name is already
# adopted.
MAX_ID_LETTERS = 76
# Minimum distance of a level from zero, in standard deviations, for the level to belong to the
# machine.
MIN_LEVEL_SD = 2.0
# Minimum level as a share of its form's change: no form is exactly right.
MIN_LEVEL_SHARE = 0.05
# Correlation with a named effect's size above which a level belongs to that effect.
MAX_NAME_CORRELATION = 0.97
# Cosine between the column of a tolerance and a level above which they are interchangeable.
MIN_LEVEL_COSINE = 0.7
# Number of classes of a variable for the means in a picture.
CLASS_COUNT = 12
# Number of points of a term's curve.
NODE_COUNT = 8


class FittedTerm(NamedTuple):
    """A term that a log shows."""

    term: Term
    tried: TriedForm
    # Gain in twice the log-likelihood, with the noise refitted.
    gain: float
    # Log posterior odds against no term.
    worth: float
    # Columns of the level (where free) and of the form.
    columns: tuple[Column, ...]
    # Explained share of the residual variance.
    explained_share: float
    # Change of the dose, %, r.m.s. over the working rows.
    field_percent: float
    # Noise with the term.
    noise: dict[str, Noise]
    # Log evidence with this term and those before.
    log_evidence: float
    # Log prior odds of the term.
    log_prior: float
    # Share of the held-out mean square error that the term explains.
    held_out: float = 0.0

    @property
    def stage(self) -> str:
        return self.term.stage

    @property
    def levels(self) -> int:
        """Number of level columns: none or one."""
        return len(self.columns) - len(self.tried.columns)


class TermContext:
    """Context in which a term is tried: a hypothesis and the terms before. base : columns of both;
    noise : noise under both."""

    def __init__(
        self,
        search: Search,
        dictionary: FormDictionary,
        now: FittedHypothesis,
        terms: Sequence[FittedTerm] = (),
    ) -> None:
        self.search, self.dictionary, self.now = search, dictionary, now
        self.channels, self.data = search.model.channels, search.model.data
        self.held = [column for one in terms for column in one.columns]
        self.base = [*search.columns.list_columns(now.parts), *self.held]
        self.noise = terms[-1].noise if terms else now.noise
        self.calm = limit_slow_noise(self.noise, self.channels)
        self._banded = search.model.calc_banded_residual(now.parts)

    def whitened(self, noise: dict[str, Noise]) -> WhitenedResidual:
        return WhitenedResidual(self.channels, self._banded, self.base, noise)

    def make_problem(self, columns: Sequence[Column]) -> Problem:
        """Return the regression problem with further columns after those of the base."""
        self.search.model.ask()
        return make_evidence_problem(self.channels, self._banded, [*self.base, *columns])


def find_terms(
    search: Search,
    dictionary: FormDictionary,
    now: FittedHypothesis,
    not_over: frozenset[str] = frozenset(),
) -> list[FittedTerm]:
    """Return terms on top of a hypothesis, the strongest first, each more likely present than
    absent.

    not_over : variables that no term may have alone.
    """
    terms: list[FittedTerm] = []
    for _ in range(MAX_TERMS):
        best = _find_best_term(TermContext(search, dictionary, now, terms), not_over)
        if best is None:
            break
        terms.append(best)
    return _refit_jointly(TermContext(search, dictionary, now), terms) if len(terms) > 1 else terms


def find_best_span(
    search: Search, dictionary: FormDictionary, now: FittedHypothesis, part: EffectInstance
) -> FittedTerm | None:
    """Return the best constant, of any quantity, that lasts as long as an effect, on top of a
    hypothesis; None where no quantity is searched over time.

    The constant represents an unknown cause in the effect's place.
    """
    given = TermContext(search, dictionary, now)
    shape = {
        "low_end": part.onset_s or 0.0,
        "high_end": np.inf if part.until_s is None else part.until_s,
    }
    found = []
    for acts, (_, variables) in dictionary.of.items():
        if "time_s" in variables.one:
            time = variables.by_name["time_s"]
            span = TriedForm(
                SpanForm,
                ("time_s",),
                shape,
                SpanForm.make_columns(shape, time, time),
                SPAN_POSITION_COUNT**2,
            )
            found.append(_verify_term(given, FormCandidate(acts, span), given.noise))
    return max(found, key=lambda one: one.worth, default=None)


def _find_best_term(given: TermContext, not_over: frozenset[str]) -> FittedTerm | None:
    """Return the most likely term; None where its absence is more likely."""
    verified = [
        _verify_term(given, candidate, given.noise)
        for candidate in _list_form_candidates(given)
        if not set(candidate.tried.over) <= not_over or candidate.tried.kind is LostConstantForm
    ]
    best = max(verified, key=lambda one: one.worth, default=None)
    if best is None or best.worth <= prior.MIN_REPORT_LOG_ODDS:
        return None
    best = _reselect_form(given, best)
    return best._replace(held_out=_calc_held_out_gain(given, best))


def _reselect_form(given: TermContext, one: FittedTerm) -> FittedTerm:
    """Return the best form over the same variable under the noise with the term: without the term,
    drift absorbed part of the dependence and biased the selection."""
    if len(one.tried.over) > 1 or one.tried.kind in (SpanForm, PeriodicForm, LostConstantForm):
        return one
    acts = one.term.acts_on
    residual = given.whitened(one.noise)
    entries = [
        entry.select_forms([form.kind is kind for form in entry.forms])
        for entry in given.dictionary.list_form_groups(acts)
        if entry.forms[0].over == one.tried.over
        for kind in dict.fromkeys(form.kind for form in entry.forms)
    ]
    ranked = sorted(
        scan_dictionary(residual, given.dictionary.of[acts][0], entries), key=lambda c: -c.score
    )[:RETRIED_FORM_COUNT]
    return max(
        [one, *(_verify_term(given, candidate, one.noise) for candidate in ranked)],
        key=lambda found: found.worth,
    )


def _list_form_candidates(given: TermContext) -> list[FormCandidate]:
    """Return the best forms under two noise models: one form of each quantity and set of variables
    under each.

    The noise of the hypothesis may hide a slow form; under a noise without drift, a drift looks
    like a form. A temporary form shows only under noise without its slow component, because its
    edges are off by half a class.
    """
    chosen: dict[tuple[TermTarget, tuple[str, ...], str, int], FormCandidate] = {}
    temporary = given.dictionary.scan_forms(
        given.whitened(_drop_slow_noise(given.noise)), temporary=True
    )
    for noise in (given.noise,) if given.calm == given.noise else (given.noise, given.calm):
        lasting = given.dictionary.scan_forms(given.whitened(noise), temporary=False)
        found = sorted([*lasting, *temporary], key=lambda c: -c.score)
        plain = [one for one in found if len(one.tried.over) == 1 and not one.tried.kind.one_run]
        leaps = [one for one in plain if one.tried.kind.leaps]
        # A strong form of one variable leads in many products.
        for one in (*found[:VERIFIED_COUNT], *plain[:1], *leaps[:1]):
            if one.score > MIN_SCORE:
                chosen.setdefault(
                    (one.acts, one.tried.over, one.tried.kind.form, len(one.tried.columns)), one
                )
    return list(chosen.values())


def _drop_slow_noise(noise: dict[str, Noise]) -> dict[str, Noise]:
    """Return the noise without its slow component."""
    return {
        name: Noise((*one.theta[:2], float(np.log(NEGLIGIBLE_SHARE * one.fast_sd)), one.theta[3]))
        for name, one in noise.items()
    }


def _refine_form_shape(
    given: TermContext, one: FormCandidate, noise: dict[str, Noise]
) -> TriedForm:
    """Move a form's shape in decreasing steps to the largest gain under a noise."""
    form, (acted, variables) = one.tried, given.dictionary.of[one.acts]
    kind, x = form.kind, variables.by_name[form.over[0]]
    if not kind.movable:
        return form
    residual = given.whitened(noise)
    constant = acted.constant[: variables.has_level(form)]

    def gain(form: TriedForm) -> float:
        series = np.concatenate((acted.calc_response(form.calc_rows(variables.by_name)), constant))
        return residual.project_out_base(
            acted.channel, calc_coefficients(series, acted.channel.cut)
        ).calc_gain_of_mixes(np.eye(len(series)))

    def near(form: TriedForm, fineness: float) -> Iterator[TriedForm]:
        for name in kind.movable:
            for way in (-fineness, fineness):
                shape = {**form.shape, name: kind.step_shape(form.shape, name, way, x)}
                if (
                    shape.get("high_end", np.inf) - shape.get("low_end", -np.inf)
                    >= MIN_KNOT_DISTANCE
                ):
                    yield form.change_shape(shape, variables.by_name)

    steps = np.repeat(
        SHAPE_STEP_SHARES if kind.leaps else SHAPE_STEP_SHARES[:3], len(kind.movable)
    ).tolist()
    return climb_to_best(form, gain, near, steps, again=False)


def _verify_term(given: TermContext, one: FormCandidate, noise: dict[str, Noise]) -> FittedTerm:
    """Refine the shape of a candidate and refit the candidate with the noise. noise : start of the
    fits."""
    base, (acted, variables) = len(given.base), given.dictionary.of[one.acts]
    quiet = (
        _drop_slow_noise(noise) if one.tried.kind.leaps else limit_slow_noise(noise, given.channels)
    )
    form = _refine_form_shape(given, one, quiet)
    name, cut = acted.channel.name, acted.channel.cut
    rows = form.calc_rows(variables.by_name)
    series = np.concatenate(
        (acted.constant[: variables.has_level(form)], acted.calc_response(rows))
    )
    levels, usual = len(series) - len(rows), prior.TERM_SDS[one.acts]
    columns = tuple(
        Column(ColumnLabel(ColumnRole.FORM, "term"), {name: calc_coefficients(row, cut)}, usual)
        for row in series
    )
    p = given.make_problem(columns)
    plain, full, log_weight = _fit_with_and_without(given, p, base + levels, noise, usual)
    sizes = full.amplitude[base + levels :]
    own, whole = (
        calc_coefficients(sizes @ series[levels:], cut),
        calc_coefficients(full.amplitude[base:] @ series, cut),
    )
    gain = full.log_likelihood - plain.log_likelihood
    integrated = (
        full.log_evidence - full.log_likelihood - (plain.log_evidence - plain.log_likelihood)
    )
    trace = Column(ColumnLabel(ColumnRole.TRACE), {name: whole}, np.inf)
    even = min(gain, calc_block_gain(given.search, given.now.parts, full.noise, trace, given.held))
    left = find_residual_power(p, name, np.arange(base + levels), plain.amplitude)
    log_prior = _calc_log_prior(len(given.dictionary.of), one.tried, variables) + log_weight
    level = (
        _find_term_level(full, base, given.base, columns[0], float(np.std(sizes @ rows)))
        if levels
        else 0.0
    )
    term = _make_term(one.acts, form, sizes, level, full, base + levels, variables)
    return FittedTerm(
        term,
        form,
        2.0 * gain,
        even + integrated + log_prior,
        columns,
        float(np.clip(np.sum(own**2) / max(1e-300, left), 0.0, 1.0)),
        _calc_dose_rms(term, given.data),
        full.noise,
        full.log_evidence,
        log_prior,
    )


def _fit_with_and_without(
    given: TermContext, p: Problem, count: int, noise: dict[str, Noise], usual: float
) -> tuple[Fit, Fit, float]:
    """Return the best fits without and with a form, and the log weight of the prior of its sizes.
    count : number of columns before the form."""
    before, every, sizes = np.arange(count), np.arange(len(p.sd)), np.arange(count, len(p.sd))
    plain = choose_better_fit(p, before, noise, given.channels)
    first = fit_amplitudes_and_noise(p, every, plain.noise)
    wide = p.sd.copy()
    wide[sizes] = [prior.find_size_sd(float(size), usual) for size in first.amplitude[sizes]]
    weight = sum(prior.find_size_log_weight(float(size), usual) for size in wide[sizes])
    p = p._replace(sd=wide)
    full = max(
        (choose_better_fit(p, every, start, given.channels) for start in (first.noise, noise)),
        key=lambda fit: fit.log_likelihood,
    )
    # A better noise fit is no gain of the form.
    again = fit_amplitudes_and_noise(p, before, full.noise)
    return max(plain, again, key=lambda fit: fit.log_likelihood), full, weight


def _calc_log_prior(quantities: int, form: TriedForm, variables: FormVariables) -> float:
    """Return the log prior odds of a form."""
    count = len(variables.one) if len(form.over) == 1 else len(variables.list_pairs())
    return prior.calc_form_log_odds(quantities, count, form.places, form.kind.one_run)


def _refit_jointly(given: TermContext, terms: Sequence[FittedTerm]) -> list[FittedTerm]:
    """Refit the terms jointly: the first was fitted before the others were added."""
    columns: list[Column] = []
    # A quantity has a single level, however many terms act on it.
    levels: dict[TermTarget, int] = {}
    forms: list[int] = []
    for one in terms:
        if one.levels and one.term.acts_on not in levels:
            levels[one.term.acts_on] = len(given.base) + len(columns)
            columns.append(one.columns[0])
        forms.append(len(given.base) + len(columns))
        columns += one.columns[one.levels :]
    p = given.make_problem(columns)
    fit = fit_amplitudes_and_noise(p, np.arange(len(p.sd)), terms[-1].noise)
    found = []
    for one, at in zip(terms, forms, strict=True):
        acts, variables = one.term.acts_on, given.dictionary.of[one.term.acts_on][1]
        sizes = fit.amplitude[at : at + len(one.tried.columns)]
        spread = float(np.std(sizes @ one.tried.calc_rows(variables.by_name)))
        level_at = levels.pop(acts, None) if one.levels else None
        level = (
            0.0
            if level_at is None
            else _find_term_level(fit, level_at, given.base, one.columns[0], spread)
        )
        term = _make_term(acts, one.tried, sizes, level, fit, at, variables)
        found.append(one._replace(term=term, field_percent=_calc_dose_rms(term, given.data)))
    return found


def _find_term_level(
    fit: Fit, at: int, base: Sequence[Column], own: Column, spread: float
) -> float:
    """Return the level of a quantity that accompanies a form, including the correlated share of the
    tolerances; 0 where the log does not support a level.

    A slow drift of this log is no property of the machine, and the change from a named effect
    belongs to that effect. No log can separate a form's mean from the offset of a nominal value
    within its tolerance, so their sum is reported. at : index in the fit. base : columns before the
    terms'. own : column of the level. spread : of the form over the log, s.d.
    """
    covariance = fit.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    if any(
        column.label.role is ColumnRole.SLOPE
        and abs(covariance[at, k]) > MAX_NAME_CORRELATION * sd[at] * sd[k]
        for k, column in enumerate(base)
    ):
        return 0.0
    # Share of a level in a unit of each column.
    share = np.zeros(len(sd))
    for k, column in enumerate(base):
        share[k] = (
            _calc_level_share(column, own) if column.label.role is ColumnRole.TOLERANCE else 0.0
        )
    # The tolerances' share of the level is subtracted.
    moved = sum(share[k] * column.mean for k, column in enumerate(base) if share[k] != 0.0)
    share[at] = 1.0
    value = float(share @ fit.amplitude) - moved
    variance = float(share @ covariance @ share)
    return (
        value
        if abs(value) > max(MIN_LEVEL_SD * np.sqrt(max(variance, 0.0)), MIN_LEVEL_SHARE * spread)
        else 0.0
    )


def _calc_level_share(one: Column, level: Column) -> float:
    """Return the share of a level in a unit of a column; 0 where the column is unrelated."""
    name = next(iter(level.coefficients))
    if name not in one.coefficients:
        return 0.0
    a, b = one.coefficients[name], level.coefficients[name]
    along, size = float(a @ b), float(b @ b)
    return (
        along / max(size, 1e-300)
        if abs(along) > MIN_LEVEL_COSINE * np.sqrt(float(a @ a) * size)
        else 0.0
    )


def _make_term(
    acts: TermTarget,
    form: TriedForm,
    sizes: Array,
    level: float,
    fit: Fit,
    at: int,
    variables: FormVariables,
) -> Term:
    """Build the term of a form from its amplitudes, which begin at index `at` of a fit, and its
    level."""
    written = form.write_form(sizes.tolist(), level, variables.by_name)
    intervals: tuple[Interval, ...] = ()
    if form.kind.main and len(sizes) == 1:
        middle = written.coefficients[form.kind.main]
        half = (
            abs(middle)
            * TWO_SIDED_90_QUANTILE
            * float(np.sqrt(max(fit.covariance[at, at], 0.0)) / max(abs(sizes[0]), 1e-300))
        )
        intervals = (Interval(form.kind.main, middle - half, middle + half),)
    over = [{"name": name, "valid": variables.by_name[name].valid_range} for name in form.over]
    return Term.model_validate(
        {
            "id": _make_term_id(f"{TARGET_STAGES[acts]}.{written.form}_{'_'.join(form.over)}"),
            "acts_on": acts,
            "form": written.form,
            "over": over,
            "intervals": intervals,
            "nodes": written.nodes,
            "values": written.values,
            "coefficients": {name: float(value) for name, value in written.coefficients.items()},
        }
    )


def _make_term_id(words: str) -> str:
    """Return the id of a term in ASCII: column names may be in any script, ids may not."""
    return re.sub(r"[^a-z0-9_.]+", "", words.lower())[:MAX_ID_LETTERS]


def calc_term_series(term: Term, data: RunData) -> Array:
    """Return the values of a term at the log's rows (rows,)."""
    found = sum_over_log([term], data.inputs, data.row_s, run_term)
    return found.get(term.acts_on.value, np.zeros(len(data.row_s)))


def _calc_dose_rms(term: Term, data: RunData) -> float:
    """Return the r.m.s. of a term over the working rows minus its mean, in per cent of the dose; an
    error of the scale does not change the dose."""
    working = np.interp(data.row_s, data.time_s, data.working) > 0.5
    if term.stage == "scale" or not working.any():
        return 0.0
    wrong = calc_term_series(term, data)[working]
    if TARGET_UNITS[term.acts_on] != "%":
        scale = data.inputs["opening_mm" if term.stage == "gate" else "shaft_rpm"][working]
        wrong = 100.0 * wrong / np.maximum(1.0, scale)
    return float(np.std(wrong))


def _calc_held_out_gain(given: TermContext, one: FittedTerm) -> float:
    """Return the share of the held-out mean square error that a term explains, with its amplitudes
    fitted to the other blocks."""
    name = CHANNEL_OF[one.term.acts_on]
    channel = given.search.model.find_channel(name)
    blocks, before = (
        hold_out_blocks(channel),
        given.search.model.calc_residual(given.now.parts)[name],
    )
    every = [
        (c, make_series(c.coefficients[name], channel.cut))
        for c in (*given.base, *one.columns)
        if name in c.coefficients
    ]
    left = []
    for columns in (every[: len(every) - len(one.columns)], every):
        sizes = fit_amplitudes(blocks, columns, before, one.noise)
        left.append(
            before - sum(size * series for size, (_, series) in zip(sizes, columns, strict=True))
        )
    _, _, plain, better = list_held_out_errors(blocks, *left)
    return (
        float(1.0 - np.sum(better**2) / max(float(np.sum(plain**2)), 1e-300)) if len(plain) else 0.0
    )


# The following functions prepare pictures: a term's curve along each variable, and the data's own
# means.


def average_marginal(term: Term, variable: str, data: RunData) -> tuple[EightValues, EightValues]:
    """Return eight values of one of a term's variables, and the term's mean at each value in the
    log."""
    values = data.inputs[name_own_command(term.stage, variable)]
    low, high = (float(v) for v in np.percentile(values, (1.0, 99.0)))
    nodes = np.linspace(low, high, NODE_COUNT)
    nearest = np.clip(
        np.round((values - low) / max(high - low, 1e-12) * (NODE_COUNT - 1)), 0, NODE_COUNT - 1
    ).astype(int)
    series = calc_term_series(term, data)
    count = np.bincount(nearest, minlength=NODE_COUNT)
    mean = np.bincount(nearest, weights=series, minlength=NODE_COUNT) / np.maximum(1, count)
    known = count > 0
    found = np.interp(nodes, nodes[known], mean[known])
    return _pack_eight(nodes), _pack_eight(found)


def _pack_eight(numbers: Array) -> EightValues:
    a, b, c, d, e, f, g, h = (float(one) for one in numbers)
    return a, b, c, d, e, f, g, h


def average_along(
    search: Search, now: FittedHypothesis, found: FittedTerm, data: RunData
) -> tuple[tuple[float, float, float], ...]:
    """Return, for classes of the term's first variable (for a product: of the term's value):
    position, mean of the data, mean of the term.

    The mean of the data is the channel's residual after the fit of the hypothesis, in the unit of
    the term's quantity, by least squares of a constant for each class.
    """
    acted = TargetResponse(search.model, now.parts, found.term.acts_on)
    channel = acted.channel
    values = calc_term_series(found.term, data)
    along = (
        values
        if len(found.tried.over) > 1
        else data.inputs[name_own_command(found.stage, found.tried.over[0])]
    )
    edges = np.unique(np.percentile(along, np.linspace(0.0, 100.0, CLASS_COUNT + 1)))
    if len(edges) < 3:
        return ()
    place = np.clip(np.searchsorted(edges, along, side="right") - 1, 0, len(edges) - 2)
    inside = np.array([place == k for k in range(len(edges) - 1)], dtype=np.float64)
    columns = acted.calc_response(inside)
    white = 1.0 / max(1e-12, found.noise[channel.name].fast_sd)
    left = search.model.calc_residual(now.parts)[channel.name]
    # The scale accumulates, so its differences show the flow.
    if channel.name == "scale":
        columns, left = np.diff(columns, axis=1), np.diff(left)
    normal = columns @ columns.T * white**2 + 1e-9 * np.eye(len(columns))
    mean = np.linalg.solve(normal, columns @ left * white**2)
    count = np.maximum(1.0, inside.sum(axis=1))
    said = inside @ values / count
    return tuple(zip((inside @ along / count).tolist(), mean.tolist(), said.tolist(), strict=True))
