"""Other methods on the cases beyond the catalogue: what each says, what it predicts of other runs, all judged as ours is.

Each peer's threshold is the highest score among healthy logs of the tuning half. What a peer says below it counts as
nothing said. PySR is not among them: it needs Julia.
"""
from __future__ import annotations

import json
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import peers_methods
from beyond_bic import forms_and_bic
from beyond_case import AGAIN, CALIBRATING, FIRST_NULL
from beyond_linear import stages
from beyond_methods import (
    Method,
    Said,
    by_library,
    gaussian_process,
    lisdd,
    picked,
    problem_of,
    spline,
    strongest,
    symbolic,
)
from beyond_other_run import READING, worth
from beyond_problem import Channel
from beyond_report import Case, counted, of_kept, peers_table
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
    some = stages(kept["log"])
    methods: dict[str, Method] = dict(PEERS)
    if task.picks is not None:
        picks = task.picks
        methods = {SYSIDENT: lambda found, seed: strongest([picked(s, picks.get(s.name, [])) for s in found])}
    out: dict[str, Any] = {}
    troubles = []
    for name, method in methods.items():
        began = time.perf_counter()
        said = None
        try:
            said = method(some, task.number % 1000)
            out[name] = {**_told(said, kept), "seconds": time.perf_counter() - began}
        except ImportError as error:
            troubles.append(f"{name}: left out: {error}")
        except Exception as error:
            out[name] = {**_told(None, kept), "seconds": time.perf_counter() - began}
            troubles.append(f"{name}: {type(error).__name__}: {error}")
    return {"number": task.number, "said": out, "trouble": "; ".join(troubles) or None}


def _read(path: str) -> dict[str, Any]:
    with Path(path).open("rb") as file:
        kept: dict[str, Any] = pickle.load(file)
    return kept


def _told(said: Said | None, kept: dict[str, Any]) -> dict[str, Any]:
    others = {word: None if kept[word] is None or not kept["truth"]["outside"] else _errors(said, kept[word])
              for word in AGAIN}
    if said is None:
        return {"score": 0.0, "stage": "", "variables": [], "form": "", **others}
    return {"score": said.score, "stage": said.stage, "variables": list(said.variables), "form": said.form, **others}


def _errors(said: Said | None, other: dict[str, Channel]) -> dict[str, Any]:
    key = None if said is None else READING[said.stage]
    mine = {} if said is None or key not in other else {key: said.predict(other[key])}
    return worth([c.truth for c in other.values() if c.truth is not None], mine)


def sysident_picks(tasks: Sequence[Task], python: Path) -> list[Task]:
    """SysIdentPy asked in its own environment. Raises CalledProcessError where that fails."""
    arrays: dict[str, Any] = {}
    where: list[tuple[int, str]] = []
    for k, task in enumerate(tasks):
        for stage in stages(_read(task.path)["log"]):
            s = problem_of(stage)
            arrays |= {f"x{len(where)}": s.x, f"y{len(where)}": s.y}
            where.append((k, stage.name))
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
    first = ("**topdress**", ours, percent(sum(bool(kept[n]["answer"] and kept[n]["answer"].get("terms"))
                                               for n in nulls), len(nulls)),
             f"{np.mean([kept[n]['seconds'] for n in said if n < CALIBRATING]):.1f}")
    calibration = [n for n in said if n >= CALIBRATING]
    out = ["## Peers on the same cases", "",
           f"{len(ours)} cases, {len(nulls)} healthy logs. Each peer's threshold is the highest score among "
           f"{len(calibration)} healthy logs of the tuning half.", "",
           *peers_table([first, *_lines(said, kept, nulls, calibration, 1.0)]),
           "", f"The same with a threshold that {100 * (1 - LENIENT):.0f} % of them exceed:", "",
           *peers_table([first, *_lines(said, kept, nulls, calibration, LENIENT)])]
    return out


def _lines(said: dict[int, Any], kept: dict[int, Any], nulls: Sequence[int], calibration: Sequence[int],
           level: float) -> list[tuple[str, list[Case], str, str]]:
    names = list(dict.fromkeys(name for one in said.values() for name in one["said"]))
    lines = []
    for name in names:
        here = {n: one["said"][name] for n, one in said.items() if name in one["said"]}
        scores = [here[n]["score"] for n in calibration if n in here]
        least = float(np.quantile(scores, level, method="higher")) if scores else 0.0
        cases = [_case(kept[n]["truth"], here[n], here[n]["score"] > least) for n in sorted(here) if n < FIRST_NULL]
        false = sum(here[n]["score"] > least for n in nulls if n in here)
        lines.append((name, cases, percent(false, len(nulls)), f"{np.mean([o['seconds'] for o in here.values()]):.2f}"))
    return lines


def _case(truth: dict[str, Any], one: dict[str, Any], speaks: bool) -> Case:
    """A peer's say in the shape of a diagnosis, marked by the same scorer."""
    answer: dict[str, Any] = {"verdict": "none", "causes": [], "unexplained": [], "terms": []}
    others = {word: one[word] for word in AGAIN}
    if not speaks:
        silent = {word: None if o is None else {**o, "adopted": o["nominal"], "left": o["removable"],
                                                     "share": None if o["share"] is None else 0.0}
                  for word, o in others.items()}
        return counted(truth, answer, one["seconds"], silent, False)
    answer |= {"verdict": "unexplained",
               "unexplained": [{"channel": one["stage"], "variable": one["variables"][0], "variables": one["variables"]}],
               "terms": [{"term": {"form": one["form"]}}]}
    return counted(truth, answer, one["seconds"], others, one["form"] != "span")
