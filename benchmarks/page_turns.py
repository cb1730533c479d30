"""From a key to a page or dialog: `python benchmarks/page_turns.py [--times 3] [--busy 4] [--against TREE]`

The real program in a pseudo-terminal, on the simulated machine: each page and the dialogs that stand on files, for the
first time since the console came up and again. Seconds from the key until the screen shows it, and the processor's time
that the console took meanwhile. --busy: so many endless loops beside it, with the same right to the processor. Linux
only: reads /proc.
"""
from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from console_deaths import Console, Terminal, wait
from console_load import taken
from trees import environment_of, ratio, spread, trees
from verdict import exit_code

SEE_S = 0.005
MADE_S = 4.0                # after the first numbers: the pages that nobody asked for are made meanwhile
MOST_S = 60.0
LIMIT_S = 2.0               # the longest that any of them may take while the machine is busy
RUN, ESCAPE = "\x1bOQ", "\x1b"


class Turn(NamedTuple):
    """A key, and words that only what it opens shows. page: the key of the page on which it is pressed."""

    name: str
    key: str
    words: str
    page: str = ""


JOB = "\x1b[21~"
TURNS = (Turn("map", "\x1bOR", "whole field"), Turn("trends", "\x1bOS", "running"),
         Turn("devices", "\x1b[15~", "protocol, port"), Turn("calibrate", "\x1b[17~", "heads check"),
         Turn("replay", "\x1b[18~", "no log is open"), Turn("diagnosis", "\x1b[20~", "Which data"),
         Turn("job", JOB, "before work"), Turn("settings", "\x1b[23~", "how often"),
         Turn("strategy ?", "t", "Strategy"), Turn("rate ?", "m", "Manual rate"), Turn("help ?", "\x1bOP", "Esc"),
         Turn("actions ?", "\x10", "find an action"),
         Turn("job ?", "j", "points_demo", JOB), Turn("export ?", "e", "Export as", JOB),
         Turn("maps ?", "p", "Which prescription", JOB), Turn("refill ?", "f", "Filled in", JOB))


class Took(NamedTuple):
    seconds: float
    processor_s: float


def until(terminal: Terminal, words: str, there: bool = True) -> None:
    begun_s = time.monotonic()
    while terminal.shows(words) != there:
        if time.monotonic() - begun_s > MOST_S:
            raise TimeoutError(f"{words!r} was not seen:\n{terminal.text()}")
        time.sleep(SEE_S)


def turn(terminal: Terminal, one: Turn) -> Took:
    """From the page of the key to what it opens, and back to the Run page."""
    if one.page:
        terminal.type(one.page)
        until(terminal, "before work")
        until(terminal, "being read", there=False)
        time.sleep(0.3)
    begun_s, worked = time.monotonic(), taken(terminal.process.pid).cpu_s
    terminal.type(one.key)
    until(terminal, one.words)
    took = Took(time.monotonic() - begun_s, taken(terminal.process.pid).cpu_s - worked)
    if one.name.endswith("?"):
        time.sleep(0.2)
        terminal.type(ESCAPE)
        until(terminal, one.words, there=False)
    terminal.type(RUN)
    until(terminal, "look-ahead")
    time.sleep(0.2)
    return took


def visit(tree: Path, busy: int) -> Iterator[tuple[str, Took]]:
    os.environ.update(environment_of(tree))
    with tempfile.TemporaryDirectory() as folder:
        console = Console(Path(folder))
        loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
        try:
            wait(lambda: console.terminal.shows("NDVI 0."), 60.0, "numbers", console.terminal)
            time.sleep(MADE_S)
            for which in ("first", "again"):
                for one in TURNS:
                    yield f"{which} {one.name}", turn(console.terminal, one)
        finally:
            for loop in loops:
                loop.kill()
                loop.wait()
            console.terminal.end()
            console.end_worker()


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--against", type=Path, help="another tree, measured in the same run")
    given = parser.parse_args()
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores, {given.busy} loops beside")
    both = trees(given.against)
    found: dict[str, dict[str, list[Took]]] = defaultdict(lambda: {name: [] for name in both})
    for _time in range(given.times):
        for name, tree in both.items():
            for what, took in visit(tree, given.busy):
                found[what][name].append(took)
    for what, by_tree in found.items():
        for name, some in by_tree.items():
            print(f"{what:18} {name} {spread([one.seconds for one in some])} s; processor "
                  f"{spread([one.processor_s for one in some])} s")
    for place, what in enumerate(("seconds, all of them", "processor, all of them")):
        sums = {name: [sum(by_tree[name][k][place] for by_tree in found.values()) for k in range(given.times)]
                for name in both}
        for name, some in sums.items():
            print(f"{what} {name} {spread(some)} s")
        print(ratio(what, sums))
    longest = max((one.seconds, what) for what, by_tree in found.items() for one in by_tree["new"])
    print(f"longest: {longest[0]:.2f} s, {longest[1]}")
    return exit_code({f"the longest: {longest[1]} {longest[0]:.2f} s: at most {LIMIT_S} s": longest[0] <= LIMIT_S})


if __name__ == "__main__":
    sys.exit(run())
