"""A long log, whole catalogue: seconds, processor time and peak memory of one diagnosis.

    python -m benchmarks diagnosis/million_rows [--rows 1000000]

The log is made by the compiled stages (the run of tests/diagnosis/test_run_diagnosis.py in rows of 0.05 s, refilled
every half an hour, two effects planted); the first diagnosis, of a short log, loads what is compiled.
"""
from __future__ import annotations

import argparse
import importlib.util
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

PLANTED = {"shaft.load_droop": 3.0, "flow.fill_falloff": 8.0}
STEP_S = 0.05
REFILL_EVERY = 36_000               # rows
REFILL_KG = 236.0


def log_of(rows: int) -> tuple[dict[str, Any], Any]:
    """Columns of a run with two effects, and the machine file that does not know them."""
    spec = importlib.util.spec_from_file_location("runs", ROOT / "tests" / "diagnosis" / "test_run_diagnosis.py")
    assert spec is not None and spec.loader is not None
    runs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(runs)
    runs.STEP_S = STEP_S
    machine, plain = runs.Machine(), runs.input_rows

    def refilled(kind: Any, count: int, **columns: Any) -> Any:
        if kind is runs.FlowInput:
            kg = np.zeros(count)
            kg[REFILL_EVERY::REFILL_EVERY] = REFILL_KG / 4.0        # the model fills in each of its four steps
            columns["refill_kg"] = kg
        return plain(kind, count, **columns)

    runs.input_rows = refilled
    planted = machine
    for name, size in PLANTED.items():
        planted = runs.with_effect(planted, name, size)
    return runs.a_run(planted, seed=3, seconds=rows * STEP_S), machine


def main() -> int:
    from verdict import exit_code

    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--rows", type=int, default=1_000_000)
    args = a.parse_args()
    from control.diagnosis.runs.diagnose import diagnose_run

    short, machine = log_of(10_000)
    diagnose_run(short, machine)
    columns, _ = log_of(args.rows)
    held = sum(c.nbytes for c in columns.values()) / 1e6
    began, busy = time.perf_counter(), time.process_time()
    with ThreadPoolExecutor(2) as pool:             # as `topdress diagnose` does
        found = diagnose_run(columns, machine, each=pool.map)
    took, busy = time.perf_counter() - began, time.process_time() - busy
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0
    print(f"{found.data.rows} rows, {found.data.duration_s / 3600.0:.1f} h: {took:.1f} s, {busy:.1f} s of processor, "
          f"peak {peak:.0f} MB ({held:.0f} MB are the columns)")
    for c in found.causes:
        print(f"{c.id} {c.size.value:.3g} [{c.size.low:.3g}, {c.size.high:.3g}] {c.size.unit}"
              + (f" or {', '.join(r.id for r in c.rivals)}" if c.rivals else ""))
    print(f"planted: {PLANTED}; verdict {found.verdict}")
    said = {name for c in found.causes for name in (c.id, *(r.id for r in c.rivals))}
    return exit_code({f"{found.data.rows} rows read: {args.rows}": found.data.rows == args.rows,
                      "each planted effect is among what is said": said >= set(PLANTED)})


if __name__ == "__main__":
    sys.exit(main())
