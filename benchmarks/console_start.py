"""From the command to the first moving number: `python benchmarks/console_start.py [--times 5]`

Cold: the kernel's file cache is emptied before (needs root on Linux, said when it cannot). Warm: started just before.
Moving: the worker's running time on the screen changed once. The modules are compiled already, as an installer leaves
them, whatever PYTHONDONTWRITEBYTECODE says here. Beside the time: the processor's time of console and worker, which a
busy machine stretches less.
"""
from __future__ import annotations

import argparse
import os
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from console_deaths import Console, wait
from verdict import exit_code

ELAPSED = re.compile(r"\d\d:\d\d  \d\d:\d\d:\d\d")


def empty_the_cache() -> bool:
    try:
        Path("/proc/sys/vm/drop_caches").write_text("3\n")
    except OSError:
        return False
    return True


class Start(NamedTuple):
    """Seconds to the first picture with numbers and to the first number that moved, processor's time till then."""

    seen_s: float
    moved_s: float
    console_s: float
    worker_s: float


def worked_s(process: int) -> float:
    """Processor's time of a process so far, s. Linux."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def once() -> Start:
    with tempfile.TemporaryDirectory() as folder:
        begun_s = time.monotonic()
        console = Console(Path(folder))
        try:
            terminal = console.terminal
            wait(lambda: ELAPSED.search(terminal.text()) is not None, 60.0, "numbers", terminal)
            seen_s, first = time.monotonic() - begun_s, terminal.text()
            console_s, worker_s = worked_s(terminal.process.pid), worked_s(console.where().pid)
            wait(lambda: terminal.text() != first and ELAPSED.search(terminal.text()) is not None, 60.0, "movement",
                 terminal)
            return Start(seen_s, time.monotonic() - begun_s, console_s, worker_s)
        finally:
            console.terminal.end()
            console.end_worker()


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--warm", action="store_true", help="leave the cold starts out")
    given = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory(prefix="topdress-compiled-") as compiled:
        os.environ["PYTHONPYCACHEPREFIX"] = compiled
        return measure(given)


def measure(given: argparse.Namespace) -> int:
    once()
    cold = [once() for _ in range(given.times) if not given.warm and empty_the_cache()]
    if not cold and not given.warm:
        print("cold: the file cache cannot be emptied here")
    warm = [once() for _ in range(given.times)]
    for name, found in (("cold", cold), ("warm", warm)):
        for what, place in (("numbers shown", 0), ("first number moved", 1), ("processor, console", 2),
                            ("processor, worker", 3)):
            seconds = [one[place] for one in found]
            if seconds:
                print(f"{name:5} {what:20} median {statistics.median(seconds):.2f} s, {min(seconds):.2f} to "
                      f"{max(seconds):.2f} s, {len(seconds)} times")
    return exit_code({"started at least once": warm,
                      "a number moved after it was shown": all(one.moved_s >= one.seen_s for one in warm)})


if __name__ == "__main__":
    sys.exit(run())
