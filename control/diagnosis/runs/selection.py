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
(`whitened.calc_block_gain`). Without an effect in its place (pi'_j = 0), D is the worth of effect
k. A posterior sums over the alternatives in an effect's place: the effect itself, each rival, an
unknown cause, and none, with weights 1, exp(-D(M, rival)), exp(unknown), exp(-worth)
(`Alternatives.calc_probabilities`; Madigan and Raftery, JASA 89, 1994, 1535).

Forward steps add the best effect. Lateral steps replace an effect by another or change its time
course. Backward steps remove effects that the others make superfluous (Miller 2002, Subset
Selection in Regression, ch. 3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, count, product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit, logsumexp, softmax
from topdress.control.diagnosis.effects import (
    CANOPY_HEAD_FOULED,
    EFFECT_ROWS,
    SHAFT_NEUTRAL,
    FoundBy,
)
from topdress.control.diagnosis.judgement.checks import is_noise_loud
from topdress.control.diagnosis.judgement.prior import (
    MIN_REPORT_LOG_ODDS,
    calc_log_prior_odds,
    calc_sign_log_prior,
    calc_size_confidence,
    find_size_log_weight,
    name_course,
)
from topdress.control.machine.machine import CATALOGUE, Machine

from .changepoint import find_best_changes
from .dictionary import FormDictionary
from .drive_curve import list_multi_effect_hypotheses
from .drives import measure_zero_offset
from .hypothesis import MAX_SWITCHES, EffectInstance, Hypothesis, remove_part, replace_part
from .model import find_absorbed_effects, find_replaced_nominals
from .nominal_values import TIMING_FIELDS, calc_excess_sd, settle_nominal_values
from .onset import disobeys_after_stop, find_standing_onset, find_stopped_drives, refine_onsets
from .quantised import find_encoder_steps
from .robust import limit_outliers
from .search import MAX_COLLINEARITY, FittedHypothesis, ScoreTest, Search
from .terms import FittedTerm, find_best_span, find_terms
from .whitened import calc_block_gain

Array = npt.NDArray[np.float64]

# Prior share of dirt effects that end by themselves: dirt stays, and a deviation that comes and
# goes is nearly always the sensor, which warms up and cools down.
DIRT_END_SHARE = 0.01
# Log odds of an effect that is listed under another name, low enough to exclude the effect.
EXCLUDED_LOG_ODDS = -1e6
# Maximum number of causes of one group of channels.
MAX_CAUSES = 4
# Number of best candidates of a scan, of each time course, that are fully refitted.
MAX_REFITTED = 4
# Number of best refitted candidates whose times are refined.
MAX_REFINED = 4
# Candidates further behind the best of a scan, in log odds, are not refitted.
MAX_SCAN_DEFICIT = 8.0
# The deficit may also be this share of the best log odds, because a scan's column is the effect's
# slope at a single size.
MAX_DEFICIT_SHARE = 0.15
# Maximum number of refitted rivals of an effect.
MAX_RIVALS = 10
# Tolerance of the log score: the accuracy to which fits converge.
SCORE_TOLERANCE = 0.05
# Maximum number of reviews of a model's effects.
MAX_REVIEWS = 8
# Models further behind the best in log score, some 1000 times less likely, are discarded.
MAX_SCORE_DEFICIT = 7.0


class RivalEffect(NamedTuple):
    """A rival: an alternative in an effect's place."""

    part: EffectInstance
    # Deficit of the rival in log score.
    behind: float


class PlaceProbabilities(NamedTuple):
    """Probabilities of an effect, of each of its rivals, and of an unknown cause in its place; the
    remainder is the probability of no effect."""

    part: float
    rivals: tuple[float, ...]
    unknown: float


class Alternatives(NamedTuple):
    """Alternatives in the place of one effect of a model. worth : log posterior odds of the effect
    against none; rivals : the most likely first; unknown : log odds of an unknown cause against the
    effect."""

    worth: float
    rivals: tuple[RivalEffect, ...] = ()
    unknown: float = -np.inf

    def limit_probability(self, probability: float) -> Alternatives:
        """Return the alternatives with the effect against none no more probable than this."""
        return self._replace(worth=min(self.worth, float(logit(probability))))

    def calc_probabilities(self, unlike: float = 0.0) -> PlaceProbabilities:
        """Return the probabilities of the alternatives. unlike : probability that the true cause is
        a different one, by the residual of the whole model."""
        part, *rivals, unknown, _ = softmax(
            [0.0, *(-one.behind for one in self.rivals), self.unknown, -self.worth]
        )
        known = 1.0 - unlike
        return PlaceProbabilities(
            known * float(part),
            tuple(known * float(p) for p in rivals),
            max(unlike, float(unknown)),
        )


class ComparedModel(NamedTuple):
    """A model with the alternatives of each of its effects."""

    fit: FittedHypothesis
    places: tuple[Alternatives, ...] = ()

    @property
    def is_credible(self) -> bool:
        """Tell whether each effect is more likely than none."""
        return all(place.worth > MIN_REPORT_LOG_ODDS for place in self.places)


class GroupResult(NamedTuple):
    """Result of one group of channels."""

    search: Search
    null: FittedHypothesis
    found: FittedHypothesis
    # Alternatives by effect.
    places: tuple[Alternatives, ...]
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


class ModelScorer:
    """Scores models by log evidence and log prior odds. The scan gives the price of onset times."""

    def __init__(self, search: Search) -> None:
        self.search = search
        self._passed = measure_zero_offset(search.model.data.shaft, search.model.machine).passed
        self._names = len({c.part.id for c in search.candidates})
        self._spent: dict[tuple[str, int | None, str], float] = {}
        self._kept: dict[Hypothesis, FittedHypothesis] = {}
        self._scans: dict[Hypothesis, list[ScoreTest]] = {}
        # Revision of the nominal values for which the caches are valid.
        self._kept_at = -1

    def calc_log_prior(self, part: EffectInstance) -> float:
        """Return the log prior odds of an effect minus the price of its times."""
        course = _name_part_course(part)
        if CATALOGUE[part.id].effect.onset_only:
            # The time of a stop is the size of the effect, so the course counts as steady.
            course = "steady"
        if part.id == SHAFT_NEUTRAL.id and part.size > 0.0 and not self._passed:
            return EXCLUDED_LOG_ODDS
        row = EFFECT_ROWS[part.id].scale_to_machine(self.search.model.machine)
        known = calc_log_prior_odds(course, self._names) + calc_sign_log_prior(
            part.size, row.only_adds
        )
        known += find_size_log_weight(part.size, row.usual) if row.has_slope else 0.0
        known += (
            float(np.log(DIRT_END_SHARE))
            if course == "ends" and part.id == CANOPY_HEAD_FOULED.id
            else 0.0
        )
        return known - self._spent.get((part.id, part.member, course), 0.0)

    def store_time_prices(self, found: Iterable[ScoreTest]) -> None:
        """Store the price of onset times from score tests."""
        for one in found:
            part = self.search.rename_started_effect(one.part)
            self._spent[(part.id, part.member, _name_part_course(part))] = max(0.0, one.spent)

    def refit_model(self, parts: Hypothesis, now: FittedHypothesis) -> FittedHypothesis:
        """Refit a model from the noise of another; cached while the nominal values are
        unchanged."""
        if self._kept_at != self.search.model.moves:
            self.clear_caches()
        if parts not in self._kept:
            found = self.search.refit_hypothesis(parts, now.noise)
            self._kept[parts] = self._kept[found.parts] = found
        return self._kept[parts]

    def scan_residual(self, now: FittedHypothesis) -> list[ScoreTest]:
        """Test every candidate on the residual of a refitted model; cached while the nominal values
        are unchanged."""
        if self._kept_at != self.search.model.moves:
            self.clear_caches()
        if now.parts not in self._scans:
            self._scans[now.parts] = self.search.scan_candidates(now.parts, now.noise)
        return self._scans[now.parts]

    def clear_caches(self) -> None:
        """Clear the caches: the corrections of outliers or the nominal values have changed."""
        self._kept.clear()
        self._scans.clear()
        self._kept_at = self.search.model.moves

    def calc_log_odds(
        self,
        one: FittedHypothesis,
        other: FittedHypothesis,
        settled: tuple[FittedHypothesis, FittedHypothesis] | None = None,
    ) -> float:
        """Return D: the log posterior odds of a model against another.

        Parameters
        ----------
        one, other : fitted at the same nominal values. Of the gain of the one over a nested model,
            or of the better over the worse, the share counts that is even over blocks of time.
        settled : both, each with the nominal values that fit it best; default: as they are.
        """
        columns = self.search.columns
        nested = len(other.parts) < len(one.parts)
        gain, share = one.log_likelihood - other.log_likelihood, 1.0
        if gain > 0.0 or not nested:
            more, less = (one, other) if gain > 0.0 else (other, one)
            even = calc_block_gain(
                self.search,
                less.parts,
                more.noise,
                columns.make_difference_column(more.parts, less.parts),
                # The position at which a gate stopped is free in both models.
                columns.list_stop_columns(more.parts),
            )
            share = min(1.0, (even if nested else max(0.0, even)) / max(abs(gain), 1e-300))
        one, other = settled or (one, other)
        gain = one.log_likelihood - other.log_likelihood
        occam = one.log_evidence - one.log_likelihood - (other.log_evidence - other.log_likelihood)
        return (
            (gain * share if gain > 0.0 or not nested else gain)
            + occam
            + self.calc_log_prior_of_all(one.parts)
            - self.calc_log_prior_of_all(other.parts)
        )

    def calc_log_prior_of_all(self, parts: Hypothesis) -> float:
        """Return the log prior odds of all parts of a model, less the cost of their times."""
        return sum(self.calc_log_prior(part) for part in parts)

    def calc_score(self, found: FittedHypothesis) -> float:
        """Return S: log evidence plus log prior odds of a whole model."""
        return found.log_evidence + self.calc_log_prior_of_all(found.parts)

    def estimate_score(self, one: ScoreTest) -> float:
        """Return the approximate score of an addition, from its score test."""
        return (
            one.evidence
            + one.spent
            + self.calc_log_prior(self.search.rename_started_effect(one.part))
        )


def judge_group(search: Search) -> GroupResult:
    """Judge a group: forward selection with a review after each step, then the search beyond the
    catalogue."""
    null = _fit_null_model(search)
    board = ModelScorer(search)
    first = board.scan_residual(null)
    now = ComparedModel(null)
    for _ in range(MAX_CAUSES):
        proposed = _propose_parts(board, now.fit)
        better = _add_parts_together(
            board, now.fit, _add_best_part(board, now.fit, proposed), proposed
        )
        if better is None:
            break
        now = _review_parts(board, _refit_with_nominals(board, better))
        if _is_split_review(search, now.fit.parts):
            now = _review_parts(board, _refit_with_nominals(board, now.fit))
        if not now.fit.parts:
            break
        now = _merge_parts(board, now)
    now = _weigh_subsets(board, now)
    null = search.refit_hypothesis(())
    now, terms = compare_with_terms(search, now, null, board.calc_log_prior_of_all(now.fit.parts))
    return GroupResult(search, null, now.fit, now.places, tuple(first), terms)


def _fit_null_model(search: Search) -> FittedHypothesis:
    """Fit the group without any effect, after directly detected effects were added to the
    candidates."""
    search.candidates += [
        c._replace(usual=EFFECT_ROWS[c.part.id].scale_to_machine(search.model.machine).usual)
        for c in (
            *find_stopped_drives(search.model),
            *find_standing_onset(search.model),
            *find_encoder_steps(search.model),
        )
    ]
    settle_nominal_values(search.columns, ())
    search.fit_start_noise()
    _limit_tails(search, ())
    settle_nominal_values(search.columns, ())
    search.fit_start_noise()
    return search.refit_hypothesis(())


def _is_split_review(search: Search, parts: Hypothesis) -> bool:
    """Tell whether a review replaced a changed nominal value by an effect, together with another
    effect.

    The effect is then in both models, and no slope leads from one model to the other.
    """
    moved = {
        key for key in find_replaced_nominals(parts) if search.model.offsets.get(key, 0.0) != 0.0
    }
    return any(key.endswith(TIMING_FIELDS) for key in moved)


def _refit_with_nominals(board: ModelScorer, now: FittedHypothesis) -> FittedHypothesis:
    """Refit a model with its nominal values and outliers."""
    search = board.search
    now = search.refine_delays(now)
    # A change of the nominal values may be due to the effect, so the values are reset first.
    search.model.set_offsets({})
    now = search.refit_hypothesis(now.parts, now.noise)
    _limit_tails(search, now.parts)
    board.clear_caches()
    return search.refit_hypothesis(settle_nominal_values(search.columns, now.parts), now.noise)


def _limit_tails(search: Search, parts: Hypothesis) -> None:
    """Limit outliers relative to the richest fit: a hypothesis with every other candidate.

    A second time constant is excluded, because with a lag and a dead time it only absorbs noise,
    and nothing is limited during moves.
    """
    more = [
        search.columns.make_candidate_column(parts, c.part)
        for c in search.candidates
        if not find_absorbed_effects(c.part.id)
        and not any(p.id == c.part.id and p.member == c.part.member for p in parts)
    ]
    limit_outliers(search.columns, parts, more)


def _add_best_part(
    board: ModelScorer, now: FittedHypothesis, proposed: Sequence[EffectInstance]
) -> FittedHypothesis | None:
    """Return the best model with one more effect; None where it is less likely than without."""
    refits = [board.refit_model((*now.parts, part), now) for part in proposed]
    refits = sorted(
        (one for one in refits if one.collinearity < MAX_COLLINEARITY),
        key=lambda one: -(one.log_evidence + board.calc_log_prior(one.parts[-1])),
    )[:MAX_REFINED]
    if not refits:
        return None
    odds = [board.calc_log_odds(one, now) for one in refits]
    best = refits[int(np.argmax(odds))]
    # A gain over no effect counts as far as it is even. That favours a model that is wrong
    # everywhere over one that is wrong at the beginning only, so the best fit of those that are
    # more likely than no effect is compared with it.
    fits_best = max(
        (one for one, own in zip(refits, odds, strict=True) if own > MIN_REPORT_LOG_ODDS),
        key=board.calc_score,
        default=best,
    )
    if board.calc_log_odds(fits_best, best) > 0.0:
        best = fits_best
    best = refine_onsets(board.search, best)
    return best if board.calc_log_odds(best, now) > MIN_REPORT_LOG_ODDS else None


def _add_parts_together(
    board: ModelScorer,
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
    least = (
        board.calc_score(now) + MIN_REPORT_LOG_ODDS if better is None else board.calc_score(better)
    )
    every = [
        board.refit_model(parts, now)
        for parts in list_multi_effect_hypotheses(board.search, now.parts, proposed)
    ]
    ahead = [
        one
        for one in every
        if one.collinearity < MAX_COLLINEARITY and board.calc_score(one) > least
    ]
    return max(ahead, key=board.calc_score, default=better)


def _propose_parts(board: ModelScorer, now: FittedHypothesis) -> list[EffectInstance]:
    """Return the best effects to add by their scans, of every time course."""
    search = board.search
    found = board.scan_residual(now)
    stopped = [
        f
        for f in found
        if CATALOGUE[f.part.id].effect.onset_only
        and disobeys_after_stop(search.model, now.parts, f.part)
    ]
    steady = [f for f in found if not CATALOGUE[f.part.id].effect.onset_only][:MAX_REFITTED]
    near = _keep_near_best(board, now, [*steady, *_propose_beginnings(board, now)])
    # A scan does not show the position of a threshold, because the noise of the model without the
    # threshold hides all but the nearest.
    thresholds = [
        f
        for f in found
        if EFFECT_ROWS[f.part.id].threshold and f.part.onset_s is None and f not in near
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
        and ids & set(EFFECT_ROWS[f.part.id].siblings)
    ]
    return [search.rename_started_effect(f.part) for f in (*near, *thresholds, *alike, *stopped)]


def _keep_near_best(
    board: ModelScorer, now: FittedHypothesis, scanned: list[ScoreTest]
) -> list[ScoreTest]:
    """Return the candidates of a scan that may be the most likely: near the best of their time
    course by approximate odds, as confirmed by a refit.

    Where a slope misleads, the next candidate may be the true effect. Time courses are not compared
    before a refit, because a scan fits the noise of steady effects only.
    """
    found = []
    for several in _group_by_course(scanned):
        best = -np.inf
        for one in sorted(several, key=board.estimate_score, reverse=True):
            rough = board.estimate_score(one)
            if rough <= max(best, 0.0) - max(MAX_SCAN_DEFICIT, MAX_DEFICIT_SHARE * best):
                break
            found.append(one)
            # A refit rarely raises the best above the approximate odds of later candidates.
            if rough > best:
                fitted = board.refit_model(
                    (*now.parts, board.search.rename_started_effect(one.part)), now
                )
                best = max(best, min(rough, board.calc_score(fitted) - board.calc_score(now)))
    return found


def _propose_beginnings(board: ModelScorer, now: FittedHypothesis) -> list[ScoreTest]:
    """Return the best effects that begin within the log, grow, or come and go, a few of each."""
    search = board.search
    shaft = search.model.data.shaft if "shaft" in search.model.names else None
    # The rounding error of an encoder changes with the speed.
    rounded = (shaft is not None and shaft.step > 0.0) or any(
        EFFECT_ROWS[part.id].found_by is FoundBy.STEPS for part in now.parts
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
    board.store_time_prices(found)
    return [one for several in _group_by_course(found) for one in several[:MAX_REFITTED]]


def _group_by_course(found: Sequence[ScoreTest]) -> list[list[ScoreTest]]:
    courses: dict[str, list[ScoreTest]] = {}
    for one in found:
        courses.setdefault(_name_part_course(one.part), []).append(one)
    return list(courses.values())


def _name_part_course(part: EffectInstance) -> str:
    return name_course(part.onset_s, part.until_s, part.grows)


def _review_parts(board: ModelScorer, fit: FittedHypothesis) -> ComparedModel:
    """Compare each effect of the model with its alternatives and with none, until no replacement is
    better, and return the most likely visited model whose effects are all more likely than none.

    A rival that leads by block-confirmed evidence only, and trails by all evidence, is considered
    equally likely.
    """
    visited: list[ComparedModel] = []
    # Where no log can distinguish two effects, the first of the catalogue represents both.
    order = list(EFFECT_ROWS)
    for left in count(MAX_REVIEWS, -1):
        now = _compare_effects(board, fit)
        parts = now.fit.parts
        if now.is_credible:
            visited.append(now)
        if not parts or (visited and left <= 0):
            break
        behind = [one.rivals[0].behind if one.rivals else np.inf for one in now.places]
        # The index of the best rival relative to none.
        in_place = np.array([one.worth for one in now.places]) - np.minimum(0.0, behind)
        k = int(np.argmin(behind))
        ends = (
            left <= 0
            or behind[k] > SCORE_TOLERANCE
            or (
                behind[k] > -SCORE_TOLERANCE
                and order.index(now.places[k].rivals[0].part.id) > order.index(parts[k].id)
            )
        )
        if in_place.min() <= MIN_REPORT_LOG_ODDS or (ends and not visited):
            fit = board.refit_model(remove_part(parts, int(np.argmin(in_place))), fit)
        elif ends:
            break
        else:
            fit = board.refit_model(replace_part(parts, k, now.places[k].rivals[0].part), fit)
    best = max(reversed(visited), key=lambda one: board.calc_score(one.fit))
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


def _compare_effects(board: ModelScorer, now: FittedHypothesis) -> ComparedModel:
    """Compare each effect with none and with its rivals within the window.

    The odds between two models are calculated directly, and from the worth of each over none.
    Either counts block-confirmed evidence only and is a lower bound, so the higher applies.
    """
    places: list[Alternatives] = []
    for k, part in enumerate(now.parts):
        alone = board.refit_model(remove_part(now.parts, k), now)
        own, found = board.calc_log_odds(now, alone), list[RivalEffect]()
        for rival in _list_alternatives(board, alone, part):
            tried = board.refit_model((*alone.parts, rival), alone)
            if tried.collinearity < MAX_COLLINEARITY:
                higher = max if now.log_likelihood > tried.log_likelihood else min
                found.append(
                    RivalEffect(
                        tried.parts[-1],
                        higher(
                            board.calc_log_odds(now, tried), own - board.calc_log_odds(tried, alone)
                        ),
                    )
                )
        best = {
            one.part.id: one
            for one in sorted(found, key=lambda r: -r.behind)
            if one.behind < MAX_SCORE_DEFICIT
            and (one.part.id != part.id or one.behind < -SCORE_TOLERANCE)
        }
        places.append(Alternatives(own, tuple(sorted(best.values(), key=lambda r: r.behind))))
    return ComparedModel(now, tuple(places))


def _merge_parts(board: ModelScorer, now: ComparedModel) -> ComparedModel:
    """Return the more probable of a model and the models with one effect in place of two: two
    beginnings may be one temporary effect, and two effects a single one that does what both do."""
    for i, j in combinations(range(len(now.fit.parts)), 2):
        first, second = now.fit.parts[i], now.fit.parts[j]
        alone = board.refit_model(remove_part(remove_part(now.fit.parts, j), i), now.fit)
        tried = _list_alternatives(board, alone, first)
        times = sorted(one.onset_s for one in (first, second) if one.onset_s is not None)
        if len(times) == 2 and times[0] < times[1]:
            tried += [
                one._replace(onset_s=times[0], until_s=times[1], grows=False)
                for one in (first, second)
            ]
        refits = [board.refit_model((*alone.parts, one), alone) for one in tried]
        best = max(
            (one for one in refits if one.collinearity < MAX_COLLINEARITY),
            key=board.calc_score,
            default=None,
        )
        if best is not None and board.calc_score(best) > board.calc_score(now.fit):
            return _review_parts(
                board, _refit_with_nominals(board, refine_onsets(board.search, best))
            )
    return now


def _weigh_subsets(board: ModelScorer, now: ComparedModel) -> ComparedModel:
    """Return a model with the worth of each part by the sum over all subsets of its parts: the
    odds of the subsets with the part against those without it.

    The nominal values of each subset are settled for that subset. The most probable subset
    replaces the model."""
    search = board.search
    while now.fit.parts:
        parts, stand = now.fit.parts, dict(search.model.offsets)
        kept = list(product((False, True), repeat=len(parts)))[:-1]
        subsets = [tuple(p for p, there in zip(parts, one, strict=True) if there) for one in kept]
        fits = [board.refit_model(one, now.fit) for one in subsets]
        settled = [_settle_alone(search, one) for one in (now.fit, *fits)]
        search.model.set_offsets(stand)
        odds = [
            -board.calc_log_odds(now.fit, one, (settled[0], there))
            for one, there in zip(fits, settled[1:], strict=True)
        ]
        best = int(np.argmax(odds))
        if odds[best] <= 0.0:
            now = now._replace(places=_sum_odds(now, [*odds, 0.0], kept, search.model.machine))
            worth = [place.worth for place in now.places]
            if min(worth) > MIN_REPORT_LOG_ODDS:
                return now
            best = kept.index(tuple(k != int(np.argmin(worth)) for k in range(len(parts))))
        now = _review_parts(
            board, _refit_with_nominals(board, board.refit_model(subsets[best], now.fit))
        )
    return now


def _sum_odds(
    now: ComparedModel, odds: Sequence[float], kept: Sequence[tuple[bool, ...]], machine: Machine
) -> tuple[Alternatives, ...]:
    """Return the alternatives of each effect with its worth by the subsets' odds (n,). kept :
    which effects each subset but the last, the whole model, has (n - 1, k)."""
    weights, has = np.array(odds), np.array([*kept, (True,) * len(now.places)])
    # The data sheet has a single time constant: its tolerance is not that of the first of two.
    absorbed = {name for part in now.fit.parts for name in find_absorbed_effects(part.id)}
    places = []
    for k, (part, sd, place) in enumerate(zip(now.fit.parts, now.fit.sd, now.places, strict=True)):
        worth = float(logsumexp(weights[has[:, k]]) - logsumexp(weights[~has[:, k]]))
        place = place._replace(worth=worth)
        if not CATALOGUE[part.id].effect.onset_only and part.id not in absorbed:
            place = place.limit_probability(
                calc_size_confidence(part.size, calc_excess_sd(part, sd, machine))
            )
        places.append(place)
    return tuple(places)


def _settle_alone(search: Search, fit: FittedHypothesis) -> FittedHypothesis:
    """Return a model refitted with nominal values that are settled for this model alone, where it
    fits better with them."""
    search.model.set_offsets({})
    settled = search.refit_hypothesis(settle_nominal_values(search.columns, fit.parts), fit.noise)
    return max((fit, settled), key=lambda one: one.log_evidence)


def _list_alternatives(
    board: ModelScorer, alone: FittedHypothesis, part: EffectInstance
) -> list[EffectInstance]:
    """Return the alternatives to an effect: steady effects, effects with their own time course, and
    other time courses of the effect itself."""
    scanned = [*board.scan_residual(alone)]
    if not CATALOGUE[part.id].effect.onset_only:
        scanned += _propose_beginnings(board, alone)
    others = [
        f
        for f in scanned
        if not CATALOGUE[f.part.id].effect.onset_only
        and board.search.rename_started_effect(f.part)._replace(size=0.0) != part._replace(size=0.0)
    ]
    near = [
        board.search.rename_started_effect(f.part)
        for f in sorted(_keep_near_best(board, alone, others), key=board.estimate_score)[
            -MAX_RIVALS:
        ]
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


def compare_with_terms(
    search: Search, now: ComparedModel, null: FittedHypothesis, log_prior: float
) -> tuple[ComparedModel, tuple[FittedTerm, ...]]:
    """Return the most likely of three models: the named effects with additional terms; the named
    effects with one replaced by a temporary constant; terms alone.

    log_prior : of all named effects together.
    """
    dictionary, parts = FormDictionary(search.model), now.fit.parts
    # The forms of the named effects over these variables are free already.
    own = frozenset(EFFECT_ROWS[part.id].form_over for part in parts)
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
            return ComparedModel(null), alone
    places = []
    for k, (part, place) in enumerate(zip(parts, now.places, strict=True)):
        rest = (
            search.refit_hypothesis(remove_part(parts, k), now.fit.noise)
            if part.until_s is not None
            else None
        )
        span = find_best_span(search, dictionary, rest, part) if rest is not None else None
        if rest is not None and span is not None and span.worth > place.worth:
            return ComparedModel(rest, now.places[:k] + now.places[k + 1 :]), (span,)
        for_as_long = -np.inf if span is None else span.worth - place.worth
        places.append(place._replace(unknown=float(np.logaddexp(unknown, for_as_long))))
    return (now, with_names) if with_names else (ComparedModel(now.fit, tuple(places)), ())


def _score_with_terms(terms: Sequence[FittedTerm]) -> float:
    """Return the log evidence of a model with terms plus the log prior odds of the terms."""
    return terms[-1].log_evidence + sum(one.log_prior for one in terms)
