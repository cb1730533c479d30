"""The whole program against everything at once, by one seed: `python -m benchmarks world`

--seeds N [--from S] runs N days, --minutes M as many as fit. Each day is drawn by its seed; half of
the days are drawn towards what no day has visited (--by-seed-alone: none). A broken day is printed
as JSON. --seed S [--kinds K,K], or --day FILE, runs one and prints what happened; with --shrink
events are taken away as long as it breaks in the same way. --twice runs every day again and
compares the sha256 of rows, files and frames.
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from world.plan import Day, draw_day
from world.run import Outcome, run_day
from world.shrink import breaks_as_before, shrink_day
from world.visits import Coverage

# End of the faults of a quick day, s, and its ticks a second.
QUICK_S, QUICK_HZ = 30.0, 5.0


def parse_arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Returns the options of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks world")
    parser.add_argument("--seeds", type=int, default=10, help="number of days")
    parser.add_argument("--from", dest="first", type=int, default=0, help="first seed")
    parser.add_argument("--minutes", type=float, help="as many days as begin within this time")
    parser.add_argument("--by-seed-alone", action="store_true", help="no steering by coverage")
    parser.add_argument("--first-failure", action="store_true", help="end with the first failure")
    parser.add_argument("--quick", action="store_true", help="days of 70 s, five ticks a second")
    parser.add_argument("--twice", action="store_true", help="compare two runs of every day")
    parser.add_argument("--seed", type=int, help="one day")
    parser.add_argument("--kinds", default="", help="draws that every day must have")
    parser.add_argument("--day", type=Path, help="one day, as a file")
    parser.add_argument("--shrink", action="store_true", help="take events of this day away")
    return parser.parse_args(words)


def parse_kinds(options: argparse.Namespace) -> tuple[str, ...]:
    """Returns the draws that every day must have."""
    return tuple(filter(None, options.kinds.split(",")))


def run_one(day: Day, shrink: bool) -> int:
    """Runs one day and prints what happened; returns the exit code."""
    outcome = run_day(day)
    if shrink and outcome.broken:
        day = shrink_day(day, breaks_as_before(outcome.broken.partition(":")[0]))
        outcome = run_day(day)
    print(day.to_json())
    print("\n".join(outcome.trace))
    print(f"{len(day.events)} events: {outcome.broken or 'holds'}")
    return bool(outcome.broken)


def run_many(options: argparse.Namespace) -> int:
    """Runs days and prints a line for each, then the table of coverage; returns the exit code."""
    coverage, began_s, simulated_s, broken, days = Coverage(), time.monotonic(), 0.0, 0, 0
    began_cpu_s = time.process_time()
    until_s = began_s + 60.0 * options.minutes if options.minutes else math.inf
    count = 10**9 if options.minutes else options.seeds
    for seed in range(options.first, options.first + count):
        kinds = parse_kinds(options) or (
            () if options.by_seed_alone else coverage.choose_kinds(seed)
        )
        day = draw_day(seed, kinds)
        if options.quick:
            day = draw_day(seed, kinds, QUICK_S)._replace(hz=QUICK_HZ)
        outcome = run_day(day, coverage)
        days, simulated_s = days + 1, simulated_s + outcome.simulated_s
        if options.twice and run_day(day).digests != outcome.digests:
            outcome = outcome._replace(broken="one_seed_is_one_run: two runs differ")
        print(format_day(day, kinds, outcome), flush=True)
        if outcome.broken:
            broken += 1
            print(f"  after {time.monotonic() - began_s:.0f} s: {outcome.broken}\n{day.to_json()}")
        if time.monotonic() > until_s or (broken and options.first_failure):
            break
    took_s = time.process_time() - began_cpu_s
    print(f"{broken} broken of {days} days")
    print(f"{simulated_s / 3600.0:.2f} h simulated, {simulated_s / took_s:.0f} times real time")
    print(coverage.format_table())
    return bool(broken)


def format_day(day: Day, kinds: Sequence[str], outcome: Outcome) -> str:
    """Returns the line of a day."""
    digest = " ".join(one[:8] for one in outcome.digests)
    return (
        f"seed {day.seed:5d} {day.farm:9} {len(day.events):3d} events {outcome.parts} parts "
        f"{outcome.true_kg:6.2f} kg {digest} {','.join(kinds) or '-'} "
        f"{'BROKEN' if outcome.broken else 'holds'}"
    )


def main() -> int:
    """Runs what the command line asks for."""
    options = parse_arguments()
    # Most objects of a day live for a tick: rare collections save a tenth of the time.
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
    if options.day is not None:
        return run_one(Day.from_json(options.day.read_text(encoding="utf-8")), options.shrink)
    if options.seed is not None:
        return run_one(draw_day(options.seed, parse_kinds(options)), options.shrink)
    return run_many(options)


if __name__ == "__main__":
    sys.exit(main())
