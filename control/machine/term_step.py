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
    """What a term remembers: its variable's first-order memory, the value that has been held since, 1 once started."""

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


def straight(p: TermParams, x: float, y: float) -> float:
    """Forms of straight lines and their bends: 0 where `x` is `at`."""
    away = x - p.at
    if p.form == HINGE:
        return (p.above if x > p.at else p.below) * away
    if p.form == THRESHOLD:
        return p.above if x > p.at else p.below
    if p.form == PRODUCT:
        return p.slope * away * (y - p.second_at)
    return p.slope * away + p.bend * away * away


def between(p: TermParams, x: float) -> float:
    """Forms with a lower and an upper end."""
    if p.form == SATURATION:
        return p.slope * (clipped(x, p.low_end, p.high_end) - p.low_end)
    if p.form == DEAD_ZONE:
        return p.slope * (x - clipped(x, p.low_end, p.high_end))
    if not p.low_end <= x < p.high_end:
        return 0.0
    return p.above * ((x - p.low_end) / (p.high_end - p.low_end) if p.grows > 0.0 else 1.0)


def sided(p: TermParams, away: float) -> float:
    """`above` on one side, `below` on the other, evenly from one to the other over `high_end` on both."""
    return 0.5 * (p.above + p.below) + 0.5 * (p.above - p.below) * clipped(away / p.high_end, -1.0, 1.0)


def term_step(p: TermParams, s: TermState, x: float, y: float, dt_s: float) -> tuple[TermState, float]:
    """Value of a term where its variables have come to `x` and `y`, `dt_s` after the step before."""
    x = clipped(x, p.low, p.high)
    y = clipped(y, p.second_low, p.second_high)
    if p.tau_s > 0.0:
        s = remembered(p, s, x, dt_s)
    if p.form == MEMORY:
        return s, p.level + p.slope * (x - p.at) + p.bend * (s.slow - p.at)
    if p.form == SIDE:
        return s, p.level + sided(p, x - (s.slow if p.tau_s > 0.0 else p.at))
    if p.form == PERIODIC:
        angle = p.cycles * x * pi / 180.0
        return s, p.level + p.sine * sin(angle) + p.cosine * cos(angle)
    if p.form == TABLE:
        return s, p.level + table_at(p.nodes, p.values, x)
    if p.form == SATURATION or p.form == DEAD_ZONE or p.form == SPAN:
        return s, p.level + between(p, x)
    return s, p.level + straight(p, x, y)


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
