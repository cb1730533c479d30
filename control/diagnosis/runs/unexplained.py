"""What no catalogued effect explains: smooth structure of a stage along a recorded variable."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.machine.elements import Table as Nodes

from .channels import ChannelSeries
from .columns import Columns
from .evidence import scores, slow_share, spread_over, without_best_block
from .likelihood import Column, Fit, Label, Problem, Role, best_fitted, fitted, power_left
from .noise import Noise
from .search import Refit
from .smooth import SHAPES, TABLES, Span, shape, span, variables_of
from .stages import RunData

Array = npt.NDArray[np.float64]

# Gains are of twice the log-likelihood; the floors were set on the tuning half of the benchmark (docs/diagnosis.md).
OPEN_THRESHOLD = 30.0       # for SHAPES shapes, the largest over all stages and variables
OPEN_SHARE = 0.03           # of what the named causes explain: their forms are never quite right
TIME_FACTOR = 2.0           # factor on both for variables over which slow noise looks smooth
WALK_FACTOR = 2.0           # factor on both where what is metered between the rows is not in the log
TIME_LIKE = frozenset({"time_s", "hopper_kg"})      # these are: time, and what only falls with time
TIME_TIE = 0.7              # time is named instead of the hopper's level from this share of its gain on

# Below both of these a structure does not matter.
MIN_SHARE = 0.005           # of the variance left
MIN_FIELD_PERCENT = 0.1     # of the dose

# Whether it shows all over the log (`holds`), and whether it is drift (`as_drift`).
MIN_WITHOUT_BLOCK = 0.4     # share of the evidence that must be left without the block with most of it
SLOW_ENERGY = 0.5           # of a structure, in bands where the slow noise is stronger than the fast
DRIFT_LEFT = 0.2            # of the slow noise's variance, once the structure is taken out
SHIFTS = 7                  # shifts of a slow variable in time: what it gains then is what drift gives
SHIFT_MARGIN = 1.5          # times the most that it gains then ...
DRIFT_MARGIN = 3.0          # ... where the slow noise remains with the structure taken out

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


class Dependence(NamedTuple):
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
    trace: Column = Column(Label(Role.TRACE), {}, np.inf)       # what it does to its channel


def unexplained(columns: Columns, now: Refit, explained: float) -> Dependence | None:
    """The strongest dependence left, where it is worth a verdict and shows all over the log.

    explained : gain of the named causes, twice the log-likelihood.
    """
    found = strongest(columns, now)
    if found is None:
        return None
    walking = walks(columns.model.channel(TABLES[found.stage].channel))
    if not significant(found, explained, walking) or not holds(columns, now, found, explained):
        return None
    return found


def strongest(columns: Columns, now: Refit) -> Dependence | None:
    """The strongest smooth dependence left at a hypothesis, over every stage of the group and recorded variable.

    A hopper that only empties tells the time: of the two, nearly as good, the plain one is named.
    """
    data, names = columns.model.data, columns.model.names
    in_steps = data.shaft is not None and data.shaft.step > 0.0     # rounding is a dependence of its own
    tried = [dependence(columns, now, stage, variable) for stage, table in TABLES.items()
             if table.channel in names and not (stage == "shaft" and in_steps)
             for variable in variables_of(data) if variable not in DOWNSTREAM[stage]]
    ranked = sorted((one for one in tried if one is not None), key=lambda one: -one.gain)
    best = next((one for one in ranked if not _is_drift(columns, now, one)), None)
    if best is not None and best.variable == "hopper_kg":
        return next((one for one in ranked if one.stage == best.stage and one.variable == "time_s"
                     and not one.slow_noise and one.gain > TIME_TIE * best.gain), best)
    return best


def _is_drift(columns: Columns, now: Refit, one: Dependence) -> bool:
    """Whether a dependence beside which the slow noise remains is a part of it: as good over any other course."""
    if not one.slow_noise or one.variable in TIME_LIKE or one.gain < OPEN_THRESHOLD:
        return one.slow_noise
    return one.gain < DRIFT_MARGIN * gain_elsewhere(columns, now, one.stage, one.variable)


def walks(channel: ChannelSeries) -> float:
    """Factor on thresholds in a channel in which something adds up unseen between the rows, as a drift does."""
    return WALK_FACTOR if channel.prior.walk_sd > 0.0 else 1.0


def significant(found: Dependence, explained: float, walking: float = 1.0) -> bool:
    """Whether a dependence is worth a verdict. explained : gain of the named causes, twice the log-likelihood.
    walking : see `walks`."""
    if found.explained_share < MIN_SHARE and found.field_percent < MIN_FIELD_PERCENT:
        return False
    factor = max(walking, TIME_FACTOR if found.variable in TIME_LIKE else 1.0)
    return found.gain > factor * max(OPEN_THRESHOLD, OPEN_SHARE * explained)


def holds(columns: Columns, now: Refit, found: Dependence, explained: float) -> bool:
    """Whether a dependence shows all over the log, and not in a stretch or at a few moments of it.

    One as slow as drift must gain more than it does with its variable moved along the log, where it can mean nothing.
    """
    seen = scores(columns, now.parts, now.noise, [found.trace])
    whole = float(seen.score.sum() ** 2 / max(float(seen.energy.sum()), 1e-12))
    least = max(OPEN_THRESHOLD, OPEN_SHARE * explained)
    if without_best_block(seen, 0) < MIN_WITHOUT_BLOCK * whole or found.gain < least * spread_over(seen, 0):
        return False
    if not found.slow or found.variable in TIME_LIKE:
        return True
    return found.gain > SHIFT_MARGIN * gain_elsewhere(columns, now, found.stage, found.variable)


def gain_elsewhere(columns: Columns, now: Refit, stage: str, variable: str) -> float:
    """The most that a stage's dependence on a variable gains with the variable moved along the log."""
    return max(moved_gain(columns, now, stage, variable, k / (SHIFTS + 1.0)) for k in range(1, SHIFTS + 1))


def moved_gain(columns: Columns, now: Refit, stage: str, variable: str, share: float) -> float:
    """Gain of a dependence once its variable is moved along the log by a share of it, round the end."""
    shapes = columns.forms.moved(stage, variable, share)
    if not shapes:
        return 0.0
    _, plain, full = _without_and_with(columns, now, shapes)
    return 2.0 * (full.log_likelihood - plain.log_likelihood)


def _without_and_with(columns: Columns, now: Refit, shapes: Sequence[Column]) -> tuple[Problem, Fit, Fit]:
    """A hypothesis and `shapes` as one problem, fitted without and with the shapes, which come last.

    The noise found with them is tried without them too: a better place for the noise is no gain of the shapes.
    """
    channels = columns.model.channels
    p, before = columns.compressed(now.parts, shapes)
    plain = best_fitted(p, np.arange(before), now.noise, channels)
    full = best_fitted(p, np.arange(before + len(shapes)), plain.noise, channels)
    again = fitted(p, np.arange(before), full.noise)
    return p, max(plain, again, key=lambda fit: fit.log_likelihood), full


def dependence(columns: Columns, now: Refit, stage: str, variable: str) -> Dependence | None:
    """A stage's dependence on a variable at a hypothesis; None where the variable hardly moves."""
    shapes = columns.forms.over(stage, variable)
    over = span(columns.model.data, variable, columns.model.machine)
    if not shapes or over is None:
        return None
    p, plain, full = _without_and_with(columns, now, shapes)
    weights = full.amplitude[len(plain.amplitude):]
    values = np.array([shape(k) for k in range(1, SHAPES + 1)]).T @ weights
    name = TABLES[stage].channel
    series = np.asarray(sum(w * c.coefficients[name] for w, c in zip(weights, shapes, strict=True)))
    left = power_left(p, name, np.arange(len(plain.amplitude)), plain.amplitude)
    share = float(np.clip(np.sum(series ** 2) / max(1e-300, left), 0.0, 1.0))
    slow, slow_noise = as_drift(columns.model.channel(name), series, plain.noise[name], full.noise[name])
    return Dependence(stage, variable, 2.0 * (full.log_likelihood - plain.log_likelihood), over.nodes,
                      tuple(values.tolist()), share, _field_percent(columns.model.data, stage, over, values),
                      slow, slow_noise, Column(Label(Role.TRACE), {name: series}, np.inf))


def as_drift(channel: ChannelSeries, series: Array, before: Noise, after: Noise) -> tuple[bool, bool]:
    """Whether a structure lives where the slow noise does, and whether that is there with it as without it.

    Drift is a few slow waves over the length of a log, and four smooth shapes of anything that itself changes slowly
    follow some of them; a dependence that is really there leaves no drift behind. series : banded coefficients (m,).
    """
    slow = slow_share(series, channel, before) > SLOW_ENERGY
    return slow, slow and after.slow_sd ** 2 > DRIFT_LEFT * before.slow_sd ** 2


def _field_percent(data: RunData, stage: str, over: Span, values: Array) -> float:
    """R.m.s. of a table over the working rows, less its mean, as per cent of the dose."""
    variables, working = data.variables, data.working > 0.0
    if stage == "scale" or not working.any():
        return 0.0
    wrong = np.interp(variables[over.variable][working], over.nodes, values)
    if stage == "gate":
        wrong = 100.0 * wrong / np.maximum(1.0, variables["opening_mm"][working])
    return float(np.std(wrong))
