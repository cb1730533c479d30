"""Gain of every steady effect on healthy machines, by group of channels and noise.

    python -m benchmarks diagnosis/steady_gain --cases 32 --seed 5

An effect that is absent gains a chi-square with one degree of freedom in twice the log-likelihood,
so the mean gain of many is 1 where the model of the noise is right. Above 1 the diagnosis is too
sure, below it is too careful. The logs are those of the hidden machines without a fault.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from kept import ROOT, arguments, code_hash, worked, written

sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "tests" / "diagnosis")]


class Task(NamedTuple):
    """One healthy log."""

    number: int
    seed: int
    programmes: str


def examine(task: Task) -> dict[str, Any]:
    """Makes one log and returns the gains of the steady effects by group."""
    from hidden.cases import one
    from topdress.control.diagnosis.runs import diagnose
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    case = one(task.number, task.seed, task.programmes, ("none",), ("run",))
    gains: dict[str, list[float]] = defaultdict(list)
    judge = diagnose.judge_group

    def judge_and_keep(search: Any) -> Any:
        group = judge(search)
        gains["+".join(search.model.names)] += [
            test.gain
            for test in group.scan
            if test.part.onset_s is None and not test.part.grows and test.gain > 0.0
        ]
        return group

    diagnose.judge_group, trouble = judge_and_keep, None
    try:
        machine = load_config("huanghai", MACHINE_KIND).model
        diagnose.diagnose_run(case.columns, machine)
    except Exception:
        trouble = traceback.format_exc(limit=-4)
    finally:
        diagnose.judge_group = judge
    return {
        "number": task.number,
        "noise": case.truth["noise"],
        "gains": gains,
        "trouble": trouble,
    }


def main() -> int:
    """Runs the cases and prints the table."""
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=32)
    arguments(a, "steady_gain", "unseen")
    args = a.parse_args()
    tasks = [
        Task(k, args.seed, args.programmes) for k in range(args.start, args.start + args.cases)
    ]
    keep = args.keep / f"{code_hash((Path(__file__),))}-{args.seed}.jsonl"
    kept, _ = worked(tasks, examine, keep, args.jobs, args.minutes)
    by: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    for one in kept.values():
        for group, gains in one["gains"].items():
            for noise in (one["noise"], "all"):
                by[group, noise].append(gains)
    lines = ["| group | noise | logs | mean gain | logs above 4 |", "|---|---|---|---|---|"]
    for (group, noise), logs in sorted(by.items()):
        means = [float(np.mean(gains)) for gains in logs if gains]
        lines.append(
            f"| {group} | {noise} | {len(logs)} | {np.mean(means) if means else 0.0:.2f} | "
            f"{sum(max(gains, default=0.0) > 4.0 for gains in logs)} |"
        )
    written("\n".join(lines) + "\n", args.out)
    return exit_code({"every log was judged": all(one["trouble"] is None for one in kept.values())})


if __name__ == "__main__":
    sys.exit(main())
