"""Effects that begin, grow, or come and go within a log: every time tried at once.

The score test for a change point (Picard 1985, Advances in Applied Probability 17, 841; Andrews 1993, Econometrica 61,
821): the gain of an effect that begins at t is (sum of residual x trace from t on)^2 / information, the residual
weighted with the inverse of the noise's covariance. The sums are cumulative, so that one pass gives them for all t; the
information changes slowly with t and is had exactly at a few times. A drift can follow a step well, but not its edge:
the time must be exact for the step to tell.

Of an effect that is there from a to b the score is that from a less that from b, and the information is had from the
inner products of what begins at a with what begins at b: first on a grid of times, then on finer ones about the best.
"""
from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import Column, adapted, best_fitted, calm, fitted, problem
from control.diagnosis.judgement.noise import Noise, coefficients
from control.machine.machine import CATALOGUE

from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import EffectInstance, Hypothesis
from .model import adds_up, course, with_course
from .search import Candidate, ScoreTest
from .whitened import WhitenedResidual

Array = npt.NDArray[np.float64]

# Numerical: how finely times are tried. A gain is of twice the log-likelihood.
TIMES = (3, 8)              # at which the information is had exactly, the second where the gain may matter
MAY_MATTER = 6.0            # gain from which on more times are tried: below the price of any beginning
EDGES = 13                  # times of a log at which an effect that comes and goes may begin or end at first ...
BETWEEN = 12                # ... times tried for each of these ...
FINER = 4                   # ... and how much finer they are then, twice
FEW = 4                     # best of those that touch the same channels, that are tried at finer times
MOST_CELLS = 1_000_000      # of one sample each: candidates are looked at side by side

END_S = 8.0                 # from either end of the log: no change point is looked for there
MIN_SPAN_S = 20.0           # of an effect that ends again: less is one stretch of the log, which is no evidence


class Alike(NamedTuple):
    """Candidates that touch the same channels in the same way, looked at side by side."""

    channels: tuple[ChannelSeries, ...]
    summed: tuple[bool, ...]            # whether each channel adds up what they do
    ones: tuple[Candidate, ...]
    units: tuple[Array, ...]            # what one unit of each does all along, (k, copies x m) by channel

    def only(self, which: Sequence[int]) -> Alike:
        """Those of them that are chosen."""
        return self._replace(ones=tuple(self.ones[k] for k in which),
                             units=tuple(unit[list(which)] for unit in self.units))

    @property
    def linear(self) -> list[int]:
        """Places of those of which half the size does half as much."""
        return [k for k, one in enumerate(self.ones) if not ROWS[one.part.id].threshold]


def changes(columns: Columns, parts: Hypothesis, noise: dict[str, Noise], tried: Sequence[Candidate],
            temporary: bool = False) -> list[ScoreTest]:
    """Every candidate with the best time to begin, at once and growing: best first, noise as given and calm.

    The gain is of twice the log-likelihood under a noise that is not fitted again. temporary : with temporary
    effects, each with the best times to begin and to end.
    """
    begins = that_may_begin(tried)
    if not begins:
        return []
    traces = [columns.model.difference(parts, candidate.part) for candidate in begins]
    channels, banded, base = columns.model.channels, columns.model.banded_residual(parts), columns.of_hypothesis(parts)
    p, every = problem(channels, banded, base), np.arange(len(base))
    fit = best_fitted(p, every, noise, channels)
    at_ease = adapted(p, every, fit.amplitude, calm(fit.noise, channels))
    under = [fit.noise] if at_ease == fit.noise else [fit.noise, at_ease]
    behind = [fit.log_evidence - fitted(p, every, one, rounds=0).log_evidence for one in under]
    return best_begins(channels, banded, base, under, begins, traces, temporary=temporary, behind=behind)


def that_may_begin(tried: Sequence[Candidate]) -> list[Candidate]:
    """Those of some candidates that may begin in the middle of a log."""
    return [c for c in tried if c.part.onset_s is None and ROWS[c.part.id].may_begin
            and not CATALOGUE[c.part.id].effect.onset_only
            and (ROWS[c.part.id].has_slope or ROWS[c.part.id].threshold)]


def best_begins(channels: Sequence[ChannelSeries], banded: dict[str, Array], base: Sequence[Column],
                under: Sequence[dict[str, Noise]], begins: Sequence[Candidate], traces: Sequence[dict[str, Array]],
                *, matters: float = MAY_MATTER, end_s: float = END_S, temporary: bool = False,
                behind: Sequence[float] = (0.0, 0.0)) -> list[ScoreTest]:
    """The same of series, however they were had. traces : what each candidate does all along, (m,) by channel.

    banded : cosine coefficients of the residual by channel. base : what the hypothesis can take up. under : noises, of
    which each candidate has the one that speaks most for it; behind : their log evidence, less than the best's by so
    much. matters : gain from which on more times are tried. end_s : from either end, where nothing is looked for.
    """
    best: dict[tuple[str, int | None, bool, bool], ScoreTest] = {}
    residuals = [WhitenedResidual(channels, banded, base, noise) for noise in under]
    for group in _alike(channels, begins, traces):
        time_s, scores = _scores(residuals, group, grows=False)
        within = (float(time_s[0]) + end_s, float(time_s[-1]) - end_s)
        linear = group.linear
        found = _begins(residuals, group, time_s, scores, within, matters, grows=False)
        if temporary and linear:
            found += _spans(residuals, group.only(linear), time_s, scores[:, linear], within, matters)
        if linear:
            group = group.only(linear)
            found += _begins(residuals, group, *_scores(residuals, group, grows=True), within, matters, grows=True)
        for at, one in found:
            one = one._replace(evidence=one.evidence - behind[at], gain=one.gain - 2.0 * behind[at])
            name = (one.part.id, one.part.member, one.part.grows, one.part.until_s is not None)
            if name not in best or one.evidence > best[name].evidence:
                best[name] = one
    return sorted(best.values(), key=lambda one: -one.evidence)


def _alike(channels: Sequence[ChannelSeries], tried: Sequence[Candidate],
           traces: Sequence[dict[str, Array]]) -> Iterator[Alike]:
    """Candidates gathered by the channels that they touch."""
    found: dict[tuple[tuple[int, ...], tuple[bool, ...]], list[int]] = {}
    touched = [tuple(k for k, c in enumerate(channels) if c.name in trace) for trace in traces]
    for k, (candidate, places) in enumerate(zip(tried, touched, strict=True)):
        if places:
            summed = tuple(adds_up(candidate.part, channels[place].name) for place in places)
            found.setdefault((places, summed), []).append(k)
    for (places, summed), ones in found.items():
        there = tuple(channels[place] for place in places)
        each = max(1, MOST_CELLS // sum(len(one.measured) for one in there))
        for begin in range(0, len(ones), each):
            some = ones[begin:begin + each]
            yield Alike(there, summed, tuple(tried[k] for k in some), tuple(
                np.array([traces[k][one.name] / tried[k].part.size for k in some]) for one in there))


def _likeliest(candidate: Candidate, score: Array, information: Array, places: int,
               at: Callable[[int], dict[str, Any]]) -> ScoreTest:
    """One candidate where it gains most, its evidence averaged over all places.

    score, information : at each place where it is looked for (n,), of so many `places`. at : the times of a place.
    """
    information = np.maximum(information, 1e-12)
    size = np.clip(score / information, candidate.low, candidate.high)
    if ROWS[candidate.part.id].threshold:       # half a threshold's column is not what half a threshold does
        size = np.full(len(score), candidate.part.size)
    gain = 2.0 * score * size - information * size ** 2
    log_odds = 0.5 * (gain - np.log1p(information * candidate.usual ** 2))
    # The log of a sum as it stands: scipy's logsumexp takes ten times as long, 2 % of a diagnosis of 24,000 rows.
    peak, best = float(log_odds.max()), int(np.argmax(gain))
    evidence = peak + float(np.log(np.sum(np.exp(log_odds - peak)) / places))
    return ScoreTest(candidate.part._replace(size=float(size[best]), **at(best)), float(gain[best]), evidence,
                     float(log_odds[best]) - evidence)


def _begins(residuals: Sequence[WhitenedResidual], group: Alike, time_s: Array, scores: Array,
            within: tuple[float, float], matters: float, grows: bool) -> list[tuple[int, ScoreTest]]:
    """The best time to begin of each candidate under each noise, at once or growing, with the noise's place.

    scores : of each, were it to begin at each time (noises, k, m).
    """
    inside = np.flatnonzero((time_s > within[0]) & (time_s < within[1]))
    if not len(inside):
        return []
    left = [(at, k) for at in range(len(residuals)) for k in range(len(group.ones))]
    found: dict[tuple[int, int], ScoreTest] = {}
    for count in TIMES:
        exact_s = np.linspace(*within, count)
        ones = sorted({k for _, k in left})
        for k, traces in zip(ones, _traces(group.only(ones), exact_s, grows), strict=True):
            for at in (at for at, one in left if one == k):
                rows, taken = _whitened(residuals[at], group, traces)
                exact = sum(np.einsum("ij,ij->i", whole, whole) for whole in rows) - np.sum(taken ** 2, axis=1)
                information = np.interp(time_s[inside], exact_s, exact)
                found[at, k] = _likeliest(group.ones[k], scores[at, k, inside], information, len(time_s),
                                          lambda best: {"onset_s": float(time_s[inside[best]]), "grows": grows})
        left = [one for one in left if found[one].gain >= matters]
        if not left:
            break
    return [(at, one) for (at, _), one in found.items()]


def _spans(residuals: Sequence[WhitenedResidual], group: Alike, time_s: Array, scores: Array,
           within: tuple[float, float], matters: float) -> list[tuple[int, ScoreTest]]:
    """The best times to begin and to end of those that gain something by coming and going, as `_begins` has them."""
    if within[1] - within[0] < 2.0 * MIN_SPAN_S:
        return []
    edges_s = np.linspace(*within, EDGES)
    under = _best_spans(residuals, group, time_s, scores, edges_s, BETWEEN)
    for at, found in enumerate(under):
        for k in np.argsort([-one.gain for one in found])[:FEW].tolist():
            one = found[k]
            if one.gain < matters:
                break
            apart_s = float(edges_s[1] - edges_s[0]) / BETWEEN
            for _ in range(2):
                assert one.part.onset_s is not None and one.part.until_s is not None
                apart_s /= FINER
                about_s = apart_s * np.arange(-FINER + 1, FINER)
                about_s = np.clip(np.concatenate([one.part.onset_s + about_s, one.part.until_s + about_s]), *within)
                [[finer]] = _best_spans(residuals[at:at + 1], group.only([k]), time_s, scores[at:at + 1, [k]],
                                        np.unique(about_s)) or [[one]]
                if finer is one:                    # the log is too short for two times so near
                    break
                spent = max(finer.spent + 2.0 * np.log(FINER), one.spent)
                one = found[k] = finer._replace(spent=spent, evidence=finer.evidence + finer.spent - spent)
    return [(at, one) for at, found in enumerate(under) for one in found if one.gain >= matters]


def _best_spans(residuals: Sequence[WhitenedResidual], group: Alike, time_s: Array, scores: Array, exact_s: Array,
                between: int = 1) -> list[list[ScoreTest]]:
    """Each candidate at the best of all pairs of times, by noise; nothing where no two are far enough apart.

    exact_s : at which inner products are had (edges,); between : so many times for each of these are tried, the
    products interpolated.
    """
    edges_s = np.interp(np.arange((len(exact_s) - 1) * between + 1) / between, np.arange(len(exact_s)), exact_s)
    shortest_s = MIN_SPAN_S if between == 1 else float(exact_s[1] - exact_s[0])     # interpolation is too coarse below
    begin, end = np.nonzero(edges_s[None, :] - edges_s[:, None] >= shortest_s)
    if not len(begin):
        return []
    found: list[list[ScoreTest]] = [[] for _ in residuals]
    for k, traces in enumerate(_traces(group, exact_s, grows=False)):
        for residual, score, tests in zip(residuals, scores[:, k], found, strict=True):
            rows, taken = _whitened(residual, group, traces)
            exact = sum(whole @ whole.T for whole in rows) - taken @ taken.T
            own = np.interp(edges_s, exact_s, np.diag(exact))
            half = np.array([np.interp(edges_s, exact_s, row) for row in exact])    # both ways: straight between times
            across = np.array([np.interp(edges_s, exact_s, row) for row in half.T])[end, begin]
            at_edges = np.interp(edges_s, time_s, score)
            information = own[begin] + own[end] - 2.0 * across
            tests.append(_likeliest(group.ones[k], at_edges[begin] - at_edges[end], information, len(begin),
                                    lambda best: {"onset_s": float(edges_s[begin[best]]),
                                                  "until_s": float(edges_s[end[best]])}))
    return found


def _scores(residuals: Sequence[WhitenedResidual], group: Alike, grows: bool) -> tuple[Array, Array]:
    """Times of the finest channel (m,), and by noise the sum of weighted residual x trace, were each to begin then:
    (noises, k, m)."""
    finest = max(group.channels, key=lambda c: len(c.grid.even_s))
    time_s = finest.grid.even_s
    scores = np.zeros((len(residuals), len(group.ones), len(time_s)))
    for residual, score in zip(residuals, scores, strict=True):
        for channel, unit, adds in zip(group.channels, group.units, group.summed, strict=True):
            sums = _sums_from(residual.weighted(channel), channel, unit.reshape(len(unit), channel.copies, -1), adds,
                              grows)
            score += sums if channel is finest else np.array([np.interp(time_s, channel.grid.even_s, row)
                                                              for row in sums])
    return time_s, scores


def _sums_from(weighted: Array, channel: ChannelSeries, trace: Array, summed: bool, grows: bool) -> Array:
    """Sum of weighted residual x trace, were it to begin at each sample: (k, m). trace : (k, copies, m)."""
    time_s = channel.grid.even_s
    if not grows:
        level = trace.sum(axis=1) * _ahead(weighted) if summed else 0.0
        return np.asarray(_ahead(weighted * trace) - level)
    if not summed:
        sums = _ahead(weighted * trace * time_s) - time_s * _ahead(weighted * trace)
    else:
        rate = np.diff(trace, prepend=trace[..., :1])
        moment, level = np.cumsum(rate * time_s, axis=-1), np.cumsum(rate, axis=-1)
        sums = _ahead(weighted * moment) - moment[:, 0] * _ahead(weighted)
        sums = sums - time_s * (_ahead(weighted * level) - level[:, 0] * _ahead(weighted))
    return np.asarray(sums / np.maximum(time_s[-1] - time_s, 1.0))


def _ahead(values: Array) -> Array:
    """Sum over copies of all samples from each one on: (..., m) of (..., copies, m)."""
    return np.asarray(np.cumsum(values[..., ::-1].sum(axis=-2), axis=-1)[..., ::-1])


def _traces(group: Alike, onsets_s: Array, grows: bool) -> Iterator[list[Array]]:
    """Of each candidate in turn, what one unit of it does that begins at each time, the same under every noise: cosine
    coefficients (onsets, m) by channel."""
    weights = [np.array([course(channel, EffectInstance("", 1.0, float(at), grows=grows)) for at in onsets_s])
               for channel in group.channels]
    for k in range(len(group.ones)):
        yield [coefficients(with_course(unit[k], weight, channel.copies, adds), channel.cut) for
               channel, unit, weight, adds in zip(group.channels, group.units, weights, group.summed, strict=True)]


def _whitened(residual: WhitenedResidual, group: Alike, traces: Sequence[Array]) -> tuple[list[Array], Array]:
    """Traces of a candidate whitened (onsets, m) by channel, and what the hypothesis takes up of them, in its basis
    (onsets, columns)."""
    found = [residual.white(channel, trace) for channel, trace in zip(group.channels, traces, strict=True)]
    return [white for white, _ in found], np.sum([own for _, own in found], axis=0)
