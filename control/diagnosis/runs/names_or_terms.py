"""Names first: a term stands beside the names that were found, or in their place where it explains plainly more."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.machine.machine import CATALOGUE
from control.machine.terms import STAGE_OF, UNIT_OF, Form

from .hypothesis import MAX_SWITCHES, Part, Parts, without
from .likelihood import Column, Label, Role, best_fitted, problem
from .noise import coefficients
from .search import Refit, Search
from .term_columns import CHANNEL_OF, ActedOn, tried
from .term_forms import PER_AMPLITUDE
from .terms import Dictionary, Found, found_terms, levels_of, series_of_term, told_together, total_price

Array = npt.NDArray[np.float64]

NAME_PRICE = 17.0           # of twice the log-likelihood: what a name must gain
NAME_WINS = 10.0            # a term takes a name's place from so much more on ...
NAME_WINS_SHARE = 0.05      # ... or from this share of what the names explain
NAMES_TRIED = 3             # for a box in time
BOX_SHARE = 0.15            # of a box's gain: an effect for a while may explain so much less
BESIDE = 0.25               # of a name's gain: a term of its channel that gains more makes it doubtful
SAME = 0.9999               # cosine of a box and what an effect does for a while: above it they are one
MAX_MEAN = 1.5              # times a term's spread: what is constant beyond that is an effect's, not a term's ...
TOLERATED_SD = 2.0          # ... but for so many s.d. of what the tolerances give


class OrBox(NamedTuple):
    """A part of a hypothesis for which a box in time does as well: something unknown may be there for as long."""

    id: str
    stage: str                  # that the box acts on
    begin_s: float


class Beyond(NamedTuple):
    """A hypothesis, what is beyond it, and which of its parts a box in time explains as well."""

    now: Refit
    terms: tuple[Found, ...]
    dictionary: Dictionary
    or_boxes: tuple[OrBox, ...] = ()


def beyond_names(search: Search, now: Refit, null: Refit) -> Beyond:
    """The hypothesis and the terms beyond it; its names are given up where terms alone explain more, or where the names
    gain nothing beside the terms."""
    explained = max(0.0, 2.0 * (now.log_likelihood - null.log_likelihood))
    dictionary = Dictionary(search)
    beside = found_terms(search, dictionary, now, explained)
    for box in [one for one in beside if one.tried.form is Form.SPAN][:1]:
        named = _for_a_while(search, now, box)
        if named is not None:
            more = max(0.0, 2.0 * (named.log_likelihood - null.log_likelihood))
            better = 2.0 * (named.log_likelihood - now.log_likelihood) > box.gain + NAME_WINS
            return Beyond(named, tuple(found_terms(search, dictionary, named, more)), dictionary,
                          () if better else (OrBox(named.parts[-1].id, box.stage, box.term.coefficients["low_end"]),))
    if not now.parts:
        return Beyond(now, tuple(beside), dictionary)
    alone = found_terms(search, dictionary, null, 0.0)
    if not alone or not _may_replace(search, now.parts, alone):
        return Beyond(now, tuple(beside), dictionary)
    superfluous = bool(beside) and _explained(now, beside) - _explained(null, alone) < NAME_PRICE
    least = _worth(now, beside) + max(NAME_WINS, NAME_WINS_SHARE * explained)
    instead = superfluous or _worth(null, alone) > least
    return Beyond(null, tuple(alone), dictionary) if instead else Beyond(now, tuple(beside), dictionary)


def overshadowed(part: Part, gain: float, terms: Sequence[Found]) -> bool:
    """Whether something unknown is so much at work in the same place that a part with its gain is only suspected."""
    return any(CHANNEL_OF[one.term.acts_on] in ROWS[part.id].channels and one.gain > BESIDE * gain for one in terms)


def told_of_what_holds(search: Search, dictionary: Dictionary, now: Refit, gains: Sequence[float],
                       terms: Sequence[Found]) -> tuple[Found, ...]:
    """Terms with the sizes that they have without the parts that are only suspected beside them: these are adopted by
    no machine file. gains : of the hypothesis' parts."""
    sure = tuple(part for part, gain in zip(now.parts, gains, strict=True) if not overshadowed(part, gain, terms))
    if not terms or sure == now.parts or any(one.tried.form is Form.SPAN for one in terms):
        return tuple(terms)
    return tuple(told_together(search, dictionary, search.refit(sure, terms[-1].noise), terms))


def _for_a_while(search: Search, now: Refit, box: Found) -> Refit | None:
    """The hypothesis with an effect that holds for as long as a box in time, where one explains as much as the box."""
    begin, end = box.term.coefficients["low_end"], box.term.coefficients["high_end"]
    if len({t for part in now.parts for t in part.switches} | {begin, end}) > MAX_SWITCHES:
        return None
    name = CHANNEL_OF[box.term.acts_on]
    those = [c._replace(part=c.part._replace(onset_s=begin, until_s=end)) for c in search.candidates
             if name in ROWS[c.part.id].channels and ROWS[c.part.id].may_begin and not ROWS[c.part.id].threshold
             and c.part.onset_s is None and not CATALOGUE[c.part.id].effect.onset_only]
    refits = [search.refit((*now.parts, one.part), now.noise)
              for one in search.scan(now.parts, box.noise, those)[:NAMES_TRIED] if one.gain > NAME_PRICE]
    best = max(refits, key=lambda one: one.log_likelihood, default=None)
    least = box.gain - max(NAME_WINS, BOX_SHARE * box.gain)
    if best is None or 2.0 * (best.log_likelihood - now.log_likelihood) < least:
        return None
    return best


def boxes_as_good(search: Search, now: Refit) -> tuple[OrBox, ...]:
    """The parts that come and go for which a box in time does as well.

    A box in per cent that is the part itself is none; a constant is one always: what adds that for a while and then is
    gone (as an offset of the gate would) has no mark of its own.
    """
    model, found = search.model, []
    for k, part in enumerate(now.parts):
        if part.onset_s is None or part.until_s is None or part.grows:
            continue
        row_s, others = model.data.row_s, without(now.parts, k)
        there = ((row_s >= part.onset_s) & (row_s < part.until_s)).astype(np.float64)
        own = search.columns.trace(now.parts, k)
        base = search.columns.of_hypothesis(others)
        best: tuple[float, OrBox] | None = None
        for acted in (ActedOn(model, others, acts) for acts in tried(model)
                      if CHANNEL_OF[acts] in ROWS[part.id].channels):
            name, series = acted.channel.name, acted.of(there[None])
            box = Column(Label(Role.CANDIDATE, part.id), {name: coefficients(series, acted.channel.cut)[0]}, np.inf)
            same = name in own.coefficients and _alike(own.coefficients[name], box.coefficients[name]) > SAME
            if name not in own.coefficients or (same and UNIT_OF[acted.acts] == "%"):
                continue
            p = problem(model.channels, model.banded_residual(others), [*base, box])
            fit = best_fitted(p, np.arange(len(base) + 1), now.noise, model.channels)
            behind = 2.0 * (now.log_likelihood - fit.log_likelihood)
            if behind < min(NAME_WINS, np.inf if best is None else best[0]):
                best = behind, OrBox(part.id, STAGE_OF[acted.acts], part.onset_s)
        if best is not None:
            found.append(best[1])
    return tuple(found)


def _alike(one: Array, other: Array) -> float:
    """Cosine of two traces."""
    return float(abs(one @ other) / max(1e-300, float(np.linalg.norm(one) * np.linalg.norm(other))))


def _explained(now: Refit, terms: Sequence[Found]) -> float:
    """Twice the log-likelihood of a hypothesis with its terms."""
    return 2.0 * (terms[-1].log_likelihood if terms else now.log_likelihood)


def _worth(now: Refit, terms: Sequence[Found]) -> float:
    """The same less all prices."""
    levels = sum(levels_of(one) for one in terms)
    return float(_explained(now, terms) - NAME_PRICE * len(now.parts) - total_price(terms) - PER_AMPLITUDE * levels)


def _may_replace(search: Search, parts: Parts, terms: Sequence[Found]) -> bool:
    """Whether terms say something else than the names: not a name's own dependence in another form, nor a constant."""
    if any(ROWS[part.id].threshold or not ROWS[part.id].has_slope for part in parts):
        return False
    if any(one.tried.form is Form.SPAN for one in terms):      # what begins, or holds for a while, has a name
        return False
    data = search.model.data
    for one in terms:
        values = series_of_term(one.term, data)
        most = MAX_MEAN * float(np.std(values)) + TOLERATED_SD * one.tolerance
        if levels_of(one) and abs(float(np.mean(values))) > most:
            return False
    constant = [one for one in terms if "constant" in one.tried.knobs]
    own = {ROWS[part.id].form_over for part in parts} | {ROWS[part.id].needs for part in parts}
    return bool(constant) or not any(set(one.tried.over) <= own for one in terms)
