"""Effects that begin, grow, or come and go within a log: every time tried at once.

The score test for a change point (Picard 1985, Advances in Applied Probability 17, 841; Andrews
1993, Econometrica 61, 821): the gain of an effect that begins at t is (sum of residual x trace
from t on)^2 / information, the residual weighted with the inverse of the noise's covariance.
The sums are cumulative, so that one pass gives them for all t; the information changes slowly
with t and is had exactly at a few times. A drift can follow a step well, but not its edge: the
time must be exact for the step to tell.

Of an effect that is there from a to b the score is that from a less that from b, and the
information is had from the inner products of what begins at a with what begins at b: first on a
grid of times, then on finer ones about the best.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import ROWS
from topdress.control.diagnosis.judgement.evidence import (
    Column,
    adapt_noise,
    choose_better_fit,
    fit_amplitudes_and_noise,
    limit_slow_noise,
    make_evidence_problem,
)
from topdress.control.diagnosis.judgement.noise import Noise, coefficients
from topdress.control.machine.machine import CATALOGUE

from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import EffectInstance, Hypothesis
from .model import apply_course, calc_part_course, is_cumulative
from .search import Candidate, ScoreTest
from .whitened import WhitenedResidual

Array = npt.NDArray[np.float64]

# Numerical: how finely times are tried. A gain is of twice the log-likelihood.
# at which the information is had exactly, the second where the gain may matter
TIMES = (3, 8)
# gain from which on more times are tried: below the price of any beginning
MAY_MATTER = 6.0
# times of a log at which an effect that comes and goes may begin or end at first ...
EDGES = 13
BETWEEN = 12  # ... times tried for each of these ...
FINER = 4  # ... and how much finer they are then, twice
# best of those that touch the same channels, that are tried at finer times
FEW = 4

# from either end of the log: no change point is looked for there
END_S = 8.0
# of an effect that ends again: less is one stretch of the log, which is no evidence
MIN_SPAN_S = 20.0


class Tried(NamedTuple):
    """A candidate with what one unit of it does all along."""

    candidate: Candidate
    channels: tuple[ChannelSeries, ...]  # that it touches
    summed: tuple[bool, ...]  # whether each channel adds up what it does
    units: tuple[Array, ...]  # (copies, m) by channel

    @property
    def time_s(self) -> Array:
        """Of the finest channel (m,)."""
        return max((c.grid.even_s for c in self.channels), key=len)


def find_best_changes(
    columns: Columns,
    parts: Hypothesis,
    noise: dict[str, Noise],
    tried: Sequence[Candidate],
    temporary: bool = False,
) -> list[ScoreTest]:
    """Every candidate with the best time to begin, at once and growing: best first, noise as
    given and calm.

    The gain is of twice the log-likelihood under a noise that is not fitted again. temporary :
    with temporary effects, each with the best times to begin and to end.
    """
    begins = that_may_begin(tried)
    if not begins:
        return []
    traces = [columns.model.difference(parts, candidate.part) for candidate in begins]
    channels, banded, base = (
        columns.model.channels,
        columns.model.banded_residual(parts),
        columns.of_hypothesis(parts),
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


def that_may_begin(tried: Sequence[Candidate]) -> list[Candidate]:
    """Those of some candidates that may begin in the middle of a log."""
    return [
        c
        for c in tried
        if c.part.onset_s is None
        and ROWS[c.part.id].may_begin
        and not CATALOGUE[c.part.id].effect.onset_only
        and (ROWS[c.part.id].has_slope or ROWS[c.part.id].threshold)
    ]


def find_best_onsets(
    channels: Sequence[ChannelSeries],
    banded: dict[str, Array],
    base: Sequence[Column],
    under: Sequence[dict[str, Noise]],
    begins: Sequence[Candidate],
    traces: Sequence[dict[str, Array]],
    *,
    matters: float = MAY_MATTER,
    end_s: float = END_S,
    temporary: bool = False,
    behind: Sequence[float] = (0.0, 0.0),
) -> list[ScoreTest]:
    """The same of series, however they were had. traces : what each candidate does all along,
    (m,) by channel.

    banded : cosine coefficients of the residual by channel. base : what the hypothesis can take
    up. under : noises, of which each candidate has the one that speaks most for it; behind :
    their log evidence, less than the best's by so much. matters : gain from which on more times
    are tried. end_s : from either end, where nothing is looked for.
    """
    residuals = [WhitenedResidual(channels, banded, base, noise) for noise in under]
    weighted = [{c.name: residual.weighted(c) for c in channels} for residual in residuals]
    found, spans = (
        list[tuple[int, ScoreTest]](),
        dict[tuple[Any, ...], list[tuple[ScoreTest, Tried, Array]]](),
    )
    for candidate, trace in zip(begins, traces, strict=True):
        there = tuple(c for c in channels if c.name in trace)
        if not there:
            continue
        one = Tried(
            candidate,
            there,
            tuple(is_cumulative(candidate.part, c.name) for c in there),
            tuple((trace[c.name] / candidate.part.size).reshape(c.copies, -1) for c in there),
        )
        within = (float(one.time_s[0]) + end_s, float(one.time_s[-1]) - end_s)
        scores = _calc_onset_scores(weighted, one, grows=False)
        found += _find_begin_times(residuals, one, scores, within, matters, grows=False)
        if ROWS[candidate.part.id].threshold:  # half the size does not do half as much
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
                _find_best_spans(residuals, one, scores, np.linspace(*within, EDGES), BETWEEN)
            ):
                if span.gain >= matters:
                    spans.setdefault((at, *(c.name for c in there), *one.summed), []).append(
                        (span, one, scores[at])
                    )
    for (at, *_), alike in spans.items():
        alike.sort(key=lambda each: -each[0].gain)
        found += [
            (at, _refine_span(residuals[at], one, score, span, end_s))
            for span, one, score in alike[:FEW]
        ]
        found += [(at, span) for span, _, _ in alike[FEW:]]
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
    """One candidate where it gains most, its evidence averaged over all places.

    score, information : at each place where it is looked for (n,), of so many `places`. at :
    the times of a place.
    """
    information = np.maximum(information, 1e-12)
    size = np.clip(score / information, candidate.low, candidate.high)
    # half a threshold's column is not what half a threshold does
    if ROWS[candidate.part.id].threshold:
        size = np.full(len(score), candidate.part.size)
    gain = 2.0 * score * size - information * size**2
    log_odds = 0.5 * (gain - np.log1p(information * candidate.usual**2))
    # The log of a sum as it stands: scipy's logsumexp takes ten times as long, 2 % of a
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
    one: Tried,
    scores: Array,
    within: tuple[float, float],
    matters: float,
    grows: bool,
) -> list[tuple[int, ScoreTest]]:
    """The best time to begin under each noise, with the noise's place. scores : were it to
    begin at each time (noises, m)."""
    inside = np.flatnonzero((one.time_s > within[0]) & (one.time_s < within[1]))
    if not len(inside):
        return []
    left, found = list(range(len(residuals))), dict[int, ScoreTest]()
    for count in TIMES:
        exact_s = np.linspace(*within, count)
        traces = _make_onset_traces(one, exact_s, grows)
        for at in left:
            rows, taken = _whiten_traces(residuals[at], one, traces)
            exact = sum(np.einsum("ij,ij->i", whole, whole) for whole in rows) - np.sum(
                taken**2, axis=1
            )
            information = np.interp(one.time_s[inside], exact_s, exact)
            found[at] = _find_likeliest_onset(
                one.candidate,
                scores[at, inside],
                information,
                len(one.time_s),
                lambda best: {"onset_s": float(one.time_s[inside[best]]), "grows": grows},
            )
        left = [at for at in left if found[at].gain >= matters]
        if not left:
            break
    return list(found.items())


def _refine_span(
    residual: WhitenedResidual, one: Tried, score: Array, span: ScoreTest, end_s: float
) -> ScoreTest:
    """The best times to begin and to end about those of `span`."""
    first_s, last_s = float(one.time_s[0]) + end_s, float(one.time_s[-1]) - end_s
    apart_s = (last_s - first_s) / (EDGES - 1) / BETWEEN
    for _ in range(2):
        assert span.part.onset_s is not None and span.part.until_s is not None
        apart_s /= FINER
        about_s = apart_s * np.arange(-FINER + 1, FINER)
        about_s = np.clip(
            np.concatenate([span.part.onset_s + about_s, span.part.until_s + about_s]),
            first_s,
            last_s,
        )
        finer = _find_best_spans([residual], one, score[None], np.unique(about_s))
        if not finer:  # the log is too short for two times so near
            break
        spent = max(finer[0].spent + 2.0 * np.log(FINER), span.spent)
        span = finer[0]._replace(spent=spent, evidence=finer[0].evidence + finer[0].spent - spent)
    return span


def _find_best_spans(
    residuals: Sequence[WhitenedResidual],
    one: Tried,
    scores: Array,
    exact_s: Array,
    between: int = 1,
) -> list[ScoreTest]:
    """The best of all pairs of times under each noise; nothing where no two are far enough
    apart. exact_s : at which inner products are had (edges,); between : so many times for each
    of these are tried, the products interpolated."""
    edges_s = np.interp(
        np.arange((len(exact_s) - 1) * between + 1) / between, np.arange(len(exact_s)), exact_s
    )
    # interpolation is too coarse below
    shortest_s = MIN_SPAN_S if between == 1 else float(exact_s[1] - exact_s[0])
    begin, end = np.nonzero(edges_s[None, :] - edges_s[:, None] >= shortest_s)
    if not len(begin):
        return []
    found, traces = list[ScoreTest](), _make_onset_traces(one, exact_s, grows=False)
    for residual, score in zip(residuals, scores, strict=True):
        rows, taken = _whiten_traces(residual, one, traces)
        exact = sum(whole @ whole.T for whole in rows) - taken @ taken.T
        own = np.interp(edges_s, exact_s, np.diag(exact))
        # both ways: straight between times
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


def _calc_onset_scores(weighted: Sequence[Mapping[str, Array]], one: Tried, grows: bool) -> Array:
    """By noise the sum of weighted residual x trace, were it to begin at each time of the
    finest channel: (noises, m)."""
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
    """Sum of weighted residual x trace, were it to begin at each sample: (m,). weighted, trace
    : (copies, m)."""
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
    """Sum over copies of all samples from each one on: (m,) of (copies, m)."""
    return np.asarray(np.cumsum(values[:, ::-1].sum(axis=0))[::-1])


def _make_onset_traces(one: Tried, onsets_s: Array, grows: bool) -> list[Array]:
    """What one unit does that begins at each time, the same under every noise: cosine
    coefficients (onsets, m) by channel."""
    return [
        coefficients(
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
    residual: WhitenedResidual, one: Tried, traces: Sequence[Array]
) -> tuple[list[Array], Array]:
    """Traces whitened (onsets, m) by channel, and what the hypothesis takes up of them, in its
    basis (onsets, columns)."""
    found = [
        residual.white(channel, trace) for channel, trace in zip(one.channels, traces, strict=True)
    ]
    return [white for white, _ in found], np.sum([own for _, own in found], axis=0)
