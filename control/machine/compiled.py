"""The steps compiled over whole logs. The only module that imports numba; import it only where a log is run.

The cache folder carries a hash of the sources: numba's own check looks at one file only, and would go on running
old machine code after an edit in another.
"""
from __future__ import annotations

import hashlib
import pathlib
from collections.abc import Callable
from typing import Any

import numba
import platformdirs
from numba.extending import register_jitable

from . import elements, fall, flow, gate, heads, scale, shaft, speed
from .over_log import Run, mapped, over_log

_here = pathlib.Path(__file__).parent
_sources = b"".join(file.read_bytes() for file in sorted(_here.glob("*.py")))
CACHE_DIR = pathlib.Path(platformdirs.user_cache_dir("topdress")) / hashlib.sha256(_sources).hexdigest()[:12]
numba.config.CACHE_DIR = str(CACHE_DIR)  # type: ignore[attr-defined]

for _piece in (elements.line_put, elements.line_mean, elements.line_held, elements.table_at, elements.stepped,
               flow.bridged, flow.grams_per_rev, fall.start_drop_s, fall.drop_s,
               shaft.approach, shaft.shaft_step, gate.gate_step, flow.flow_step, speed.speed_step, fall.fall_step,
               scale.scale_reads, heads.head_reads):
    register_jitable(_piece)


def _compiled(run: Callable[..., Any]) -> Run:
    return numba.njit(cache=True, nogil=True, error_model="numpy")(run)


shaft_run = _compiled(over_log(shaft.shaft_step))
gate_run = _compiled(over_log(gate.gate_step))
flow_run = _compiled(over_log(flow.flow_step))
speed_run = _compiled(over_log(speed.speed_step))
scale_run = _compiled(mapped(scale.scale_reads))
heads_run = _compiled(mapped(heads.head_reads))
