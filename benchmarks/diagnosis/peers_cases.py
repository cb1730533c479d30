"""Cases for the peers: made and turned into evidence in processes of their own, and kept on disk."""
from __future__ import annotations

import hashlib
import multiprocessing
import pickle
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from evidence import Evidence, evidence
from hidden.cases import one
from hidden.plan import wanted
from peers_spline import spline_gain

ROOT = Path(__file__).resolve().parents[2]
KEEP = ROOT / ".benchmarks" / "peers"
NULL_SEED, NULLS = 3, 60


class Job(NamedTuple):
    truth: dict[str, Any]
    evidence: Evidence
    spline: float | None          # share of the removable error that a spline removed on held-out rows


class Task(NamedTuple):
    """A case of the timetable, or (seed NULL_SEED) a run of the tuning half with nothing hidden."""

    number: int
    seed: int


def tasks(test: int, nulls: int, seed: int) -> list[Task]:
    """The first `test` runs of the timetable, then `nulls` runs with nothing hidden."""
    runs = (k for k in range(100_000) if wanted(k, seed).kinds == ("run",))
    return [Task(next(runs), seed) for _ in range(test)] + [Task(k, NULL_SEED) for k in range(nulls)]


def code_hash() -> str:
    """Of what makes the evidence."""
    digest = hashlib.sha256()
    for path in (*sorted((ROOT / "tests/diagnosis/hidden").glob("*.py")), Path(__file__).parent / "evidence.py"):
        if path.name not in ("score.py", "report.py", "make.py", "write.py"):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def prepare(task: Task) -> Job:
    """Case -> evidence, kept on disk."""
    path = KEEP / code_hash() / f"{task.seed}-{task.number}.pickle"
    if path.exists():
        with path.open("rb") as file:
            kept: Job = pickle.load(file)
            return kept
    if task.seed == NULL_SEED:
        case = one(task.number, task.seed, "tuning", ("none",), ("run",))
    else:
        w = wanted(task.number, task.seed)
        case = one(task.number, task.seed, "all", (w.category,), w.kinds, w.ids)
    job = Job(case.truth, evidence(case.columns), spline_gain(case.truth, case.columns))
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(job))
    part.replace(path)
    return job


def prepared(wanted_tasks: Sequence[Task], jobs: int) -> list[Job]:
    """All of them, in order, `jobs` at a time."""
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        out = []
        for job in pool.imap(prepare, wanted_tasks):
            out.append(job)
            print(f"\r{len(out)}/{len(wanted_tasks)} runs prepared ", end="", file=sys.stderr, flush=True)
    return out
