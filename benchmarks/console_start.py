"""From the command to the first moving number: `python benchmarks/console_start.py [--times 5]`

Cold: the kernel's file cache is emptied before (needs root on Linux, said when it cannot). Warm: started just before.
Moving: the worker's running time on the screen changed once.
"""
from __future__ import annotations

import argparse
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path

from console_deaths import Console, wait
from verdict import exit_code

ELAPSED = re.compile(r"\d\d:\d\d  \d\d:\d\d:\d\d")


def empty_the_cache() -> bool:
    try:
        Path("/proc/sys/vm/drop_caches").write_text("3\n")
    except OSError:
        return False
    return True


def once() -> tuple[float, float]:
    """Seconds to the first picture with numbers, and to the first number that moved."""
    with tempfile.TemporaryDirectory() as folder:
        begun_s = time.monotonic()
        console = Console(Path(folder))
        try:
            terminal = console.terminal
            wait(lambda: ELAPSED.search(terminal.text()) is not None, 60.0, "numbers", terminal)
            seen_s, first = time.monotonic() - begun_s, terminal.text()
            wait(lambda: terminal.text() != first and ELAPSED.search(terminal.text()) is not None, 60.0, "movement",
                 terminal)
            return seen_s, time.monotonic() - begun_s
        finally:
            console.terminal.end()
            console.end_worker()


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--warm", action="store_true", help="leave the cold starts out")
    given = parser.parse_args()
    cold = [once() for _ in range(given.times) if not given.warm and empty_the_cache()]
    if not cold and not given.warm:
        print("cold: the file cache cannot be emptied here")
    once()
    warm = [once() for _ in range(given.times)]
    for name, found in (("cold", cold), ("warm", warm)):
        for what, place in (("numbers shown", 0), ("first number moved", 1)):
            seconds = [one[place] for one in found]
            if seconds:
                print(f"{name:5} {what:20} median {statistics.median(seconds):.2f} s, {min(seconds):.2f} to "
                      f"{max(seconds):.2f} s, {len(seconds)} times")
    return exit_code({"started at least once": warm, "a number moved after it was shown": all(m >= s for s, m in warm)})


if __name__ == "__main__":
    sys.exit(run())
