"""Terms that a log shows beyond the catalogue: which stage, which variables, which form.

Forward selection over a dictionary of forms [1]_, each held against the residual whitened by its channel's noise. What
gains most beyond its price is refitted with the noise; it must show all over the log, must not be what the log's own
drift gives, and must make rows better that it was not fitted to.

References
----------
.. [1] Miller, Subset Selection in Regression, 2nd ed., 2002, ch. 3.
"""
from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.judgement import prior
from control.diagnosis.judgement.evidence import (
    Z90,
    Column,
    Fit,
    Label,
    Role,
    best_fitted,
    calm,
    fitted,
    power_left,
)
from control.diagnosis.judgement.noise import Noise, coefficients, series_of
from control.machine.compiled import term_run
from control.machine.machine import Machine, of_nominal
from control.machine.term_sums import over_log
from control.machine.terms import SHAFT_ANGLE, STAGE_OF, UNIT_OF, Acts, Form, Interval, Term, own_command

from . import term_forms
from .channels import ChannelSeries
from .coarsening import even_gain
from .held_out import amplitudes, errors_of, held_out
from .hypothesis import EffectInstance
from .search import FittedHypothesis, Search
from .smooth import DOWNSTREAM, MIN_RANGE, RANGES
from .stages import RunData
from .term_columns import CHANNEL_OF, ActedOn, tried
from .term_forms import Scaled, Tried
from .term_residual import WhitenedResidual, gain_of, gains_of_single, without

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.bool_]

# Gains are of twice the log-likelihood, prices of forms taken off (`term_forms`).
MIN_SCORE = 6.0             # of a scan, for a refit
MAX_TERMS = 2               # of one group of channels
VERIFIED = 4                # best of a scan that are refitted, their noise too ...
FORMS_AGAIN = 3             # ... and best forms over a term's variable under the noise that it leaves
FINENESS = (1.0, 0.5, 0.25)     # of the steps by which shape parameters are settled
FINER = (*FINENESS, 0.12, 0.06)     # of a box's edges
LONGEST_ID = 76             # letters; where another of the same name was adopted, it is given a number
LEVEL_SD = 2.0              # s.d. of a level, that it must differ from nothing by ...
LEVEL_SHARE = 0.05          # ... and so much of what its form does
A_NAME = 0.97               # correlation with a name's size, above which a level is the name's
A_LEVEL = 0.7               # cosine of what a tolerance does and a level, above which the one gives the other
OF_JUMPS = (Form.THRESHOLD, Form.SPAN)
OF_MOVES = (Form.MEMORY, Form.SIDE)     # forms that tell how something has been moving
STILL = 0.01                # of the fast noise: a drift that is none
EXTRA_SPREAD = 1e-12
NARROWEST = 1e-3            # of a variable's spread, between two ends: nearer ones are one
# The wheel is held against the GNSS speed, whose own noise is a dependence on it; in a product with another variable
# that noise adds up to nothing.
NEVER_ALONE = {"speed": frozenset({"speed_mps"})}
TURNS_SHARE = 1e-3          # of the fastest command: below, the shaft is commanded to stand
SLOWER_THAN_HZ = 2.5        # forms are chosen by what is slower: the variables are means over a second and a half


class FittedTerm(NamedTuple):
    """A term that a log shows."""

    term: Term
    tried: Tried
    gain: float                         # of twice the log-likelihood, its noise refitted
    worth: float                        # log posterior odds against nothing in its place
    columns: tuple[Column, ...]         # level (where it is open) and form
    trace: Column                       # what the whole term does to its channel
    explained_share: float              # of what is left, as variance
    field_percent: float                # of the dose, r.m.s. over the working rows
    noise: dict[str, Noise]             # with it
    log_evidence: float                 # with it and those before
    log_prior: float                    # odds of it
    held_out: float = 0.0               # share of the held-out mean square error that it takes away
    tolerance: float = 0.0              # s.d. of what the tolerances may give of its level

    @property
    def stage(self) -> str:
        return self.term.stage


class _Candidate(NamedTuple):
    acts: Acts
    tried: Tried
    gain: float
    score: float                        # gain less price


class _Variables(NamedTuple):
    """What the forms of one quantity may be over."""

    by_name: dict[str, Scaled]
    one: tuple[str, ...]
    two: tuple[str, ...]
    work: Rows
    never_alone: tuple[str, ...] = ()               # in products with those of `two` only


class _Entry(NamedTuple):
    """Forms over one variable, or over two, of one quantity."""

    forms: tuple[Tried, ...]
    kept: npt.NDArray[np.float32]       # cosine coefficients of their series, the slowest (k, kept)
    level: bool                         # whether the last series is a level


class Dictionary:
    """Everything that is tried on a group of channels, made once: it does not depend on the hypothesis."""

    def __init__(self, search: Search) -> None:
        model = search.model
        self.of = {acts: (ActedOn(model, (), acts), _variables(model.data, model.machine, acts))
                   for acts in tried(model)}
        self._made: dict[Acts, list[_Entry]] = {}
        self._data = model.data

    def entries(self, acts: Acts) -> list[_Entry]:
        if acts not in self._made:
            self._made[acts] = list(_entries(*self.of[acts], self._data))
        return self._made[acts]


def found_terms(search: Search, dictionary: Dictionary, now: FittedHypothesis,
                not_over: frozenset[str] = frozenset()) -> list[FittedTerm]:
    """Terms on top of a hypothesis, the strongest first, each likelier with than without it. not_over : variables that
    no term is over alone."""
    terms: list[FittedTerm] = []
    for _ in range(MAX_TERMS):
        best = _best(search, dictionary, now, terms, not_over)
        if best is None:
            break
        terms.append(best)
    return refit_jointly(search, dictionary, now, terms) if len(terms) > 1 else terms


def best_span(search: Search, dictionary: Dictionary, now: FittedHypothesis, part: EffectInstance) -> FittedTerm | None:
    """The best constant that is there as long as a part, of any quantity, on top of a hypothesis: something unknown in
    the part's place. None where no quantity is looked at over time."""
    base = search.columns.of_hypothesis(now.parts)
    shape_params = {"low_end": part.onset_s or 0.0, "high_end": part.until_s or np.inf}
    span = Tried(Form.SPAN, ("time_s",), shape_params, np.ones((1, 1)), term_forms.SPAN_PLACES ** 2)
    found = [_verified(search, now, base, 0, now.noise, _Candidate(acts, span, 0.0, 0.0), acted, variables)
             for acts, (acted, variables) in dictionary.of.items() if "time_s" in variables.one]
    best = max(found, key=lambda one: one.worth, default=None)
    return best and best._replace(field_percent=_field_percent(best.term, search.model.data))


def refit_jointly(search: Search, dictionary: Dictionary, now: FittedHypothesis,
                  terms: Sequence[FittedTerm]) -> list[FittedTerm]:
    """The same terms with the sizes that they have together: the first was fitted before the others came."""
    names = search.columns.of_hypothesis(now.parts)
    columns: list[Column] = []
    levels: dict[Acts, int] = {}        # a quantity has one level, whatever terms act on it
    forms: list[int] = []
    for one in terms:
        count = levels_of(one)
        if count and one.term.acts_on not in levels:
            levels[one.term.acts_on] = len(names) + len(columns)
            columns.append(one.columns[0])
        forms.append(len(names) + len(columns))
        columns += one.columns[count:]
    p, before = search.columns.compressed(now.parts, columns)
    fit = fitted(p, np.arange(before + len(columns)), terms[-1].noise)
    found = []
    for one, at in zip(terms, forms, strict=True):
        acts = one.term.acts_on
        level_at = levels.pop(acts, None) if levels_of(one) else None
        sizes, variables = fit.amplitude[at:at + len(one.columns) - levels_of(one)], dictionary.of[acts][1]
        spread = float(np.std(sizes @ _form_series(one.tried, variables, search.model.data)))
        level = NO_LEVEL if level_at is None else _level(fit, level_at, names, one.columns[0], spread)
        term = _term(acts, one.tried, sizes, level.value, fit, at, variables, search.model.data)
        found.append(one._replace(term=term, field_percent=_field_percent(term, search.model.data)))
    return found


def levels_of(one: FittedTerm) -> int:
    """How many of a term's columns are its level: none or one."""
    return int(len(one.columns) > one.tried.mix.shape[1])


def _best(search: Search, dictionary: Dictionary, now: FittedHypothesis, terms: Sequence[FittedTerm],
          not_over: frozenset[str]) -> FittedTerm | None:
    """The likeliest term on top of a hypothesis and other terms; None where it is likelier without."""
    noise = terms[-1].noise if terms else now.noise
    held = [column for one in terms for column in one.columns]
    base = [*search.columns.of_hypothesis(now.parts), *held]
    verified = [_verified(search, now, base, len(held), noise, candidate, *dictionary.of[candidate.acts])
                for candidate in _candidates(search, dictionary, now, base, noise)
                if not set(candidate.tried.over) <= not_over or "constant" in candidate.tried.shape_params]
    best = max(verified, key=lambda one: one.worth, default=None)
    if best is None or best.worth <= prior.SAID:
        return None
    best = _form_again(search, now, base, len(held), best, dictionary)
    return best._replace(field_percent=_field_percent(best.term, search.model.data),
                         held_out=held_out_gain(search, now, base, best))


def _form_again(search: Search, now: FittedHypothesis, base: Sequence[Column], held: int, one: FittedTerm,
                dictionary: Dictionary) -> FittedTerm:
    """The best form over the same variable under the noise that a term leaves: without it drift stood for a part of
    what it does, and bent the choice."""
    if len(one.tried.over) > 1 or one.tried.form in (Form.SPAN, Form.PERIODIC) or "constant" in one.tried.shape_params:
        return one
    acted, variables = dictionary.of[one.term.acts_on]
    ground = WhitenedResidual(search.columns, now.parts, base, one.noise)
    entries = [entry._replace(forms=tuple(form for form in entry.forms if form.form is kind))
               for entry in dictionary.entries(one.term.acts_on) if entry.forms[0].over == one.tried.over
               for kind in dict.fromkeys(form.form for form in entry.forms)]
    ranked = sorted(_scan(ground, acted, entries), key=lambda c: -c.score)[:FORMS_AGAIN]
    again = [_verified(search, now, base, held, one.noise, candidate, acted, variables) for candidate in ranked]
    return max([one, *again], key=lambda found: found.worth)


def _candidates(search: Search, dictionary: Dictionary, now: FittedHypothesis, base: Sequence[Column],
                noise: dict[str, Noise]) -> list[_Candidate]:
    """The best under the noise that the hypothesis leaves, which may hide a slow form, and under a calm one, under
    which drift looks like one: of each quantity and variables one form under each."""
    chosen: dict[tuple[Acts, tuple[str, ...], Form, int], _Candidate] = {}
    still = WhitenedResidual(search.columns, now.parts, base, _still(noise))
    temporary = _scanned(still, dictionary, of_temporary=True)
    for start in _starts(search, noise):
        ground = WhitenedResidual(search.columns, now.parts, base, start)
        found = sorted([*_scanned(ground, dictionary, of_temporary=False), *temporary], key=lambda c: -c.score)
        plain = [one for one in found if len(one.tried.over) == 1 and one.tried.form is not Form.SPAN]
        jumps = [one for one in plain if one.tried.form in OF_JUMPS]
        for one in (*found[:VERIFIED], *plain[:1], *jumps[:1]):     # a strong form of one leads in many products
            if one.score > MIN_SCORE:
                chosen.setdefault((one.acts, one.tried.over, one.tried.form, one.tried.mix.shape[1]), one)
    return list(chosen.values())


def _starts(search: Search, noise: dict[str, Noise]) -> list[dict[str, Noise]]:
    quiet = calm(noise, search.model.channels)
    return [noise] if quiet == noise else [noise, quiet]


def _still(noise: dict[str, Noise]) -> dict[str, Noise]:
    """The same with hardly a drift: only then is a temporary term seen whose edges are half a class off."""
    return {name: Noise((*one.theta[:2], float(np.log(STILL * one.fast_sd)), one.theta[3]))
            for name, one in noise.items()}


def _variables(data: RunData, machine: Machine, acts: Acts) -> _Variables:
    """Variables that move, by their names, and those that may be multiplied with each other."""
    stage = STAGE_OF[acts]
    inputs = dict(data.inputs)
    if "hopper_kg" in data.variables:           # as predicted: a reading's own noise must not come back
        inputs["hopper_kg"] = np.interp(data.row_s, data.time_s, data.variables["hopper_kg"])
    turning = inputs.get("shaft_rpm", np.ones(len(data.row_s))) > 1.0
    work = turning if stage in ("shaft", "flow") and turning.sum() > 0.1 * len(turning) else np.ones(len(turning), bool)
    found: dict[str, Scaled] = {}
    for name in _names(data, acts):
        values = inputs.get(own_command(stage, name))
        if values is None or not np.isfinite(values).all():
            continue
        one = term_forms.scaled(name, values, work)
        least = of_nominal(machine, RANGES.get(name, ())) * MIN_RANGE.get(name, EXTRA_SPREAD)
        if one.high - one.low >= least:
            found[name] = one
    never_alone = tuple(name for name in found if name in NEVER_ALONE.get(stage, ()))
    single = tuple(name for name in found if name not in never_alone
                   and (acts is not Acts.SHAFT_RPM or name == "time_s"))
    double = tuple(name for name in found if name not in ("time_s", "heading_deg", SHAFT_ANGLE, *never_alone))
    return _Variables(found, single, double if acts is not Acts.SHAFT_RPM else (), work, never_alone)


def _names(data: RunData, acts: Acts) -> list[str]:
    """What a quantity may depend on; of the shaft, temporary terms are looked for in r/min."""
    stage = STAGE_OF[acts]
    further = [name for name in data.variables if name not in MIN_RANGE]
    names = [name for name in (*MIN_RANGE, *further)
             if name not in DOWNSTREAM[stage] - NEVER_ALONE.get(stage, frozenset())]
    drive = {"shaft": data.shaft, "gate": data.gate}.get(stage)
    if acts is Acts.SHAFT_PERCENT or (drive is not None and drive.settled):     # on a bench, time and command are one
        names.remove("time_s")
    return [*names, SHAFT_ANGLE] if acts is Acts.SHAFT_PERCENT else names


def _bases(variables: _Variables, time_s: Array) -> Iterator[term_forms.Basis]:
    for name in variables.one:
        yield term_forms.over_one(variables.by_name[name], time_s, variables.work)
    if len(variables.two) > 1:
        yield term_forms.over_two([variables.by_name[name] for name in variables.two])
    if variables.two:
        for last in variables.never_alone:
            yield _with_one(variables, variables.two, last)


def _with_one(variables: _Variables, names: Sequence[str], last: str) -> term_forms.Basis:
    return term_forms.with_one([variables.by_name[name] for name in names], variables.by_name[last])


def _has_level(acts: Acts, form: Tried) -> bool:
    """Whether a form has a free level: it would take up what a variable does that is never alone."""
    never_alone = NEVER_ALONE.get(STAGE_OF[acts], frozenset())
    return "constant" not in form.shape_params and form.over != ("time_s",) and not never_alone & set(form.over)


def _entries(acted: ActedOn, variables: _Variables, data: RunData) -> Iterator[_Entry]:
    """The dictionary of one quantity."""
    ones, channel = acted.of(np.ones((1, len(data.row_s)))), acted.channel
    if acted.acts is Acts.SHAFT_RPM:            # a constant number of r/min lost of every command
        form = Tried(Form.SATURATION, ("shaft_rpm",), {"constant": 1.0}, np.ones((1, 1)), 1)
        yield _Entry((form,), _kept(ones, channel, 1.0), False)
    share = min(1.0, 2.0 * SLOWER_THAN_HZ * channel.grid.step_s)
    for basis in _bases(variables, data.row_s):
        over = basis.forms[0].over
        if _moves_unseen(acted.acts, over, data):
            basis = basis._replace(forms=tuple(form for form in basis.forms if form.form not in OF_MOVES))
        level = _has_level(acted.acts, basis.forms[0])
        series = np.concatenate((acted.of(basis.series), ones)) if level else acted.of(basis.series)
        yield _Entry(basis.forms, _kept(series, channel, 1.0 if SHAFT_ANGLE in over else share), level)


def _moves_unseen(acts: Acts, over: tuple[str, ...], data: RunData) -> bool:
    """Whether forms over a drive's own command would tell how it moves, of a log that does not hold all commands."""
    drive = {"shaft": data.shaft, "gate": data.gate}.get(STAGE_OF[acts])
    own = {"shaft": "shaft_rpm", "gate": "opening_mm"}.get(STAGE_OF[acts])
    return drive is not None and not drive.moves_seen and own in over


def _kept(series: Array, channel: ChannelSeries, share: float) -> npt.NDArray[np.float32]:
    """Cosine coefficients of series (k, m), the slowest share of them."""
    every = coefficients(series.astype(np.float32), channel.cut)
    return np.ascontiguousarray(every[:, :max(64, int(share * every.shape[1]))], dtype=np.float32)


def _scanned(ground: WhitenedResidual, dictionary: Dictionary, of_temporary: bool) -> list[_Candidate]:
    """The whole dictionary under a given noise: its temporary terms, or all else."""
    return [one for acts, (acted, _) in dictionary.of.items() for one in _scan(ground, acted, [
        entry for entry in dictionary.entries(acts) if (entry.forms[0].form is Form.SPAN) == of_temporary])]


def _scan(ground: WhitenedResidual, acted: ActedOn, entries: Sequence[_Entry]) -> list[_Candidate]:
    """The best form over each variable, or two, under a given noise."""
    found: list[_Candidate] = []
    for entry in entries:
        normal, right = ground.kept_products(acted.channel, entry.kept)
        if entry.level:
            normal, right = without(normal, right, len(right) - 1)
            normal, right = normal[:-1, :-1], right[:-1]
        by_over: dict[tuple[str, ...], list[_Candidate]] = {}
        single = [form for form in entry.forms if form.mix.shape[1] == 1]
        gains = dict(zip(map(id, single), gains_of_single(normal, right, np.hstack([form.mix for form in single])),
                         strict=True)) if single else {}
        for form in entry.forms:
            gain = float(gains[id(form)]) if id(form) in gains else gain_of(normal, right, form.mix)[0]
            by_over.setdefault(form.over, []).append(_Candidate(acted.acts, form, gain, gain - form.price))
        for several in by_over.values():        # an edge that is a little off hides how good a jump is
            found += [max(those, key=lambda one: one.score) for jumps in (False, True)
                      if (those := [one for one in several if (one.tried.form in OF_JUMPS) is jumps])]
    return found


def _form_series(one: Tried, variables: _Variables, data: RunData) -> Array:
    """A form's columns over the rows: (amplitudes, rows)."""
    if "constant" in one.shape_params:
        return np.ones((1, len(data.row_s)))
    if one.form in (Form.HINGE, Form.THRESHOLD, Form.SATURATION, Form.DEAD_ZONE, Form.MEMORY, Form.SIDE, Form.SPAN):
        return term_forms.columns_at(one, variables.by_name, data.row_s)
    if one.form is not Form.PRODUCT:
        basis = term_forms.over_one(variables.by_name[one.over[0]], data.row_s, variables.work)
    elif one.over[1] in variables.never_alone:
        basis = _with_one(variables, one.over[:1], one.over[1])
    else:
        basis = term_forms.over_two([variables.by_name[name] for name in one.over])
    for form in basis.forms:
        if form.form is one.form and form.shape_params == one.shape_params:
            return np.asarray(form.mix.T @ basis.series)
    raise ValueError(f"form {one.form.value} is not among those tried")


def _settled(ground: WhitenedResidual, one: Tried, acted: ActedOn, variables: _Variables, data: RunData) -> Tried:
    """Shape parameters moved in ever smaller steps to where they gain most."""
    level = _has_level(acted.acts, one)

    def gain(form: Tried) -> float:
        series = acted.of(_form_series(form, variables, data))
        if level:
            series = np.concatenate((series, acted.of(np.ones((1, len(data.row_s))))))
        return gain_of(*ground.products(acted.channel, series), np.eye(len(series)))[0]
    if "constant" in one.shape_params:
        return one
    best = gain(one)
    for fineness in FINER if one.form in OF_JUMPS else FINENESS:
        for name in term_forms.movable(one):
            for way in (-1.0, 1.0):
                value = term_forms.moved(one, name, way * fineness, variables.by_name)
                form = one._replace(shape_params={**one.shape_params, name: value})
                if form.shape_params.get("high_end", np.inf) - form.shape_params.get("low_end", -np.inf) < NARROWEST:
                    continue
                here = gain(form)
                if here > best:
                    one, best = form, here
                    break
    return one


class _Fits(NamedTuple):
    """A hypothesis without and with a form, both with their noise."""

    columns: tuple[Column, ...]         # level, where it is open, and form
    series: Array                       # the same in the channel (columns, m)
    levels: int
    plain: Fit
    full: Fit
    log_weight: float                   # of the prior of its sizes

    @property
    def gain(self) -> float:
        return 2.0 * (self.full.log_likelihood - self.plain.log_likelihood)


def _fits(search: Search, now: FittedHypothesis, base: Sequence[Column], held: int, noise: dict[str, Noise],
          form: Tried, acted: ActedOn, variables: _Variables) -> _Fits:
    data, channel = search.model.data, acted.channel
    series = acted.of(_form_series(form, variables, data))
    level = acted.of(np.ones((1, len(data.row_s)))) if _has_level(acted.acts, form) else series[:0]
    both = np.concatenate((level, series))
    sd = prior.USUAL_OF_TERM[acted.acts]
    columns = tuple(Column(Label(Role.FORM, "term"), {channel.name: coefficients(row, channel.cut)}, sd)
                    for row in both)
    p, _ = search.columns.compressed(now.parts, [*base[len(base) - held:], *columns])
    plain = best_fitted(p, np.arange(len(base) + len(level)), noise, search.model.channels)
    every, sizes = np.arange(len(base) + len(columns)), np.arange(len(base) + len(level), len(base) + len(columns))
    first = fitted(p, every, plain.noise)
    wide = p.sd.copy()
    wide[sizes] = [prior.sd_of_size(float(size), sd) for size in first.amplitude[sizes]]
    p = p._replace(sd=wide)
    full = max((best_fitted(p, every, start, search.model.channels) for start in (first.noise, noise)),
               key=lambda fit: fit.log_likelihood)
    weight = sum(prior.log_of_size(float(size), sd) for size in wide[sizes])
    again = fitted(p, np.arange(len(base) + len(level)), full.noise)    # a better noise is no gain of the form
    return _Fits(columns, both, len(level), max(plain, again, key=lambda fit: fit.log_likelihood), full, weight)


class _Level(NamedTuple):
    """The level that a quantity has along with a form."""

    value: float                        # in its unit, what the tolerances give of it with it; 0: not sure
    tolerance: float                    # s.d. of what the tolerances may give of it


NO_LEVEL = _Level(0.0, 0.0)


def _level(fit: Fit, at: int, base: Sequence[Column], own: Column, spread: float) -> _Level:
    """The level that a fit has in place `at` along with a form, where the log holds it: a slow drift of this log is no
    trait of the machine, and what a name of the hypothesis does is the name's.

    What is the form's mean and what a nominal value that is off within its tolerance no log tells; their sum is
    reported, and is what the machine does. base : columns before the terms'. own : the level's. spread : of the form
    over the log, s.d.: no form is quite right, and a small share of it is no level.
    """
    covariance = fit.covariance
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    share = np.zeros(len(sd))           # so much of a level a unit of each column is
    for k, column in enumerate(base):
        share[k] = _along(column, own) if column.label.role is Role.TOLERANCE else 0.0
    tolerance = float(np.sqrt(sum((share[k] * column.sd) ** 2 for k, column in enumerate(base) if share[k] != 0.0)))
    names = [k for k, column in enumerate(base) if column.label.role is Role.SLOPE]
    if any(abs(covariance[at, k]) > A_NAME * sd[at] * sd[k] for k in names):
        return _Level(0.0, tolerance)
    moved = sum(share[k] * column.mean for k, column in enumerate(base) if share[k] != 0.0)     # by so much less
    share[at] = 1.0
    value = float(share @ fit.amplitude) - moved
    variance = float(share @ covariance @ share)
    least = max(LEVEL_SD * float(np.sqrt(max(variance, 0.0))), LEVEL_SHARE * spread)
    return _Level(value if abs(value) > least else 0.0, tolerance)


def _along(one: Column, level: Column) -> float:
    """So much of a level a unit of a column is; 0 where it is something else."""
    name = next(iter(level.coefficients))
    if name not in one.coefficients:
        return 0.0
    a, b = one.coefficients[name], level.coefficients[name]
    along, size = float(a @ b), float(b @ b)
    return along / max(size, 1e-300) if abs(along) > A_LEVEL * np.sqrt(float(a @ a) * size) else 0.0


def _verified(search: Search, now: FittedHypothesis, base: Sequence[Column], held: int, noise: dict[str, Noise],
              one: _Candidate, acted: ActedOn, variables: _Variables) -> FittedTerm:
    """A candidate with its shape parameters settled, refitted with the noise."""
    data, channel = search.model.data, acted.channel
    quiet = _still(noise) if one.tried.form in OF_JUMPS else _starts(search, noise)[-1]
    form = _settled(WhitenedResidual(search.columns, now.parts, base, quiet), one.tried, acted, variables, data)
    fits = _fits(search, now, base, held, noise, form, acted, variables)
    amplitude, levels = fits.full.amplitude[len(base):], fits.levels
    trace = coefficients(amplitude @ fits.series, channel.cut)
    own = coefficients(amplitude[levels:] @ fits.series[levels:], channel.cut)
    spread = float(np.std(amplitude[levels:] @ _form_series(form, variables, data)))
    level = _level(fits.full, len(base), base, fits.columns[0], spread) if levels else NO_LEVEL
    log_prior = _log_prior(search, one, variables) + fits.log_weight
    term = _term(one.acts, form, amplitude[levels:], level.value, fits.full, len(base) + levels, variables, data)
    return FittedTerm(term, form, fits.gain, _worth(search, now, base, held, fits, trace, channel.name) + log_prior,
                 fits.columns, Column(Label(Role.TRACE), {channel.name: trace}, np.inf),
                 _explained(search, now, base, held, fits, channel.name, own), 0.0, fits.full.noise,
                 fits.full.log_evidence, log_prior, tolerance=level.tolerance)


def _worth(search: Search, now: FittedHypothesis, base: Sequence[Column], held: int, fits: _Fits, trace: Array,
           name: str) -> float:
    """What a form adds to the log evidence: its likelihood as far as it is evidence, its sizes integrated."""
    gain = fits.full.log_likelihood - fits.plain.log_likelihood
    integrated = fits.full.log_evidence - fits.full.log_likelihood - (fits.plain.log_evidence
                                                                      - fits.plain.log_likelihood)
    heavy = even_gain(search, now.parts, fits.full.noise, Column(Label(Role.TRACE), {name: trace}, np.inf),
                      base[len(base) - held:])
    return min(gain, heavy) + integrated


def _log_prior(search: Search, one: _Candidate, variables: _Variables) -> float:
    """Log prior odds of a form."""
    count = len(variables.one) if len(one.tried.over) == 1 else len(variables.two) * (len(variables.two) - 1) // 2
    return prior.log_odds_of_form(len(tried(search.model)), count, one.tried.places, one.tried.form is Form.SPAN)


def _explained(search: Search, now: FittedHypothesis, base: Sequence[Column], held: int, fits: _Fits, name: str,
               own: Array) -> float:
    """Share of what is left of a channel that a form explains, as variance."""
    p, _ = search.columns.compressed(now.parts, [*base[len(base) - held:], *fits.columns])
    left = power_left(p, name, np.arange(len(fits.plain.amplitude)), fits.plain.amplitude)
    return float(np.clip(np.sum(own ** 2) / max(1e-300, left), 0.0, 1.0))


def _term(acts: Acts, form: Tried, sizes: Array, level: float, fit: Fit, at: int, variables: _Variables,
          data: RunData) -> Term:
    """The term of a form's amplitudes, which a fit has from place `at` on, and its level."""
    stage, reported_form = STAGE_OF[acts], term_forms.reported_form(form)
    over: list[dict[str, Any]]
    nodes: list[float]
    values: list[float]
    sd = np.sqrt(np.maximum(np.diag(fit.covariance)[at:], 0.0))
    within = Z90 * float(np.max(sd / np.maximum(np.abs(sizes), 1e-300))) if len(sizes) == 1 else None
    if "constant" in form.shape_params:
        commanded = data.inputs[own_command("shaft", "shaft_rpm")]
        turning = commanded > TURNS_SHARE * float(commanded.max(initial=0.0))
        least = float(np.min(commanded[turning], initial=abs(float(sizes[0])) + 1e-3))
        end = min(max(abs(float(sizes[0])), 1e-3), least)
        numbers = {"slope": float(sizes[0]) / end, "low_end": 0.0, "high_end": end}
        over = [{"name": "shaft_rpm"}]
        nodes, values = [], []
    else:
        numbers = term_forms.coefficients(form, sizes, level, variables.by_name)
        nodes, values = term_forms.table_of(form, sizes, level, variables.by_name)
        over = [variables.by_name[name].variable.model_dump() for name in form.over]
    main = {Form.SLOPE: "slope", Form.SATURATION: "slope", Form.DEAD_ZONE: "slope", Form.PRODUCT: "slope",
            Form.MEMORY: "bend", Form.THRESHOLD: "above", Form.SIDE: "above", Form.SPAN: "above"}.get(form.form)
    intervals: tuple[Interval, ...] = ()
    if main is not None and within is not None:
        middle, half = numbers[main], abs(numbers[main]) * within
        intervals = (Interval(main, middle - half, middle + half),)
    return Term.model_validate({
        "id": _id(f"{stage}.{reported_form.value}_{'_'.join(form.over)}"), "acts_on": acts, "form": reported_form,
        "over": over, "coefficients": {name: float(value) for name, value in numbers.items()}, "intervals": intervals,
        "nodes": tuple(nodes), "values": tuple(values)})


def _id(words: str) -> str:
    """Of a term: names of columns may be in any writing, ids are not."""
    return re.sub(r"[^a-z0-9_.]+", "", words.lower())[:LONGEST_ID]


def series_of_term(term: Term, data: RunData) -> Array:
    """Value of a term at the log's rows (rows,)."""
    found = over_log([term], data.inputs, data.row_s, term_run)
    return found.get(term.acts_on.value, np.zeros(len(data.row_s)))


def _field_percent(term: Term, data: RunData) -> float:
    """R.m.s. of a term over the working rows, less its mean, as per cent of the dose; a scale's error moves no dose."""
    working = np.interp(data.row_s, data.time_s, data.working) > 0.5
    if term.stage == "scale" or not working.any():
        return 0.0
    wrong = series_of_term(term, data)[working]
    if UNIT_OF[term.acts_on] != "%":
        scale = data.inputs["opening_mm" if term.stage == "gate" else "shaft_rpm"][working]
        wrong = 100.0 * wrong / np.maximum(1.0, scale)
    return float(np.std(wrong))


def held_out_gain(search: Search, now: FittedHypothesis, base: Sequence[Column], one: FittedTerm) -> float:
    """Share of the held-out mean square error that a term takes away, its amplitudes fitted to the other blocks."""
    name = CHANNEL_OF[one.term.acts_on]
    channel = search.model.channel(name)
    blocks, before = held_out(channel), search.model.residual(now.parts)[name]
    fixed = [(c, series_of(c.coefficients[name], channel.cut)) for c in base if name in c.coefficients]
    own = [(c, series_of(c.coefficients[name], channel.cut)) for c in one.columns]
    without_it = before - _taken(amplitudes(blocks, fixed, before, one.noise), fixed)
    with_it = before - _taken(amplitudes(blocks, [*fixed, *own], before, one.noise), [*fixed, *own])
    _, _, plain, better = errors_of(blocks, without_it, with_it)
    if not len(plain):
        return 0.0
    return float(1.0 - np.sum(better ** 2) / max(float(np.sum(plain ** 2)), 1e-300))


def _taken(sizes: Array, columns: Sequence[tuple[Column, Array]]) -> Array:
    return np.asarray(sum(size * series for size, (_, series) in zip(sizes, columns, strict=True)))
