"""What no catalogued effect explains: smooth structure of a stage along a recorded variable."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.machine.elements import Table as Nodes

from .likelihood import fitted, power_left
from .noise import Noise
from .null import slow_share
from .search import Group, Refit
from .sensitivities import FORM_CHANNEL
from .smooth import LEAST_RANGE, SHAPES, TABLES, Span, shape, span

OPEN_THRESHOLD = 30.0       # of twice the log-likelihood for SHAPES shapes, over all stages and variables
LEAST_SHARE = 0.005         # of what is left; a structure below this and below LEAST_FIELD_PERCENT is nobody's worry
LEAST_FIELD_PERCENT = 0.1   # of the dose
TIME_FACTOR = 2.0           # slow noise is smooth in time by its nature
SLOW_ENERGY = 0.5           # of a structure, in bands where the slow noise is stronger than the fast
DRIFT_LEFT = 0.2            # of the slow noise's variance, once the structure is taken out
OPEN_SHARE = 0.03           # of what the named causes explain: their forms are never quite right

# Recorded variables that follow a stage's own reading, so that its noise comes back through them. Control sets shaft
# and gate by the measured speed, and by the scale through the flow trim; shaft_rpm and opening_mm are the commands
# (drives see them before they answer). A gate knows nothing of the shaft; the shaft bears the load of the opening.
DOWNSTREAM: dict[str, frozenset[str]] = {
    "shaft": frozenset(),
    "gate": frozenset({"shaft_rpm"}),
    "flow": frozenset(),
    "scale": frozenset({"hopper_kg", "shaft_rpm", "opening_mm"}),
    "speed": frozenset({"speed_mps", "shaft_rpm", "opening_mm"}),
}


class Table(NamedTuple):
    """A smooth nameless dependence of one stage on one variable."""

    stage: str
    variable: str
    gain: float                 # of twice the log-likelihood
    nodes: Nodes
    values: Nodes               # in the unit of the stage's table
    explained_share: float      # of what the named causes and the tolerances leave, as variance
    field_percent: float        # of the dose, r.m.s. over the working rows; a scale's error moves no dose
    slow_noise: bool = False    # as slow as the channel's drift, which remains without it


def best_table(group: Group, now: Refit) -> Table | None:
    """The strongest smooth dependence left at a hypothesis, over every stage of the group and recorded variable."""
    best: Table | None = None
    for stage in TABLES:
        if FORM_CHANNEL[stage] not in group.names:
            continue
        for variable in LEAST_RANGE:
            if variable in DOWNSTREAM[stage]:
                continue
            found = _table(group, now, stage, variable)
            if found is not None and not found.slow_noise and (best is None or found.gain > best.gain):
                best = found
    return best


def significant(table: Table, explained: float) -> bool:
    """Whether a dependence is worth a verdict. `explained`: gain of the named causes, twice the log-likelihood."""
    if table.explained_share < LEAST_SHARE and table.field_percent < LEAST_FIELD_PERCENT:
        return False
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
    series = np.asarray(sum(w * c.coefficients[name] for w, c in zip(weights, columns, strict=True)))
    left = power_left(p, name, fixed, plain.amplitude)
    share = float(np.clip(np.sum(series ** 2) / max(1e-300, left), 0.0, 1.0))
    return Table(stage, variable, 2.0 * (full.log_likelihood - plain.log_likelihood), over.nodes,
                 tuple(values.tolist()), share, _field_percent(group, stage, over, values),
                 _slow_noise(group, name, series, plain.noise[name], full.noise[name]))


def _slow_noise(group: Group, name: str, series: npt.NDArray[np.float64], before: Noise, after: Noise) -> bool:
    """Whether a structure lives where the slow noise does and the slow noise is there with it as without it.

    Drift is a few slow waves over the length of a log, and four smooth shapes of anything that itself changes slowly
    follow some of them; a dependence that is really there leaves no drift behind.
    """
    channel = next(c for c in group.channels if c.name == name)
    slow = slow_share(series, channel, before) > SLOW_ENERGY
    return slow and after.slow_sd ** 2 > DRIFT_LEFT * before.slow_sd ** 2


def _field_percent(group: Group, stage: str, over: Span, values: npt.NDArray[np.float64]) -> float:
    """R.m.s. of a table over the working rows, less its mean, as per cent of the dose."""
    variables, working = group.data.variables, group.data.working > 0.0
    if stage == "scale" or not working.any():
        return 0.0
    wrong = np.interp(variables[over.variable][working], over.nodes, values)
    if stage == "gate":
        wrong = 100.0 * wrong / np.maximum(1.0, variables["opening_mm"][working])
    return float(np.std(wrong))
