"""Score tests for effects that begin, grow, or come and go within a log, over all times of change.

The score test for a change point (Picard 1985, Advances in Applied Probability 17, 841; Andrews
1993, Econometrica 61, 821): the gain of an effect that begins at t is (sum of residual x trace from
t on)^2 / information, the residual weighted with the inverse of the noise's covariance. Cumulative
sums give the numerator for all t in a single pass. The information changes slowly with t and is
calculated exactly at a few times only. A noise drift can absorb most of a step, but not the step's
edge: only the exact time separates a step from a drift.

The score of an effect that lasts from a to b is its score from a minus its score from b. Its
information follows from the inner products of traces that begin at a and at b, first on a coarse
grid of times, then on finer grids around the best pair.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    adapt_noise,
    choose_better_fit,
    fit_amplitudes_and_noise,
    limit_slow_noise,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.noise import Noise, calc_coefficients
from topdress.control.machine.machine import CATALOGUE

from .channels import ChannelSeries
from .columns import HypothesisColumns
from .hypothesis import EffectInstance, Hypothesis
from .model import apply_course, calc_part_course, is_cumulative
from .search import Candidate, ScoreTest
from .whitened import WhitenedResidual

Array = npt.NDArray[np.float64]

# Numbers of onset times at which the information is calculated exactly: first coarsely, then finely
# where the gain (in twice the log-likelihood) may matter.
EXACT_TIME_COUNTS = (3, 8)
# Number of rounds in which the information is calculated exactly at the best time so far.
BEST_TIMES = 3
# Gain, in twice the log-likelihood, from which more onset times are tried. The value is below the
# prior price of any onset.
MIN_REFINED_GAIN = 6.0
# Number of times in the log's length at which a temporary effect may begin or end in the first
# grid.
COARSE_EDGE_COUNT = 13
# Number of interpolated times that are tried for each time of the first grid.
INTERPOLATED_TIMES = 12
# Factor by which the grid of times is refined, applied twice.
REFINEMENT_FACTOR = 4
# Number of best candidates, among those that change the same channels, whose times are refined.
MAX_REFINED_CANDIDATES = 4

# No change point is searched for within this time of either end of the log, s.
EDGE_MARGIN_S = 8.0
# Minimum duration of an effect that ends again, s: a shorter stretch of the log is too little
# evidence.
MIN_SPAN_S = 20.0


class CandidateTraces(NamedTuple):
    """A candidate effect with the traces of one unit of the effect over the whole log."""

    candidate: Candidate
    # These are the channels that the candidate changes.
    channels: tuple[ChannelSeries, ...]
    # Each flag says whether the channel accumulates the effect.
    summed: tuple[bool, ...]
    # Each channel has an array of traces, (copies, m).
    units: tuple[Array, ...]

    @property
    def time_s(self) -> Array:
        """Sample times of the finest channel, s: (m,)."""
        return max((c.grid.even_s for c in self.channels), key=len)


def find_best_changes(
    columns: HypothesisColumns,
    parts: Hypothesis,
    noise: dict[str, Noise],
    tried: Sequence[Candidate],
    temporary: bool = False,
) -> list[ScoreTest]:
    """Test every candidate at its best onset, both as a step and as a growth, and return the tests,
    best first.

    The noise is both the given noise and the noise of a calm log; neither is refitted. The gain is
    in twice the log-likelihood. With `temporary`, effects that begin and end are tested as well,
    each at its best pair of times.
    """
    begins = select_onset_candidates(tried)
    if not begins:
        return []
    traces = [columns.model.calc_difference(parts, candidate.part) for candidate in begins]
    channels, banded, base = (
        columns.model.channels,
        columns.model.calc_banded_residual(parts),
        columns.list_columns(parts),
    )
    p, every = make_evidence_problem(channels, banded, base), np.arange(len(base))
    fit = choose_better_fit(p, every, noise, channels)
    at_ease = adapt_noise(p, every, fit.amplitude, limit_slow_noise(fit.noise, channels))
    under = [fit.noise] if at_ease == fit.noise else [fit.noise, at_ease]
    behind = [
        fit.log_evidence - fit_amplitudes_and_noise(p, every, one, rounds=0).log_evidence
        for one in under
    ]
    return find_best_onsets(
        channels, banded, base, under, begins, traces, temporary=temporary, behind=behind
    )


def select_onset_candidates(tried: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that may begin in the middle of a log."""
    return [
        c
        for c in tried
        if c.part.onset_s is None
        and EFFECT_ROWS[c.part.id].may_begin
        and not CATALOGUE[c.part.id].effect.onset_only
        and (EFFECT_ROWS[c.part.id].has_slope or EFFECT_ROWS[c.part.id].threshold)
    ]


def find_best_onsets(
    channels: Sequence[ChannelSeries],
    banded: dict[str, Array],
    base: Sequence[Column],
    under: Sequence[dict[str, Noise]],
    begins: Sequence[Candidate],
    traces: Sequence[dict[str, Array]],
    *,
    matters: float = MIN_REFINED_GAIN,
    end_s: float = EDGE_MARGIN_S,
    temporary: bool = False,
    behind: Sequence[float] = (0.0, 0.0),
) -> list[ScoreTest]:
    """Test candidates with given traces at their best onsets, and return the tests, best first.

    Parameters
    ----------
    channels
        The channels of the group.
    banded
        Cosine coefficients of the residual by channel.
    base
        Columns of everything that the hypothesis can absorb.
    under
        Noise models. Each candidate is judged under the model that gives it the most evidence.
    begins, traces
        The candidates, and the series (m,) by channel that each produces over the whole log.
    matters
        Gain, in twice the log-likelihood, from which more times are tried.
    end_s
        No onset is searched for within this time of either end of the log, s.
    temporary
        Whether effects that begin and end are tested as well.
    behind
        Log evidence of each noise model, below that of the best model.
    """
    residuals = [WhitenedResidual(channels, banded, base, noise) for noise in under]
    weighted = [{c.name: residual.weigh_residual(c) for c in channels} for residual in residuals]
    found, spans = (
        list[tuple[int, ScoreTest]](),
        dict[tuple[Any, ...], list[tuple[ScoreTest, CandidateTraces, Array]]](),
    )
    for candidate, trace in zip(begins, traces, strict=True):
        there = tuple(c for c in channels if c.name in trace)
        if not there:
            continue
        one = CandidateTraces(
            candidate,
            there,
            tuple(is_cumulative(candidate.part, c.name) for c in there),
            tuple((trace[c.name] / candidate.part.size).reshape(c.copies, -1) for c in there),
        )
        within = (float(one.time_s[0]) + end_s, float(one.time_s[-1]) - end_s)
        scores = _calc_onset_scores(weighted, one, grows=False)
        found += _find_begin_times(residuals, one, scores, within, matters, grows=False)
        # A threshold effect is not proportional to its size, so its growth has no fixed trace.
        if EFFECT_ROWS[candidate.part.id].threshold:
            continue
        found += _find_begin_times(
            residuals,
            one,
            _calc_onset_scores(weighted, one, grows=True),
            within,
            matters,
            grows=True,
        )
        if temporary and within[1] - within[0] >= 2.0 * MIN_SPAN_S:
            for at, span in enumerate(
                _find_best_spans(
                    residuals,
                    one,
                    scores,
                    np.linspace(*within, COARSE_EDGE_COUNT),
                    INTERPOLATED_TIMES,
                )
            ):
                if span.gain >= matters:
                    spans.setdefault((at, *(c.name for c in there), *one.summed), []).append(
                        (span, one, scores[at])
                    )
    for (at, *_), alike in spans.items():
        alike.sort(key=lambda each: -each[0].gain)
        found += [
            (at, _refine_span(residuals[at], one, score, span, end_s))
            for span, one, score in alike[:MAX_REFINED_CANDIDATES]
        ]
        found += [(at, span) for span, _, _ in alike[MAX_REFINED_CANDIDATES:]]
    best: dict[tuple[str, int | None, bool, bool], ScoreTest] = {}
    for at, test in found:
        test = test._replace(evidence=test.evidence - behind[at], gain=test.gain - 2.0 * behind[at])
        name = (test.part.id, test.part.member, test.part.grows, test.part.until_s is not None)
        if name not in best or test.evidence > best[name].evidence:
            best[name] = test
    return sorted(best.values(), key=lambda test: -test.evidence)


def _find_likeliest_onset(
    candidate: Candidate,
    score: Array,
    information: Array,
    places: int,
    at: Callable[[int], dict[str, Any]],
) -> ScoreTest:
    """Return the test of a candidate at its best onset, with the evidence averaged over all onset
    times.

    score, information : at each tested onset (n,), which stand for `places` possible onsets. at :
    sample indices of the tested onsets.
    """
    information = np.maximum(information, 1e-12)
    size = np.clip(score / information, candidate.low, candidate.high)
    # The trace of a threshold effect is not proportional to its size.
    if EFFECT_ROWS[candidate.part.id].threshold:
        size = np.full(len(score), candidate.part.size)
    gain = 2.0 * score * size - information * size**2
    log_odds = 0.5 * (gain - np.log1p(information * candidate.usual**2))
    # The log-sum-exp is written out, because scipy's logsumexp takes ten times as long: 2 % of a
    # diagnosis of 24,000 rows.
    peak, best = float(log_odds.max()), int(np.argmax(gain))
    evidence = peak + float(np.log(np.sum(np.exp(log_odds - peak)) / places))
    return ScoreTest(
        candidate.part._replace(size=float(size[best]), **at(best)),
        float(gain[best]),
        evidence,
        float(log_odds[best]) - evidence,
    )


def _find_begin_times(
    residuals: Sequence[WhitenedResidual],
    one: CandidateTraces,
    scores: Array,
    within: tuple[float, float],
    matters: float,
    grows: bool,
) -> list[tuple[int, ScoreTest]]:
    """Return the best onset test under each noise model, with the index of the noise model.

    scores : score of an onset at each sample (noises, m).
    """
    inside = np.flatnonzero((one.time_s > within[0]) & (one.time_s < within[1]))
    if not len(inside):
        return []
    left, found = list(range(len(residuals))), dict[int, ScoreTest]()
    exact_s = np.empty(0)
    exact: dict[int, Array] = {at: np.empty(0) for at in left}
    rounds = [np.linspace(*within, count) for count in EXACT_TIME_COUNTS] + [
        np.empty(0)
    ] * BEST_TIMES
    for times_s in rounds:
        # After the grids, the information is calculated at the best time itself: between two exact
        # times it may be far from their line, above all near the ends of a log.
        best_s = [found[at].part.onset_s for at in left if not len(times_s)]
        new_s = np.setdiff1d(np.array([*times_s, *best_s], np.float64), exact_s)
        if not len(new_s):
            break
        traces = _make_onset_traces(one, new_s, grows)
        order = np.argsort(np.concatenate((exact_s, new_s)))
        exact_s = np.concatenate((exact_s, new_s))[order]
        for at in left:
            rows, taken = _whiten_traces(residuals[at], one, traces)
            own = sum(np.einsum("ij,ij->i", whole, whole) for whole in rows) - np.sum(
                taken**2, axis=1
            )
            exact[at] = np.concatenate((exact[at], own))[order]
            found[at] = _find_likeliest_onset(
                one.candidate,
                scores[at, inside],
                np.interp(one.time_s[inside], exact_s, exact[at]),
                len(one.time_s),
                lambda best: {"onset_s": float(one.time_s[inside[best]]), "grows": grows},
            )
        left = [at for at in left if found[at].gain >= matters]
        if not left:
            break
    return list(found.items())


def _refine_span(
    residual: WhitenedResidual, one: CandidateTraces, score: Array, span: ScoreTest, end_s: float
) -> ScoreTest:
    """Return the test with the best begin and end times near those of `span`."""
    first_s, last_s = float(one.time_s[0]) + end_s, float(one.time_s[-1]) - end_s
    apart_s = (last_s - first_s) / (COARSE_EDGE_COUNT - 1) / INTERPOLATED_TIMES
    for _ in range(2):
        assert span.part.onset_s is not None and span.part.until_s is not None
        apart_s /= REFINEMENT_FACTOR
        about_s = apart_s * np.arange(-REFINEMENT_FACTOR + 1, REFINEMENT_FACTOR)
        about_s = np.clip(
            np.concatenate([span.part.onset_s + about_s, span.part.until_s + about_s]),
            first_s,
            last_s,
        )
        finer = _find_best_spans([residual], one, score[None], np.unique(about_s))
        # The log is too short for two times this close together.
        if not finer:
            break
        spent = max(finer[0].spent + 2.0 * np.log(REFINEMENT_FACTOR), span.spent)
        span = finer[0]._replace(spent=spent, evidence=finer[0].evidence + finer[0].spent - spent)
    return span


def _find_best_spans(
    residuals: Sequence[WhitenedResidual],
    one: CandidateTraces,
    scores: Array,
    exact_s: Array,
    between: int = 1,
) -> list[ScoreTest]:
    """Return the best pair of begin and end times under each noise model; empty where no two times
    are far enough apart.

    exact_s : times of the exact inner products (edges,). between : number of interpolated times for
    each exact time.
    """
    edges_s = np.interp(
        np.arange((len(exact_s) - 1) * between + 1) / between, np.arange(len(exact_s)), exact_s
    )
    # Interpolated information is too inaccurate for shorter spans.
    shortest_s = MIN_SPAN_S if between == 1 else float(exact_s[1] - exact_s[0])
    begin, end = np.nonzero(edges_s[None, :] - edges_s[:, None] >= shortest_s)
    if not len(begin):
        return []
    found, traces = list[ScoreTest](), _make_onset_traces(one, exact_s, grows=False)
    for residual, score in zip(residuals, scores, strict=True):
        rows, taken = _whiten_traces(residual, one, traces)
        exact = sum(whole @ whole.T for whole in rows) - taken @ taken.T
        own = np.interp(edges_s, exact_s, np.diag(exact))
        # The products are interpolated linearly in both time directions.
        half = np.array([np.interp(edges_s, exact_s, row) for row in exact])
        across = np.array([np.interp(edges_s, exact_s, row) for row in half.T])[end, begin]
        at_edges = np.interp(edges_s, one.time_s, score)
        information = own[begin] + own[end] - 2.0 * across
        found.append(
            _find_likeliest_onset(
                one.candidate,
                at_edges[begin] - at_edges[end],
                information,
                len(begin),
                lambda best: {
                    "onset_s": float(edges_s[begin[best]]),
                    "until_s": float(edges_s[end[best]]),
                },
            )
        )
    return found


def _calc_onset_scores(
    weighted: Sequence[Mapping[str, Array]], one: CandidateTraces, grows: bool
) -> Array:
    """Return the sum of weighted residual x trace for an onset at each sample of the finest
    channel, by noise model: (noises, m)."""
    scores = np.zeros((len(weighted), len(one.time_s)))
    for score, left in zip(scores, weighted, strict=True):
        for channel, unit, adds in zip(one.channels, one.units, one.summed, strict=True):
            time_s = channel.grid.even_s
            sums = _sum_from_each_sample(left[channel.name], time_s, unit, adds, grows)
            score += sums if time_s is one.time_s else np.interp(one.time_s, time_s, sums)
    return scores


def _sum_from_each_sample(
    weighted: Array, time_s: Array, trace: Array, summed: bool, grows: bool
) -> Array:
    """Return the sum of weighted residual x trace from each sample to the end: (m,).

    weighted, trace : (copies, m).
    """
    if not grows:
        level = trace.sum(axis=0) * _sum_ahead(weighted) if summed else 0.0
        return np.asarray(_sum_ahead(weighted * trace) - level)
    if not summed:
        sums = _sum_ahead(weighted * trace * time_s) - time_s * _sum_ahead(weighted * trace)
    else:
        rate = np.diff(trace, prepend=trace[:, :1])
        moment, level = np.cumsum(rate * time_s, axis=-1), np.cumsum(rate, axis=-1)
        sums = _sum_ahead(weighted * moment) - moment[0] * _sum_ahead(weighted)
        sums = sums - time_s * (_sum_ahead(weighted * level) - level[0] * _sum_ahead(weighted))
    return np.asarray(sums / np.maximum(time_s[-1] - time_s, 1.0))


def _sum_ahead(values: Array) -> Array:
    """Return the sum over copies and over all samples from each sample on: (m,) of (copies, m)."""
    return np.asarray(np.cumsum(values[:, ::-1].sum(axis=0))[::-1])


def _make_onset_traces(one: CandidateTraces, onsets_s: Array, grows: bool) -> list[Array]:
    """Return the traces of one unit of the effect for each onset, the same under every noise model:
    cosine coefficients (onsets, m) by channel."""
    return [
        calc_coefficients(
            apply_course(
                unit.ravel(),
                np.array(
                    [
                        calc_part_course(channel, EffectInstance("", 1.0, float(at), grows=grows))
                        for at in onsets_s
                    ]
                ),
                channel.copies,
                adds,
            ),
            channel.cut,
        )
        for channel, unit, adds in zip(one.channels, one.units, one.summed, strict=True)
    ]


def _whiten_traces(
    residual: WhitenedResidual, one: CandidateTraces, traces: Sequence[Array]
) -> tuple[list[Array], Array]:
    """Return whitened traces (onsets, m) by channel, and their components in the basis of the
    hypothesis (onsets, columns)."""
    found = [
        residual.whiten(channel, trace) for channel, trace in zip(one.channels, traces, strict=True)
    ]
    return [white for white, _ in found], np.sum([own for _, own in found], axis=0)
