"""Answers of the diagnosis to cases of the examination, written down or held against answers written down before.

    python benchmarks/diagnosis/answers.py --out before.jsonl
    python benchmarks/diagnosis/answers.py --against before.jsonl

Only the tuning half is asked. After a change that should change nothing the second command prints 0 differing answers;
else each difference, case by case, and exits 1 (--added: fields that only the new answers have are let pass). Cases are
dealt as by run.py; their data is the same for the same seed.
"""
from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from run import Task, examine, tasks_of
from verdict import exit_code

SHOWN = 12                  # differences of a case that are printed


def differences(before: Any, after: Any, where: str = "") -> Iterator[str]:
    """Every place at which two answers differ, as "place: before -> after"."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys([*before, *after]):
            if key not in before or key not in after:
                yield f"{where}.{key}: {'added' if key in after else 'gone'}"
            else:
                yield from differences(before[key], after[key], f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for k, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{where}[{k}]")
    elif before != after:
        yield f"{where}: {before!r} -> {after!r}"


def _answers(tasks: list[Task], jobs: int) -> Iterator[tuple[int, Any]]:
    if jobs <= 1:
        for task in tasks:
            yield task.number, examine(task)["answer"]
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for one in pool.imap_unordered(examine, tasks):
            yield one["number"], one["answer"]


def main() -> int:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--cases", type=int, default=1200)
    a.add_argument("--start", type=int, default=0)
    a.add_argument("--seed", type=int, default=1)
    a.add_argument("--data", choices=("all", "run", "table"), default="all")
    a.add_argument("--jobs", type=int, default=2)
    a.add_argument("--out", type=Path, help="write the answers here")
    a.add_argument("--against", type=Path, help="hold them against these")
    a.add_argument("--added", action="store_true", help="fields that are new are told and not counted")
    a.add_argument("--ignore", action="append", default=[], help="a field whose changes are told and not counted")
    args = a.parse_args()
    args.programmes, args.category, args.kind = "tuning", None, None
    old: dict[int, Any] = {}
    tasks = tasks_of(args)
    if args.against is not None:
        old = {one["number"]: one["answer"] for one in map(json.loads, args.against.read_text("utf-8").splitlines())}
        tasks = [task for task in tasks if task.number in old]
    new: dict[int, Any] = {}
    for number, answer in _answers(tasks, args.jobs):
        new[number] = answer
        print(f"\r{len(new)}/{len(tasks)} ", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    if args.out is not None:
        args.out.write_text("".join(json.dumps({"number": k, "answer": new[k]}) + "\n" for k in sorted(new)), "utf-8")
    raised = sum(answer is None for answer in new.values())
    asked: dict[str, object] = {"at least one case is asked": new, f"{raised} answers raised: none": not raised}
    if args.against is None:
        return exit_code(asked)
    changed = 0
    for number in sorted(new):
        found = list(differences(old[number], new[number]))
        counted = [line for line in found if not any(word in line.split(":")[0] for word in args.ignore)
                   and not (args.added and line.endswith(": added"))]
        changed += bool(counted)
        if found:
            print(f"case {number}: " + "; ".join(found[:SHOWN]) + ("; ..." if len(found) > SHOWN else ""))
    print(f"{len(new)} answers, {changed} differ")
    return exit_code(asked | {f"{changed} answers differ: none": not changed})


if __name__ == "__main__":
    sys.exit(main())
