"""The console frozen, killed, its terminal closed; the worker killed: `python -m benchmarks
console_deaths`

The real program runs in a pseudo-terminal of its own, with folders of its own, on the simulated
machine at work. A second client without the token looks on and keeps the time. POSIX only.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from terminals import Console, Watcher, took, wait
from topdress.console.running import WorkerAddress
from topdress.drivers.files.read_log import read_log
from verdict import exit_code


class Death(NamedTuple):
    what: str
    happened: str
    after_s: float | None  # to held, or to word of it
    log: str
    ok: bool


def at_work(console: Console) -> tuple[WorkerAddress, Watcher]:
    where = console.where()
    watcher = Watcher(where)
    wait(lambda: bool(watcher.frames), 10.0, "frames", console.terminal)
    for key, state in (("r", "ready"), ("s", "working")):
        wait(lambda: console.terminal.shows("NDVI 0."), 20.0, "the Run screen", console.terminal)
        console.terminal.type(key)
        wait(
            lambda state=state: watcher.frames[-1][1].row.state == state,
            10.0,
            state,  # type: ignore[misc]
            console.terminal,
        )
    wait(
        lambda: (watcher.frames[-1][1].row.shaft_rpm or 0.0) > 60.0, 15.0, "flow", console.terminal
    )
    return where, watcher


def log_says(where: WorkerAddress) -> tuple[str, list[Any]]:
    rows = list(read_log(Path(where.log_path)).rows())
    gap_s = max(later.time_s - earlier.time_s for earlier, later in pairwise(rows))
    return f"{len(rows)} rows, last state {rows[-1].state}, longest gap {1000 * gap_s:.0f} ms", rows


def console_dies(folder: Path, how: str) -> Death:
    """`how`: SIGSTOP, SIGKILL, or hang-up."""
    console = Console(folder)
    try:
        where, watcher = at_work(console)
        died_s = time.monotonic()
        if how == "hang-up":
            console.terminal.hang_up()
            wait(lambda: console.terminal.process.poll() is not None, 5.0, "the console's end")
        else:
            os.kill(console.terminal.process.pid, getattr(signal, how))
        wait(
            lambda: watcher.since(died_s, lambda f: f.row.state == "held") is not None, 6.0, "held"
        )
        held_s = watcher.since(died_s, lambda f: f.row.state == "held")
        zero_s = watcher.since(died_s, lambda f: f.row.shaft_rpm_cmd == 0.0)
        stands_s = wait(
            lambda: (watcher.frames[-1][1].row.shaft_rpm or 0.0) < 1.0, 4.0, "a shaft that stands"
        )
        time.sleep(0.7)  # rows reach the disk every half second
        log, rows = log_says(where)
        happened = (
            f"held, shaft commanded to 0 after {zero_s:.2f} s, stands {stands_s:.1f} s later; "
        )
        again_s = time.monotonic()
        if how == "SIGSTOP":
            os.kill(console.terminal.process.pid, signal.SIGCONT)
        else:
            console.terminal.end()
            console.terminal = console.open()
            wait(
                lambda: console.terminal.shows("joined it"),
                20.0,
                "word of the machine that runs",
                console.terminal,
            )
            took(console.terminal, "\x1b", lambda text: "joined it" not in text)
        wait(lambda: console.terminal.shows("HELD"), 10.0, "held on screen", console.terminal)
        back_s = time.monotonic() - again_s
        console.terminal.type("a")
        wait(lambda: not watcher.frames[-1][1].alarms, 5.0, "acknowledged", console.terminal)
        console.terminal.type("s")
        wait(
            lambda: watcher.frames[-1][1].row.state == "working",
            5.0,
            "working again",
            console.terminal,
        )
        verb = "thawed" if how == "SIGSTOP" else "a new one attaches"
        return Death(
            f"console {how}",
            f"{happened}{verb}, shows it after {back_s:.1f} s; acknowledged, works again",
            held_s,
            log,
            held_s is not None and 1.4 < held_s < 2.6 and rows[-1].state == "held",
        )
    finally:
        console.terminal.end()
        console.end_worker()


def worker_dies(folder: Path) -> Death:
    console = Console(folder)
    try:
        where, watcher = at_work(console)
        time.sleep(1.0)
        died_s = time.monotonic()
        os.kill(where.pid, signal.SIGKILL)
        said_s = wait(
            lambda: console.terminal.shows("NO CONNECTION"), 5.0, "word of it", console.terminal
        )
        wait(lambda: watcher.gone_at_s is not None, 5.0, "the link's end")
        assert watcher.gone_at_s is not None
        log, rows = log_says(where)
        last = watcher.frames[-1][1].row
        missing_s = last.time_s - rows[-1].time_s
        alive = console.terminal.process.poll() is None
        return Death(
            "worker SIGKILL",
            f"link closed after {watcher.gone_at_s - died_s:.2f} s, the console says so; "
            "the board stops by itself after 1 s (loss table); the last "
            f"{max(0.0, missing_s):.2f} s are not in the log",
            said_s,
            log,
            said_s < 1.5 and missing_s < 1.1 and alive,
        )
    finally:
        console.terminal.end()
        console.end_worker()


def run() -> int:
    cases = [
        *(partial(console_dies, how=how) for how in ("SIGSTOP", "SIGKILL", "hang-up")),
        worker_dies,
    ]
    found = []
    for case in cases:
        with tempfile.TemporaryDirectory() as folder:
            found.append(d := case(Path(folder)))
        print(
            f"{d.what:36}{d.after_s or float('nan'):6.2f} s  "
            f"{'ok' if d.ok else 'SHORT':6}{d.happened}\n"
            f"{'':44}      log: {d.log}",
            flush=True,
        )
    return exit_code({f"{d.what}: as it should be": d.ok for d in found})


if __name__ == "__main__":
    sys.exit(run())
