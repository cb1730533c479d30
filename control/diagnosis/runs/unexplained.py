"""What no catalogued effect explains: smooth structure of a stage along a recorded variable."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.machine.elements import Table as Nodes

from .evidence import scores, slow_share, spread_over, without_best_block
from .likelihood import Column, Fit, Problem, best_fitted, power_left
from .noise import Noise
from .nuisances import FORM_CHANNEL
from .search import Group, Refit
from .smooth import MIN_RANGE, SHAPES, TABLES, Span, shape, span

OPEN_THRESHOLD = 30.0       # of twice the log-likelihood for SHAPES shapes, over all stages and variables
MIN_SHARE = 0.005         # of what is left; a structure below this and below MIN_FIELD_PERCENT is nobody's worry
MIN_FIELD_PERCENT = 0.1   # of the dose
TIME_FACTOR = 2.0           # slow noise is smooth in time by its nature ...
TIME_TIE = 0.7              # of the gain over the hopper's level, from which on the time is named in its place
TIME_LIKE = frozenset({"time_s", "hopper_kg"})      # ... and in what only falls with time
SLOW_ENERGY = 0.5           # of a structure, in bands where the slow noise is stronger than the fast
DRIFT_LEFT = 0.2            # of the slow noise's variance, once the structure is taken out
SHIFTS = 7                  # of a slow variable along the log: what it gains then is what drift gives
SHIFT_MARGIN = 1.5          # times the most that it gains then
MIN_WITHOUT_BLOCK = 0.4   # of the evidence, once the best block is left out
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
    slow: bool = False          # as slow as the channel's drift
    slow_noise: bool = False    # ... which remains once it is taken out
    trace: Column = Column("", {}, np.inf)      # what it does to its channel


def best_table(group: Group, now: Refit) -> Table | None:
    """The strongest smooth dependence left at a hypothesis, over every stage of the group and recorded variable.

    A hopper that only empties tells the time: of the two, nearly as good, the plain one is named.
    """
    in_steps = group.data.shaft is not None and group.data.shaft.step > 0.0     # rounding is a dependence of its own
    tried = [_table(group, now, stage, variable) for stage in TABLES
             if FORM_CHANNEL[stage] in group.names and not (stage == "shaft" and in_steps)
             for variable in MIN_RANGE if variable not in DOWNSTREAM[stage]]
    found = [table for table in tried if table is not None and not table.slow_noise]
    best = max(found, key=lambda table: table.gain, default=None)
    if best is not None and best.variable == "hopper_kg":
        return next((table for table in found if table.stage == best.stage and table.variable == "time_s"
                     and table.gain > TIME_TIE * best.gain), best)
    return best


def unexplained(group: Group, now: Refit, explained: float) -> Table | None:
    """The strongest dependence left, where it is worth a verdict and shows all over the log."""
    table = best_table(group, now)
    if table is None or not significant(table, explained) or not holds(group, now, table, explained):
        return None
    return table


def significant(table: Table, explained: float) -> bool:
    """Whether a dependence is worth a verdict. `explained`: gain of the named causes, twice the log-likelihood."""
    if table.explained_share < MIN_SHARE and table.field_percent < MIN_FIELD_PERCENT:
        return False
    factor = TIME_FACTOR if table.variable in TIME_LIKE else 1.0
    return table.gain > factor * max(OPEN_THRESHOLD, OPEN_SHARE * explained)


def holds(group: Group, now: Refit, table: Table, explained: float) -> bool:
    """Whether a dependence shows all over the log, and not in a stretch or at a few moments of it.

    One as slow as drift must gain more than it does with its variable moved along the log, where it can mean nothing.
    """
    seen = scores(group, now.parts, now.noise, [table.trace])
    whole = float(seen.score.sum() ** 2 / max(float(seen.energy.sum()), 1e-12))
    least = max(OPEN_THRESHOLD, OPEN_SHARE * explained)
    if without_best_block(seen, 0) < MIN_WITHOUT_BLOCK * whole or table.gain < least * spread_over(seen, 0):
        return False
    if not table.slow or table.variable in TIME_LIKE:
        return True
    return table.gain > SHIFT_MARGIN * gain_elsewhere(group, now, table.stage, table.variable)


def gain_elsewhere(group: Group, now: Refit, stage: str, variable: str) -> float:
    """The most that a stage's dependence on a variable gains with the variable moved along the log."""
    return max(_moved_gain(group, now, stage, variable, k / (SHIFTS + 1.0)) for k in range(1, SHIFTS + 1))


def _moved_gain(group: Group, now: Refit, stage: str, variable: str, share: float) -> float:
    """Gain of a dependence once its variable is moved along the log by a share of it, round the end."""
    columns = group.moved_forms(stage, variable, share)
    if not columns:
        return 0.0
    _, plain, full = _without_and_with(group, now, columns)
    return 2.0 * (full.log_likelihood - plain.log_likelihood)


def _without_and_with(group: Group, now: Refit, columns: Sequence[Column]) -> tuple[Problem, Fit, Fit]:
    """A hypothesis and `columns` as one problem, fitted without and with the columns, which come last."""
    p, before = group.compressed(now.parts, columns)
    plain = best_fitted(p, np.arange(before), now.noise, group.channels)
    return p, plain, best_fitted(p, np.arange(before + len(columns)), plain.noise, group.channels)


def _table(group: Group, now: Refit, stage: str, variable: str) -> Table | None:
    columns = group.forms(stage, variable)
    over = span(group.data, variable)
    if not columns or over is None:
        return None
    p, plain, full = _without_and_with(group, now, columns)
    weights = full.amplitude[len(plain.amplitude):]
    values = np.array([shape(k) for k in range(1, SHAPES + 1)]).T @ weights
    name = FORM_CHANNEL[stage]
    series = np.asarray(sum(w * c.coefficients[name] for w, c in zip(weights, columns, strict=True)))
    left = power_left(p, name, np.arange(len(plain.amplitude)), plain.amplitude)
    share = float(np.clip(np.sum(series ** 2) / max(1e-300, left), 0.0, 1.0))
    return Table(stage, variable, 2.0 * (full.log_likelihood - plain.log_likelihood), over.nodes,
                 tuple(values.tolist()), share, _field_percent(group, stage, over, values),
                 *_slow_noise(group, name, series, plain.noise[name], full.noise[name]),
                 Column(f"{stage} over {variable}", {name: series}, np.inf))


def _slow_noise(group: Group, name: str, series: npt.NDArray[np.float64], before: Noise,
                after: Noise) -> tuple[bool, bool]:
    """Whether a structure lives where the slow noise does, and whether that is there with it as without it.

    Drift is a few slow waves over the length of a log, and four smooth shapes of anything that itself changes slowly
    follow some of them; a dependence that is really there leaves no drift behind.
    """
    slow = slow_share(series, group.channel(name), before) > SLOW_ENERGY
    return slow, slow and after.slow_sd ** 2 > DRIFT_LEFT * before.slow_sd ** 2


def _field_percent(group: Group, stage: str, over: Span, values: npt.NDArray[np.float64]) -> float:
    """R.m.s. of a table over the working rows, less its mean, as per cent of the dose."""
    variables, working = group.data.variables, group.data.working > 0.0
    if stage == "scale" or not working.any():
        return 0.0
    wrong = np.interp(variables[over.variable][working], over.nodes, values)
    if stage == "gate":
        wrong = 100.0 * wrong / np.maximum(1.0, variables["opening_mm"][working])
    return float(np.std(wrong))
