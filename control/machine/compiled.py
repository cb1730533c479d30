"""How do the model's steps run compiled over whole logs? Only this module and `jit_cache` import
numba; import it only where a log is run.

The cache folder and its entries carry a hash of the sources: numba's own check looks at one
file only, and would go on running old machine code after an edit in another."""

from __future__ import annotations

import contextlib
import hashlib
import pathlib
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np
import platformdirs
from numba.extending import overload, register_jitable
from numba.np.unsafe import ndarray

from . import effort, elements, fall, flow, forms, gate, heads, scale, shaft, speed, term_step
from .form import TermParams
from .jit_cache import KeptCode, named_apart
from .stage_runner import Run, filling, mapped, with_room

to_fixed_tuple: Any = ndarray.to_fixed_tuple  # (array, count) -> tuple, in compiled code

F = TypeVar("F", bound=Callable[..., Any])

_here = pathlib.Path(__file__).parent
_sources = b"".join(file.read_bytes() for file in sorted(_here.glob("*.py")))
_SOURCES = hashlib.sha256(_sources).hexdigest()[:12]
CACHE_DIR = pathlib.Path(platformdirs.user_cache_dir("topdress")) / _SOURCES
numba.config.CACHE_DIR = str(CACHE_DIR)  # type: ignore[attr-defined]


def jitable(piece: F) -> F:
    """Marks a function that compiled functions may call."""
    made: F = register_jitable(piece)
    return made


for _piece in (
    elements.put_in_line,
    elements.average_line,
    elements.read_held_line,
    elements.table_at,
    elements.stepped,
    flow.bridged,
    flow.grams_per_rev,
    flow.common_factor,
    flow.in_flutes,
    effort.of_drive,
    effort.shaft_parts,
    effort.supply_factor,
    effort.shaft_effort,
    effort.gate_effort,
    fall.find_start_drop_s,
    fall.drop_s,
    shaft.approach,
    shaft.free_swing,
    shaft.passes_s,
    shaft.free_for_s,
    shaft.swung,
    shaft.lag_s,
    shaft.fastest_rpm_s,
    shaft.follows,
    shaft.beyond_rpm,
    shaft.asked_rpm,
    shaft.dead_s,
    shaft.shaft_step,
    gate.gate_step,
    flow.step_flow,
    speed.step_speed,
    fall.step_fall,
    scale.scale_reads,
    heads.read_head,
    forms.clipped,
    term_step.remembered,
    term_step.term_step,
):
    jitable(_piece)
for _value in forms.VALUES:
    jitable(_value)


def _either(
    number: int, value: Callable[..., float], others: Callable[..., float]
) -> Callable[..., float]:
    """Returns the value of the form with this number, or that of one of the others."""

    def chosen(p: TermParams, x: float, y: float, slow: float) -> float:
        return value(p, x, y, slow) if p.form == number else others(p, x, y, slow)

    return jitable(chosen)


@overload(term_step.value_of)
def _value_of(p, x, y, slow):  # type: ignore[no-untyped-def]
    """Returns the value of a form by a chain of comparisons, because compiled code has no list
    of functions."""
    chosen = forms.VALUES[-1]
    for number in reversed(range(len(forms.VALUES) - 1)):
        chosen = _either(number, forms.VALUES[number], chosen)
    return lambda p, x, y, slow: chosen(p, x, y, slow)


def _sources_of(run: Callable[..., Any]) -> str:
    """Returns a hash of everything that is compiled into a function: these files, and those of
    its own folder where that is another one. Constants of a module are not in the bytecode, so
    that numba's own key does not notice their change."""
    code: Any = run.__code__
    folder = pathlib.Path(code.co_filename).parent
    if folder == _here:
        return _SOURCES
    with contextlib.suppress(OSError):
        of_folder = b"".join(file.read_bytes() for file in sorted(folder.glob("*.py")))
        return hashlib.sha256(_sources + of_folder).hexdigest()[:12]
    return _SOURCES


def compiled(run: Callable[..., Any], makes_arrays: bool = True) -> Callable[..., Any]:
    """Returns a function of numbers and arrays that is compiled when it is first called, and
    kept on disk where there is room.

    makes_arrays: False where it makes no arrays and passes none on: references are then not
    counted. Counting them at each step takes a stage four times as long as the step itself."""
    apart = named_apart(run)
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": makes_arrays}
    dispatcher: Any = numba.njit(**options)(apart)
    # Without a writable folder it is compiled anew in each process.
    with contextlib.suppress(RuntimeError, OSError):
        dispatcher._cache = KeptCode(apart, _sources_of(run))
    made: Callable[..., Any] = dispatcher
    return made


def _compiled(run: Callable[..., Any]) -> Run:
    return compiled(run)


def stage_run(step: Callable[..., Any], exact: bool = False) -> Run:
    """Returns `over_log.over_log` of a step, compiled."""
    return with_room(compiled(filling(step, exact), makes_arrays=False))


shaft_run = stage_run(shaft.shaft_step, exact=True)
gate_run = stage_run(gate.gate_step, exact=True)
flow_run = stage_run(flow.step_flow)
speed_run = stage_run(speed.step_speed)
scale_run = _compiled(mapped(scale.scale_reads))
heads_run = _compiled(mapped(heads.read_head))
shaft_effort_run = _compiled(mapped(effort.shaft_effort))
gate_effort_run = _compiled(mapped(effort.gate_effort))
term_run = _compiled(term_step.over_rows(term_step.term_step))


@compiled
def remembered_run(keep: float, fresh: elements.Array) -> elements.Array:
    """Returns y[k] = keep y[k - 1] + fresh[k], with y before the first 0: (rows,)."""
    out = np.empty(len(fresh))
    y = 0.0
    for row in range(len(fresh)):
        y = keep * y + fresh[row]
        out[row] = y
    return out


@compiled
def table_run(nodes: elements.Table, values: elements.Table, at: elements.Array) -> elements.Array:
    """Evaluates a table over a log: (rows,)."""
    out = np.empty(len(at))
    for row in range(len(at)):
        out[row] = elements.table_at(nodes, values, at[row])
    return out


@compiled
def flutes_run(
    p: flow.Flow,
    shaft_rpm: elements.Array,
    opening_mm: elements.Array,
    pitch_deg: elements.Array,
    share_full: elements.Array,
    time_s: elements.Array,
    refilled: bool,
) -> elements.Array:
    """Evaluates `flow.in_flutes` over a log, without its terms: (rows, 2)."""
    out = np.empty((len(time_s), 2))
    for row in range(len(time_s)):
        out[row, 0], out[row, 1] = flow.in_flutes(
            p,
            shaft_rpm[row],
            opening_mm[row],
            pitch_deg[row],
            share_full[row],
            time_s[row],
            0.0,
            refilled,
        )
    return out
