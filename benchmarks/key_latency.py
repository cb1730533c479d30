"""From a key to the screen: `python -m benchmarks key_latency [--times 20]`

The real program in a pseudo-terminal at work on the simulated machine; then a replay alone, playing at 100x. Of each
kind of key the seconds from writing it to the terminal until the screen shows what it does: median and 95th
percentile. Hold and STOP go to the worker and come back in its frames, so they hold a frame's and a look's time; a page
and a dialog are the console's alone. POSIX only; a quiet machine, else it measures the others' work.
"""
from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from console_deaths import Console, Terminal, wait
from verdict import exit_code

F2, F3, F7, HOME, ESCAPE = "\x1bOQ", "\x1bOR", "\x1b[18~", "\x1b[H", "\x1b"
LIMIT_S = {"hold": 0.6, "stop": 0.6, "page": 0.4, "dialog": 0.3}     # median, on a quiet machine
SEE_S = 0.002
LOG_S = 3600                # at 100x it plays for 36 s
PAGE, DIALOG = "whole field", "Manual rate"


def took(terminal: Terminal, key: str, seen: Callable[[str], bool], most_s: float = 10.0) -> float:
    """Seconds from the key until the screen is so."""
    started_s = time.monotonic()
    terminal.type(key)
    while not seen(terminal.text()):
        if time.monotonic() - started_s > most_s:
            raise TimeoutError(f"{key!r} was not seen:\n{terminal.text()}")
        time.sleep(SEE_S)
    return time.monotonic() - started_s


def state(word: str) -> Callable[[str], bool]:
    return lambda text: word in text.splitlines()[0]


def at_work(terminal: Terminal, times: int) -> Iterator[tuple[str, float]]:
    """The machine works between the keys."""
    for _time in range(times):
        work(terminal)
        yield "hold", took(terminal, " ", state("HELD"))
        work(terminal)
        yield "stop", took(terminal, "x", state("OFF"))
        work(terminal)
        yield from console_alone(terminal)


def work(terminal: Terminal) -> None:
    first = terminal.text().splitlines()[0]
    if "OFF" in first:
        took(terminal, "r", state("READY"))
    if "WORKING" not in terminal.text().splitlines()[0]:
        took(terminal, "s", state("WORKING"))
    time.sleep(0.3)


def console_alone(terminal: Terminal) -> Iterator[tuple[str, float]]:
    yield "page", took(terminal, F3, lambda text: PAGE in text)
    took(terminal, F2, lambda text: PAGE not in text)
    time.sleep(0.1)
    yield "dialog", took(terminal, "m", lambda text: DIALOG in text)
    took(terminal, ESCAPE, lambda text: DIALOG not in text)
    time.sleep(0.2)


def from_its_start(terminal: Terminal) -> None:
    """A log that came to its end has stopped."""
    terminal.type(HOME)
    time.sleep(0.4)
    if "playing" not in terminal.text():
        took(terminal, "y", lambda text: "playing" in text)


def in_replay(terminal: Terminal, times: int) -> Iterator[tuple[str, float]]:
    """Hold pauses the log, for there is no machine."""
    for _time in range(times):
        from_its_start(terminal)
        yield "page", took(terminal, F3, lambda text: PAGE in text)
        took(terminal, F7, lambda text: PAGE not in text)
        time.sleep(0.2)
        yield "dialog", took(terminal, "q2", lambda text: "Findings about" in text)
        took(terminal, ESCAPE, lambda text: "Findings about" not in text)
        from_its_start(terminal)
        yield "hold", took(terminal, " ", lambda text: "paused" in text)
        took(terminal, " ", lambda text: "playing" in text)
        time.sleep(0.2)


def printed(name: str, found: list[tuple[str, float]]) -> dict[str, object]:
    promises: dict[str, object] = {}
    for kind in dict.fromkeys(kind for kind, _s in found):
        seconds = sorted(s for one, s in found if one == kind)
        median, p95 = statistics.median(seconds), seconds[min(len(seconds) - 1, round(0.95 * (len(seconds) - 1)))]
        print(f"{name:22} {kind:7} median {1000 * median:4.0f} ms, p95 {1000 * p95:4.0f} ms, {len(seconds)} times")
        promises[f"{name}, {kind}: median {median:.2f} s: at most {LIMIT_S[kind]} s"] = median <= LIMIT_S[kind]
    return promises


def run() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=20)
    times = parser.parse_args().times
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as place:
        console = Console(Path(place))
        terminal = console.terminal
        try:
            wait(lambda: terminal.shows("NDVI 0."), 60.0, "numbers", terminal)
            promises = printed("at work", list(at_work(terminal, times)))
        finally:
            terminal.end()
            console.end_worker()
        log = str(Path(place) / "long.csv")
        program = str(Path(sys.executable).parent / "topdress")
        subprocess.run([program, "simulate", "--seconds", f"{LOG_S}", "--out", log], env=console.environment,
                       check=True, stdout=subprocess.DEVNULL)
        replay = Terminal([program, "replay", log], console.environment)
        try:
            wait(lambda: replay.shows("REPLAY"), 60.0, "the log", replay)
            for _press in range(6):
                replay.type("]")                # 2x, 5x, 10x, 20x, 50x, 100x
                time.sleep(0.1)
            replay.type("y")
            wait(lambda: replay.shows("playing"), 20.0, "playing", replay)
            speed = next((word for word in replay.text().split() if word.endswith("x") and word[:-1].isdigit()), "?")
            promises |= printed(f"in replay at {speed}", list(in_replay(replay, times)))
        finally:
            replay.end()
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(run())
