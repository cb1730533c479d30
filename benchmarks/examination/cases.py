"""Cases of the examination: a folder with data and machine file each, and the truth apart.

The timetable is `hidden/class_plan.py`: runs and bench tables with one hidden effect, several, a
form that no catalogue holds, or nothing.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Seed of the machine's other run, relative to the seed of the case.
OTHER_RUN = 50_000
# Categories of cases that hide something outside of every list.
OUTSIDE = ("outside", "term", "column")


class Case(NamedTuple):
    """One case on the disk."""

    number: int
    # What an entry may read.
    folder: Path
    # What only the scorer may read: truth.json, other.csv.
    truth: Path


def write_case(number: int, seed: int, folder: Path) -> Case:
    """Writes case `number` of a seed below a folder, and returns where it is. Cases that are there
    already stay."""
    from hidden import class_plan
    from hidden.cases import one
    from hidden.write import _cells

    name = f"case-{seed}-{number:05d}"
    here = Case(number, folder / "cases" / name, folder / "truth" / name)
    if (here.truth / "truth.json").exists():
        return here
    wanted = class_plan.wanted(number, seed)
    case = one(number, seed, "unseen", (wanted.category,), wanted.kinds, wanted.ids)
    for place in here[1:]:
        place.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "configs" / "machines" / "huanghai.yaml", here.folder / "machine.yaml")

    def write_columns(path: Path, columns: dict[str, Any]) -> None:
        rows = zip(*[_cells(np.asarray(c)) for c in columns.values()], strict=True)
        lines = [",".join(columns), *map(",".join, rows)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")

    table = case.kind != "run"
    write_columns(here.folder / ("bench.csv" if table else "log.csv"), case.columns)
    (here.folder / "kind.txt").write_text(case.kind, encoding="utf-8")
    if case.redriven is not None:
        other = case.redriven(lambda drive: drive, seed * OTHER_RUN + number)
        write_columns(here.truth / "other.csv", other.columns)
    ids = sorted({c["id"] for c in case.truth["causes"]})
    outside = case.truth["category"] in OUTSIDE
    truth = {
        "category": case.truth["category"],
        "ids": [] if outside else ids,
        "unknown": outside,
        "none": not ids and not outside,
        "sizes": {c["id"]: c["size"] for c in case.truth["causes"] if c["size_defined"]},
        "alike": {c["id"]: sorted(c["equal"]) for c in case.truth["causes"]},
        "z": {c["id"]: c["z"] for c in case.truth["causes"]},
    }
    # The truth is written last: a case that was cut is written again.
    (here.truth / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return here
