"""Which set of effects one group of channels shows: the models visited on the way, and their
posterior odds.

A model M is a set of parts, refitted through the machine model (`search.py`), with

    L      the log-likelihood at its best fit
    O      the Occam factor: log evidence less L (sizes, tolerances and freedom of form
           integrated; times averaged)
    pi_k   the log prior odds of its part k, the price of its times taken off

    S(M) = L + O + sum_k pi_k                           score of a model: its log posterior, but
                                                        for a constant
    D(M, M') = g + (O - O') + (pi_k - pi'_j)            log odds of M over M', which has part j in
                                                        place of part k

L - L' counts as far as it holds by blocks of time as well: g is the smaller of the two
(`whitened.find_even_gain`). Without a part in its place (pi'_j = 0) D is what part k is worth. A
posterior sums over what may stand in a part's place: the part itself, each rival, something
unknown, and nothing, with weights 1, exp(-D(M, rival)), exp(unknown), exp(-worth)
(`InPlace.posterior`; Madigan and Raftery, JASA 89, 1994, 1535).

Forward steps add the best effect, lateral steps put another in a member's place or give it
another course in time, backward steps drop what the others make superfluous (Miller 2002,
Subset Selection in Regression, ch. 3).
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

# Dirt stays where it is; what wanders off and comes back is nearly always the sensor, which
# warms up and cools down. so much rarer than others it comes and goes by itself
DIRT_ENDS = 0.01
NEVER = -1e6  # of log odds: what has another name
MAX_CAUSES = 4  # of one group of channels
# best of a scan that are refitted in full, of each course in time
REFITTED = 4
REFINED = 4  # best of these that are held against each other
# of a scan's log odds behind the best: what is further off is not refitted ...
REACH = 8.0
# ... or by this share of it: a scan's column is the effect's slope at one size
REACH_SHARE = 0.15
MAX_RIVALS = 10  # of a part, that are refitted
EVEN = 0.05  # of the log score: as near as fits settle
REVIEWS = 8  # of a model's parts
# of the log score behind the best: models that are 1000 times less likely are let go
WINDOW = 7.0


class RivalOf(NamedTuple):
    """What could stand in a part's place."""

    part: EffectInstance
    behind: float  # by so much of the log score


class Shares(NamedTuple):
    """Probabilities of a part, of each of its rivals, and of something unknown in its place;
    the rest is nothing's."""

    part: float
    rivals: tuple[float, ...]
    unknown: float


class InPlace(NamedTuple):
    """What may stand in the place of one part of a model. worth : log posterior odds of the
    part against nothing there; rivals : the likeliest first; unknown : log odds of something
    unknown there against the part."""

    worth: float
    rivals: tuple[RivalOf, ...] = ()
    unknown: float = -np.inf

    def posterior(self, unlike: float = 0.0) -> Shares:
        """unlike : probability that it is something else altogether, by what the whole model
        leaves."""
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
    """A model with what may stand in the place of each of its parts."""

    fit: FittedHypothesis
    places: tuple[InPlace, ...] = ()

    @property
    def is_said(self) -> bool:
        """Whether each part is likelier than nothing."""
        return all(place.worth > SAID for place in self.places)


class GroupResult(NamedTuple):
    """What one group of channels shows."""

    search: Search
    null: FittedHypothesis
    found: FittedHypothesis
    places: tuple[InPlace, ...]  # by part
    scan: tuple[ScoreTest, ...]  # the whole catalogue on top of nothing
    terms: tuple[FittedTerm, ...] = ()  # beyond the catalogue

    @property
    def p_nothing(self) -> float:
        """Probability that there is nothing: by the odds of the likeliest thing that is said to
        be there."""
        said = [*(place.worth for place in self.places), *(term.worth for term in self.terms)]
        return float(expit(-max(said, default=-np.inf)))


class Scores:
    """The score of models: log evidence and log prior odds. Times of beginning cost what their
    scan says."""

    def __init__(self, search: Search) -> None:
        self.search = search
        self._passed = read_off_zero(search.model.data.shaft, search.model.machine).passed
        self._names = len({c.part.id for c in search.candidates})
        self._spent: dict[tuple[str, int | None, str], float] = {}
        self._kept: dict[Hypothesis, FittedHypothesis] = {}
        self._scans: dict[Hypothesis, list[ScoreTest]] = {}
        self._kept_at = -1  # of the model's moves

    def prior(self, part: EffectInstance) -> float:
        """Log prior odds of a part, the price of its times taken off."""
        course = _name_part_course(part)
        if CATALOGUE[part.id].effect.onset_only:
            course = "steady"  # when a drive stopped is its size
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
        """Keep what the times of beginning cost."""
        for one in found:
            part = self.search.name_as_started(one.part)
            self._spent[(part.id, part.member, _name_part_course(part))] = max(0.0, one.spent)

    def refit(self, parts: Hypothesis, now: FittedHypothesis) -> FittedHypothesis:
        """A model refitted from the noise of another, kept while the nominal values stand."""
        if self._kept_at != self.search.model.moves:
            self.forget()
        if parts not in self._kept:
            found = self.search.refit(parts, now.noise)
            self._kept[parts] = self._kept[found.parts] = found
        return self._kept[parts]

    def scan(self, now: FittedHypothesis) -> list[ScoreTest]:
        """What a refitted model leaves held against every candidate, kept as long."""
        if self._kept_at != self.search.model.moves:
            self.forget()
        if now.parts not in self._scans:
            self._scans[now.parts] = self.search.scan(now.parts, now.noise)
        return self._scans[now.parts]

    def forget(self) -> None:
        """The data have changed, outliers drawn in anew, or the nominal values have."""
        self._kept.clear()
        self._scans.clear()
        self._kept_at = self.search.model.moves

    def worth(
        self, one: FittedHypothesis, k: int, other: FittedHypothesis, j: int | None = None
    ) -> float:
        """D: log posterior odds of a model against another that differs from it in one part: k
        of the one, j of the other, None where it has nothing in its place."""
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
                # where a gate stopped is open in both
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
        """S: log evidence and log prior odds of a whole model."""
        return found.log_evidence + sum(self.prior(part) for part in found.parts)

    def rough(self, one: ScoreTest) -> float:
        """The same of what a scan adds, roughly."""
        return one.evidence + one.spent + self.prior(self.search.name_as_started(one.part))


def judge_group(search: Search) -> GroupResult:
    """Judge a group: forward selection, each step reviewed; then what is beyond the catalogue."""
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
    """The group with nothing wrong, once what is read off the drives is among the candidates."""
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
    """Whether a review put a part where the nominal value had been moved, along with another
    part: it is in both, and where no slope leads from one to the other."""
    moved = {
        key for key in find_replaced_nominals(parts) if search.model.offsets.get(key, 0.0) != 0.0
    }
    return any(key.endswith(TIMED) for key in moved)


def _settle_board(board: Scores, now: FittedHypothesis) -> FittedHypothesis:
    """A model once more, along with it the nominal values and outliers."""
    search = board.search
    now = search.walk_delays(now)
    # what the nominal values took upon themselves may be the effect's
    search.model.move({})
    now = search.refit(now.parts, now.noise)
    _draw_in_tails(search, now.parts)
    board.forget()
    return search.refit(settle_nominal_values(search.columns, now.parts), now.noise)


def _draw_in_tails(search: Search, parts: Hypothesis) -> None:
    """Tails drawn in along with the richest fit: a hypothesis with every other candidate. Not a
    second time constant: next to a lag and a dead time it leaves less of the noise, and of
    moves nothing is drawn in."""
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
    """The best model with one more part, where it is likelier than without."""
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
    """The likeliest of a model with one more part and of those whose curve, or answer to a
    step, is fitted as a whole; the latter are tried where something is there: a part, or more
    noise than the machine file's can be."""
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
    """The best parts to add by their scans, of every course in time."""
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
    # Where a threshold lies no scan says: the noise that nothing leaves in it hides all but the
    # nearest.
    thresholds = [
        f for f in found if ROWS[f.part.id].threshold and f.part.onset_s is None and f not in near
    ]
    # ... nor what a second time constant does, once the first is moved along: till then a dead
    # time passes for it.
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
    """Those of a scan that may be the likeliest: near the best of their course in time by their
    rough odds, as far as a refit bears these out: where a slope leads nowhere, the next one may
    be what is there. Courses are not held against each other before a refit: a scan fits the
    noise of steady effects only."""
    found = []
    for several in _group_by_course(scanned):
        best = -np.inf
        for one in sorted(several, key=board.rough, reverse=True):
            rough = board.rough(one)
            if rough <= max(best, 0.0) - max(REACH, REACH_SHARE * best):
                break
            found.append(one)
            # no refit puts the best above the rough odds of what comes later
            if rough > best:
                fitted = board.refit((*now.parts, board.search.name_as_started(one.part)), now)
                best = max(best, min(rough, board.score(fitted) - board.score(now)))
    return found


def _propose_beginnings(board: Scores, now: FittedHypothesis) -> list[ScoreTest]:
    """The best parts that begin within the log, at once or growing, or come and go, a few of
    each."""
    search = board.search
    shaft = search.model.data.shaft if "shaft" in search.model.names else None
    # rounding changes with the speed
    rounded = (shaft is not None and shaft.step > 0.0) or any(
        ROWS[part.id].found_by is FoundBy.STEPS for part in now.parts
    )
    switches = len({time_s for part in now.parts for time_s in part.switches})
    if rounded or switches + 1 > MAX_SWITCHES or any(c.settled for c in search.model.channels):
        # minutes on a bench, in the order of the commands: time and command are one
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
    """The model with each part against what could stand in its place and against nothing, until
    none is better; of the models on the way whose parts are all likelier than nothing, the
    likeliest. A rival that is ahead of it where only even evidence counts, and behind where all
    does, is as likely as it is."""
    visited: list[WeighedModel] = []
    # where no log tells two effects apart, the catalogue's first stands for both
    order = list(ROWS)
    for left in count(REVIEWS, -1):
        now = _weigh_parts(board, fit)
        parts = now.fit.parts
        if now.is_said:
            visited.append(now)
        if not parts or (visited and left <= 0):
            break
        behind = [one.rivals[0].behind if one.rivals else np.inf for one in now.places]
        # the best over nothing
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
    """What each part is worth, and what could stand in its place within the window. How far one
    model is ahead of another is had directly, and by what each is worth over nothing: either
    counts even evidence alone and is a lower bound, so that the higher one holds."""
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
    """What could stand in a part's place: steady, or in a course of its own; of the part itself
    its other courses."""
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
    return [*near, *alike]  # the part's times are refined: at these, too


# -- names and terms by one score
# --------------------------------------------------------------------------------------


def beyond_names(
    search: Search, now: WeighedModel, null: FittedHypothesis, log_prior: float
) -> tuple[WeighedModel, tuple[FittedTerm, ...]]:
    """The likeliest of: the names, with the terms that stand along with them; the names but
    one, with a constant for as long as that one; terms alone. log_prior : of all names
    together.
    """
    dictionary, parts = Dictionary(search.model), now.fit.parts
    # over these the names' forms are free already
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
    """Log evidence with terms, and log prior odds of them."""
    return terms[-1].log_evidence + sum(one.log_prior for one in terms)
