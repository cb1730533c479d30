"""How do the model's steps run compiled over whole logs? Only this module and `jit_cache` import
numba, because the import is slow.

The cache folder and its entries carry a hash of the sources. numba's own check covers a single
file, and would run old machine code after an edit in another file.
"""

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

from . import (
    effort,
    fall,
    flow,
    gate,
    heads,
    model_elements,
    scale,
    shaft,
    speed,
    term_forms,
    term_step,
)
from .jit_cache import CompiledCodeCache, rename_uniquely
from .stage_runner import StageRun, allocate_output, make_fill, make_map_run
from .term_form import TermParams

# In compiled code, the function maps (array, count) to a tuple.
to_fixed_tuple: Any = ndarray.to_fixed_tuple

F = TypeVar("F", bound=Callable[..., Any])

_here = pathlib.Path(__file__).parent
_sources = b"".join(file.read_bytes() for file in sorted(_here.glob("*.py")))
_SOURCES = hashlib.sha256(_sources).hexdigest()[:12]
CACHE_DIR = pathlib.Path(platformdirs.user_cache_dir("topdress")) / _SOURCES
numba.config.CACHE_DIR = str(CACHE_DIR)  # type: ignore[attr-defined]


def mark_compilable(piece: F) -> F:
    """Marks a function that compiled functions may call."""
    made: F = register_jitable(piece)
    return made


for _piece in (
    model_elements.put_in_line,
    model_elements.average_line,
    model_elements.read_held_line,
    model_elements.interpolate_table,
    model_elements.round_to_step,
    flow.is_bridged,
    flow.calc_grams_per_rev,
    flow.calc_common_factor,
    flow.calc_flute_load,
    effort.calc_drive_parts,
    effort.calc_shaft_parts,
    effort.calc_supply_factor,
    effort.calc_shaft_effort,
    effort.calc_gate_effort,
    fall.find_start_drop_s,
    fall.calc_drop_s,
    shaft.step_first_order,
    shaft.solve_free_response,
    shaft.find_next_zero_s,
    shaft.find_free_time_s,
    shaft.step_second_order,
    shaft.calc_time_constant_s,
    shaft.calc_acceleration_rpm_s,
    shaft.follow_command,
    shaft.calc_effective_command_rpm,
    shaft.calc_settled_rpm,
    shaft.calc_speed_factor,
    shaft.calc_dead_time_s,
    shaft.step_shaft,
    gate.step_gate,
    flow.step_flow,
    speed.step_speed,
    fall.step_fall,
    scale.read_scale,
    heads.read_head,
    term_forms.clip_value,
    term_step.update_memory,
    term_step.step_term,
):
    mark_compilable(_piece)
for _value in term_forms.FORM_VALUES:
    mark_compilable(_value)


def _choose_form(
    number: int, value: Callable[..., float], others: Callable[..., float]
) -> Callable[..., float]:
    """Returns the value of the form with this number, or that of one of the others."""

    def chosen(p: TermParams, x: float, y: float, slow: float) -> float:
        return value(p, x, y, slow) if p.form == number else others(p, x, y, slow)

    return mark_compilable(chosen)


@overload(term_step.calc_form_value)
def _overload_value(p, x, y, slow):  # type: ignore[no-untyped-def]
    """Returns the value of a form by a chain of comparisons, because compiled code has no list
    of functions."""
    chosen = term_forms.FORM_VALUES[-1]
    for number in reversed(range(len(term_forms.FORM_VALUES) - 1)):
        chosen = _choose_form(number, term_forms.FORM_VALUES[number], chosen)
    return lambda p, x, y, slow: chosen(p, x, y, slow)


def _hash_sources(run: Callable[..., Any]) -> str:
    """Returns a hash of all sources that are compiled into a function: these files, and those of
    the function's own folder.

    Constants of a module are not in the bytecode, so numba's own key does not detect a change of a
    constant.
    """
    code: Any = run.__code__
    folder = pathlib.Path(code.co_filename).parent
    if folder == _here:
        return _SOURCES
    with contextlib.suppress(OSError):
        of_folder = b"".join(file.read_bytes() for file in sorted(folder.glob("*.py")))
        return hashlib.sha256(_sources + of_folder).hexdigest()[:12]
    return _SOURCES


def compile_function(run: Callable[..., Any], makes_arrays: bool = True) -> Callable[..., Any]:
    """Returns a function of numbers and arrays that is compiled at its first call, and cached on
    disk where there is room.

    makes_arrays: False for a function that neither makes arrays nor passes them on; references are
    then not counted. Counting references at each step would take four times as long as the step.
    """
    apart = rename_uniquely(run)
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": makes_arrays}
    dispatcher: Any = numba.njit(**options)(apart)
    # Without a writable folder the function is compiled again in each process.
    with contextlib.suppress(RuntimeError, OSError):
        dispatcher._cache = CompiledCodeCache(apart, _hash_sources(run))
    made: Callable[..., Any] = dispatcher
    return made


def _compile_run(run: Callable[..., Any]) -> StageRun:
    return compile_function(run)


def compile_stage_run(step: Callable[..., Any], exact: bool = False) -> StageRun:
    """Returns the compiled function that runs a step over a log, as `make_stage_run` does
    interpreted."""
    return allocate_output(compile_function(make_fill(step, exact), makes_arrays=False))


run_shaft = compile_stage_run(shaft.step_shaft, exact=True)
run_gate = compile_stage_run(gate.step_gate, exact=True)
run_flow = compile_stage_run(flow.step_flow)
run_speed = compile_stage_run(speed.step_speed)
run_scale = _compile_run(make_map_run(scale.read_scale))
run_heads = _compile_run(make_map_run(heads.read_head))
run_shaft_effort = _compile_run(make_map_run(effort.calc_shaft_effort))
run_gate_effort = _compile_run(make_map_run(effort.calc_gate_effort))
run_term = _compile_run(term_step.make_term_run(term_step.step_term))


@compile_function
def run_memory(keep: float, fresh: model_elements.Array) -> model_elements.Array:
    """Returns y[k] = keep y[k - 1] + fresh[k], with y before the first 0: (rows,)."""
    out = np.empty(len(fresh))
    y = 0.0
    for row in range(len(fresh)):
        y = keep * y + fresh[row]
        out[row] = y
    return out


@compile_function
def run_table(
    nodes: model_elements.Table, values: model_elements.Table, at: model_elements.Array
) -> model_elements.Array:
    """Evaluates a table over a log: (rows,)."""
    out = np.empty(len(at))
    for row in range(len(at)):
        out[row] = model_elements.interpolate_table(nodes, values, at[row])
    return out


@compile_function
def run_flutes(
    p: flow.Flow,
    shaft_rpm: model_elements.Array,
    opening_mm: model_elements.Array,
    pitch_deg: model_elements.Array,
    share_full: model_elements.Array,
    time_s: model_elements.Array,
    refilled: bool,
) -> model_elements.Array:
    """Evaluates `flow.calc_flute_load` over a log, without its terms: (rows, 2)."""
    out = np.empty((len(time_s), 2))
    for row in range(len(time_s)):
        out[row, 0], out[row, 1] = flow.calc_flute_load(
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
