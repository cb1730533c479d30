"""From the command to the first moving number: `python -m benchmarks console_start [--times 5] [--against TREE]`

Cold: the kernel's file cache is emptied before (needs root on Linux, said when it cannot). Warm: started just before.
Moving: the worker's running time on the screen changed once. The modules are compiled already, as an installer leaves
them, whatever PYTHONDONTWRITEBYTECODE says here. Beside the time: the processor's time of console and worker, which a
busy machine stretches less. --against: another tree, in turns with this one.
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
from trees import environment_of, ratio, trees
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


def once(tree: Path) -> Start:
    os.environ.update(environment_of(tree))
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
    parser.add_argument("--against", type=Path, help="another tree, measured in the same run")
    parser.add_argument("--warm", action="store_true", help="leave the cold starts out")
    given = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory(prefix="topdress-compiled-") as compiled:
        os.environ["PYTHONPYCACHEPREFIX"] = compiled
        return measure(given)


def measure(given: argparse.Namespace) -> int:
    both = trees(given.against)
    for tree in both.values():
        once(tree)
    cold: dict[str, list[Start]] = {name: [] for name in both}
    warm: dict[str, list[Start]] = {name: [] for name in both}
    for _time in range(given.times):
        for name, tree in both.items():
            if not given.warm and empty_the_cache():
                cold[name].append(once(tree))
    if not cold["new"] and not given.warm:
        print("cold: the file cache cannot be emptied here")
    for _time in range(given.times):
        for name, tree in both.items():
            warm[name].append(once(tree))
    tell("cold", cold)
    tell("warm", warm)
    return exit_code({"started at least once": warm["new"],
                      "a number moved after it was shown": all(one.moved_s >= one.seen_s for one in warm["new"])})


def tell(name: str, found: dict[str, list[Start]]) -> None:
    for what, place in (("numbers shown", 0), ("first number moved", 1), ("processor, console", 2),
                        ("processor, worker", 3)):
        seconds = {which: [one[place] for one in starts] for which, starts in found.items() if starts}
        for which, some in seconds.items():
            print(f"{name:5} {what:20} {which} median {statistics.median(some):.2f} s, {min(some):.2f} to "
                  f"{max(some):.2f} s, {len(some)} times")
        if len(seconds) > 1:
            print(ratio(f"{name:5} {what:20}", seconds))


if __name__ == "__main__":
    sys.exit(run())
