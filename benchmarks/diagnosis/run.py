"""The benchmark of the diagnosis: hidden effects, found or not, counted into one table.

    python -m benchmarks diagnosis/run --cases 1200 --seed 1 --programmes all --jobs 2

What case k hides is dealt by hidden/plan.py (runs and tables, nulls, every id in turn), with
`--plan classes` by hidden/class_plan.py (all classes of runs); with `--category` or `--kind` it
is drawn among those instead. Cases done are kept (one line each below --keep) and not done
again, as long as the program's code is the same; `--minutes` bounds the time, and the next call
goes on from there.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from pathlib import Path
from typing import Any, NamedTuple

from kept import ROOT, arguments, code_hash, worked, written

sys.path[:0] = [
    str(ROOT),
    str(ROOT / "benchmarks"),
    str(ROOT / "tests" / "diagnosis"),
    str(Path(__file__).parent),
]

PLANS = ("catalogue", "classes")


class Task(NamedTuple):
    """One case to be made and asked about: the arguments of `hidden.cases.one`."""

    number: int
    seed: int
    programmes: str
    categories: tuple[str, ...]
    kinds: tuple[str, ...]
    ids: tuple[str, ...] = ()


def tasks_of(args: argparse.Namespace) -> list[Task]:
    """By a timetable, or drawn among the categories and kinds asked for."""
    from hidden import class_plan, plan
    from hidden.cases import CATEGORIES

    wanted = class_plan.wanted if getattr(args, "plan", PLANS[0]) == "classes" else plan.wanted
    numbers = range(args.start, args.start + args.cases)
    if args.category or args.kind:
        return [
            Task(
                k,
                args.seed,
                args.programmes,
                tuple(args.category or CATEGORIES),
                tuple(args.kind or ()),
            )
            for k in numbers
        ]
    planned = [(k, wanted(k, args.seed)) for k in numbers]
    return [
        Task(k, args.seed, args.programmes, (w.category,), w.kinds, w.ids)
        for k, w in planned
        if args.data == "all" or (args.data == "run") == (w.kinds == ("run",))
    ]


def examine(task: Task) -> dict[str, Any]:
    """Makes one case, asks the diagnosis, returns truth, answer and seconds."""
    number, seed = task.number, task.seed
    import ask
    from hidden.cases import one
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    started = time.perf_counter()
    case = one(*task)
    machine = load_config("huanghai", MACHINE_KIND).model
    began, answer, trouble, share = time.perf_counter(), None, None, None
    try:
        answer = ask.diagnosis(case.kind, case.columns, machine, case.name, seed)
    except Exception:
        trouble = traceback.format_exc(limit=-4)
    seconds = time.perf_counter() - began
    if answer is not None and answer["causes"]:
        share = case.gain_share(answer["causes"])
    return {
        "number": number,
        "truth": case.truth,
        "answer": answer,
        "seconds": seconds,
        "gain_share": share,
        "trouble": trouble,
        "whole_s": time.perf_counter() - started,
    }


def main() -> int:
    from hidden.cases import CATEGORIES
    from hidden.classes import CLASSES
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=1200)
    a.add_argument(
        "--plan",
        choices=PLANS,
        default=PLANS[0],
        help="timetable: the effects of the catalogue in runs and tables, or all classes of runs",
    )
    a.add_argument(
        "--category",
        action="append",
        choices=(*CATEGORIES, *CLASSES),
        help="only these (repeatable)",
    )
    a.add_argument(
        "--kind", action="append", choices=("run", "lag", "catch", "weigh", "heads", "place")
    )
    a.add_argument(
        "--data",
        choices=("all", "run", "table"),
        default="all",
        help="of the timetable, only these",
    )
    arguments(a, "diagnosis", "all")
    args = a.parse_args()
    from hidden.class_report import sections
    from hidden.report import report
    from hidden.score import mark

    plan = (
        "drawn" if args.category or args.kind else "classes" if args.plan == "classes" else "plan"
    )
    words = "-".join(
        (
            str(args.seed),
            args.programmes,
            plan,
            *sorted(set(args.category or ())),
            *(args.kind or ()),
            code_hash(),
        )
    )
    began = time.monotonic()
    kept, count = worked(
        tasks_of(args), examine, args.keep / f"{words}.jsonl", args.jobs, args.minutes
    )
    marks = [mark(o["truth"], o["answer"], o["seconds"], o["gain_share"]) for o in kept.values()]
    spent = time.monotonic() - began
    busy = sum(o.get("whole_s", o["seconds"]) for o in kept.values())
    text = (
        report(
            marks,
            f"Diagnosis of hidden effects, seed {args.seed}, programmes: {args.programmes}",
            sections(marks) if any("log" in m.truth for m in marks) else (),
        )
        + f"\nCode {code_hash()}; {count} cases in this call, wall time {spent / 60:.1f} "
        f"min with {args.jobs} "
        f"jobs; making and asking all {len(kept)} took {busy / 60:.1f} min of one job.\n"
    )
    written(text, args.out)
    print(f"\n{len(marks)} cases", file=sys.stderr)
    raised = sum(bool(o["trouble"]) for o in kept.values())
    promises: dict[str, object] = {
        "at least one case is asked": kept,
        f"{raised} of {len(kept)} cases raised: none": not raised,
    }
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
