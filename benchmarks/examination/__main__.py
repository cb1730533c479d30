"""The examination of diagnoses: named faults with probabilities, on machines that hide them.

    python -m benchmarks examination --entry topdress --seed 4711 --cases 40

Each case is a folder with data and a machine file; the truth lies apart. README.md says how a
method enters. Answers are kept; an examination that was cut goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
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

from kept import code_hash, done_in, written  # noqa: E402

HERE = Path(__file__).resolve().parent
# Files that decide a case or an answer; scores are made anew from kept answers.
DECIDING = [HERE / name for name in ("cases.py", "drives.py", "entries.py")]
DECIDING_PEERS = [HERE / name for name in ("learner.py", "peers.py", "plain.py")]
# Processor time that an entry may take for a case, s; a later answer counts as none.
LIMIT_S = 60.0
NO_ANSWER: dict[str, Any] = {"causes": {}, "none": 0.5, "unknown": 0.5, "size": {}}


class Task(NamedTuple):
    """One case, and the entries that have not answered it."""

    number: int
    seed: int
    entries: tuple[str, ...]
    folder: str
    programmes: str = "unseen"


class Peeked(Exception):
    """An entry opened what only the scorer may read."""


_forbidden: list[str] = []


def _refuse_truth(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuses to open a file below a forbidden folder, by whatever code of Python."""
    if event == "open" and _forbidden and isinstance(arguments[0], (str, bytes, Path)):
        path = arguments[0].decode() if isinstance(arguments[0], bytes) else str(arguments[0])
        if any(folder in str(Path(path).resolve()) for folder in _forbidden):
            raise Peeked(f"{path}: only the scorer may open it")


sys.addaudithook(_refuse_truth)


def calc_gain(machine: str | None, case: Any) -> float:
    """Returns the r.m.s. error of an entry's machine on another run over that of the machine file,
    in units of the noise over all channels; 1 without a machine, nan without another run."""
    import numpy as np
    from beyond_other_run import NOISE, errors_of, seen
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.read_log import read_log

    other = case.truth / "other.csv"
    if not other.exists():
        return float("nan")
    if machine is None:
        return 1.0
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


def ask_entry(name: str, case: Any) -> dict[str, Any]:
    """Asks an entry with a copy of the case in a folder of its own, and returns what is kept."""
    from entries import find_entry

    answer, trouble, gain = NO_ANSWER, None, 1.0
    with tempfile.TemporaryDirectory(prefix="examination-") as place:
        folder = Path(place) / "case"
        shutil.copytree(case.folder, folder)
        data = next(p for p in (folder / "log.csv", folder / "bench.csv") if p.exists())
        began = time.process_time()
        _forbidden[:] = [str(case.truth.parent.resolve()), str(case.folder.parent.resolve())]
        try:
            answer = find_entry(name)(data, folder / "machine.yaml")
        except Exception as error:  # an entry of others may raise anything
            trouble = f"{type(error).__name__}: {error}"
        finally:
            _forbidden.clear()
        seconds = time.process_time() - began
        if seconds > LIMIT_S:
            answer, trouble = NO_ANSWER, f"{seconds:.0f} s of processor, {LIMIT_S:.0f} allowed"
        try:
            gain = calc_gain(answer.get("machine"), case)
        except Exception as error:
            trouble = f"its machine: {type(error).__name__}: {error}"
    answer = {**answer, "machine": None}
    return {
        "number": case.number,
        "answer": answer,
        "gain": gain,
        "seconds": seconds,
        "trouble": trouble,
    }


def examine(task: Task) -> dict[str, dict[str, Any]]:
    """Makes a case, asks the entries, and returns what is kept of each."""
    from cases import write_case

    case = write_case(task.number, task.seed, Path(task.folder), task.programmes)
    return {name: ask_entry(name, case) for name in task.entries}


def ask_all(tasks: Sequence[Task], jobs: int) -> Iterator[dict[str, dict[str, Any]]]:
    """Yields what the entries answer, a case at a time."""
    if jobs <= 1:
        yield from map(examine, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(examine, tasks)


def keep_answers(args: argparse.Namespace, names: Sequence[str]) -> dict[str, dict[int, Any]]:
    """Returns the kept answers by entry and case, those not there before asked for, each written
    as soon as it is there."""
    from entries import PEERS

    own, peers = code_hash(DECIDING), code_hash([*DECIDING, *DECIDING_PEERS])
    files = {
        name: args.folder
        / "answers"
        / f"{name}-{args.seed}-{peers if name in PEERS else own}.jsonl"
        for name in names
    }
    numbers = range(args.start, args.start + args.cases)
    kept = {name: done_in(path) for name, path in files.items()}
    kept = {n: {k: one for k, one in of.items() if k in numbers} for n, of in kept.items()}
    tasks = [
        Task(k, args.seed, missing, str(args.folder), args.programmes)
        for k in numbers
        if (missing := tuple(name for name in names if k not in kept[name]))
    ]
    (args.folder / "answers").mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    for done, answers in enumerate(ask_all(tasks if args.minutes > 0.0 else [], args.jobs), 1):
        for name, one in answers.items():
            kept[name][one["number"]] = one
            with files[name].open("a", encoding="utf-8", newline="\n") as out:
                out.write(json.dumps(one) + "\n")
            if one["trouble"]:
                print(f"case {one['number']}, {name}: {one['trouble']}", file=sys.stderr)
        spent = time.monotonic() - began
        left = spent / done * (len(tasks) - done) / 60.0
        print(f"\r{done}/{len(tasks)}, {left:.0f} min left ", end="", file=sys.stderr, flush=True)
        if spent > 60.0 * args.minutes:
            break
    return kept


def main() -> int:
    """Runs the entries on the cases and writes the page."""
    from cases import place_case
    from entries import find_entry
    from report import write_page
    from score import score_answer
    from topdress.control.machine.machine import CATALOGUE
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--entry", action="append", help="repeatable; the constant is always there")
    a.add_argument("--seed", type=int, required=True, help="given at the time of scoring")
    a.add_argument("--cases", type=int, default=400)
    a.add_argument("--start", type=int, default=0)
    a.add_argument("--programmes", choices=("tuning", "unseen"), default="unseen")
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument(
        "--minutes", type=float, default=240.0, help="what is done counts; 0: score what is kept"
    )
    a.add_argument("--folder", type=Path, default=ROOT / ".benchmarks" / "examination")
    a.add_argument("--out", type=Path, help="Markdown, pictures next to it; else to the screen")
    args = a.parse_args()
    names = list(dict.fromkeys(["constant", *(args.entry or ["topdress"])]))
    for name in names:
        try:
            find_entry(name)
        except (ValueError, ImportError) as error:
            print(error, file=sys.stderr)
            return 2
    kept = keep_answers(args, names)
    # Entries are compared on cases that all of them have answered.
    common = sorted(set.intersection(*(set(of) for of in kept.values())))
    by_entry: dict[str, list[Any]] = {name: [] for name in names}
    turns: list[str] = []
    for number in common:
        truth_of = place_case(number, args.seed, args.folder).truth / "truth.json"
        truth = json.loads(truth_of.read_text(encoding="utf-8"))
        turns.append(truth["turn"])
        for name, scored in by_entry.items():
            one = kept[name][number]
            scored.append(
                score_answer(one["answer"], truth, CATALOGUE, one["gain"], one["seconds"])
            )
    trouble = {n: sum(bool(kept[n][k]["trouble"]) for k in common) for n in names}
    if common:
        written(write_page(by_entry, turns, trouble, args.out), args.out)
    return exit_code({"every case was scored": len(common) == args.cases})


if __name__ == "__main__":
    sys.exit(main())
