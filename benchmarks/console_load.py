"""What console and worker take: `python -m benchmarks console_load [--minutes 15]`, or `--idle [--against TREE]`

The real program in a pseudo-terminal of 120 x 40, on the simulated machine, at work in real time. Run (with its map and
trend) is looked at all the time; then each other page for a while. --idle: a machine that was not even made ready, five
times for some seconds, in turns with the other tree's where one is given. Linux only: reads /proc.
"""
from __future__ import annotations

import argparse
import asyncio
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from console_deaths import Console, at_work, wait
from trees import environment_of, ratio, spread, trees
from verdict import exit_code

from console.frame import Frame
from console.link import Link, WorkerGone
from console.running import Where

SAMPLE_S = 10.0
SETTLE_S = 60.0            # not counted in the slope: caches fill, Python's heap finds its size
PAGE_S = 20.0
IDLE_S, IDLE_SETTLE_S, IDLE_TIMES = 15.0, 5.0, 5
TICKS_A_S = os.sysconf("SC_CLK_TCK")
PAGES = (("map", "\x1bOR"), ("trends", "\x1bOS"), ("devices", "\x1b[15~"), ("run", "\x1bOQ"))


class Taken(NamedTuple):
    cpu_s: float
    resident_mb: float


def taken(pid: int) -> Taken:
    """CPU seconds so far and resident memory of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return Taken((int(fields[11]) + int(fields[12])) / TICKS_A_S, resident / 2**20)


def share(pid: int, seconds: float) -> float:
    """Percent of one core over the next seconds."""
    before, begun_s = taken(pid), time.monotonic()
    time.sleep(seconds)
    return 100.0 * (taken(pid).cpu_s - before.cpu_s) / (time.monotonic() - begun_s)


async def loop_figures(where: Where) -> tuple[dict[str, float], Frame | None]:
    """What the worker says of its own punctuality, and how far it is."""
    link = Link(where)
    run = asyncio.create_task(link.run())
    try:
        await asyncio.wait_for(link.attached.wait(), 5.0)
        return await link.stats(), link.newest
    finally:
        run.cancel()
        try:
            await run
        except (asyncio.CancelledError, WorkerGone):
            pass


def measure(minutes: float) -> int:
    with tempfile.TemporaryDirectory() as folder:
        console = Console(Path(folder))
        try:
            where, watcher = at_work(console)
            watcher.close()
            pids = {"console": console.terminal.process.pid, "worker": where.pid}
            begun_s = time.monotonic()
            first = {name: taken(pid) for name, pid in pids.items()}
            samples: list[tuple[float, dict[str, Taken]]] = []
            while time.monotonic() - begun_s < 60.0 * minutes:
                time.sleep(SAMPLE_S)
                samples.append((time.monotonic() - begun_s, {name: taken(pid) for name, pid in pids.items()}))
                print(f"\r{samples[-1][0] / 60:.1f} of {minutes:g} min ", end="", flush=True)
            print(f"\rRun page, {minutes:g} min, load {os.getloadavg()[2]:.1f}")
            for name in pids:
                last_s, last = samples[-1][0], samples[-1][1][name]
                settled = [(s, t[name].resident_mb) for s, t in samples if s >= min(SETTLE_S, last_s / 2)]
                slope = np.polyfit(*np.array(settled).T, 1)[0] * 60.0 if len(settled) > 2 else float("nan")
                print(f"  {name:8} {100 * (last.cpu_s - first[name].cpu_s) / last_s:5.1f} % of a core, "
                      f"{settled[0][1]:.1f} MB after {settled[0][0]:.0f} s, {last.resident_mb:.1f} MB at the end, "
                      f"slope {slope:+.3f} MB/min")
            found, frame = asyncio.run(loop_figures(where))
            print("  loop     " + ", ".join(f"{name} {value:.3g}" for name, value in found.items()))
            for page, keys in PAGES:
                console.terminal.type(keys)
                time.sleep(2.0)
                print(f"{page:8} page: console {share(pids['console'], PAGE_S):5.1f} % of a core", flush=True)
            return exit_code({
                "at least one sample": samples,
                "the machine works at the end": frame is not None and frame.row.state == "working",
                "something was spread: above 0 kg": frame is not None and frame.applied_kg > 0.0,
                "the console lives at the end": console.terminal.process.poll() is None})
        finally:
            console.terminal.end()
            console.end_worker()


def idle_shares(tree: Path) -> dict[str, float]:
    """Percent of one core that console and worker take while nothing moves."""
    os.environ.update(environment_of(tree))
    with tempfile.TemporaryDirectory() as folder:
        console = Console(Path(folder))
        try:
            wait(lambda: console.terminal.shows("NDVI 0."), 60.0, "numbers", console.terminal)
            time.sleep(IDLE_SETTLE_S)
            pids = {"console": console.terminal.process.pid, "worker": console.where().pid}
            before, begun_s = {name: taken(pid) for name, pid in pids.items()}, time.monotonic()
            time.sleep(IDLE_S)
            took_s = time.monotonic() - begun_s
            return {name: 100.0 * (taken(pid).cpu_s - before[name].cpu_s) / took_s for name, pid in pids.items()}
        finally:
            console.terminal.end()
            console.end_worker()


def idle(against: Path | None) -> int:
    both = trees(against)
    found: dict[str, dict[str, list[float]]] = {what: {name: [] for name in both} for what in ("console", "worker")}
    for _time in range(IDLE_TIMES):
        for name, tree in both.items():
            for what, share_percent in idle_shares(tree).items():
                found[what][name].append(share_percent)
    for what, shares in found.items():
        for name, some in shares.items():
            print(f"idle {what:8} {name} {spread(some, 1)}, % of a core")
        print(ratio(f"idle {what:8}", shares))
    return exit_code({"measured": all(found["console"]["new"])})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--idle", action="store_true", help="nothing moves")
    parser.add_argument("--against", type=Path, help="with --idle: another tree, measured in the same run")
    given = parser.parse_args()
    sys.exit(idle(given.against) if given.idle else measure(given.minutes))
