"""What console and worker take: `python -m benchmarks console_load [--minutes 15]`

The real program in a pseudo-terminal of 120 x 40, on the simulated machine, at work in real time. Run (with its map and
trend) is looked at all the time; then each other page for a while. What a start and an idle console take stands in the
table of `speed.py`, measured by `started` and `idle_shares`. Linux only: reads /proc.
"""
from __future__ import annotations

import argparse
import asyncio
import os
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from console_deaths import Console, at_work, wait
from trees import environment_of
from verdict import exit_code

from console.frame import Frame
from console.link import Link, WorkerGone
from console.running import Where

SAMPLE_S = 10.0
SETTLE_S = 60.0            # not counted in the slope: caches fill, Python's heap finds its size
PAGE_S = 20.0
IDLE_S, IDLE_SETTLE_S = 8.0, 3.0
TICKS_A_S = os.sysconf("SC_CLK_TCK")
ELAPSED = re.compile(r"\d\d:\d\d  \d\d:\d\d:\d\d")
PAGES = (("map", "\x1bOR"), ("trends", "\x1bOS"), ("devices", "\x1b[15~"), ("run", "\x1bOQ"))


class Taken(NamedTuple):
    cpu_s: float
    resident_mb: float


def taken(pid: int) -> Taken:
    """CPU seconds so far and resident memory of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return Taken((int(fields[11]) + int(fields[12])) / TICKS_A_S, resident / 2**20)


class Start(NamedTuple):
    """Seconds to the first picture with numbers and to the first number that moved, processor's time till the first."""

    seen_s: float
    moved_s: float
    console_s: float
    worker_s: float


def started(tree: Path) -> Start:
    """The console of a tree, from the command to its first moving number: the worker's running time."""
    os.environ.update(environment_of(tree))
    with tempfile.TemporaryDirectory() as folder:
        started_s = time.monotonic()
        console = Console(Path(folder))
        try:
            terminal = console.terminal
            wait(lambda: ELAPSED.search(terminal.text()) is not None, 60.0, "numbers", terminal)
            seen_s, first = time.monotonic() - started_s, terminal.text()
            console_s, worker_s = taken(terminal.process.pid).cpu_s, taken(console.where().pid).cpu_s
            wait(lambda: terminal.text() != first and ELAPSED.search(terminal.text()) is not None, 60.0, "movement",
                 terminal)
            return Start(seen_s, time.monotonic() - started_s, console_s, worker_s)
        finally:
            console.terminal.end()
            console.end_worker()


def share(pid: int, seconds: float) -> float:
    """Percent of one core over the next seconds."""
    before, started_s = taken(pid), time.monotonic()
    time.sleep(seconds)
    return 100.0 * (taken(pid).cpu_s - before.cpu_s) / (time.monotonic() - started_s)


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
            started_s = time.monotonic()
            first = {name: taken(pid) for name, pid in pids.items()}
            samples: list[tuple[float, dict[str, Taken]]] = []
            while time.monotonic() - started_s < 60.0 * minutes:
                time.sleep(SAMPLE_S)
                samples.append((time.monotonic() - started_s, {name: taken(pid) for name, pid in pids.items()}))
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
            before, started_s = {name: taken(pid) for name, pid in pids.items()}, time.monotonic()
            time.sleep(IDLE_S)
            took_s = time.monotonic() - started_s
            return {name: 100.0 * (taken(pid).cpu_s - before[name].cpu_s) / took_s for name, pid in pids.items()}
        finally:
            console.terminal.end()
            console.end_worker()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=15.0)
    sys.exit(measure(parser.parse_args().minutes))
