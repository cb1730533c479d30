"""Machines that do what no catalogue holds, end to end: log, answer, adopted file, closed loop before and after.

    python -m benchmarks diagnosis/adopted_terms --seconds 1200 --seeds 3 --out docs/benchmark-diagnosis-terms.md

A machine with a term that control does not know is simulated, its log diagnosed and adopted, the new file checked, all
by the commands that a user would give. Then the same machine is driven on other fields by control that reads the
shipped file, the adopted one, and one with the true term: dose and place on the ground, in truth. At the end
`topdress history --undo` takes the change back. Exit code 1 where a machine's term is not found.
"""
from __future__ import annotations

import argparse
import datetime as dt
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from adopted import ROOT, Driven, command, judged

sys.path.insert(0, str(ROOT))

# One over two variables, one over one; both as `topdress simulate --term` takes them.
TERMS = ("flow_percent product roll_deg,speed_mps slope=20 at=0 second_at=1.2",
         "flow_percent hinge speed_mps at=1.2 above=-25")
STRATEGY = "opening_first"
ROUGHNESS_DEG, SLOW_KMH, FAST_KMH, EVERY_S = 2.0, 3.0, 6.0, 45.0      # of the field that is driven
LOGGED_SEED, DRIVEN_SEED = 7, 11
FILES = ("nominal", "adopted", "true")
HEADS = ("hidden", "verdict", "found", "held-out gain", "after", "file undone",
         *(f"{what}: {' -> '.join(FILES)}" for what in ("mean dose off target, %", "rate error, %", "place error, m")))


class Outcome(NamedTuple):
    """`found`: terms adopted, in words; `after`: verdict of the same log with the adopted file."""

    hidden: str
    verdict: str
    found: str
    gain: str
    after: str
    undone: bool
    driven: dict[str, list[Driven]]


def field_job(folder: Path, seconds: float) -> Path:
    """The shipped job on rougher ground, driven slowly and fast in turn."""
    from drivers.files.config import load
    from drivers.files.kinds import JOB

    job = load("demo", JOB).model
    changes = [{"at_s": at, "speed_kmh": FAST_KMH if k % 2 else SLOW_KMH}
               for k, at in enumerate(np.arange(EVERY_S, seconds, EVERY_S).tolist())]
    data = job.model_dump(mode="json", exclude_unset=True)
    data["simulated"] = {**data["simulated"], "roughness_deg": ROUGHNESS_DEG, "speed_changes": changes}
    path = folder / "job.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def outcome(text: str, seconds: float, seeds: int, folder: Path) -> Outcome:
    """Raises RuntimeError where a command refuses, as `diagnose --adopt` does where it finds nothing."""
    from control.machine.terms import Term, parse_term
    from drivers.files.config import load
    from drivers.files.kinds import MACHINE
    from drivers.files.setup import load_setup

    log, answer, again = folder / "run.csv", folder / "answer.json", folder / "again.json"
    new, undone = folder / "adopted.yaml", folder / "undone.yaml"
    job = field_job(folder, seconds)
    command("simulate", "--job", str(job), "--seconds", str(seconds), "--seed", str(LOGGED_SEED), "--strategy",
            STRATEGY, "--flow-trim", "off", "--term", text, "--out", str(log))
    command("diagnose", str(log), "--json", str(answer), "--adopt", str(new))
    command("check", str(new))
    command("diagnose", str(log), "--machine", str(new), "--json", str(again))
    command("history", str(new), "--undo", "--out", str(undone))
    said, after = (json.loads(path.read_text(encoding="utf-8")) for path in (answer, again))
    setup = load_setup("huanghai", str(job), dt.date.today())
    term = parse_term(text, Term.model_validate)
    adopted = load(str(new), MACHINE).model
    files = dict(zip(FILES, (setup.machine, adopted, setup.machine.model_copy(update={"terms": (term,)})), strict=True))
    driven = {word: [_driven(setup, known, term, seconds, DRIVEN_SEED + k) for k in range(seeds)]
              for word, known in files.items()}
    return Outcome(text, said["verdict"], told(said), ", ".join(_share(t["held_out_gain"]) for t in said["terms"]),
                   after["verdict"], _but_history(load(str(undone), MACHINE).model) == setup.machine, driven)


def _but_history(machine: Any) -> Any:
    """What was taken back stays in the file's history."""
    return machine.model_copy(update={"history": ()})


def _driven(setup: Any, known: Any, term: Any, seconds: float, seed: int) -> Driven:
    """One field of the machine that has the term, by control that reads the file `known`."""
    from control.orders import Strategy
    from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
    from control.simulation.closed_loop import Record, simulated_run
    from control.simulation.errors import errors

    job = setup.job.model_copy(update={"strategy": Strategy(STRATEGY), "flow_trim": False})
    job = with_simulated_field(job, setup.machine)
    record = Record()
    plant = simulated_machine(setup.machine, job, seed, 0.05, terms=(term,))
    for step in simulated_run(plant, control_loop(known, setup.crop, setup.rule, job), seconds):
        record.add(step)
    return judged(errors(record.columns(), record.fired, setup.machine.geometry.working_width_m,
                         setup.machine.fall.lever_arm_m))


def told(answer: dict[str, Any]) -> str:
    """Names and terms of a diagnosis in a table's cell."""
    terms = [f"{t['term']['acts_on']} {t['term']['form']} {','.join(v['name'] for v in t['term']['over'])} "
             + " ".join(f"{k}={v:.3g}" for k, v in t["term"]["coefficients"].items()) for t in answer["terms"]]
    return "; ".join([*terms, *(c["id"] for c in answer["causes"])]) or "nothing"


def _share(gain: float | None) -> str:
    return "-" if gain is None else f"{gain:.2f}"


def _spread(values: Sequence[float]) -> str:
    """Mean and, over several seeds, their spread."""
    mean = float(np.mean(values))
    return f"{mean:.3g}" if len(values) < 2 else f"{mean:.3g} +- {float(np.std(values, ddof=1)):.2g}"


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Markdown."""
    rows = []
    for o in outcomes:
        fields = [" -> ".join(_spread([getattr(d, field) for d in o.driven[word]]) for word in FILES)
                  for field in Driven._fields]
        rows.append([o.hidden, o.verdict, o.found, o.gain, o.after, "yes" if o.undone else "NO", *fields])
    return [f"| {' | '.join(HEADS)} |", "|" + "---|" * len(HEADS), *(f"| {' | '.join(row)} |" for row in rows)]


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--seconds", type=float, default=1200.0, help="of the log, and of each field")
    a.add_argument("--seeds", type=int, default=3, help="fields for each file")
    a.add_argument("--term", action="append", help="instead of the two machines of this benchmark (repeatable)")
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    outcomes, failed = [], []
    for text in args.term or TERMS:
        try:
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(outcome(text, args.seconds, args.seeds, Path(folder)))
            print(outcomes[-1], file=sys.stderr, flush=True)
        except RuntimeError as error:
            failed.append(f"{text}: {error}")
    text = "\n".join([
        "# Terms beyond the catalogue, found, adopted, driven", "",
        f"`python -m benchmarks diagnosis/adopted_terms --seconds {args.seconds:g} --seeds {args.seeds}`; opening "
        f"first, flow trim off, ground of {ROUGHNESS_DEG:g} deg, {SLOW_KMH:g} and {FAST_KMH:g} km/h in turn; log of "
        f"seed {LOGGED_SEED}, fields of seeds from {DRIVEN_SEED} on (mean +- s.d.). The machine has the hidden term; "
        "control reads the shipped file, the adopted one, one with the true term. After: verdict of the same log with "
        "the adopted file. Undone: after `topdress history --undo` the file is the shipped one again, "
        "but for the history that it keeps.", "",
        *table(outcomes), *(f"\nNot adopted: {line}" for line in failed)]) + "\n"
    if args.out is None:
        print(text)
    else:
        args.out.write_text(text, encoding="utf-8", newline="\n")
    if failed or not outcomes:
        sys.exit(f"{len(failed)} of {len(failed) + len(outcomes)} machines: nothing adopted")


if __name__ == "__main__":
    main()
