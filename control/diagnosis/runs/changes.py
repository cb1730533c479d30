"""Effects that begin, grow or end somewhere in a log: every time of beginning tried at once.

The score test for a change point (Picard 1985, Advances in Applied Probability 17, 841; Andrews 1993, Econometrica 61,
821): the gain of an effect that begins at t is (sum of residual x trace from t on)^2 / information, the residual
weighted with the inverse of the noise's covariance. The sums are cumulative, so that one pass gives them for all t; the
information changes slowly with t and is had exactly at a few times. A drift can follow a step well, but not its edge:
the time must be exact for the step to tell.
"""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from control.diagnosis.effects import ROWS
from control.diagnosis.judgement.evidence import (
    Column,
    Problem,
    adapted,
    best_fitted,
    calm,
    fitted,
    problem,
    solved,
    taken_off,
)
from control.diagnosis.judgement.noise import Noise
from control.machine.machine import CATALOGUE

from .changepoint import Alike, WhitenedResidual, alike, rows_from_onset, scores_by_onset, whitened_residual
from .channels import ChannelSeries
from .columns import Columns
from .hypothesis import Hypothesis
from .search import Candidate, ScoreTest
from .temporary import best_temporary

Array = npt.NDArray[np.float64]

TIMES = 8                   # at which the information is had exactly ...
FEW_TIMES = 3               # ... once it is had at these and the gain may matter
MAY_MATTER = 6.0            # of twice the log-likelihood
MOST_CELLS = 1_000_000      # of one sample each: candidates are looked at side by side
END_S = 8.0                 # from either end of the log: no change point is looked for there


def changes(columns: Columns, parts: Hypothesis, noise: dict[str, Noise], tried: Sequence[Candidate],
            temporary: bool = False) -> list[ScoreTest]:
    """Every candidate with the best time to begin, at once and growing: best gain first, noise as given and calm.

    The gain is of twice the log-likelihood under a noise that is not fitted again. temporary : with temporary
    effects, each with the best times to begin and to end.
    """
    begins = that_may_begin(tried)
    if not begins:
        return []
    traces = [columns.model.difference(parts, candidate.part) for candidate in begins]
    channels, banded, base = columns.model.channels, columns.model.banded_residual(parts), columns.of_hypothesis(parts)
    p = problem(channels, banded, base)
    fit = best_fitted(p, np.arange(len(base)), noise, channels)
    at_ease = adapted(p, np.arange(len(base)), fit.amplitude, calm(fit.noise, channels))
    under = [fit.noise] if at_ease == fit.noise else [fit.noise, at_ease]
    behind = [fit.log_evidence - fitted(p, np.arange(len(base)), one, rounds=0).log_evidence for one in under]
    return best_begins(p, channels, banded, base, under, begins, traces, temporary=temporary, behind=behind)


def that_may_begin(tried: Sequence[Candidate]) -> list[Candidate]:
    """Those of some candidates that may begin in the middle of a log."""
    return [c for c in tried if c.part.onset_s is None and ROWS[c.part.id].may_begin
            and not CATALOGUE[c.part.id].effect.onset_only
            and (ROWS[c.part.id].has_slope or ROWS[c.part.id].threshold)]


def best_begins(p: Problem, channels: Sequence[ChannelSeries], banded: dict[str, Array], base: Sequence[Column],
                under: Sequence[dict[str, Noise]], begins: Sequence[Candidate], traces: Sequence[dict[str, Array]],
                matters: float = MAY_MATTER, end_s: float = END_S, temporary: bool = False,
                behind: Sequence[float] = (0.0, 0.0)) -> list[ScoreTest]:
    """The same of series, however they were had. traces : what each candidate does all along, (m,) by channel.

    banded : cosine coefficients of the residual by channel. base : what the hypothesis can take up. p : both as one
    problem. under : noises, of which each candidate has the one that speaks most for it. matters : gain from which on
    the information is had at more times. end_s : from either end, within which nothing is looked for.
    """
    best: dict[tuple[str, int | None, bool, bool], ScoreTest] = {}
    for noise, less in zip(under, behind, strict=False):
        amplitude, _ = solved(p, np.arange(len(base)), noise)
        ground = whitened_residual(channels, taken_off(banded, base, amplitude), base, noise)
        found = []
        for group in alike(ground, begins, traces, MOST_CELLS):
            time_s, score = scores_by_onset(group, grows=False)
            found += _from_onsets(ground, group, time_s, score, False, matters, end_s)
            if temporary:
                found += best_temporary(ground, group, time_s, score, matters, end_s)
            growing = group.only([not ROWS[one.candidate.part.id].threshold for one in group.ones])
            if growing.ones:
                found += _from_onsets(ground, growing, *scores_by_onset(growing, grows=True), True, matters, end_s)
        for one in (each._replace(evidence=each.evidence - less, gain=each.gain - 2.0 * less) for each in found):
            name = (one.part.id, one.part.member, one.part.grows, one.part.until_s is not None)
            if name not in best or one.evidence > best[name].evidence:
                best[name] = one
    return sorted(best.values(), key=lambda one: -one.evidence)


def _from_onsets(ground: WhitenedResidual, group: Alike, time_s: Array, score: Array, grows: bool, matters: float,
           end_s: float) -> list[ScoreTest]:
    """The best time to begin for candidates that touch the same channels in the same way."""
    inside = (time_s > time_s[0] + end_s) & (time_s < time_s[-1] - end_s)
    if not inside.any():
        return []
    left = np.arange(len(group.ones))
    found: dict[int, ScoreTest] = {}
    usual = group.usual
    for count in (FEW_TIMES, TIMES):
        exact_s = np.linspace(time_s[0] + end_s, time_s[-1] - end_s, count)
        exact = _information(ground, group.only(np.isin(np.arange(len(group.ones)), left).tolist()), exact_s, grows)
        more = []
        for k, line in zip(left.tolist(), exact, strict=True):
            information = np.maximum(np.interp(time_s, exact_s, line), 1e-12)
            found[k] = _at_best(group.ones[k].candidate, score[k], information, inside, time_s, grows, usual[k])
            if found[k].gain >= matters:
                more.append(k)
        left = np.array(more, int)
        if not more:
            break
    return [found[k] for k in range(len(group.ones))]


def _at_best(candidate: Candidate, score: Array, information: Array, inside: npt.NDArray[np.bool_], time_s: Array,
             grows: bool, usual: float) -> ScoreTest:
    """One candidate at its best time, its evidence averaged over all times. score, information : were it to begin at
    each sample (m,). usual : s.d. of its size's prior."""
    size = np.clip(score / information, candidate.low, candidate.high)
    if ROWS[candidate.part.id].threshold:       # half a threshold's column is not what half a threshold does
        size = np.full(len(time_s), candidate.part.size)
    gain = np.where(inside, 2.0 * score * size - information * size ** 2, -np.inf)
    at = int(np.argmax(gain))
    log_odds = np.where(inside, 0.5 * (gain - np.log1p(information * usual ** 2)), -np.inf)
    evidence = float(logsumexp(log_odds)) - float(np.log(len(time_s)))
    return ScoreTest(candidate.part._replace(size=float(size[at]), onset_s=float(time_s[at]), grows=grows),
                   float(gain[at]), evidence, float(log_odds[at]) - evidence)


def _information(ground: WhitenedResidual, group: Alike, onsets_s: Array, grows: bool) -> Array:
    """Information on sizes by onset, (k, onsets), once the hypothesis has taken up what it can."""
    rows, taken = rows_from_onset(ground, group, onsets_s, grows)
    own = sum(np.einsum("kij,kij->ki", whole, whole) for whole in rows)
    return np.asarray(own - np.sum(taken ** 2, axis=2))
