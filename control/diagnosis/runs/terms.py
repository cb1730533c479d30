"""Terms that a log shows beyond the catalogue: which quantity, which variables, which form.

Forward selection over a dictionary of forms [1]_. Each is held against the residual whitened by
its channel's noise; the best have their shapes settled and are refitted with the noise. A term
is said where it is likelier than nothing in its place, by the score that effects have.

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
    Z90,
    Column,
    Fit,
    Label,
    Problem,
    Role,
    choose_better_fit,
    find_residual_power,
    fit_amplitudes_and_noise,
    limit_slow_noise,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.line_search import climb_to_best
from topdress.control.diagnosis.judgement.noise import Noise, coefficients, make_series_of
from topdress.control.machine.compiled import run_term
from topdress.control.machine.form import TriedForm
from topdress.control.machine.forms import SPAN_PLACES, LostConstantForm, PeriodicForm, SpanForm
from topdress.control.machine.term_sums import sum_over_log
from topdress.control.machine.terms import (
    TARGET_STAGES,
    TARGET_UNITS,
    Interval,
    Term,
    TermTarget,
    name_own_command,
)

from .dictionary import CHANNEL_OF, ActedOn, Dictionary, FormCandidate, Variables, scan_dictionary
from .held_out import fit_amplitudes, hold_out_blocks, list_held_out_errors
from .hypothesis import EffectInstance
from .search import FittedHypothesis, Search
from .stages import RunData
from .whitened import WhitenedResidual, find_even_gain

Array = npt.NDArray[np.float64]
Eight = tuple[float, float, float, float, float, float, float, float]

MAX_TERMS = 2  # of one group of channels
# What a scan hands on to be refitted; gains are of twice the log-likelihood, what ranks forms
# taken off.
MIN_SCORE = 6.0  # of what is refitted
VERIFIED = 4  # best of a scan, their noise refitted too ...
# ... and best forms over a term's variable under the noise that it leaves
FORMS_AGAIN = 3
# of the steps by which a shape is settled: the last two where a form leaps
FINENESS = (1.0, 0.5, 0.25, 0.12, 0.06)
STILL = 0.01  # of the fast noise: a drift that is none
# of a variable's spread, between two ends: nearer ones are one
NARROWEST = 1e-3
# letters; where another of the same name was adopted, it is given a number
LONGEST_ID = 76
# What of a level is the machine's.
# s.d. of a level, that it must differ from nothing by ...
LEVEL_SD = 2.0
# ... and so much of what its form does: no form is quite right
LEVEL_SHARE = 0.05
# correlation with a name's size, above which a level is the name's
A_NAME = 0.97
# cosine of what a tolerance does and a level, above which the one gives the other
A_LEVEL = 0.7
# As it is shown.
CLASSES = 12  # of a variable, for means
NODES = 8


class FittedTerm(NamedTuple):
    """A term that a log shows."""

    term: Term
    tried: TriedForm
    gain: float  # of twice the log-likelihood, its noise refitted
    worth: float  # log posterior odds against nothing in its place
    columns: tuple[Column, ...]  # level (where it is open) and form
    explained_share: float  # of what is left, as variance
    field_percent: float  # of the dose, r.m.s. over the working rows
    noise: dict[str, Noise]  # with it
    log_evidence: float  # with it and those before
    log_prior: float  # odds of it
    # share of the held-out mean square error that it takes away
    held_out: float = 0.0

    @property
    def stage(self) -> str:
        return self.term.stage

    @property
    def levels(self) -> int:
        """How many of its columns are its level: none or one."""
        return len(self.columns) - len(self.tried.columns)


class TriedOn:
    """What a term is tried on top of: a hypothesis, and the terms before. base : columns of all
    that; noise : under it."""

    def __init__(
        self,
        search: Search,
        dictionary: Dictionary,
        now: FittedHypothesis,
        terms: Sequence[FittedTerm] = (),
    ) -> None:
        self.search, self.dictionary, self.now = search, dictionary, now
        self.channels, self.data = search.model.channels, search.model.data
        self.held = [column for one in terms for column in one.columns]
        self.base = [*search.columns.of_hypothesis(now.parts), *self.held]
        self.noise = terms[-1].noise if terms else now.noise
        self.calm = limit_slow_noise(self.noise, self.channels)
        self._banded = search.model.banded_residual(now.parts)

    def whitened(self, noise: dict[str, Noise]) -> WhitenedResidual:
        return WhitenedResidual(self.channels, self._banded, self.base, noise)

    def problem(self, columns: Sequence[Column]) -> Problem:
        """Further columns behind those of the base."""
        self.search.model.ask()
        return make_evidence_problem(self.channels, self._banded, [*self.base, *columns])


def find_terms(
    search: Search,
    dictionary: Dictionary,
    now: FittedHypothesis,
    not_over: frozenset[str] = frozenset(),
) -> list[FittedTerm]:
    """Terms on top of a hypothesis, the strongest first, each likelier with than without it.
    not_over : variables that no term is over alone."""
    terms: list[FittedTerm] = []
    for _ in range(MAX_TERMS):
        best = _find_best_term(TriedOn(search, dictionary, now, terms), not_over)
        if best is None:
            break
        terms.append(best)
    return _refit_jointly(TriedOn(search, dictionary, now), terms) if len(terms) > 1 else terms


def find_best_span(
    search: Search, dictionary: Dictionary, now: FittedHypothesis, part: EffectInstance
) -> FittedTerm | None:
    """The best constant that is there as long as a part, of any quantity, on top of a
    hypothesis: something unknown in the part's place. None where no quantity is looked at over
    time."""
    given = TriedOn(search, dictionary, now)
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
                SPAN_PLACES**2,
            )
            found.append(_verify_term(given, FormCandidate(acts, span), given.noise))
    return max(found, key=lambda one: one.worth, default=None)


def _find_best_term(given: TriedOn, not_over: frozenset[str]) -> FittedTerm | None:
    """The likeliest term; None where it is likelier without."""
    verified = [
        _verify_term(given, candidate, given.noise)
        for candidate in _list_form_candidates(given)
        if not set(candidate.tried.over) <= not_over or candidate.tried.kind is LostConstantForm
    ]
    best = max(verified, key=lambda one: one.worth, default=None)
    if best is None or best.worth <= prior.SAID:
        return None
    best = _choose_form_again(given, best)
    return best._replace(held_out=_held_out_gain(given, best))


def _choose_form_again(given: TriedOn, one: FittedTerm) -> FittedTerm:
    """The best form over the same variable under the noise that a term leaves: without it drift
    stood for a part of what it does, and bent the choice."""
    if len(one.tried.over) > 1 or one.tried.kind in (SpanForm, PeriodicForm, LostConstantForm):
        return one
    acts = one.term.acts_on
    residual = given.whitened(one.noise)
    entries = [
        entry.only([form.kind is kind for form in entry.forms])
        for entry in given.dictionary.entries(acts)
        if entry.forms[0].over == one.tried.over
        for kind in dict.fromkeys(form.kind for form in entry.forms)
    ]
    ranked = sorted(
        scan_dictionary(residual, given.dictionary.of[acts][0], entries), key=lambda c: -c.score
    )[:FORMS_AGAIN]
    return max(
        [one, *(_verify_term(given, candidate, one.noise) for candidate in ranked)],
        key=lambda found: found.worth,
    )


def _list_form_candidates(given: TriedOn) -> list[FormCandidate]:
    """The best under the noise that the hypothesis leaves, which may hide a slow form, and
    under a calm one, under which drift looks like one: of each quantity and variables one form
    under each. Where something comes and goes is seen only in noise without its slow part: its
    edges are half a class off."""
    chosen: dict[tuple[TermTarget, tuple[str, ...], str, int], FormCandidate] = {}
    temporary = given.dictionary.scanned(
        given.whitened(_drop_slow_noise(given.noise)), temporary=True
    )
    for noise in (given.noise,) if given.calm == given.noise else (given.noise, given.calm):
        lasting = given.dictionary.scanned(given.whitened(noise), temporary=False)
        found = sorted([*lasting, *temporary], key=lambda c: -c.score)
        plain = [one for one in found if len(one.tried.over) == 1 and not one.tried.kind.one_run]
        leaps = [one for one in plain if one.tried.kind.leaps]
        # a strong form of one leads in many products
        for one in (*found[:VERIFIED], *plain[:1], *leaps[:1]):
            if one.score > MIN_SCORE:
                chosen.setdefault(
                    (one.acts, one.tried.over, one.tried.kind.form, len(one.tried.columns)), one
                )
    return list(chosen.values())


def _drop_slow_noise(noise: dict[str, Noise]) -> dict[str, Noise]:
    """The noise without its slow part."""
    return {
        name: Noise((*one.theta[:2], float(np.log(STILL * one.fast_sd)), one.theta[3]))
        for name, one in noise.items()
    }


def _settle_form_shape(given: TriedOn, one: FormCandidate, noise: dict[str, Noise]) -> TriedForm:
    """The shape moved in ever smaller steps to where the form gains most under a noise."""
    form, (acted, variables) = one.tried, given.dictionary.of[one.acts]
    kind, x = form.kind, variables.by_name[form.over[0]]
    if not kind.movable:
        return form
    residual = given.whitened(noise)
    constant = acted.constant[: variables.has_level(form)]

    def gain(form: TriedForm) -> float:
        series = np.concatenate((acted.of(form.calc_rows(variables.by_name)), constant))
        return residual.beyond(
            acted.channel, coefficients(series, acted.channel.cut)
        ).calc_gain_of_mixes(np.eye(len(series)))

    def near(form: TriedForm, fineness: float) -> Iterator[TriedForm]:
        for name in kind.movable:
            for way in (-fineness, fineness):
                shape = {**form.shape, name: kind.step_shape(form.shape, name, way, x)}
                if shape.get("high_end", np.inf) - shape.get("low_end", -np.inf) >= NARROWEST:
                    yield form.change_shape(shape, variables.by_name)

    steps = np.repeat(FINENESS if kind.leaps else FINENESS[:3], len(kind.movable)).tolist()
    return climb_to_best(form, gain, near, steps, again=False)


def _verify_term(given: TriedOn, one: FormCandidate, noise: dict[str, Noise]) -> FittedTerm:
    """A candidate with its shape settled, refitted with the noise. noise : where the fits start."""
    base, (acted, variables) = len(given.base), given.dictionary.of[one.acts]
    quiet = (
        _drop_slow_noise(noise) if one.tried.kind.leaps else limit_slow_noise(noise, given.channels)
    )
    form = _settle_form_shape(given, one, quiet)
    name, cut = acted.channel.name, acted.channel.cut
    rows = form.calc_rows(variables.by_name)
    series = np.concatenate((acted.constant[: variables.has_level(form)], acted.of(rows)))
    levels, usual = len(series) - len(rows), prior.USUAL_OF_TERM[one.acts]
    columns = tuple(
        Column(Label(Role.FORM, "term"), {name: coefficients(row, cut)}, usual) for row in series
    )
    p = given.problem(columns)
    plain, full, log_weight = _fit_with_and_without(given, p, base + levels, noise, usual)
    sizes = full.amplitude[base + levels :]
    own, whole = (
        coefficients(sizes @ series[levels:], cut),
        coefficients(full.amplitude[base:] @ series, cut),
    )
    gain = full.log_likelihood - plain.log_likelihood
    integrated = (
        full.log_evidence - full.log_likelihood - (plain.log_evidence - plain.log_likelihood)
    )
    trace = Column(Label(Role.TRACE), {name: whole}, np.inf)
    even = min(gain, find_even_gain(given.search, given.now.parts, full.noise, trace, given.held))
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
        _field_percent(term, given.data),
        full.noise,
        full.log_evidence,
        log_prior,
    )


def _fit_with_and_without(
    given: TriedOn, p: Problem, count: int, noise: dict[str, Noise], usual: float
) -> tuple[Fit, Fit, float]:
    """The best fits without a form and with it, and the log weight of the prior of its sizes.
    count : columns before it."""
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
    again = fit_amplitudes_and_noise(p, before, full.noise)  # a better noise is no gain of the form
    return max(plain, again, key=lambda fit: fit.log_likelihood), full, weight


def _calc_log_prior(quantities: int, form: TriedForm, variables: Variables) -> float:
    """Log prior odds of a form."""
    count = len(variables.one) if len(form.over) == 1 else len(variables.pairs())
    return prior.log_odds_of_form(quantities, count, form.places, form.kind.one_run)


def _refit_jointly(given: TriedOn, terms: Sequence[FittedTerm]) -> list[FittedTerm]:
    """The same terms with the sizes that they have together: the first was fitted before the
    others came."""
    columns: list[Column] = []
    # a quantity has one level, whatever terms act on it
    levels: dict[TermTarget, int] = {}
    forms: list[int] = []
    for one in terms:
        if one.levels and one.term.acts_on not in levels:
            levels[one.term.acts_on] = len(given.base) + len(columns)
            columns.append(one.columns[0])
        forms.append(len(given.base) + len(columns))
        columns += one.columns[one.levels :]
    p = given.problem(columns)
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
        found.append(one._replace(term=term, field_percent=_field_percent(term, given.data)))
    return found


def _find_term_level(
    fit: Fit, at: int, base: Sequence[Column], own: Column, spread: float
) -> float:
    """The level that a quantity has along with a form, what the tolerances give of it with it;
    0 where the log does not hold it: a slow drift of this log is no trait of the machine, and
    what a name of the hypothesis does is the name's.

    What is the form's mean and what a nominal value that is off within its tolerance no log
    tells; their sum is reported, and is what the machine does. at : its place in the fit. base
    : columns before the terms'. own : the level's. spread : of the form over the log, s.d.
    """
    covariance = fit.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    if any(
        column.label.role is Role.SLOPE and abs(covariance[at, k]) > A_NAME * sd[at] * sd[k]
        for k, column in enumerate(base)
    ):
        return 0.0
    share = np.zeros(len(sd))  # so much of a level a unit of each column is
    for k, column in enumerate(base):
        share[k] = _share_of_level(column, own) if column.label.role is Role.TOLERANCE else 0.0
    # by so much less
    moved = sum(share[k] * column.mean for k, column in enumerate(base) if share[k] != 0.0)
    share[at] = 1.0
    value = float(share @ fit.amplitude) - moved
    variance = float(share @ covariance @ share)
    return (
        value
        if abs(value) > max(LEVEL_SD * np.sqrt(max(variance, 0.0)), LEVEL_SHARE * spread)
        else 0.0
    )


def _share_of_level(one: Column, level: Column) -> float:
    """So much of a level a unit of a column is; 0 where it is something else."""
    name = next(iter(level.coefficients))
    if name not in one.coefficients:
        return 0.0
    a, b = one.coefficients[name], level.coefficients[name]
    along, size = float(a @ b), float(b @ b)
    return along / max(size, 1e-300) if abs(along) > A_LEVEL * np.sqrt(float(a @ a) * size) else 0.0


def _make_term(
    acts: TermTarget,
    form: TriedForm,
    sizes: Array,
    level: float,
    fit: Fit,
    at: int,
    variables: Variables,
) -> Term:
    """The term of a form's amplitudes, which a fit has from place `at` on, and its level."""
    written = form.write_form(sizes.tolist(), level, variables.by_name)
    intervals: tuple[Interval, ...] = ()
    if form.kind.main and len(sizes) == 1:
        middle = written.coefficients[form.kind.main]
        half = (
            abs(middle)
            * Z90
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
    """Of a term: names of columns may be in any writing, ids are not."""
    return re.sub(r"[^a-z0-9_.]+", "", words.lower())[:LONGEST_ID]


def series_of_term(term: Term, data: RunData) -> Array:
    """Value of a term at the log's rows (rows,)."""
    found = sum_over_log([term], data.inputs, data.row_s, run_term)
    return found.get(term.acts_on.value, np.zeros(len(data.row_s)))


def _field_percent(term: Term, data: RunData) -> float:
    """R.m.s. of a term over the working rows, less its mean, as per cent of the dose; a scale's
    error moves no dose."""
    working = np.interp(data.row_s, data.time_s, data.working) > 0.5
    if term.stage == "scale" or not working.any():
        return 0.0
    wrong = series_of_term(term, data)[working]
    if TARGET_UNITS[term.acts_on] != "%":
        scale = data.inputs["opening_mm" if term.stage == "gate" else "shaft_rpm"][working]
        wrong = 100.0 * wrong / np.maximum(1.0, scale)
    return float(np.std(wrong))


def _held_out_gain(given: TriedOn, one: FittedTerm) -> float:
    """Share of the held-out mean square error that a term takes away, its amplitudes fitted to
    the other blocks."""
    name = CHANNEL_OF[one.term.acts_on]
    channel = given.search.model.channel(name)
    blocks, before = hold_out_blocks(channel), given.search.model.residual(given.now.parts)[name]
    every = [
        (c, make_series_of(c.coefficients[name], channel.cut))
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


# -- as it is shown: how it runs along each of its variables, and what the data themselves say
# there -------------------


def average_marginal(term: Term, variable: str, data: RunData) -> tuple[Eight, Eight]:
    """Eight places along one of a term's variables and its mean there in the log."""
    values = data.inputs[name_own_command(term.stage, variable)]
    low, high = (float(v) for v in np.percentile(values, (1.0, 99.0)))
    nodes = np.linspace(low, high, NODES)
    nearest = np.clip(
        np.round((values - low) / max(high - low, 1e-12) * (NODES - 1)), 0, NODES - 1
    ).astype(int)
    series = series_of_term(term, data)
    count = np.bincount(nearest, minlength=NODES)
    mean = np.bincount(nearest, weights=series, minlength=NODES) / np.maximum(1, count)
    known = count > 0
    found = np.interp(nodes, nodes[known], mean[known])
    return _pack_eight(nodes), _pack_eight(found)


def _pack_eight(numbers: Array) -> Eight:
    a, b, c, d, e, f, g, h = (float(one) for one in numbers)
    return a, b, c, d, e, f, g, h


def average_along(
    search: Search, now: FittedHypothesis, found: FittedTerm, data: RunData
) -> tuple[tuple[float, float, float], ...]:
    """By classes of the term's first variable (of a product: of what the term says): place, the
    data's own mean, the term's mean.

    The data's mean is what the channel leaves once the hypothesis is fitted, in the unit of
    what the term acts on: least squares of one constant for each class.
    """
    acted = ActedOn(search.model, now.parts, found.term.acts_on)
    channel = acted.channel
    values = series_of_term(found.term, data)
    along = (
        values
        if len(found.tried.over) > 1
        else data.inputs[name_own_command(found.stage, found.tried.over[0])]
    )
    edges = np.unique(np.percentile(along, np.linspace(0.0, 100.0, CLASSES + 1)))
    if len(edges) < 3:
        return ()
    place = np.clip(np.searchsorted(edges, along, side="right") - 1, 0, len(edges) - 2)
    inside = np.array([place == k for k in range(len(edges) - 1)], dtype=np.float64)
    columns = acted.of(inside)
    white = 1.0 / max(1e-12, found.noise[channel.name].fast_sd)
    left = search.model.residual(now.parts)[channel.name]
    if channel.name == "scale":  # a level adds up: its changes say what flowed
        columns, left = np.diff(columns, axis=1), np.diff(left)
    normal = columns @ columns.T * white**2 + 1e-9 * np.eye(len(columns))
    mean = np.linalg.solve(normal, columns @ left * white**2)
    count = np.maximum(1.0, inside.sum(axis=1))
    said = inside @ values / count
    return tuple(zip((inside @ along / count).tolist(), mean.tolist(), said.tolist(), strict=True))
