"""Reports a season: the course of each effect on each machine, the effects of other levels, and
every level with its interval.

`mixed_model.py` fits the model; this module converts its terms to sizes, pieces and changes in an
effect's own units.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import expit, ndtr
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.judgement.gaussian import Array

from .change_points import NEIGHBOUR_GAPS, CoursePartition, LogStretch
from .log_evidence import SeasonLog, stack_logs
from .mixed_model import (
    Alternative,
    FactorLevels,
    Season,
    find_season_causes,
    judge_season_causes,
    scan_season,
)

# Maximum p value of a slope that counts as wear.
MAX_WEAR_SLOPE_P_VALUE = 1e-3
# Minimum share of an effect that a repair removes.
MIN_EFFECT_SHARE_REPAIRED = 0.25
# Probability from which a change is reported.
MIN_CHANGE_PROB = 0.1
# Number of logs on either side of a change whose sizes are averaged.
CHANGE_WINDOW_LOGS = 5
# Minimum share of common logs of two levels for their effects to be inseparable.
MIN_COMMON_LOG_SHARE = 0.9


class CoursePiece(NamedTuple):
    """A linear piece of a course: sizes at its begin and end, and the half widths of their 90 %
    intervals."""

    begin_d: float
    end_d: float
    begin: float
    end: float
    begin_half: float
    end_half: float
    per_day: float
    # P value of the slope.
    per_day_p: float


class SeasonChange(NamedTuple):
    """A change of a machine between two logs. repair: probability that the change reduced the
    effect."""

    time_d: float
    probability: float
    repair: float
    before: float
    after: float
    logs_after: int


class SeasonCause(NamedTuple):
    """Effect of one level of a factor. size, half: mean over all its logs with half of the 90 %
    interval.

    alternatives: the equally possible causes, including this cause, with probabilities. apart:
    whether these logs contain more information on the cause than its prior; otherwise they cannot
    separate it from others. A machine has a course without the effects of its operators, products
    and fields: the size in each log (in the order of `times_d`) with its 90 % half width, the
    scatter included, and the linear pieces.
    """

    factor: str
    level: str
    effect: str
    size: float
    half: float
    probability: float
    logs: int
    alternatives: tuple[Alternative, ...] = ()
    apart: bool = True
    times_d: tuple[float, ...] = ()
    sizes: tuple[float, ...] = ()
    halves: tuple[float, ...] = ()
    pieces: tuple[CoursePiece, ...] = ()
    changes: tuple[SeasonChange, ...] = ()

    @property
    def final_size(self) -> float:
        """Size in the last log."""
        return self.pieces[-1].end if self.pieces else self.size

    @property
    def other_effects(self) -> tuple[str, ...]:
        """Other effects among the alternatives."""
        return tuple(one.effect for one in self.alternatives if one.effect != self.effect)


class InseparableLevels(NamedTuple):
    """Two levels whose logs are the same except for a few: their effects are inseparable."""

    factor: str
    level: str
    other_factor: str
    other_level: str


class SeasonFit(NamedTuple):
    """Fit of a season. courses: the machines' own causes. shared: causes that machines share.
    levels: for every reported effect, every level of every factor."""

    courses: tuple[SeasonCause, ...] = ()
    shared: tuple[SeasonCause, ...] = ()
    levels: tuple[SeasonCause, ...] = ()
    same: tuple[InseparableLevels, ...] = ()


def fit_season(logs: Sequence[SeasonLog]) -> SeasonFit:
    """Fit the whole season."""
    if not logs:
        return SeasonFit()
    season = judge_season_causes(find_season_causes(stack_logs(logs)))
    causes = [_make_season_cause(season, number) for number in range(len(season.causes))]
    return SeasonFit(
        tuple(sorted(one for one in causes if one.pieces)),
        tuple(one for one in causes if not one.pieces),
        tuple(_list_effect_levels(season, causes)),
        tuple(_compare_levels(season.levels)),
    )


def _make_season_cause(season: Season, number: int) -> SeasonCause:
    """Return a cause with its size in each log: the residual after all other terms at their
    means."""
    cause, (mean, cov) = season.causes[number], season.find_posterior(number)
    whole = cause.columns.mean(axis=0)
    found = SeasonCause(
        *season.levels.keys[cause.row],
        season.logs.names[cause.effect],
        float(whole @ mean),
        TWO_SIDED_90_QUANTILE * float(whole @ cov @ whole) ** 0.5,
        float(expit(cause.log_odds)),
        len(cause.at),
        cause.alternatives,
    )
    if cause.course is None:
        return found
    times_d, (score, information) = season.logs.times_d[cause.at], season.calc_effect_score(number)
    # The variance includes the scatter.
    sizes, variance = score / information, 1.0 / information
    return found._replace(
        times_d=tuple(times_d.tolist()),
        sizes=tuple(sizes.tolist()),
        halves=tuple((TWO_SIDED_90_QUANTILE * variance**0.5).tolist()),
        pieces=tuple(
            _list_course_pieces(cause.course.stretches, times_d, cause.columns, mean, cov, variance)
        ),
        changes=tuple(_list_season_changes(cause.course, times_d, sizes, variance)),
    )


def _list_course_pieces(
    stretches: Sequence[LogStretch],
    times_d: Array,
    columns: Array,
    mean: Array,
    cov: Array,
    variance: Array,
) -> Iterator[CoursePiece]:
    for one in stretches:
        first, last = columns[one.begin], columns[one.end - 1]
        days = float(times_d[one.end - 1] - times_d[one.begin])
        per_day, sd = 0.0, 0.0
        if one.kind == "line" and days > 0.0:
            per_day = float((last - first) @ mean) / days
            sd = float((last - first) @ cov @ (last - first)) ** 0.5 / days
        halves = [TWO_SIDED_90_QUANTILE * float(row @ cov @ row) ** 0.5 for row in (first, last)]
        if one.kind == "gone":
            halves = [
                TWO_SIDED_90_QUANTILE * float(np.sum(1.0 / variance[one.begin : one.end])) ** -0.5
            ] * 2
        yield CoursePiece(
            float(times_d[one.begin]),
            float(times_d[one.end - 1]),
            float(first @ mean),
            float(last @ mean),
            halves[0],
            halves[1],
            per_day,
            float(2.0 * ndtr(-abs(per_day) / sd)) if sd > 0.0 else 1.0,
        )


def _list_season_changes(
    course: CoursePartition, times_d: Array, sizes: Array, variance: Array
) -> Iterator[SeasonChange]:
    """Yield the changes of the most likely course, and other probable changes."""
    gaps = [one.begin - 1 for one in course.stretches[1:]]
    for gap in map(int, np.argsort(-course.change, kind="stable")):
        if (
            all(abs(gap - one) > NEIGHBOUR_GAPS for one in gaps)
            and course.calc_change_probability_near(gap) >= MIN_CHANGE_PROB
        ):
            gaps.append(gap)
    for gap in sorted(gaps):
        before, after = ([one for one in gaps if one < gap], [one for one in gaps if one > gap])
        early = slice(max(gap + 1 - CHANGE_WINDOW_LOGS, max(before, default=-1) + 1), gap + 1)
        late = slice(
            gap + 1, min(gap + 1 + CHANGE_WINDOW_LOGS, min(after, default=len(sizes) - 1) + 1)
        )
        was, is_ = (
            (
                float(np.average(sizes[part], weights=1.0 / variance[part])),
                float(np.sum(1.0 / variance[part])) ** -1.0,
            )
            for part in (early, late)
        )
        probability = course.calc_change_probability_near(gap)
        yield SeasonChange(
            0.5 * float(times_d[gap] + times_d[gap + 1]),
            probability,
            probability * _calc_repair_probability(*was, *is_),
            was[0],
            is_[0],
            len(sizes) - gap - 1,
        )


def _calc_repair_probability(
    was: float, was_variance: float, is_: float, is_variance: float
) -> float:
    """Return the probability that a size decreased by MIN_EFFECT_SHARE_REPAIRED at least, and not
    to an equal size of the opposite sign."""
    left = 1.0 - MIN_EFFECT_SHARE_REPAIRED
    sd = float(left**2 * was_variance + is_variance) ** 0.5
    sign = 1.0 if was >= 0.0 else -1.0
    return float(
        max(
            0.0,
            ndtr((left * abs(was) - sign * is_) / sd)
            + ndtr((left * abs(was) + sign * is_) / sd)
            - 1.0,
        )
    )


def _list_effect_levels(season: Season, causes: Sequence[SeasonCause]) -> Iterator[SeasonCause]:
    """Yield every level of every reported effect: reported causes unchanged, others shrunk towards
    the levels of their factor.

    The members of a set of alternatives share its probability.
    """
    if not season.causes:
        return
    seen, logs = scan_season(season), season.logs
    shown = {(one.factor, one.level, one.effect): one for one in causes}
    of_set = {
        (other.factor, other.level, other.effect): other.probability * one.probability
        for one in causes
        for other in one.alternatives
    }
    for effect in sorted({cause.effect for cause in season.causes}):
        # A level that cannot have the effect gets no row.
        for row in np.flatnonzero(seen.odds[:, effect] > -np.inf):
            key = (*season.levels.keys[row], logs.names[effect])
            precision = seen.information[row, effect] + seen.tau[row, effect] ** -2.0
            one = shown.get(key) or SeasonCause(
                *key,
                float(seen.score[row, effect] / precision),
                TWO_SIDED_90_QUANTILE * float(precision) ** -0.5,
                float(expit(seen.odds[row, effect])),
                len(season.levels.logs[row]),
                (),
                bool(seen.information[row, effect] * seen.tau[row, effect] ** 2 > 1.0),
            )
            yield one._replace(probability=of_set.get(key, one.probability))


def _compare_levels(levels: FactorLevels) -> Iterator[InseparableLevels]:
    """Yield all pairs of inseparable levels, among those that some log has."""
    count = np.array([len(one) for one in levels.logs])
    for one, other in combinations(range(levels.code.shape[1]), 2):
        pairs, both = np.unique(levels.code[:, [one, other]], axis=0, return_counts=True)
        for (a, b), logs in zip(pairs.tolist(), both.tolist(), strict=True):
            if min(a, b) >= 0 and logs > MIN_COMMON_LOG_SHARE * (count[a] + count[b] - logs):
                yield InseparableLevels(*levels.keys[a], *levels.keys[b])


def is_wearing(course: SeasonCause) -> bool:
    """Tell whether the last piece of a course grows away from zero."""
    last = course.pieces[-1]
    return last.per_day_p < MAX_WEAR_SLOPE_P_VALUE and last.per_day * last.end > 0.0
