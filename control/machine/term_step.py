"""The evaluator of terms: one value of one term, from its variables and what it remembers. Compiles as it stands.

Plant, prediction, control and diagnosis ask this step and no other. Scalars in, scalars out.
"""
from __future__ import annotations

from math import cos, exp, pi, sin
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .elements import FLAT, TABLE_X, Table, table_at

Array = npt.NDArray[np.float64]

# Numbers of the forms, for compiled code; `terms.Form` has their names in the same order.
SLOPE, BEND, HINGE, SATURATION, DEAD_ZONE, THRESHOLD, PRODUCT, MEMORY, PERIODIC, SIDE, SPAN, TABLE = range(12)


class TermParams(NamedTuple):
    """A term as numbers. What a form does not use stays at its default; `terms.Coefficients` says what each means."""

    form: int
    low: float = -1e300         # validity: beyond it the variable is held at the edge
    high: float = 1e300
    second_low: float = -1e300
    second_high: float = 1e300
    level: float = 0.0
    at: float = 0.0
    second_at: float = 0.0
    slope: float = 0.0
    bend: float = 0.0
    below: float = 0.0
    above: float = 0.0
    low_end: float = 0.0
    high_end: float = 0.0
    cycles: float = 0.0
    sine: float = 0.0
    cosine: float = 0.0
    tau_s: float = 0.0
    grows: float = 0.0
    nodes: Table = TABLE_X
    values: Table = FLAT


class TermState(NamedTuple):
    """What a term remembers: its variable's first-order memory, the value that has been held since, 1 once begun."""

    slow: float = 0.0
    last: float = 0.0
    begun: float = 0.0


def clipped(x: float, low: float, high: float) -> float:
    return min(high, max(low, x))


def remembered(p: TermParams, s: TermState, x: float, dt_s: float) -> TermState:
    """The memory after `dt_s` in which the last value was held; it begins settled. Exact for held inputs."""
    if s.begun == 0.0:
        return TermState(x, x, 1.0)
    keep = exp(-dt_s / p.tau_s)
    return TermState(s.last + (s.slow - s.last) * keep, x, 1.0)


def term_step(p: TermParams, s: TermState, x: float, y: float, dt_s: float) -> tuple[TermState, float]:
    """Value of a term where its variables have come to `x` and `y`, `dt_s` after the step before."""
    x = clipped(x, p.low, p.high)
    y = clipped(y, p.second_low, p.second_high)
    if p.tau_s > 0.0:
        s = remembered(p, s, x, dt_s)
    value = p.level
    if p.form == SLOPE:
        value += p.slope * (x - p.at)
    elif p.form == BEND:
        value += p.slope * (x - p.at) + p.bend * (x - p.at) * (x - p.at)
    elif p.form == HINGE:
        value += (p.above if x > p.at else p.below) * (x - p.at)
    elif p.form == SATURATION:
        value += p.slope * (clipped(x, p.low_end, p.high_end) - p.low_end)
    elif p.form == DEAD_ZONE:
        value += p.slope * (x - clipped(x, p.low_end, p.high_end))
    elif p.form == THRESHOLD:
        value += p.above if x > p.at else p.below
    elif p.form == PRODUCT:
        value += p.slope * (x - p.at) * (y - p.second_at)
    elif p.form == MEMORY:
        value += p.slope * (x - p.at) + p.bend * (s.slow - p.at)
    elif p.form == PERIODIC:
        angle = p.cycles * x * pi / 180.0
        value += p.sine * sin(angle) + p.cosine * cos(angle)
    elif p.form == SIDE:
        away = x - (s.slow if p.tau_s > 0.0 else p.at)
        side = clipped(away / p.high_end, -1.0, 1.0)
        value += 0.5 * (p.above + p.below) + 0.5 * (p.above - p.below) * side
    elif p.form == SPAN:
        if p.low_end <= x < p.high_end:
            share = (x - p.low_end) / (p.high_end - p.low_end) if p.grows > 0.0 else 1.0
            value += p.above * share
    elif p.form == TABLE:
        value += table_at(p.nodes, p.values, x)
    return s, value


def over_rows(step: Any) -> Any:
    """`run(params, x, y, time_s) -> (rows,)`: a term over a log. x, y : its variables at each row (rows,)."""
    def run(params, x, y, time_s):  # type: ignore[no-untyped-def]
        out = np.empty(len(x))
        state = TermState(0.0, 0.0, 0.0)
        before = time_s[0]
        for row in range(len(x)):
            state, out[row] = step(params, state, x[row], y[row], time_s[row] - before)
            before = time_s[row]
        return out
    return run
