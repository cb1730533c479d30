"""One simulated run with one effect, its log rewritten at other sample times and with rows missing: same verdict?

    python -m benchmarks diagnosis/sampling --effect shaft.load_droop=4 --seconds 900 --seed 1

The run is simulated once, in ticks of 0.02 s; each rewritten log holds the rows that fall on its own sample time.
"""
from __future__ import annotations

import argparse
import datetime as dt
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

TICK_S = 0.02
SAMPLE_TIMES_S = (0.02, 0.1, 0.5, 1.0)
MISSING_SHARE = 0.05


class Rewritten(NamedTuple):
    word: str
    columns: dict[str, Any]


def simulated(effects: list[tuple[str, float]], seconds: float, seed: int) -> tuple[dict[str, Any], Any]:
    """Columns of the log of a simulated run in ticks of TICK_S, and the machine file that knows nothing of effects."""
    from control.log_row import COLUMNS, TEXT_COLUMNS
    from control.machine.planting import Planted
    from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
    from control.simulation.closed_loop import simulated_run
    from drivers.files.setup import load_setup

    setup = load_setup("huanghai", "demo", dt.date(2026, 1, 1))
    job = with_simulated_field(setup.job, setup.machine)
    plant = simulated_machine(setup.machine, job, seed, TICK_S, tuple(Planted(name, size) for name, size in effects))
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    rows = [step.tick.row for step in simulated_run(plant, loop, seconds)]
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        cells = [getattr(row, name) for row in rows]
        columns[name] = (np.array(["" if c is None else c for c in cells], object) if name in TEXT_COLUMNS
                         else np.array([np.nan if c is None else c for c in cells], np.float64))
    return columns, setup.machine


def rewritten(columns: dict[str, Any], seed: int) -> list[Rewritten]:
    """The log at each sample time, and with rows missing at random."""
    found = []
    for sample_s in SAMPLE_TIMES_S:
        every = round(sample_s / TICK_S)
        found.append(Rewritten(f"{sample_s:g} s", {name: series[::every] for name, series in columns.items()}))
    tenth = found[1].columns
    kept = np.random.default_rng(seed).random(len(tenth["time_s"])) >= MISSING_SHARE
    found.append(Rewritten(f"0.1 s, {100.0 * MISSING_SHARE:.0f} % of rows missing",
                           {name: series[kept] for name, series in tenth.items()}))
    return found


def line(one: Rewritten, machine: Any, effects: list[tuple[str, float]]) -> tuple[str, bool]:
    """One row of the table, and whether each effect is named in it or said not to show.

    Where an effect is not named, the smallest size that this log would have shown.

    What the diagnosis itself says against its verdict stands beside it.
    """
    from control.diagnosis.runs.diagnose import diagnose_run

    found = diagnose_run(one.columns, machine)
    named = "; ".join(f"{c.id} {c.size.value:.3g} [{c.size.low:.3g}, {c.size.high:.3g}] {c.size.unit}"
                      + (f" or {', '.join(r.id for r in c.rivals)}" if c.rivals else "") for c in found.causes)
    least = {n.id: n.smallest_detectable for n in found.not_shown}
    why = [f"{name}: this log shows it from {least[name].value:.3g} {least[name].unit} on"
           if least[name].value is not None else f"{name}: this log cannot show it"
           for name, _ in effects if name in least]
    doubts = [said for said in found.findings if "a command given between two rows" in said]
    beside = "; ".join([*why, *doubts]) or "-"
    said = {name for c in found.causes for name in (c.id, *(r.id for r in c.rivals))} | set(least)
    told = all(name in said for name, _ in effects)
    return f"| {one.word} | {found.data.rows} | {found.verdict} | {named or '-'} | {beside} |", told


def main() -> int:
    from verdict import exit_code

    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--effect", action="append", help="ID=SIZE, may be given again; default shaft.load_droop=4")
    a.add_argument("--seconds", type=float, default=900.0)
    a.add_argument("--seed", type=int, default=1)
    args = a.parse_args()
    effects = [(name, float(size)) for name, _, size in (e.partition("=") for e in args.effect or
                                                           ["shaft.load_droop=4"])]
    columns, machine = simulated(effects, args.seconds, args.seed)
    planted = ", ".join(f"{name} = {size:g}" for name, size in effects)
    print(f"{planted}; {args.seconds:g} s simulated, seed {args.seed}\n")
    print("| rows every | rows | verdict | named, 90 % interval | not named, or doubted |\n|---|---|---|---|---|")
    promises: dict[str, object] = {}
    for one in rewritten(columns, args.seed):
        row, told = line(one, machine, effects)
        print(row, flush=True)
        promises[f"{one.word}: each effect is named, or said from where on this log shows it"] = told
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
