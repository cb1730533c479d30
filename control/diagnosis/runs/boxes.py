"""Effects that come and go again within a log: all beginnings and ends of a grid tried at once, then finer ones.

As changes.py: the gain of an effect that is there from a to b is (pull from a - pull from b)^2 / information, and the
information is had from the inner products of what begins at a with what begins at b.
"""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.diagnosis.effects import ROWS

from .begun import Alike, Ground, begun_rows
from .search import Scanned

Array = npt.NDArray[np.float64]

EDGES = 13                  # times of a log at which a box may begin or end at first
FEW = 4                     # best of those that touch the same channels, that are tried at finer times
LEVELS = 2                  # of finer times ...
FINER = 4                   # ... each so many times finer
MIN_SPAN_S = 20.0           # of an effect that ends again: less is one stretch of the log, which is no evidence


def box(ground: Ground, group: Alike, time_s: Array, pull: Array, matters: float, end_s: float) -> list[Scanned]:
    """The best times to begin and to end for candidates that touch the same channels in the same way.

    time_s, pull : of group, were each to begin at each sample (m,), (k, m). matters : gain of twice the log-likelihood
    from which on finer times are tried. end_s : from either end of the log, within which nothing begins or ends.
    """
    first_s, last_s = float(time_s[0]) + end_s, float(time_s[-1]) - end_s
    if last_s - first_s < 2.0 * MIN_SPAN_S:
        return []
    may = [not ROWS[one.candidate.part.id].threshold for one in group.ones]
    group, pull = group.only(may), pull[may]
    edges_s = np.linspace(first_s, last_s, EDGES)
    found = _best(ground, group, time_s, pull, edges_s) if group.ones else []
    for k in np.argsort([-one.gain for one in found])[:FEW].tolist():
        one = found[k]
        if one.gain >= matters:
            only = [j == k for j in range(len(found))]
            apart_s = float(edges_s[1] - edges_s[0])
            for _ in range(LEVELS):
                about_s = np.clip(_about(one, apart_s), first_s, last_s)
                one = found[k] = _best(ground, group.only(only), time_s, pull[only], np.unique(about_s))[0]
                apart_s /= FINER
    return [one for one in found if one.gain >= matters]


def _about(one: Scanned, apart_s: float) -> Array:
    """Times about a box's beginning and end. apart_s : those tried before."""
    assert one.part.onset_s is not None and one.part.until_s is not None
    finer_s = apart_s / FINER * np.arange(-FINER + 1, FINER)
    return np.concatenate([one.part.onset_s + finer_s, one.part.until_s + finer_s])


def _best(ground: Ground, group: Alike, time_s: Array, pull: Array, edges_s: Array) -> list[Scanned]:
    """Each candidate at the best of all pairs of times (edges,)."""
    rows, taken = begun_rows(ground, group, edges_s, grows=False)
    begin, end = np.nonzero(edges_s[None, :] - edges_s[:, None] >= MIN_SPAN_S)
    found = []
    for k, one in enumerate(group.ones):
        inner = sum(whole[k] @ whole[k].T for whole in rows) - taken[k] @ taken[k].T
        own = np.diag(inner)
        information = np.maximum(own[begin] + own[end] - 2.0 * inner[begin, end], 1e-12)
        at_edges = np.interp(edges_s, time_s, pull[k])
        pulled = at_edges[begin] - at_edges[end]
        size = np.clip(pulled / information, one.candidate.low, one.candidate.high)
        gain = 2.0 * pulled * size - information * size ** 2
        at = int(np.argmax(gain))
        found.append(Scanned(one.candidate.part._replace(
            size=float(size[at]), onset_s=float(edges_s[begin[at]]), until_s=float(edges_s[end[at]])), float(gain[at])))
    return found
