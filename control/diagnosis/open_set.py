"""What no catalogued effect explains: smooth structure of a stage along a recorded variable."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from control.machine.elements import Table as Nodes

from .likelihood import fitted
from .search import Group, Refit
from .sensitivities import FORM_CHANNEL
from .smooth import LEAST_RANGE, SHAPES, TABLES, shape, span

OPEN_THRESHOLD = 30.0       # of twice the log-likelihood for SHAPES shapes, over all stages and variables
OWN = {("speed", "speed_mps"), ("scale", "hopper_kg")}     # a channel against its own reading
TIME_FACTOR = 2.0           # slow noise is smooth in time by its nature
OPEN_SHARE = 0.03           # of what the named causes explain: their forms are never quite right


class Table(NamedTuple):
    """A smooth nameless dependence of one stage on one variable."""

    stage: str
    variable: str
    gain: float                 # of twice the log-likelihood
    nodes: Nodes
    values: Nodes               # in the unit of the stage's table
    explained_share: float      # of the residual's variance


def best_table(group: Group, now: Refit) -> Table | None:
    """The strongest smooth dependence left at a hypothesis, over every stage of the group and recorded variable."""
    best: Table | None = None
    for stage in TABLES:
        if FORM_CHANNEL[stage] not in group.names:
            continue
        for variable in LEAST_RANGE:
            if (stage, variable) in OWN:
                continue
            found = _table(group, now, stage, variable)
            if found is not None and (best is None or found.gain > best.gain):
                best = found
    return best


def significant(table: Table, explained: float) -> bool:
    factor = TIME_FACTOR if table.variable == "time_s" else 1.0
    return table.gain > factor * max(OPEN_THRESHOLD, OPEN_SHARE * explained)


def _table(group: Group, now: Refit, stage: str, variable: str) -> Table | None:
    columns = group.forms(stage, variable)
    over = span(group.data, variable)
    if not columns or over is None:
        return None
    p, before = group.compressed(now.parts, columns)
    fixed = np.arange(before)
    plain = fitted(p, fixed, now.noise, rounds=1)
    full = fitted(p, np.arange(before + SHAPES), plain.noise, rounds=2)
    weights = full.amplitude[before:]
    values = np.array([shape(k) for k in range(1, SHAPES + 1)]).T @ weights
    name = FORM_CHANNEL[stage]
    series = sum(w * c.coefficients[name] for w, c in zip(weights, columns, strict=True))
    left = group.data_of(now.parts)[name]
    share = float(np.clip(np.sum(np.asarray(series) ** 2) / max(1e-300, float(np.sum(left ** 2))), 0.0, 1.0))
    return Table(stage, variable, 2.0 * (full.log_likelihood - plain.log_likelihood), over.nodes,
                 tuple(values.tolist()), share)
