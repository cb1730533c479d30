"""Simulation-based calibration of the diagnosis: machines with faults drawn from its own prior.

    python -m benchmarks diagnosis/calibration --cases 200 --seed 1 --jobs 2

Each case is a machine within its tolerances; each group of channels has a fault with the prior's
probability, of an effect, a size and a begin that are drawn from the prior as well. The program
writes the log (`topdress simulate`) and judges it. Where its probabilities are the
posterior of its prior, the mean probability of a fault is the share of faults, and the true size
lies at any quantile of its posterior equally often (Talts and others 2018, arXiv 1804.06788).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from kept import ROOT, arguments, code_hash, worked, written

sys.path.insert(0, str(ROOT / "benchmarks"))

SECONDS = 900.0
# Quantile classes of the true sizes.
CLASS_COUNT = 5


class Task(NamedTuple):
    """One case."""

    number: int
    seed: int


class Fault(NamedTuple):
    """One planted effect."""

    group: str
    id: str
    size: float
    onset_s: float
    member: int | None


def draw_faults(number: int, seed: int) -> list[Fault]:
    """Returns the faults of a case, drawn from the prior."""
    from topdress.control.diagnosis.effects import EFFECT_ROWS
    from topdress.control.diagnosis.judgement.prior import COURSE_PROBS, FAULT_PROB, WRONG_SIGN_PROB
    from topdress.control.diagnosis.runs.effort import EFFORT_CHANNELS
    from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS
    from topdress.control.machine.machine import CATALOGUE, find_size_bounds
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    machine, rng = (
        load_config("huanghai", MACHINE_KIND).model,
        np.random.default_rng([seed, number]),
    )
    found = []
    for group, channels in CHANNEL_GROUPS.items():
        rows = [
            row.scale_to_machine(machine)
            for row in EFFECT_ROWS.values()
            if row.scanned
            and row.channels[:1]
            and row.channels[0] in channels
            and row.channels[0] not in EFFORT_CHANNELS
            and row.usual > 0.0
            and not CATALOGUE[row.id].effect.onset_only
        ]
        if rng.random() >= FAULT_PROB:
            continue
        row = rows[int(rng.integers(len(rows)))]
        size = row.usual * float(rng.standard_cauchy())
        if row.only_adds:
            size = abs(size) if rng.random() >= WRONG_SIGN_PROB else -abs(size)
        low, high = find_size_bounds(row.id, machine)
        begins = row.may_begin and rng.random() >= COURSE_PROBS["steady"]
        onset_s = float(rng.uniform(0.0, SECONDS)) if begins else 0.0
        member = 1 + int(rng.integers(6)) if CATALOGUE[row.id].effect.member_field else None
        size = float(np.clip(abs(size) if low >= 0.0 else size, low, high))
        found.append(Fault(group, row.id, size, onset_s, member))
    return found


def draw_tolerances(number: int, seed: int) -> dict[str, float]:
    """Returns how far nominal values are off, drawn from their tolerances: size by the effect that
    changes the same value."""
    from topdress.control.diagnosis.effects import EFFECT_ROWS
    from topdress.control.diagnosis.runs.model import find_tolerance
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    machine = load_config("huanghai", MACHINE_KIND).model
    rng = np.random.default_rng([seed, number, 1])
    sds = {row.id: find_tolerance(row.id, machine) for row in EFFECT_ROWS.values() if row.moves}
    return {name: float(rng.normal(0.0, sd)) for name, sd in sds.items() if sd > 0.0}


def run_topdress(*words: str) -> str:
    """Runs the program, and returns what it prints.

    Raises
    ------
    RuntimeError : the program failed; with its last line.
    """
    done = subprocess.run(
        [sys.executable, "-c", "from topdress.console.cli import main; main()", *words],
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"topdress {' '.join(words)}: {done.stderr[-400:]}")
    return done.stdout


def examine(task: Task) -> dict[str, Any]:
    """Makes one case, asks the diagnosis, and returns truth and answer."""
    faults, off = draw_faults(task.number, task.seed), draw_tolerances(task.number, task.seed)
    # Tolerances of values that a fault replaces are part of the fault's size.
    sizes = {one.id: one for one in faults}
    planted = [
        *(f"{name}={by:.6g}" for name, by in off.items() if name not in sizes),
        *(
            f"{one.id}={one.size:.6g}@{one.onset_s:.1f}"
            + ("" if one.member is None else f"#{one.member}")
            for one in faults
        ),
    ]
    words = [word for one in planted for word in ("--effect", one)]
    answer, trouble = None, None
    with tempfile.TemporaryDirectory() as folder:
        log = str(Path(folder) / "log.csv")
        seeds = ("--seed", str(task.seed * 100_000 + task.number))
        try:
            run_topdress("simulate", "--seconds", f"{SECONDS:g}", *seeds, "--out", log, *words)
            answer = json.loads(run_topdress("diagnose", log, "--json", "-"))
        except (RuntimeError, ValueError) as error:
            trouble = str(error)
    return {
        "number": task.number,
        "faults": [one._asdict() for one in faults],
        "answer": answer,
        "trouble": trouble,
    }


def main() -> int:
    """Runs the cases and prints the table."""
    from scipy.special import erf
    from topdress.control.diagnosis.effects import EFFECT_ROWS
    from topdress.control.diagnosis.judgement.prior import FAULT_PROB
    from topdress.control.diagnosis.runs.model import CHANNEL_GROUPS
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--cases", type=int, default=200)
    arguments(a, "calibration", "all")
    args = a.parse_args()
    tasks = [Task(k, args.seed) for k in range(args.start, args.start + args.cases)]
    keep = args.keep / f"{code_hash((Path(__file__),))}-{args.seed}.jsonl"
    kept, _ = worked(tasks, examine, keep, args.jobs, args.minutes)
    done = [one for one in kept.values() if one["answer"] is not None]
    lines = ["| group | cases | faults | mean p of a fault | prior |", "|---|---|---|---|---|"]
    ranks: list[float] = []
    for group, channels in CHANNEL_GROUPS.items():
        present, said = [], []
        for one in done:
            ours = [
                c for c in one["answer"]["causes"] if EFFECT_ROWS[c["id"]].channels[0] in channels
            ]
            fault = [f for f in one["faults"] if f["group"] == group]
            present.append(bool(fault))
            rows = [c["structure_p"] for c in one["answer"]["channels"] if c["channel"] in channels]
            if rows:
                said.append(1.0 - min(rows))
            for cause in ours:
                size = cause["size"]
                if fault and fault[0]["id"] == cause["id"] and size["high"] > size["low"]:
                    z = (fault[0]["size"] - size["value"]) / (size["high"] - size["low"]) * 3.2897
                    ranks.append(0.5 * (1.0 + float(erf(z / np.sqrt(2.0)))))
        lines.append(
            f"| {group} | {len(done)} | {np.mean(present):.3f} | "
            f"{np.mean(said) if said else float('nan'):.3f} | {FAULT_PROB:g} |"
        )
    counts = np.histogram(ranks, CLASS_COUNT, (0.0, 1.0))[0].tolist()
    lines += ["", f"True sizes by quantile of their posterior ({len(ranks)}): {counts}", ""]
    written("\n".join(lines), args.out)
    return exit_code({"every case was judged": bool(done) and len(done) == len(kept)})


if __name__ == "__main__":
    sys.exit(main())
