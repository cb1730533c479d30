"""Hidden effects and terms, from one run log to the adopted machine to the closed loop: what
knowing them is worth.

    python -m benchmarks diagnosis/adopted --seconds 1200 --out docs/benchmark-diagnosis-adopted.md

A machine with two effects, or with a term that no catalogue holds, is driven by control that
does not know it. Its log is diagnosed, adopted and the new file checked by the commands that a
user would give; `topdress history --undo` takes the change back. Then the same machine is
driven on another field, with other canopy and noise, by control that reads the shipped machine
file and by control that reads the adopted one: dose and place on the ground, in truth.
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

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

# the shaft turns at 70 r/min, where both effects of the flow weigh most
STRATEGY = "opening_first"
LOGGED_SEED, DRIVEN_SEED = 7, 11
WORSE_PERCENT = 0.1  # of the rate error: the noise of one field
# of the field on which a term shows
ROUGHNESS_DEG, SLOW_KMH, FAST_KMH, EVERY_S = 2.0, 3.0, 6.0, 45.0
HEADS = (
    "hidden",
    "flow trim",
    "found (90 %)",
    "the log again, file known",
    "undone",
    "mean dose off target, %",
    "rate error, %",
    "place error, m",
)


class Hidden(NamedTuple):
    """What the machine has: options of `topdress simulate`; `rough`: driven on rougher ground,
    slowly and fast."""

    effects: tuple[str, ...]
    terms: tuple[str, ...] = ()
    trim: str = "off"
    rough: bool = False


PAIRS = (
    ("flow.fill_falloff=15", "shaft.dead_time=0.4"),
    ("gate.offset=1.5", "shaft.voltage_sag=4"),
)
TERMS = (
    "flow_percent product roll_deg,speed_mps slope=20 at=0 second_at=1.2",
    "flow_percent hinge speed_mps at=1.2 above=-25",
)
MACHINES = (
    *(Hidden(pair, trim=trim) for pair in PAIRS for trim in ("off", "on")),
    *(Hidden((), (term,), rough=True) for term in TERMS),
)


class Driven(NamedTuple):
    """One field, on the ground."""

    bias_percent: float
    rate_error_percent: float
    place_error_m: float


class Outcome(NamedTuple):
    """`again`: verdict of the same log with the adopted file."""

    hidden: Hidden
    found: str
    again: str
    undone: bool
    not_known: Driven
    known: Driven


def command(*words: str) -> None:
    """A topdress command of this checkout. Raises RuntimeError with what it said where it fails."""
    done = subprocess.run(
        [sys.executable, "-c", "from topdress.console.cli import main; main()", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"topdress {' '.join(words)}: {done.stderr.strip()}")


def job_file(hidden: Hidden, folder: Path, seconds: float) -> Path:
    """The shipped job, on the ground on which what is hidden shows."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import JOB_KIND

    data = load_config("demo", JOB_KIND).model.model_dump(mode="json", exclude_unset=True)
    if hidden.rough:
        changes = [
            {"at_s": k * EVERY_S, "speed_kmh": SLOW_KMH if k % 2 else FAST_KMH}
            for k in range(1, 1 + int(seconds / EVERY_S))
        ]
        data["simulated"] |= {"roughness_deg": ROUGHNESS_DEG, "speed_changes": changes}
    path = folder / "job.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def outcome(hidden: Hidden, seconds: float, folder: Path) -> Outcome:
    """Log, diagnosis, adopted machine, two fields. Raises RuntimeError where a command refuses,
    as `diagnose --adopt` does where it finds nothing."""
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND
    from topdress.drivers.files.run_setup import load_setup

    log, answer, again = folder / "run.csv", folder / "answer.json", folder / "again.json"
    new, undone, job = (
        folder / "adopted.yaml",
        folder / "undone.yaml",
        job_file(hidden, folder, seconds),
    )
    planted = [
        word
        for option, texts in (("--effect", hidden.effects), ("--term", hidden.terms))
        for text in texts
        for word in (option, text)
    ]
    command(
        "simulate",
        "--job",
        str(job),
        "--seconds",
        str(seconds),
        "--seed",
        str(LOGGED_SEED),
        "--strategy",
        STRATEGY,
        "--flow-trim",
        hidden.trim,
        "--out",
        str(log),
        *planted,
    )
    command("diagnose", str(log), "--json", str(answer), "--adopt", str(new))
    command("check", str(new))
    command("diagnose", str(log), "--machine", str(new), "--json", str(again))
    command("history", str(new), "--undo", "--out", str(undone))
    said, after = (json.loads(path.read_text(encoding="utf-8")) for path in (answer, again))
    setup = load_setup("huanghai", str(job), dt.date.today())
    # its history keeps both changes
    back = load_config(str(undone), MACHINE_KIND).model.model_copy(update={"history": ()})
    return Outcome(
        hidden,
        found_in(said),
        after["verdict"],
        back == setup.machine,
        *(
            driven(setup, known, hidden, seconds)
            for known in (setup.machine, load_config(str(new), MACHINE_KIND).model)
        ),
    )


def driven(setup: Any, known: Any, hidden: Hidden, seconds: float) -> Driven:
    """One field of the machine that has what is hidden, by control that reads the file `known`."""
    from topdress.control.machine.fault_injection import parse_planted
    from topdress.control.machine.terms import Term, parse_term
    from topdress.control.orders import Strategy
    from topdress.control.simulation.assembly import (
        add_simulated_field,
        make_control_loop,
        make_plant,
    )
    from topdress.control.simulation.closed_loop import RunRecord, simulate_run
    from topdress.control.simulation.error_metrics import judge_run

    machine = setup.machine
    job = add_simulated_field(
        setup.job.model_copy(
            update={"strategy": Strategy(STRATEGY), "flow_trim": hidden.trim == "on"}
        ),
        machine,
    )
    record = RunRecord()
    plant = make_plant(
        machine,
        job,
        DRIVEN_SEED,
        0.05,
        [parse_planted(text) for text in hidden.effects],
        terms=[parse_term(text, Term.model_validate) for text in hidden.terms],
    )
    for step in simulate_run(plant, make_control_loop(known, setup.crop, setup.rule, job), seconds):
        record.add_tick(step)
    off = judge_run(
        record.make_columns(),
        record.fired,
        machine.geometry.working_width_m,
        machine.fall.lever_arm_m,
    )
    return Driven(
        100.0 * off.bias_kg_ha / off.mean_target_kg_ha, off.rate_error_percent, off.place_error_m
    )


def found_in(answer: dict[str, Any]) -> str:
    """Causes and terms of a diagnosis in a table's cell."""
    causes = [
        f"{c['id']} {c['size']['value']:.3g} ({c['size']['low']:.3g} to {c['size']['high']:.3g})"
        for c in answer["causes"]
        if c["size"]["low"] is not None
    ]
    terms = [
        f"{t['term']['acts_on']} {t['term']['form']} "
        f"{','.join(v['name'] for v in t['term']['over'])} "
        + " ".join(f"{k}={v:.3g}" for k, v in t["term"]["coefficients"].items())
        for t in answer["terms"]
    ]
    return "; ".join((*terms, *causes)) or str(answer["verdict"])


def table(outcomes: list[Outcome]) -> list[str]:
    """Markdown: not known -> known."""
    rows = [
        [
            " + ".join((*o.hidden.effects, *o.hidden.terms)),
            o.hidden.trim,
            o.found,
            o.again,
            "yes" if o.undone else "NO",
            f"{o.not_known.bias_percent:+.2f} -> {o.known.bias_percent:+.2f}",
            f"{o.not_known.rate_error_percent:.2f} -> {o.known.rate_error_percent:.2f}",
            f"{o.not_known.place_error_m:.3f} -> {o.known.place_error_m:.3f}",
        ]
        for o in outcomes
    ]
    return [
        f"| {' | '.join(HEADS)} |",
        "|" + "---|" * len(HEADS),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def main() -> int:
    from kept import written
    from verdict import exit_code

    a = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    a.add_argument("--seconds", type=float, default=1200.0, help="of the log, and of each field")
    a.add_argument(
        "--term",
        action="append",
        default=[],
        help="machines with these terms instead of this benchmark's",
    )
    a.add_argument("--out", type=Path)
    args = a.parse_args()
    outcomes, refused = [], []
    for hidden in [Hidden((), (term,), rough=True) for term in args.term] or MACHINES:
        try:
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(outcome(hidden, args.seconds, Path(folder)))
            print(outcomes[-1], file=sys.stderr, flush=True)
        except RuntimeError as error:
            refused.append(f"{hidden}: {error}")
    text = (
        "\n".join(
            [
                "# Hidden effects and terms, found, adopted, driven",
                "",
                f"`python -m benchmarks diagnosis/adopted --seconds {args.seconds:g}`; "
                "opening first; log of seed "
                f"{LOGGED_SEED}, fields of seed {DRIVEN_SEED}; terms on ground of "
                f"{ROUGHNESS_DEG:g} deg, {SLOW_KMH:g} and "
                f"{FAST_KMH:g} km/h in turn. Control that does not know what is hidden -> "
                "control that reads the adopted file; "
                "the machine has what is hidden, not what was found. Undone: after "
                "`topdress history --undo` the file is the "
                "shipped one again.",
                "",
                *table(outcomes),
                *(f"\nNot adopted: {line}" for line in refused),
            ]
        )
        + "\n"
    )
    written(text, args.out)
    return exit_code(
        {f"{len(refused)} machines with nothing adopted: none": not refused}
        | {
            f"{' + '.join((*o.hidden.effects, *o.hidden.terms))}, flow trim "
            f"{o.hidden.trim}: something is found, driving "
            "with it is not worse": o.found.count(" ") > 0
            and o.known.rate_error_percent <= o.not_known.rate_error_percent + WORSE_PERCENT
            for o in outcomes
        }
    )


if __name__ == "__main__":
    sys.exit(main())
