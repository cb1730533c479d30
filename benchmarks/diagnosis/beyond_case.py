"""One case of the benchmark beyond the catalogue: made, diagnosed, adopted, held against other
runs of the machine."""

from __future__ import annotations

import time
import traceback
from typing import Any, NamedTuple

# Healthy logs, in turn: half of them as the machine is said to be, half from further afield.
NULLS = (
    "none",
    "healthy_columns",
    "none",
    "healthy_loud",
    "none",
    "healthy_loop",
    "none",
    "healthy_coarse",
    "none",
    "healthy_sparse",
    "none",
    "healthy_foreign",
)
FIRST_NULL = 1_000_000  # number of the first healthy log
# other runs: of the same programme, of another one
AGAIN = {"again": False, "elsewhere": True}


class Task(NamedTuple):
    """Case `number` of a seed."""

    number: int
    seed: int
    programmes: str


def made(task: Task) -> Any:
    """The hidden generator's case: the nine classes in turn, or a healthy log."""
    from hidden.cases import one
    from hidden.terms import CLASSES

    if task.number >= FIRST_NULL:
        return one(
            task.number, task.seed, task.programmes, (NULLS[task.number % len(NULLS)],), ("run",)
        )
    kind = CLASSES[task.number % len(CLASSES)]
    category = "column" if kind == "column" else "term"
    return one(task.number, task.seed, task.programmes, (category,), ("run",), (kind,))


def examine(task: Task) -> dict[str, Any]:
    """Truth, answer, and what the adopted file is worth on other runs. Without a truth: the
    case could not be made."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    started = time.perf_counter()
    nominal = load_config("huanghai", MACHINE_KIND).model
    out: dict[str, Any] = {
        "number": task.number,
        "truth": None,
        "answer": None,
        "seconds": 0.0,
        "processor_s": 0.0,
        "adopted": False,
        "trouble": None,
        **dict.fromkeys(AGAIN),
    }
    try:
        case = made(task)
        out["truth"] = case.truth
        others = _other_runs(case)
        out |= _answered(case, nominal, others, task.seed)
    except Exception:
        out["trouble"] = traceback.format_exc(limit=-4)
    return {**out, "whole_s": time.perf_counter() - started}


def _other_runs(case: Any) -> dict[str, Any]:
    from hidden.another_run import another_run

    if not case.truth["outside"]:
        return dict.fromkeys(AGAIN)
    return {
        word: another_run(case.redriven, case.truth, k, elsewhere)
        for k, (word, elsewhere) in enumerate(AGAIN.items())
    }


def _answered(case: Any, nominal: Any, others: dict[str, Any], seed: int) -> dict[str, Any]:
    import ask
    from beyond_other_run import judged
    from topdress.control.diagnosis.extend import extend

    began, busy = time.perf_counter(), time.process_time()
    diagnosis = ask.found("run", case.columns, nominal, case.name, seed)
    seconds, busy = time.perf_counter() - began, time.process_time() - busy
    adopted = extend(nominal, diagnosis, date="2026-01-01")
    changed = adopted.model_copy(update={"adopted": nominal.adopted}) != nominal
    worth = {
        word: None
        if other is None
        else {
            "programme": other.truth["programme"],
            **judged(
                other.columns, other.changed(), case.truth["outside"]["channel"], nominal, adopted
            ),
        }
        for word, other in others.items()
    }
    return {
        "answer": ask.published(diagnosis),
        "seconds": seconds,
        "processor_s": busy,
        "adopted": changed,
        **worth,
    }
