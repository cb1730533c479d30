"""What the search for terms costs: one log, 12 variables, diagnosed with and without it in turn.

    python benchmarks/diagnosis/search_cost.py [--rows 24000] [--further 3] [--times 3]

The log is one of the hidden generator's healthy drives of the tuning half with further columns, cut to so many rows. A
healthy log is the dear case: nothing ends the search early. Each diagnosis runs in a process of its own, for the peak
of memory is that of a process; what is compiled is loaded before by a short log. Printed: seconds, processor time, peak
memory, and the ratio of each pair.
"""
from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np
from kept import ROOT

sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "diagnosis")]

SHORT_ROWS = 3000
WITH_TERM = "with a term"


def log_of(rows: int, further: int, hidden: bool) -> dict[str, Any]:
    """Columns of a drive with every variable moving; with `hidden` the flow depends on the first further column."""
    from hidden import extras, noise, runlog, terms
    from hidden.nominal import Effect, Physics
    from hidden.plant import Plant
    from hidden.programmes import PROGRAMMES, drive

    p = next(p for p in PROGRAMMES if p.name == "grid_refill")
    d = drive(p._replace(refill=False, minutes=(rows / 1200.0 + 1.0,) * 2), 4)
    rng = np.random.default_rng(5)
    more = extras.dealt(d, further, rng, True)
    planted = ()
    if hidden and more:
        term = terms.term_over("column", (more[0].name,), {more[0].name: more[0].true}, 0, 0.5)
        planted = (Effect("y.flow", 6.0, term=term),)
    plant = Plant(d, {x.name: x.true for x in more})
    columns = runlog.columns(plant, Physics(), planted, noise.noises("ar1", d.row_s, rng), 6)
    columns |= {x.name: x.told for x in more}
    return {name: column[:rows] for name, column in columns.items()}


def asked(rows: int, further: int, hidden: bool, search: bool) -> dict[str, Any]:
    """One diagnosis in this process."""
    from control.diagnosis.runs import names_or_terms
    from control.diagnosis.runs.diagnose import diagnose_run
    from control.machine.machine import Machine

    columns = log_of(rows, further, hidden)
    diagnose_run({name: column[:SHORT_ROWS] for name, column in columns.items()}, Machine())
    before_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0
    if not search:
        assert hasattr(names_or_terms, "found_terms"), "the search has moved"
        names_or_terms.found_terms = lambda *_: []
    began, busy = time.perf_counter(), time.process_time()
    found = diagnose_run(columns, Machine())
    return {"seconds": time.perf_counter() - began, "processor_s": time.process_time() - busy,
            "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0, "before_mb": before_mb,
            "variables": len(found.excited), "rows": found.data.rows, "verdict": found.verdict,
            "terms": [t.term["id"] for t in found.terms]}


def one(args: argparse.Namespace, hidden: bool, search: bool) -> dict[str, Any]:
    """The same in a process of its own."""
    words = [sys.executable, __file__, "--rows", str(args.rows), "--further", str(args.further), "--one",
             f"{int(hidden)}{int(search)}"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told


def main() -> None:
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--rows", type=int, default=24_000)
    a.add_argument("--further", type=int, default=3, help="columns beyond the standard ones, of which 9 move")
    a.add_argument("--times", type=int, default=3, help="pairs, in turn")
    a.add_argument("--one", help=argparse.SUPPRESS)
    args = a.parse_args()
    if args.one:
        print(json.dumps(asked(args.rows, args.further, args.one[0] == "1", args.one[1] == "1")))
        return
    for hidden in (False, True):
        pairs = []
        for _ in range(args.times):
            plain, search = (one(args, hidden, way) for way in (False, True))
            pairs.append((plain, search))
            for word, told in (("without the search", plain), ("with it", search)):
                print(f"{WITH_TERM if hidden else 'healthy'}, {told['rows']} rows, {told['variables']} variables, "
                      f"{word}: {told['seconds']:.1f} s, {told['processor_s']:.1f} s of processor, peak "
                      f"{told['peak_mb']:.0f} MB (before {told['before_mb']:.0f}), {told['verdict']} "
                      f"{' '.join(told['terms'])}", flush=True)
        ratios = [search["processor_s"] / plain["processor_s"] for plain, search in pairs]
        print(f"ratio of processor time: {np.median(ratios):.2f} (median of {len(ratios)}, {min(ratios):.2f} to "
              f"{max(ratios):.2f}); of peak memory "
              f"{np.median([s['peak_mb'] / p['peak_mb'] for p, s in pairs]):.2f}", flush=True)


if __name__ == "__main__":
    main()
