"""Selects the set of effects that one group of channels shows: the visited models and their
posterior odds.

A model M is a set of effects, refitted through the machine model (`search.py`), with

    L      the log-likelihood at its best fit
    O      the Occam factor: log evidence minus L (sizes, tolerances and freedom of form
           integrated; times averaged)
    pi_k   the log prior odds of its effect k, minus the price of its times

    S(M) = L + O + sum_k pi_k                           score of a model: its log posterior, except
                                                        for a constant
    D(M, M') = g + (O - O') + (pi_k - pi'_j)            log odds of M over M', which has effect j in
                                                        place of effect k

L - L' counts only as far as it is confirmed over blocks of time: g is the smaller of the two
(`whitened.find_even_gain`). Without an effect in its place (pi'_j = 0), D is the worth of effect k.
A posterior sums over the alternatives in an effect's place: the effect itself, each rival, an
unknown cause, and none, with weights 1, exp(-D(M, rival)), exp(unknown), exp(-worth)
(`InPlace.posterior`; Madigan and Raftery, JASA 89, 1994, 1535).

Forward steps add the best effect. Lateral steps replace an effect by another or change its time
course. Backward steps remove effects that the others make superfluous (Miller 2002, Subset
Selection in Regression, ch. 3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, softmax
from topdress.control.diagnosis.effects import CANOPY_HEAD_FOULED, ROWS, SHAFT_NEUTRAL, FoundBy
from topdress.control.diagnosis.judgement.checks import is_noise_loud
from topdress.control.diagnosis.judgement.prior import (
    SAID,
    calc_log_of_sign,
    calc_log_prior_odds,
    find_size_log_weight,
    name_course,
)
from topdress.control.machine.machine import CATALOGUE

from .changepoint import find_best_changes
from .dictionary import Dictionary
from .drive_curve import list_multi_effect_hypotheses
from .drives import read_off_zero
from .hypothesis import MAX_SWITCHES, EffectInstance, Hypothesis, remove_part, replace_part
from .model import find_absorbed_effects, find_replaced_nominals
from .nominal_values import TIMED, settle_nominal_values
from .onset import find_standing_onset, find_stopped_drives, refine_onsets, still_disobeys
from .quantised import encoder_steps
from .robust import draw_in_outliers
from .search import MAX_COLLINEARITY, FittedHypothesis, ScoreTest, Search
from .terms import FittedTerm, find_best_span, find_terms
from .whitened import find_even_gain

Array = npt.NDArray[np.float64]

# Prior share of dirt effects that end by themselves: dirt stays, and a deviation that comes and
# goes is nearly always the sensor, which warms up and cools down.
DIRT_ENDS = 0.01
# Log odds of an effect that is listed under another name, low enough to exclude the effect.
NEVER = -1e6
# Maximum number of causes of one group of channels.
MAX_CAUSES = 4
# Number of best candidates of a scan, of each time course, that are fully refitted.
REFITTED = 4
# Number of best refitted candidates whose times are refined.
REFINED = 4
# Candidates further behind the best of a scan, in log odds, are not refitted.
REACH = 8.0
# The deficit may also be this share of the best log odds, because a scan's column is the effect's
# slope at a single size.
REACH_SHARE = 0.15
# Maximum number of refitted rivals of an effect.
MAX_RIVALS = 10
# Tolerance of the log score: the accuracy to which fits converge.
EVEN = 0.05
# Maximum number of reviews of a model's effects.
REVIEWS = 8
# Models further behind the best in log score, some 1000 times less likely, are discarded.
WINDOW = 7.0


class RivalOf(NamedTuple):
    """A rival: an alternative in an effect's place."""

    part: EffectInstance
    # Deficit of the rival in log score.
    behind: float


class Shares(NamedTuple):
    """Probabilities of an effect, of each of its rivals, and of an unknown cause in its place; the
    remainder is the probability of no effect."""

    part: float
    rivals: tuple[float, ...]
    unknown: float


class InPlace(NamedTuple):
    """Alternatives in the place of one effect of a model. worth : log posterior odds of the effect
    against none; rivals : the most likely first; unknown : log odds of an unknown cause against the
    effect."""

    worth: float
    rivals: tuple[RivalOf, ...] = ()
    unknown: float = -np.inf

    def posterior(self, unlike: float = 0.0) -> Shares:
        """Return the probabilities of the alternatives. unlike : probability that the true cause is
        a different one, by the residual of the whole model."""
        part, *rivals, unknown, _ = softmax(
            [0.0, *(-one.behind for one in self.rivals), self.unknown, -self.worth]
        )
        known = 1.0 - unlike
        return Shares(
            known * float(part),
            tuple(known * float(p) for p in rivals),
            max(unlike, float(unknown)),
        )


class WeighedModel(NamedTuple):
    """A model with the alternatives of each of its effects."""

    fit: FittedHypothesis
    places: tuple[InPlace, ...] = ()

    @property
    def is_said(self) -> bool:
        """Tell whether each effect is more likely than none."""
        return all(place.worth > SAID for place in self.places)


class GroupResult(NamedTuple):
    """Result of one group of channels."""

    search: Search
    null: FittedHypothesis
    found: FittedHypothesis
    # Alternatives by effect.
    places: tuple[InPlace, ...]
    # Score tests of the whole catalogue without any effect in the model.
    scan: tuple[ScoreTest, ...]
    # Terms beyond the catalogue.
    terms: tuple[FittedTerm, ...] = ()

    @property
    def p_nothing(self) -> float:
        """Probability that no effect is present, by the odds of the most likely reported effect or
        term."""
        said = [*(place.worth for place in self.places), *(term.worth for term in self.terms)]
        return float(expit(-max(said, default=-np.inf)))


class Scores:
    """Scores models by log evidence and log prior odds. The scan gives the price of onset times."""

    def __init__(self, search: Search) -> None:
        self.search = search
        self._passed = read_off_zero(search.model.data.shaft, search.model.machine).passed
        self._names = len({c.part.id for c in search.candidates})
        self._spent: dict[tuple[str, int | None, str], float] = {}
        self._kept: dict[Hypothesis, FittedHypothesis] = {}
        self._scans: dict[Hypothesis, list[ScoreTest]] = {}
        # Revision of the nominal values for which the caches are valid.
        self._kept_at = -1

    def prior(self, part: EffectInstance) -> float:
        """Return the log prior odds of an effect minus the price of its times."""
        course = _name_part_course(part)
        if CATALOGUE[part.id].effect.onset_only:
            # The time of a stop is the size of the effect, so the course counts as steady.
            course = "steady"
        if part.id == SHAFT_NEUTRAL.id and part.size > 0.0 and not self._passed:
            return NEVER
        row = ROWS[part.id].on(self.search.model.machine)
        known = calc_log_prior_odds(course, self._names) + calc_log_of_sign(
            part.size, row.only_adds
        )
        known += find_size_log_weight(part.size, row.usual) if row.has_slope else 0.0
        known += (
            float(np.log(DIRT_ENDS))
            if course == "ends" and part.id == CANOPY_HEAD_FOULED.id
            else 0.0
        )
        return known - self._spent.get((part.id, part.member, course), 0.0)

    def take(self, found: Iterable[ScoreTest]) -> None:
        """Store the price of onset times from score tests."""
        for one in found:
            part = self.search.name_as_started(one.part)
            self._spent[(part.id, part.member, _name_part_course(part))] = max(0.0, one.spent)

    def refit(self, parts: Hypothesis, now: FittedHypothesis) -> FittedHypothesis:
        """Refit a model from the noise of another; cached while the nominal values are
        unchanged."""
        if self._kept_at != self.search.model.moves:
            self.forget()
        if parts not in self._kept:
            found = self.search.refit(parts, now.noise)
            self._kept[parts] = self._kept[found.parts] = found
        return self._kept[parts]

    def scan(self, now: FittedHypothesis) -> list[ScoreTest]:
        """Test every candidate on the residual of a refitted model; cached while the nominal values
        are unchanged."""
        if self._kept_at != self.search.model.moves:
            self.forget()
        if now.parts not in self._scans:
            self._scans[now.parts] = self.search.scan(now.parts, now.noise)
        return self._scans[now.parts]

    def forget(self) -> None:
        """Clear the caches: the corrections of outliers or the nominal values have changed."""
        self._kept.clear()
        self._scans.clear()
        self._kept_at = self.search.model.moves

    def worth(
        self, one: FittedHypothesis, k: int, other: FittedHypothesis, j: int | None = None
    ) -> float:
        """Return D: log posterior odds of a model against another that differs in one effect.

        k, j : indices of the effect in the one and in the other model; None for no effect in its
        place.
        """
        columns = self.search.columns
        gain = one.log_likelihood - other.log_likelihood
        occam = one.log_evidence - one.log_likelihood - (other.log_evidence - other.log_likelihood)
        if gain > 0.0 or j is not None:
            more, less = (one, other) if gain > 0.0 else (other, one)
            even = find_even_gain(
                self.search,
                less.parts,
                more.noise,
                columns.between(more.parts, less.parts),
                # The position at which a gate stopped is free in both models.
                columns.list_stop_columns(more.parts),
            )
            even = min(abs(gain), even)
            gain = even if j is None else float(np.sign(gain)) * max(0.0, even)
        return (
            gain
            + occam
            + self.prior(one.parts[k])
            - (0.0 if j is None else self.prior(other.parts[j]))
        )

    def score(self, found: FittedHypothesis) -> float:
        """Return S: log evidence plus log prior odds of a whole model."""
        return found.log_evidence + sum(self.prior(part) for part in found.parts)

    def rough(self, one: ScoreTest) -> float:
        """Return the approximate score of an addition, from its score test."""
        return one.evidence + one.spent + self.prior(self.search.name_as_started(one.part))


def judge_group(search: Search) -> GroupResult:
    """Judge a group: forward selection with a review after each step, then the search beyond the
    catalogue."""
    null = _fit_nothing_wrong(search)
    board = Scores(search)
    first = board.scan(null)
    now = WeighedModel(null)
    for _ in range(MAX_CAUSES):
        proposed = _propose_parts(board, now.fit)
        better = _add_parts_together(
            board, now.fit, _add_best_part(board, now.fit, proposed), proposed
        )
        if better is None:
            break
        now = _review_parts(board, _settle_board(board, better))
        if _is_split_review(search, now.fit.parts):
            now = _review_parts(board, _settle_board(board, now.fit))
        if not now.fit.parts:
            break
    null = search.refit(())
    now, terms = beyond_names(search, now, null, sum(board.prior(part) for part in now.fit.parts))
    return GroupResult(search, null, now.fit, now.places, tuple(first), terms)


def _fit_nothing_wrong(search: Search) -> FittedHypothesis:
    """Fit the group without any effect, after directly detected effects were added to the
    candidates."""
    search.candidates += [
        c._replace(usual=ROWS[c.part.id].on(search.model.machine).usual)
        for c in (
            *find_stopped_drives(search.model),
            *find_standing_onset(search.model),
            *encoder_steps(search.model),
        )
    ]
    settle_nominal_values(search.columns, ())
    search.find_noise()
    _draw_in_tails(search, ())
    settle_nominal_values(search.columns, ())
    search.find_noise()
    return search.refit(())


def _is_split_review(search: Search, parts: Hypothesis) -> bool:
    """Tell whether a review replaced a changed nominal value by an effect, together with another
    effect.

    The effect is then in both models, and no slope leads from one model to the other.
    """
    moved = {
        key for key in find_replaced_nominals(parts) if search.model.offsets.get(key, 0.0) != 0.0
    }
    return any(key.endswith(TIMED) for key in moved)


def _settle_board(board: Scores, now: FittedHypothesis) -> FittedHypothesis:
    """Refit a model with its nominal values and outliers."""
    search = board.search
    now = search.walk_delays(now)
    # A change of the nominal values may be due to the effect, so the values are reset first.
    search.model.move({})
    now = search.refit(now.parts, now.noise)
    _draw_in_tails(search, now.parts)
    board.forget()
    return search.refit(settle_nominal_values(search.columns, now.parts), now.noise)


def _draw_in_tails(search: Search, parts: Hypothesis) -> None:
    """Limit outliers relative to the richest fit: a hypothesis with every other candidate.

    A second time constant is excluded, because with a lag and a dead time it only absorbs noise,
    and nothing is limited during moves.
    """
    more = [
        search.columns.of_candidate(parts, c.part)
        for c in search.candidates
        if not find_absorbed_effects(c.part.id)
        and not any(p.id == c.part.id and p.member == c.part.member for p in parts)
    ]
    draw_in_outliers(search.columns, parts, more)


def _add_best_part(
    board: Scores, now: FittedHypothesis, proposed: Sequence[EffectInstance]
) -> FittedHypothesis | None:
    """Return the best model with one more effect; None where it is less likely than without."""
    refits = [board.refit((*now.parts, part), now) for part in proposed]
    refits = sorted(
        (one for one in refits if one.collinearity < MAX_COLLINEARITY),
        key=lambda one: -(one.log_evidence + board.prior(one.parts[-1])),
    )[:REFINED]
    best = max(refits, key=lambda one: board.worth(one, len(now.parts), now), default=None)
    if best is None:
        return None
    best = refine_onsets(board.search, best)
    return best if board.worth(best, len(now.parts), now) > SAID else None


def _add_parts_together(
    board: Scores,
    now: FittedHypothesis,
    better: FittedHypothesis | None,
    proposed: Sequence[EffectInstance],
) -> FittedHypothesis | None:
    """Return the most likely among the model with one more effect and the models whose curve or
    step response is fitted as a whole.

    The latter are tried where there is a sign of an effect: a named effect, or more noise than the
    machine file's can be.
    """
    model = board.search.model
    loud = any(is_noise_loud(now.noise[c.name], c.prior) for c in model.channels)
    if better is None and not loud:
        return None
    least = board.score(now) + SAID if better is None else board.score(better)
    every = [
        board.refit(parts, now)
        for parts in list_multi_effect_hypotheses(board.search, now.parts, proposed)
    ]
    ahead = [
        one for one in every if one.collinearity < MAX_COLLINEARITY and board.score(one) > least
    ]
    return max(ahead, key=board.score, default=better)


def _propose_parts(board: Scores, now: FittedHypothesis) -> list[EffectInstance]:
    """Return the best effects to add by their scans, of every time course."""
    search = board.search
    found = board.scan(now)
    stopped = [
        f
        for f in found
        if CATALOGUE[f.part.id].effect.onset_only
        and still_disobeys(search.model, now.parts, f.part)
    ]
    steady = [f for f in found if not CATALOGUE[f.part.id].effect.onset_only][:REFITTED]
    near = _keep_near_best(board, now, [*steady, *_propose_beginnings(board, now)])
    # A scan does not show the position of a threshold, because the noise of the model without the
    # threshold hides all but the nearest.
    thresholds = [
        f for f in found if ROWS[f.part.id].threshold and f.part.onset_s is None and f not in near
    ]
    # A scan does not show a second time constant before the first is refitted, because a dead time
    # mimics it.
    ids = {f.part.id for f in near if f.part.onset_s is None}
    alike = [
        f
        for f in found
        if f not in near
        and f.evidence > 0.0
        and find_absorbed_effects(f.part.id)
        and ids & set(ROWS[f.part.id].siblings)
    ]
    return [search.name_as_started(f.part) for f in (*near, *thresholds, *alike, *stopped)]


def _keep_near_best(
    board: Scores, now: FittedHypothesis, scanned: list[ScoreTest]
) -> list[ScoreTest]:
    """Return the candidates of a scan that may be the most likely: near the best of their time
    course by approximate odds, as confirmed by a refit.

    Where a slope misleads, the next candidate may be the true effect. Time courses are not compared
    before a refit, because a scan fits the noise of steady effects only.
    """
    found = []
    for several in _group_by_course(scanned):
        best = -np.inf
        for one in sorted(several, key=board.rough, reverse=True):
            rough = board.rough(one)
            if rough <= max(best, 0.0) - max(REACH, REACH_SHARE * best):
                break
            found.append(one)
            # A refit rarely raises the best above the approximate odds of later candidates.
            if rough > best:
                fitted = board.refit((*now.parts, board.search.name_as_started(one.part)), now)
                best = max(best, min(rough, board.score(fitted) - board.score(now)))
    return found


def _propose_beginnings(board: Scores, now: FittedHypothesis) -> list[ScoreTest]:
    """Return the best effects that begin within the log, grow, or come and go, a few of each."""
    search = board.search
    shaft = search.model.data.shaft if "shaft" in search.model.names else None
    # The rounding error of an encoder changes with the speed.
    rounded = (shaft is not None and shaft.step > 0.0) or any(
        ROWS[part.id].found_by is FoundBy.STEPS for part in now.parts
    )
    switches = len({time_s for part in now.parts for time_s in part.switches})
    if rounded or switches + 1 > MAX_SWITCHES or any(c.settled for c in search.model.channels):
        # A bench run of minutes follows the order of its commands, so time and command are
        # confounded.
        return []
    taken = {(p.id, p.member) for p in now.parts}
    tried = [c for c in search.candidates if (c.part.id, c.part.member) not in taken]
    found = find_best_changes(
        search.columns, now.parts, now.noise, tried, switches + 2 <= MAX_SWITCHES
    )
    board.take(found)
    return [one for several in _group_by_course(found) for one in several[:REFITTED]]


def _group_by_course(found: Sequence[ScoreTest]) -> list[list[ScoreTest]]:
    courses: dict[str, list[ScoreTest]] = {}
    for one in found:
        courses.setdefault(_name_part_course(one.part), []).append(one)
    return list(courses.values())


def _name_part_course(part: EffectInstance) -> str:
    return name_course(part.onset_s, part.until_s, part.grows)


def _review_parts(board: Scores, fit: FittedHypothesis) -> WeighedModel:
    """Compare each effect of the model with its alternatives and with none, until no replacement is
    better, and return the most likely visited model whose effects are all more likely than none.

    A rival that leads by block-confirmed evidence only, and trails by all evidence, is considered
    equally likely.
    """
    visited: list[WeighedModel] = []
    # Where no log can distinguish two effects, the first of the catalogue represents both.
    order = list(ROWS)
    for left in count(REVIEWS, -1):
        now = _weigh_parts(board, fit)
        parts = now.fit.parts
        if now.is_said:
            visited.append(now)
        if not parts or (visited and left <= 0):
            break
        behind = [one.rivals[0].behind if one.rivals else np.inf for one in now.places]
        # The index of the best rival relative to none.
        in_place = np.array([one.worth for one in now.places]) - np.minimum(0.0, behind)
        k = int(np.argmin(behind))
        ends = (
            left <= 0
            or behind[k] > EVEN
            or (
                behind[k] > -EVEN
                and order.index(now.places[k].rivals[0].part.id) > order.index(parts[k].id)
            )
        )
        if in_place.min() <= SAID or (ends and not visited):
            fit = board.refit(remove_part(parts, int(np.argmin(in_place))), fit)
        elif ends:
            break
        else:
            fit = board.refit(replace_part(parts, k, now.places[k].rivals[0].part), fit)
    best = max(reversed(visited), key=lambda one: board.score(one.fit))
    return best._replace(
        places=tuple(
            place._replace(
                rivals=tuple(
                    one._replace(behind=max(0.0, one.behind))
                    for one in place.rivals
                    if one.part.id != part.id
                )
            )
            for part, place in zip(best.fit.parts, best.places, strict=True)
        )
    )


def _weigh_parts(board: Scores, now: FittedHypothesis) -> WeighedModel:
    """Compare each effect with none and with its rivals within the window.

    The odds between two models are calculated directly, and from the worth of each over none.
    Either counts block-confirmed evidence only and is a lower bound, so the higher applies.
    """
    places: list[InPlace] = []
    for k, part in enumerate(now.parts):
        alone = board.refit(remove_part(now.parts, k), now)
        own, place, found = board.worth(now, k, alone), len(alone.parts), []
        for rival in _in_its_place(board, alone, part):
            tried = board.refit((*alone.parts, rival), alone)
            if tried.collinearity < MAX_COLLINEARITY:
                higher = max if now.log_likelihood > tried.log_likelihood else min
                found.append(
                    RivalOf(
                        tried.parts[-1],
                        higher(
                            board.worth(now, k, tried, place),
                            own - board.worth(tried, place, alone),
                        ),
                    )
                )
        best = {
            one.part.id: one
            for one in sorted(found, key=lambda r: -r.behind)
            if one.behind < WINDOW and (one.part.id != part.id or one.behind < -EVEN)
        }
        places.append(InPlace(own, tuple(sorted(best.values(), key=lambda r: r.behind))))
    return WeighedModel(now, tuple(places))


def _in_its_place(
    board: Scores, alone: FittedHypothesis, part: EffectInstance
) -> list[EffectInstance]:
    """Return the alternatives to an effect: steady effects, effects with their own time course, and
    other time courses of the effect itself."""
    scanned = board.scan(alone)
    if not CATALOGUE[part.id].effect.onset_only:
        scanned += _propose_beginnings(board, alone)
    others = [
        f
        for f in scanned
        if not CATALOGUE[f.part.id].effect.onset_only
        and board.search.name_as_started(f.part)._replace(size=0.0) != part._replace(size=0.0)
    ]
    near = [
        board.search.name_as_started(f.part)
        for f in sorted(_keep_near_best(board, alone, others), key=board.rough)[-MAX_RIVALS:]
    ]
    course = _name_part_course(part)
    alike = [
        one._replace(onset_s=part.onset_s, until_s=part.until_s)
        for one in near
        if part.onset_s is not None and one.id != part.id and _name_part_course(one) == course
    ]
    # The refined times of the effect are included.
    return [*near, *alike]


# The following functions compare named effects and terms by the same score.


def beyond_names(
    search: Search, now: WeighedModel, null: FittedHypothesis, log_prior: float
) -> tuple[WeighedModel, tuple[FittedTerm, ...]]:
    """Return the most likely of three models: the named effects with additional terms; the named
    effects with one replaced by a temporary constant; terms alone.

    log_prior : of all named effects together.
    """
    dictionary, parts = Dictionary(search.model), now.fit.parts
    # The forms of the named effects over these variables are free already.
    own = frozenset(ROWS[part.id].form_over for part in parts)
    with_names = tuple(find_terms(search, dictionary, now.fit, own))
    if not parts:
        return now, with_names
    alone = tuple(find_terms(search, dictionary, null))
    names, unknown = now.fit.log_evidence + log_prior, -np.inf
    if alone:
        unknown = _score_with_terms(alone) - names
        if _score_with_terms(alone) > (
            log_prior + _score_with_terms(with_names) if with_names else names
        ):
            return WeighedModel(null), alone
    places = []
    for k, (part, place) in enumerate(zip(parts, now.places, strict=True)):
        rest = (
            search.refit(remove_part(parts, k), now.fit.noise) if part.until_s is not None else None
        )
        span = find_best_span(search, dictionary, rest, part) if rest is not None else None
        if rest is not None and span is not None and span.worth > place.worth:
            return WeighedModel(rest, now.places[:k] + now.places[k + 1 :]), (span,)
        for_as_long = -np.inf if span is None else span.worth - place.worth
        places.append(place._replace(unknown=float(np.logaddexp(unknown, for_as_long))))
    return (now, with_names) if with_names else (WeighedModel(now.fit, tuple(places)), ())


def _score_with_terms(terms: Sequence[FittedTerm]) -> float:
    """Return the log evidence of a model with terms plus the log prior odds of the terms."""
    return terms[-1].log_evidence + sum(one.log_prior for one in terms)
