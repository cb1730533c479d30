"""Other methods on the cases beyond the catalogue: what each says and predicts of other runs, judged as ours is.

Each peer's threshold for a stage is its highest score there among healthy logs of the tuning half. What a peer says
below it counts as nothing said; of several stages above it that counts which is furthest above. PySR is not among
them: it needs Julia.
"""
from __future__ import annotations

import json
import pickle
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import peers_methods
from beyond_bic import forms_and_bic
from beyond_case import AGAIN, CALIBRATING, FIRST_NULL
from beyond_linear import STAGES, Log
from beyond_methods import (
    Method,
    Said,
    by_library,
    gaussian_process,
    lisdd,
    picked,
    spline,
    symbolic,
    there,
)
from beyond_other_run import READING, worth
from beyond_problem import Channel
from beyond_report import Case, counted, named, of_kept, peers_table
from hidden.report import percent
from kept import HERE, file_hash, worked

PEERS: dict[str, Method] = {
    "pysindy STLSQ, degree 2, whitened": by_library(peers_methods.stlsq),
    "pysindy FROLS, degree 2, whitened": by_library(peers_methods.frols),
    "same forms, lmfit + BIC, whitened": forms_and_bic,
    "LISDD's recipe": lisdd,
    "gplearn, symbolic regression": symbolic,
    "Gaussian process (prediction only)": gaussian_process,
    "additive spline (prediction only)": spline,
}
SYSIDENT = "SysIdentPy FROLS, degree 2, whitened"
LENIENT = 0.9                     # share of the healthy logs that stays silent at the lower threshold
METHODS = ("beyond_peers.py", "beyond_methods.py", "beyond_linear.py", "beyond_bic.py", "peers_methods.py",
           "peers_sysident.py")


class Task(NamedTuple):
    """What was kept of one case. `picks`: stage -> columns that SysIdentPy took, where it was asked."""

    number: int
    path: str
    picks: dict[str, list[int]] | None = None


def examine(task: Task) -> dict[str, Any]:
    """Every peer's say about one case; a peer that breaks says nothing, and why."""
    kept = _read(task.path)
    log = Log(kept["log"])
    methods: dict[str, Method] = dict(PEERS)
    if task.picks is not None:
        picks = task.picks
        methods = {SYSIDENT: lambda one, seed: there(picked(s, one.libraries[s.name], picks.get(s.name, []))
                                                     for s in one.stages)}
    out: dict[str, Any] = {}
    troubles = []
    for name, method in methods.items():
        began, said = time.process_time(), []
        try:
            said = [_told(one, kept) for one in method(log, task.number % 1000)]
        except ImportError as error:
            troubles.append(f"{name}: left out: {error}")
            continue
        except Exception as error:
            troubles.append(f"{name}: {type(error).__name__}: {error}")
        out[name] = {"said": said, "silent": _others(None, kept), "processor_s": time.process_time() - began}
    return {"number": task.number, "said": out, "trouble": "; ".join(troubles) or None}


def _read(path: str) -> dict[str, Any]:
    with Path(path).open("rb") as file:
        kept: dict[str, Any] = pickle.load(file)
    return kept


def _told(said: Said, kept: dict[str, Any]) -> dict[str, Any]:
    return {"score": said.score, "stage": said.stage, "variables": list(said.variables), "form": said.form,
            **_others(said, kept)}


def _others(said: Said | None, kept: dict[str, Any]) -> dict[str, Any]:
    """What it is worth on each other run; None: nothing said."""
    return {word: None if kept[word] is None or not kept["truth"]["outside"] else _errors(said, kept[word])
            for word in AGAIN}


def _errors(said: Said | None, other: dict[str, Channel]) -> dict[str, Any]:
    key = None if said is None else READING[said.stage]
    mine = {} if said is None or key not in other else {key: said.predict(other[key])}
    return worth([c.truth for c in other.values() if c.truth is not None], mine)


def sysident_picks(tasks: Sequence[Task], python: Path) -> list[Task]:
    """SysIdentPy asked in its own environment. Raises CalledProcessError where that fails."""
    arrays: dict[str, Any] = {}
    where: list[tuple[int, str]] = []
    for k, task in enumerate(tasks):
        for name, s in Log(_read(task.path)["log"]).libraries.items():
            arrays |= {f"x{len(where)}": s.x, f"y{len(where)}": s.y}
            where.append((k, name))
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/problems.npz", **arrays)
        subprocess.run([str(python), str(HERE / "peers_sysident.py"), f"{folder}/problems.npz", f"{folder}/picks.json"],
                       check=True)
        picks = json.loads(Path(f"{folder}/picks.json").read_text(encoding="utf-8"))
    by_task: list[dict[str, list[int]]] = [{} for _ in tasks]
    for (k, name), columns in zip(where, picks, strict=True):
        by_task[k][name] = columns
    return [task._replace(picks=found) for task, found in zip(tasks, by_task, strict=True)]


def compared(kept: dict[int, dict[str, Any]], folder: Path, sysident: Path | None, jobs: int) -> list[str]:
    """Markdown: every peer on all that is kept, ours first."""
    tasks = [Task(n, str(folder / f"{n}.pickle")) for n in sorted(kept) if (folder / f"{n}.pickle").exists()]
    code = file_hash(HERE / name for name in METHODS)
    said, _ = worked(tasks, examine, folder / f"peers-{code}.jsonl", jobs, np.inf)
    if sysident is not None:
        path = folder / f"sysident-{code}.jsonl"
        asked = sysident_picks(tasks, sysident)
        for n, one in worked(asked, examine, path, 1, np.inf)[0].items():
            said[n]["said"] |= one["said"]
    ours = [of_kept(kept[n]) for n in sorted(said) if n < FIRST_NULL]
    nulls = [n for n in said if FIRST_NULL <= n < CALIBRATING]
    first = ("**topdress**", ours, percent(sum(named(kept[n]) for n in nulls), len(nulls)),
             f"{np.mean([kept[n]['processor_s'] for n in said if n < CALIBRATING]):.1f}")
    calibration = [n for n in said if n >= CALIBRATING]
    return ["## Peers on the same cases", "",
            f"{len(ours)} cases, {len(nulls)} healthy logs. Each peer's thresholds are its highest scores of each "
            f"stage among {len(calibration)} healthy logs of the tuning half.", "",
            *peers_table([first, *_lines(said, kept, nulls, calibration, 1.0)]),
            "", f"The same with thresholds that {100 * (1 - LENIENT):.0f} % of them exceed:", "",
            *peers_table([first, *_lines(said, kept, nulls, calibration, LENIENT)])]


def _lines(said: dict[int, Any], kept: dict[int, Any], nulls: Sequence[int], calibration: Sequence[int],
           level: float) -> list[tuple[str, list[Case], str, str]]:
    lines = []
    for name in dict.fromkeys(name for one in said.values() for name in one["said"]):
        here = {n: one["said"][name] for n, one in said.items() if name in one["said"]}
        least = {stage: _threshold([here[n]["said"] for n in calibration if n in here], stage, level)
                 for stage in STAGES}
        loudest = {n: max((o for o in one["said"] if o["score"] > least[o["stage"]]),
                          key=lambda o: o["score"] - least[o["stage"]], default=None) for n, one in here.items()}
        cases = [_case(kept[n]["truth"], here[n], loudest[n]) for n in sorted(here) if n < FIRST_NULL]
        false = sum(loudest.get(n) is not None for n in nulls)
        seconds = float(np.mean([one["processor_s"] for one in here.values()]))
        lines.append((name, cases, percent(false, len(nulls)), f"{seconds:.2f}"))
    return lines


def _threshold(said: Sequence[Sequence[dict[str, Any]]], stage: str, level: float) -> float:
    """Of one stage: not exceeded by this share of the healthy logs."""
    scores = [max((o["score"] for o in one if o["stage"] == stage), default=0.0) for one in said]
    return float(np.quantile(scores, level, method="higher")) if scores else 0.0


def _case(truth: dict[str, Any], one: dict[str, Any], loudest: dict[str, Any] | None) -> Case:
    """A peer's say in the shape of a diagnosis, marked by the same scorer."""
    answer: dict[str, Any] = {"verdict": "none", "causes": [], "unexplained": [], "terms": []}
    if loudest is None:
        return counted(truth, answer, one["processor_s"], {word: one["silent"][word] for word in AGAIN}, False)
    variables = loudest["variables"]
    answer |= {"verdict": "unexplained", "terms": [{"term": {"form": loudest["form"]}}],
               "unexplained": [{"channel": loudest["stage"], "variable": variables[0], "variables": variables}]}
    others = {word: loudest[word] for word in AGAIN}
    return counted(truth, answer, one["processor_s"], others, loudest["form"] != "span")
