"""The examination of diagnoses: named faults with probabilities, on machines that hide them.

    python -m benchmarks examination --entry topdress --seed 4711 --cases 40

Each case is a folder with data and a machine file; the truth lies apart. README.md says how a
method enters.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [
    str(Path(__file__).resolve().parent),
    str(ROOT),
    str(ROOT / "benchmarks"),
    str(ROOT / "benchmarks" / "diagnosis"),
    str(ROOT / "tests" / "diagnosis"),
]

from kept import code_hash, worked, written  # noqa: E402

HERE = sorted(Path(__file__).resolve().parent.glob("*.py"))


class Task(NamedTuple):
    """One case for one entry."""

    number: int
    seed: int
    entry: str
    folder: str


def calc_gain(machine: str | None, case: Any) -> float:
    """Returns the r.m.s. error of an entry's machine on another run over that of the machine file,
    in units of the noise over all channels; nan where there is no other run or no machine."""
    import numpy as np
    from beyond_other_run import NOISE, errors_of, seen
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.read_log import read_log

    other = case.truth / "other.csv"
    if machine is None or not other.exists():
        return float("nan")
    columns, sums = read_log(other).columns, []
    for path in (machine, str(case.folder / "machine.yaml")):
        model = load_config(path, MACHINE_KIND).model
        found = seen(columns, model)
        squares = [
            float(np.mean((errors_of(name, one.measured - one.predicted, one.step_s) / sd) ** 2))
            for name, sd in NOISE.items()
            if (one := found.get(name)) is not None
        ]
        sums.append(sum(squares))
    return float(np.sqrt(sums[0] / sums[1])) if sums[1] > 0.0 else float("nan")


def examine(task: Task) -> dict[str, Any]:
    """Makes a case, asks the entry, and returns the scored answer."""
    from cases import write_case
    from entries import find_entry
    from score import score_answer

    case = write_case(task.number, task.seed, Path(task.folder))
    data = next(p for p in (case.folder / "log.csv", case.folder / "bench.csv") if p.exists())
    began, trouble = time.perf_counter(), None
    answer: dict[str, Any] = {"causes": {}, "none": 0.5, "unknown": 0.5, "size": {}}
    try:
        answer = find_entry(task.entry)(data, case.folder / "machine.yaml")
    except Exception as error:  # an entry of others may raise anything
        trouble = f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - began
    truth = json.loads((case.truth / "truth.json").read_text(encoding="utf-8"))
    gain = calc_gain(answer.get("machine"), case)
    scored = score_answer(answer, truth, gain, seconds)
    return {"number": task.number, "scored": scored, "answer": answer, "trouble": trouble}


def main() -> int:
    """Runs the entries on the cases and writes the page."""
    from entries import find_entry
    from score import Scored, write_table
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--entry", action="append", help="repeatable; the constant is always there")
    a.add_argument("--seed", type=int, required=True, help="given at the time of scoring")
    a.add_argument("--cases", type=int, default=400)
    a.add_argument("--start", type=int, default=0)
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--minutes", type=float, default=240.0)
    a.add_argument("--folder", type=Path, default=ROOT / ".benchmarks" / "examination")
    a.add_argument("--out", type=Path, help="Markdown; else to the screen")
    args = a.parse_args()
    by_entry, left = {}, 0
    for name in dict.fromkeys(["constant", *(args.entry or ["topdress"])]):
        try:
            find_entry(name)
        except ValueError as error:
            print(error, file=sys.stderr)
            return 2
        numbers = range(args.start, args.start + args.cases)
        tasks = [Task(k, args.seed, name, str(args.folder)) for k in numbers]
        kept, _ = worked(
            tasks,
            examine,
            args.folder / "answers" / f"{name}-{args.seed}-{code_hash(HERE)}.jsonl",
            args.jobs,
            args.minutes,
        )
        by_entry[name] = [Scored(*kept[k]["scored"]) for k in sorted(kept)]
        left += len(tasks) - len(kept)
    written(write_table(by_entry, "constant"), args.out)
    return exit_code({"every case was scored": left == 0})


if __name__ == "__main__":
    sys.exit(main())
