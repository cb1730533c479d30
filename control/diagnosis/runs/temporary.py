"""Effects that come and go again within a log: all beginnings and ends of a grid tried at once, then finer ones.

As changes.py: the gain of an effect that is there from a to b is (score from a - score from b)^2 / information, and the
information is had from the inner products of what begins at a with what begins at b.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp

from control.diagnosis.effects import ROWS

from .changepoint import Alike, WhitenedResidual, rows_from_onset
from .search import ScoreTest

Array = npt.NDArray[np.float64]

EDGES = 13                  # times of a log at which a best_temporary may begin or end at first
FEW = 4                     # best of those that touch the same channels, that are tried at finer times
BETWEEN = 12                # times tried for each of these
LEVELS = 2                  # of finer times ...
FINER = 4                   # ... each so many times finer
MIN_SPAN_S = 20.0           # of an effect that ends again: less is one stretch of the log, which is no evidence


def best_temporary(ground: WhitenedResidual, group: Alike, time_s: Array, score: Array, matters: float,
                   end_s: float) -> list[ScoreTest]:
    """The best times to begin and to end for candidates that touch the same channels in the same way.

    time_s, score : of group, were each to begin at each sample (m,), (k, m). matters : gain of twice the log-likelihood
    from which on finer times are tried. end_s : from either end of the log, within which nothing begins or ends.
    """
    first_s, last_s = float(time_s[0]) + end_s, float(time_s[-1]) - end_s
    if last_s - first_s < 2.0 * MIN_SPAN_S:
        return []
    may = [not ROWS[one.candidate.part.id].threshold for one in group.ones]
    group, score = group.only(may), score[may]
    edges_s = np.linspace(first_s, last_s, EDGES)
    found = _best(ground, group, time_s, score, edges_s, BETWEEN) if group.ones else []
    for k in np.argsort([-one.gain for one in found])[:FEW].tolist():
        one = found[k]
        if one.gain >= matters:
            only = [j == k for j in range(len(found))]
            apart_s = float(edges_s[1] - edges_s[0]) / BETWEEN
            for _ in range(LEVELS):
                about_s = np.clip(_about(one, apart_s), first_s, last_s)
                finer = _best(ground, group.only(only), time_s, score[only], np.unique(about_s))[0]
                if finer.part.onset_s is None:      # the log is too short for two times so near
                    break
                spent = max(finer.spent + 2.0 * np.log(FINER), one.spent) if finer is not one else one.spent
                one = found[k] = finer._replace(spent=spent, evidence=finer.evidence + finer.spent - spent)
                apart_s /= FINER
    return [one for one in found if one.gain >= matters]


def _about(one: ScoreTest, apart_s: float) -> Array:
    """Times about a best_temporary's beginning and end. apart_s : those tried before."""
    assert one.part.onset_s is not None and one.part.until_s is not None
    finer_s = apart_s / FINER * np.arange(-FINER + 1, FINER)
    return np.concatenate([one.part.onset_s + finer_s, one.part.until_s + finer_s])


def _best(ground: WhitenedResidual, group: Alike, time_s: Array, score: Array, exact_s: Array,
          between: int = 1) -> list[ScoreTest]:
    """Each candidate at the best of all pairs of times. exact_s : at which inner products are had (edges,); between :
    so many times for each of these are tried, the inner products interpolated."""
    rows, taken = rows_from_onset(ground, group, exact_s, grows=False)
    edges_s = np.interp(np.arange((len(exact_s) - 1) * between + 1) / between, np.arange(len(exact_s)), exact_s)
    shortest_s = MIN_SPAN_S if between == 1 else float(exact_s[1] - exact_s[0])     # interpolation is too coarse below
    begin, end = np.nonzero(edges_s[None, :] - edges_s[:, None] >= shortest_s)
    if not len(begin):
        return [ScoreTest(one.candidate.part, -np.inf, -np.inf) for one in group.ones]
    found = []
    for k, one in enumerate(group.ones):
        exact = sum(whole[k] @ whole[k].T for whole in rows) - taken[k] @ taken[k].T
        own = np.interp(edges_s, exact_s, np.diag(exact))
        across = exact[begin, end] if between == 1 else _inner(exact_s, exact, edges_s[begin], edges_s[end])
        information = np.maximum(own[begin] + own[end] - 2.0 * across, 1e-12)
        at_edges = np.interp(edges_s, time_s, score[k])
        pulled = at_edges[begin] - at_edges[end]
        size = np.clip(pulled / information, one.candidate.low, one.candidate.high)
        gain = 2.0 * pulled * size - information * size ** 2
        at = int(np.argmax(gain))
        log_odds = 0.5 * (gain - np.log1p(information * group.usual[k] ** 2))
        evidence = float(logsumexp(log_odds)) - float(np.log(len(begin)))
        found.append(ScoreTest(one.candidate.part._replace(
            size=float(size[at]), onset_s=float(edges_s[begin[at]]), until_s=float(edges_s[end[at]])), float(gain[at]),
            evidence, float(log_odds[at]) - evidence))
    return found


def _inner(times_s: Array, exact: Array, begin_s: Array, end_s: Array) -> Array:
    """Inner products (times, times) straight between their times. Not scipy.interpolate's, which takes a tenth of a
    second to load."""
    (row, below), (column, left) = _place(times_s, begin_s), _place(times_s, end_s)
    return np.asarray(exact[row, column] * (1.0 - below) * (1.0 - left) + exact[row, column + 1] * (1.0 - below) * left
                      + exact[row + 1, column] * below * (1.0 - left) + exact[row + 1, column + 1] * below * left)


def _place(times_s: Array, at_s: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """The time before each, and how far it is on the way to the next one."""
    before = np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, len(times_s) - 2)
    return before, (at_s - times_s[before]) / (times_s[before + 1] - times_s[before])
