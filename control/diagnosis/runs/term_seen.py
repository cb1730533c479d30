"""A term as it is shown: how it runs along each of its variables, and what the data themselves say there."""
from __future__ import annotations

import numpy as np
import numpy.typing as npt

from control.machine.terms import Term, own_command

from .dictionary import ActedOn
from .search import FittedHypothesis, Search
from .stages import RunData
from .terms import FittedTerm, series_of_term

Array = npt.NDArray[np.float64]
Eight = tuple[float, float, float, float, float, float, float, float]

CLASSES = 12                # of a variable, for means
NODES = 8


def marginal(term: Term, variable: str, data: RunData) -> tuple[Eight, Eight]:
    """Eight places along one of a term's variables and its mean there in the log."""
    values = data.inputs[own_command(term.stage, variable)]
    low, high = (float(v) for v in np.percentile(values, (1.0, 99.0)))
    nodes = np.linspace(low, high, NODES)
    nearest = np.clip(np.round((values - low) / max(high - low, 1e-12) * (NODES - 1)), 0, NODES - 1).astype(int)
    series = series_of_term(term, data)
    count = np.bincount(nearest, minlength=NODES)
    mean = np.bincount(nearest, weights=series, minlength=NODES) / np.maximum(1, count)
    known = count > 0
    found = np.interp(nodes, nodes[known], mean[known])
    return _eight(nodes), _eight(found)


def _eight(numbers: Array) -> Eight:
    a, b, c, d, e, f, g, h = (float(one) for one in numbers)
    return a, b, c, d, e, f, g, h


def means_along(search: Search, now: FittedHypothesis, found: FittedTerm,
                data: RunData) -> tuple[tuple[float, float, float], ...]:
    """By classes of the term's first variable (of a product: of what the term says): place, the data's own mean, the
    term's mean.

    The data's mean is what the channel leaves once the hypothesis is fitted, in the unit of what the term acts on:
    least squares of one constant for each class.
    """
    acted = ActedOn(search.model, now.parts, found.term.acts_on)
    channel = acted.channel
    values = series_of_term(found.term, data)
    along = values if len(found.tried.over) > 1 else data.inputs[own_command(found.stage, found.tried.over[0])]
    edges = np.unique(np.percentile(along, np.linspace(0.0, 100.0, CLASSES + 1)))
    if len(edges) < 3:
        return ()
    place = np.clip(np.searchsorted(edges, along, side="right") - 1, 0, len(edges) - 2)
    inside = np.array([place == k for k in range(len(edges) - 1)], dtype=np.float64)
    columns = acted.of(inside)
    white = 1.0 / max(1e-12, found.noise[channel.name].fast_sd)
    left = search.model.residual(now.parts)[channel.name]
    if channel.name == "scale":                 # a level adds up: its changes say what flowed
        columns, left = np.diff(columns, axis=1), np.diff(left)
    normal = columns @ columns.T * white ** 2 + 1e-9 * np.eye(len(columns))
    mean = np.linalg.solve(normal, columns @ left * white ** 2)
    count = np.maximum(1.0, inside.sum(axis=1))
    said = inside @ values / count
    return tuple(zip((inside @ along / count).tolist(), mean.tolist(), said.tolist(), strict=True))
