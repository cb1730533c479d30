"""Names and terms by one score: a term stands along with the names that were found, or in their place where the log
posterior odds of terms alone are higher."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from control.diagnosis.effects import ROWS

from .dictionary import Dictionary
from .hypothesis import without
from .search import FittedHypothesis, Search
from .terms import FittedTerm, best_span, found_terms


class Beyond(NamedTuple):
    """A model, the terms along with its names, and of each name the log odds of something unknown in its place."""

    now: FittedHypothesis
    kept: tuple[int, ...]           # places of the names that stay, among those that were found
    terms: tuple[FittedTerm, ...]
    unknown: tuple[float, ...] = ()


def beyond_names(search: Search, now: FittedHypothesis, null: FittedHypothesis, worths: Sequence[float],
                 log_prior: float) -> Beyond:
    """The likeliest of: the names, with the terms that stand along with them; the names but one, with a constant for as
    long as that one; terms alone. worths : log posterior odds of each name against nothing in its place. log_prior :
    of all names together.
    """
    dictionary = Dictionary(search.model)
    every = tuple(range(len(now.parts)))
    own = frozenset(ROWS[part.id].form_over for part in now.parts)      # over these the names' forms are free already
    with_names = tuple(found_terms(search, dictionary, now, own))
    if not now.parts:
        return Beyond(now, (), with_names)
    alone = tuple(found_terms(search, dictionary, null))
    names, unknown = now.log_evidence + log_prior, -np.inf
    if alone:
        unknown = _score(alone) - names
        if _score(alone) > (log_prior + _score(with_names) if with_names else names):
            return Beyond(null, (), alone)
    odds = []
    for k, (part, worth) in enumerate(zip(now.parts, worths, strict=True)):
        rest = search.refit(without(now.parts, k), now.noise) if part.until_s is not None else None
        span = best_span(search, dictionary, rest, part) if rest is not None else None
        if rest is not None and span is not None and span.worth > worth:
            return Beyond(rest, every[:k] + every[k + 1:], (span,))
        odds.append(float(np.logaddexp(unknown, -np.inf if span is None else span.worth - worth)))
    return Beyond(now, every, with_names, tuple(odds))


def _score(terms: Sequence[FittedTerm]) -> float:
    """Log evidence with terms, and log prior odds of them."""
    return terms[-1].log_evidence + sum(one.log_prior for one in terms)
