"""What is the value of a term, from its variables and its memory? The functions use scalars only,
so that they compile.

Plant, prediction, control and diagnosis all use this step.
"""

from __future__ import annotations

from math import exp
from typing import Any, NamedTuple

import numpy as np

from .term_form import TermParams
from .term_forms import FORM_VALUES, clip_value


class TermState(NamedTuple):
    """Holds the memory of a term: its variable's first-order memory, the last value, and 1 after
    the first value."""

    slow: float = 0.0
    last: float = 0.0
    known: float = 0.0


def update_memory(p: TermParams, s: TermState, x: float, dt_s: float) -> TermState:
    """Returns the memory after `dt_s` with the last value constant; it starts settled. Exact for
    constant inputs."""
    if s.known == 0.0:
        return TermState(x, x, 1.0)
    keep = exp(-dt_s / p.tau_s)
    return TermState(s.last + (s.slow - s.last) * keep, x, 1.0)


def calc_form_value(p: TermParams, x: float, y: float, slow: float) -> float:
    """Returns the value of the form with this number; `compiled.py` compiles this function."""
    return FORM_VALUES[p.form](p, x, y, slow)


def step_term(
    p: TermParams, s: TermState, x: float, y: float, dt_s: float
) -> tuple[TermState, float]:
    """Returns the value of a term with the variables `x` and `y`, `dt_s` after the step before."""
    x = clip_value(x, p.low, p.high)
    y = clip_value(y, p.second_low, p.second_high)
    if p.tau_s > 0.0:
        s = update_memory(p, s, x, dt_s)
    return s, p.level + calc_form_value(p, x, y, s.slow)


def make_term_run(step: Any) -> Any:
    """Returns `run(params, x, y, time_s) -> (rows,)`, which evaluates a term over a log. x, y:
    variables at each row (rows,)."""

    def run(params, x, y, time_s):  # type: ignore[no-untyped-def]
        out = np.empty(len(x))
        state = TermState(0.0, 0.0, 0.0)
        before = time_s[0]
        for row in range(len(x)):
            state, out[row] = step(params, state, x[row], y[row], time_s[row] - before)
            before = time_s[row]
        return out

    return run
