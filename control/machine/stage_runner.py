"""How does a stage run over a whole log? This module runs it interpreted; `compiled` compiles
the same functions.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import Any

import numpy as np
import numpy.typing as npt

# Maximum model step, s: a quarter of a control tick of 0.05 s.
MAX_MODEL_STEP_S = 0.0125
# Minimum number of model steps in a row.
MIN_STEPS_PER_ROW = 4

StageRun = Callable[..., npt.NDArray[np.float64]]


def make_stage_run(step: Callable[..., Any], exact: bool = False) -> StageRun:
    """Returns `run(sets, switch_rows, state, first, rows, time_s, most_step_s) -> (rows, outputs)`,
    interpreted.

    sets : parameter sets in the order in which they come into force; set j+1 starts at row
    switch_rows[j], so that an effect may begin within a run. state, first : state and output at
    time_s[0]. rows : record array of the stage's inputs, row k in force from time_s[k] to
    time_s[k+1]. The output of row k is that at time_s[k], so the command of row k does not affect
    it. Rows may have any step; each is divided into at least MIN_STEPS_PER_ROW steps. A step that
    is exact for any length is not divided, because division would gain nothing.
    """
    return allocate_output(make_fill(step, exact))


def allocate_output(fill: Callable[..., None]) -> StageRun:
    """Returns the run of `make_fill` that allocates its own output array."""

    def run(sets, switch_rows, state, first, rows, time_s, most_step_s):  # type: ignore[no-untyped-def]
        out = np.empty((len(rows), len(first)))
        fill(out, sets, switch_rows, state, first, rows, time_s, most_step_s)
        return out

    return run


def make_fill(step: Callable[..., Any], exact: bool = False) -> Callable[..., None]:
    """Returns a run that writes into a given array; it allocates none, so that it compiles
    without reference counting."""

    def fill(out, sets, switch_rows, state, first, rows, time_s, most_step_s):  # type: ignore[no-untyped-def]
        count = len(rows)
        output = first
        current = 0
        for row in range(count):
            for column in range(len(first)):
                out[row, column] = output[column]
            while current < len(switch_rows) and row >= switch_rows[current]:
                current += 1
            if row + 1 < count:
                dt_s = time_s[row + 1] - time_s[row]
                steps = 1 if exact else max(MIN_STEPS_PER_ROW, ceil(dt_s / most_step_s - 1e-9))
                for _ in range(steps):
                    state, output = step(sets[current], state, rows[row], dt_s / steps)

    return fill


def make_input_rows(kind: Any, count: int, **columns: npt.ArrayLike) -> Any:
    """Returns a record array of a stage's inputs: given columns, and defaults for the others
    (shape (count,))."""
    rows = np.zeros(count, [(name, np.float64) for name in kind._fields]).view(np.recarray)
    for name in kind._fields:
        rows[name] = columns.get(name, kind._field_defaults.get(name, 0.0))
    return rows


def make_map_run(reads: Callable[..., float]) -> StageRun:
    """Returns `run(params, rows) -> (rows,)` for stages without memory."""

    def run(params, rows):  # type: ignore[no-untyped-def]
        out = np.empty(len(rows))
        for row in range(len(rows)):
            out[row] = reads(params, rows[row])
        return out

    return run


def make_no_switch() -> npt.NDArray[np.int64]:
    return np.empty(0, dtype=np.int64)
