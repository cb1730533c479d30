"""How punctual is the control loop where? `python -m benchmarks loop_period --hz 100 --seconds 60 --rounds 2`

Three places, taken in turns so that all meet the same load; everything is the real thing, the machine simulated:

    bare     the loop alone in a process: what the machine and the operating system allow
    thread   the loop in a thread of the console (`ThreadHost`)
    worker   the loop in the control worker, the console attached to it over loopback

The console is topdress itself on its Run screen (numbers, map, trend, alarms) in a pseudo-terminal of 120x40, working:
made ready and started as an operator would. Period error is |interval - period| in ms, of every tick from the first,
the console's own start included. `busy` is what a tick takes; `load` and `cpu_percent` are the computer's while it ran;
`drawn_kB` is what the console wrote to its terminal. POSIX only. TOPDRESS_FIFO=1: with real-time priority.
"""
from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import select
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thread_host import ThreadHost
from verdict import exit_code

from console.link import Link
from console.running import start_worker
from console.worker.assemble import assemble
from console.worker.host import Host
from console.worker.options import Options
from console.worker.system import take_priority
from control.orders import Do, Order

PLACES = ("bare", "thread", "worker")
COLUMNS = ("p50_ms", "p99_ms", "p999_ms", "max_ms", "busy_p50_ms", "busy_max_ms", "skipped", "ticks", "cpu_percent",
           "load", "drawn_kB")
ROWS, COLUMNS_WIDE = 40, 120
START_EVERY_S = 0.5             # the operator tries again until it works
LEAST_TICKS = 0.8               # the console's start and end take some; skipped ones are printed


def host_of(given: argparse.Namespace) -> Host:
    began = time.monotonic()

    def clock() -> float:
        return time.monotonic() - began

    folder = Path(given.folder)
    parts = assemble(Options(config=(), run_file=folder / "w.json", hz=given.hz, log=str(folder / "loop.csv")), clock)
    return Host(parts, clock, time.sleep, hz=given.hz, orphan_s=1e9)


def measure_bare(given: argparse.Namespace) -> dict[str, float]:
    """The same work as under a console: the machine is started here too."""
    import threading
    host = host_of(given)

    def operate() -> None:
        until_s = time.monotonic() + given.seconds
        while time.monotonic() < until_s:
            host.console_heard()
            for do in _next_orders(host.newest):
                host.ask(Order(do), lambda *_: None)
            time.sleep(START_EVERY_S)
        host.stop("enough")

    threading.Thread(target=operate, daemon=True).start()
    host.run()
    return host.period.summary()


def measure_under_the_console(given: argparse.Namespace) -> None:
    """The console in this process and terminal; what was measured goes to a file."""
    from console.app.app import TopdressApp
    folder = Path(given.folder)
    if given.place == "thread":
        link: Any = ThreadHost(host_of(given))
    else:
        link = Link(start_worker(["--hz", str(given.hz), "--log", str(folder / "loop.csv")], folder / "trouble",
                                 run_file=folder / "run" / "w.json"))

    class Measured(TopdressApp):
        def on_ready(self) -> None:
            self.operating = asyncio.create_task(self.operate())

        async def operate(self) -> None:
            until_s = time.monotonic() + given.seconds
            while time.monotonic() < until_s:
                await asyncio.sleep(START_EVERY_S)
                for do in _next_orders(link.newest):
                    await link.order(Order(do))
            said = await link.stats(5.0)
            said["working"] = float(link.newest.row.state == "working")
            (folder / "said.json").write_text(json.dumps(said), encoding="utf-8")
            with contextlib.suppress(Exception):
                await link.stop_worker()
            self.exit()

    Measured(link, tour=False).run()


def _next_orders(frame: Any) -> tuple[Do, ...]:
    state = frame.row.state if frame is not None else ""
    return {"off": (Do.READY,), "ready": (Do.START,), "held": (Do.READY, Do.START)}.get(state, ())


def cpu_times() -> tuple[float, float] | None:
    """(busy, all) seconds of all cores so far, where the system tells."""
    try:
        fields = [float(f) for f in Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:9]]
    except OSError:
        return None
    return sum(fields) - fields[3] - fields[4], sum(fields)


def one(place: str, arguments: Sequence[str], seconds: float) -> dict[str, float]:
    """One measurement in processes of its own, with the computer's load while it ran."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {name: folder for name in (
            "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR", "XDG_CACHE_HOME")} | {
            "TERM": "xterm-256color", "COLORTERM": "truecolor"}
        command = [sys.executable, __file__, *arguments, "--place", place, "--folder", folder]
        before = cpu_times()
        drawn = _in_a_terminal(command, environment, seconds + 60.0)
        after = cpu_times()
        try:
            said: dict[str, float] = json.loads((Path(folder) / "said.json").read_text(encoding="utf-8"))
        except OSError:
            sys.exit(f"{place}: nothing was measured; last on its terminal: {drawn[-600:]!r}")
    if before and after:
        said["cpu_percent"] = 100.0 * (after[0] - before[0]) / (after[1] - before[1])
    said["load"] = os.getloadavg()[0]
    said["drawn_kB"] = len(drawn) / 1000.0
    return said


def _in_a_terminal(command: list[str], environment: dict[str, str], longest_s: float) -> bytes:
    """Run it in a pseudo-terminal that is read as fast as it draws; what it drew."""
    import fcntl
    import termios
    master, slave = os.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS_WIDE, 0, 0))
    child = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, env=environment, start_new_session=True)
    os.close(slave)
    drawn = bytearray()
    until_s = time.monotonic() + longest_s
    try:
        while time.monotonic() < until_s:
            if select.select([master], [], [], 0.2)[0]:
                try:
                    drawn += os.read(master, 65536)
                except OSError:
                    break
            elif child.poll() is not None:
                break
    finally:
        if child.poll() is None:
            child.terminate()
        child.wait(10)
        os.close(master)
    return bytes(drawn)


def run() -> int:
    parser = argparse.ArgumentParser(description="Period error of the control loop: bare, thread, worker.")
    parser.add_argument("--hz", type=float, default=100.0)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=1, help="each place once a round")
    parser.add_argument("--json", type=Path, help="write all measurements there")
    parser.add_argument("--place", choices=PLACES, help=argparse.SUPPRESS)
    parser.add_argument("--folder", default=".", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.place == "bare":
        take_priority(os.environ.get("TOPDRESS_FIFO"))
        (Path(given.folder) / "said.json").write_text(json.dumps(measure_bare(given)), encoding="utf-8")
        return 0
    if given.place:
        measure_under_the_console(given)
        return 0
    found = []
    print(f"{given.hz:g} Hz, {given.seconds:g} s each, {os.cpu_count()} cores, "
          f"real-time priority {'wanted' if os.environ.get('TOPDRESS_FIFO') else 'off'}")
    print(f"{'place':8}" + "".join(f"{c:>12}" for c in COLUMNS))
    for _ in range(given.rounds):
        for place in PLACES:
            said = one(place, sys.argv[1:], given.seconds)
            found.append({"place": place} | said)
            print(f"{place:8}" + "".join(f"{said.get(c, float('nan')):12.3f}" for c in COLUMNS), flush=True)
            if said.get("working") == 0.0:
                sys.exit(f"{place}: the machine was not working at the end")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    ticks = given.hz * given.seconds
    return exit_code({f"{one['place']}: {one['ticks']:.0f} ticks: {LEAST_TICKS:.0%} of those due at least":
                      one["ticks"] >= LEAST_TICKS * ticks > 0.0 for one in found})


if __name__ == "__main__":
    sys.exit(run())
