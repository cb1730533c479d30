"""Cases of the examination: a folder with data and machine file each, and the truth apart.

Of five cases three are runs of 12 to 14 minutes (`hidden/class_plan.py`), one is a bench table, one
a drive of another machine (drives.py). A third hides nothing.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Length of a run, minutes: as `hidden/another_run.py` has it; a case then takes some 2 s.
RUN_MINUTES = (12.0, 14.0)
# Seed of the machine's other run, relative to the seed of the case.
OTHER_RUN = 50_000
# Categories of cases that hide something outside of every list.
OUTSIDE = ("outside", "term", "column")
# What the cases of five numbers are.
TURNS = ("run", "run", "table", "run", "drive")


class Case(NamedTuple):
    """One case on the disk."""

    number: int
    # What an entry may read.
    folder: Path
    # What only the scorer may read: truth.json, other.csv.
    truth: Path


def place_case(number: int, seed: int, folder: Path) -> Case:
    """Returns where a case is, made or not."""
    name = f"case-{seed}-{number:05d}"
    return Case(number, folder / "cases" / name, folder / "truth" / name)


def write_case(
    number: int, seed: int, folder: Path, programmes: str = "unseen", is_scored: bool = True
) -> Case:
    """Writes case `number` of a seed below a folder, and returns where it is. Cases that are there
    already stay.

    Parameters
    ----------
    programmes : half of the drive programmes, `unseen` or `tuning`.
    is_scored : whether the machine's other run is made as well, which takes as long again.
    """
    here = place_case(number, seed, folder)
    if (here.truth / "truth.json").exists():
        return here
    for place in here[1:]:
        place.mkdir(parents=True, exist_ok=True)
    turn = TURNS[number % len(TURNS)]
    truth = (
        _write_drive(here, seed)
        if turn == "drive"
        else _write_hidden(here, seed, turn, programmes, is_scored)
    )
    # The truth is written last: a case that was cut is written again.
    (here.truth / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return here


def _write_drive(here: Case, seed: int) -> dict[str, Any]:
    from drives import make_drive_case

    made = make_drive_case(np.random.default_rng([seed, here.number, 5]))
    (here.folder / "machine.yaml").write_text(made.machine, encoding="utf-8")
    (here.folder / "kind.txt").write_text("run", encoding="utf-8")
    write_columns(here.folder / "log.csv", made.columns)
    write_columns(here.truth / "other.csv", made.other)
    return {"turn": "drive", **make_truth(made.truth["category"], made.truth["causes"])}


def _write_hidden(
    here: Case, seed: int, turn: str, programmes: str, is_scored: bool
) -> dict[str, Any]:
    from hidden import class_plan
    from hidden.cases import CATEGORIES, TABLE_KINDS, one
    from hidden.programmes import drive

    shutil.copy(ROOT / "configs" / "machines" / "huanghai.yaml", here.folder / "machine.yaml")
    if turn == "table":
        case = one(here.number, seed, programmes, CATEGORIES, TABLE_KINDS)
    else:
        # Tables of the timetable are passed over: they have a turn of their own.
        number = here.number
        while (wanted := class_plan.wanted(number, seed)).kinds != ("run",):
            number += 1_000_000
        case = one(
            here.number, seed, programmes, (wanted.category,), ("run",), wanted.ids, RUN_MINUTES
        )
    write_columns(here.folder / ("bench.csv" if turn == "table" else "log.csv"), case.columns)
    (here.folder / "kind.txt").write_text(case.kind, encoding="utf-8")
    if is_scored and case.redriven is not None:
        own_seed = seed * OTHER_RUN + here.number

        def drive_again(first: Any) -> Any:
            return drive(first.programme._replace(minutes=RUN_MINUTES), own_seed)

        write_columns(here.truth / "other.csv", case.redriven(drive_again, own_seed).columns)
    return {"turn": turn, **make_truth(case.truth["category"], case.truth["causes"])}


def make_truth(category: str, causes: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns what the scorer reads: ids that are there, none, unknown, sizes, and for each id the
    others that leave the same trace in this data."""
    ids, outside = sorted({c["id"] for c in causes}), category in OUTSIDE
    return {
        "category": category,
        "ids": [] if outside else ids,
        "unknown": outside,
        "none": not ids and not outside,
        "sizes": {c["id"]: c["size"] for c in causes if c["size_defined"]},
        "alike": {c["id"]: sorted(c["equal"]) for c in causes},
        "z": {c["id"]: c["z"] for c in causes},
    }


def write_columns(path: Path, columns: dict[str, Any]) -> None:
    """Writes columns of equal length as CSV, NaN as an empty cell."""
    from hidden.write import write_cells

    rows = zip(*[write_cells(np.asarray(c)) for c in columns.values()], strict=True)
    lines = [",".join(columns), *map(",".join, rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
