"""Two hidden effects, from one run log to the adopted machine to the closed loop: what knowing them is worth.

    python -m benchmarks diagnosis/adopted --seconds 1200 --out docs/benchmark-diagnosis-adopted.md

A machine with two effects is driven by control that does not know them. Its log is diagnosed and adopted by the
commands that a user would give. Then the same machine is driven again, with other canopy and noise, by control that
reads the shipped machine file and by control that reads the adopted one: dose and place on the ground, in truth.
"""
from __future__ import annotations

import argparse
import datetime as dt
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

PAIRS = (("flow.fill_falloff=15", "shaft.dead_time=0.4"), ("gate.offset=1.5", "shaft.voltage_sag=4"))
STRATEGY = "opening_first"        # the shaft turns at 70 r/min, where both effects of the flow weigh most
LOGGED_SEED, DRIVEN_SEED = 7, 11
WORSE_PERCENT = 0.1               # of the rate error: the noise of one field
HEADS = ("hidden", "flow trim", "found (90 %)", "mean dose off target, %", "rate error, %", "place error, m")


class Driven(NamedTuple):
    """One field, on the ground."""

    bias_percent: float
    rate_error_percent: float
    place_error_m: float


class Outcome(NamedTuple):
    hidden: tuple[str, ...]
    trim: str
    found: str
    not_known: Driven
    known: Driven


def command(*words: str) -> None:
    """A topdress command of this checkout. Raises RuntimeError with what it said where it fails."""
    done = subprocess.run([sys.executable, "-c", "from console.cli import main; main()", *words], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"topdress {' '.join(words)}: {done.stderr.strip()}")


def outcome(effects: tuple[str, ...], trim: str, seconds: float, folder: Path) -> Outcome:
    """Log, diagnosis, adopted machine, two fields."""
    from control.diagnosis.runs.closed_loop import closed_loop_gain
    from control.machine.planting import parse_planted
    from control.orders import Strategy
    from drivers.files.config import load
    from drivers.files.kinds import MACHINE
    from drivers.files.setup import load_setup

    log, answer, new = folder / "run.csv", folder / "answer.json", folder / "adopted.yaml"
    planted = [word for effect in effects for word in ("--effect", effect)]
    command("simulate", "--seconds", str(seconds), "--seed", str(LOGGED_SEED), "--strategy", STRATEGY,
            "--flow-trim", trim, "--out", str(log), *planted)
    command("diagnose", str(log), "--json", str(answer), "--adopt", str(new))
    setup = load_setup("huanghai", "demo", dt.date.today())
    job = setup.job.model_copy(update={"strategy": Strategy(STRATEGY), "flow_trim": trim == "on"})
    gain = closed_loop_gain(setup.machine, load(str(new), MACHINE).model, [parse_planted(e) for e in effects],
                            setup.crop, setup.rule, job, seconds, DRIVEN_SEED)
    return Outcome(effects, trim, told(json.loads(answer.read_text(encoding="utf-8"))), judged(gain.before),
                   judged(gain.after))


def told(answer: dict[str, Any]) -> str:
    """The causes of a diagnosis in a table's cell."""
    causes = [f"{c['id']} {c['size']['value']:.3g} ({c['size']['low']:.3g} to {c['size']['high']:.3g})"
              for c in answer["causes"] if c["size"]["low"] is not None]
    return "; ".join(causes) or str(answer["verdict"])


def judged(errors: Any) -> Driven:
    """What the table tells of a field's errors."""
    return Driven(100.0 * errors.bias_kg_ha / errors.mean_target_kg_ha, errors.rate_error_percent, errors.place_error_m)


def table(outcomes: list[Outcome]) -> list[str]:
    """Markdown: not known -> known."""
    rows = [[" + ".join(o.hidden), o.trim, o.found,
             f"{o.not_known.bias_percent:+.2f} -> {o.known.bias_percent:+.2f}",
             f"{o.not_known.rate_error_percent:.2f} -> {o.known.rate_error_percent:.2f}",
             f"{o.not_known.place_error_m:.3f} -> {o.known.place_error_m:.3f}"] for o in outcomes]
    return [f"| {' | '.join(HEADS)} |", "|" + "---|" * len(HEADS), *(f"| {' | '.join(row)} |" for row in rows)]


def main() -> int:
    from verdict import exit_code

    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--seconds", type=float, default=1200.0, help="of the log, and of each field")
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    outcomes = []
    for effects in PAIRS:
        for trim in ("off", "on"):
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(outcome(effects, trim, args.seconds, Path(folder)))
            print(outcomes[-1], file=sys.stderr, flush=True)
    text = "\n".join([
        "# Two hidden effects, found, adopted, driven", "",
        f"`python -m benchmarks diagnosis/adopted --seconds {args.seconds:g}`; opening first; log of seed "
        f"{LOGGED_SEED}, fields of seed {DRIVEN_SEED}. Control that does not know the effects -> control that reads "
        "the adopted file; "
        "the machine has the hidden effects, not those found.", "", *table(outcomes)]) + "\n"
    if args.out is None:
        print(text)
    else:
        args.out.write_text(text, encoding="utf-8", newline="\n")
    return exit_code({f"{' + '.join(o.hidden)}, flow trim {o.trim}: something is found, driving with it is not worse":
                      "(" in o.found and o.known.rate_error_percent <= o.not_known.rate_error_percent + WORSE_PERCENT
                      for o in outcomes})


if __name__ == "__main__":
    sys.exit(main())
