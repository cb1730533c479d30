"""How punctual is the control loop where? `python benchmarks/loop_period.py --hz 20 --seconds 300 --rounds 1`

Three places, taken in turns so that all meet the same machine load:

    bare     the loop alone in a process: what the machine and the operating system allow
    thread   the loop in a thread of a console that draws (Textual, headless: everything but the terminal itself)
    worker   the loop in the control worker, the same console attached to it over loopback

The console redraws numbers at 5 Hz, a table and a plot at 2 Hz. The loop does a fixed amount of pure Python work a tick
(`--work`, about 1 ms at 20 000), or with `--real` drives the simulated machine. Period error is |interval - period|.
"""
from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from console.link import Link, start_worker
from console.worker.host import Host
from console.worker.parts import Assembly, Names
from console.worker.program import Assemble, Clock, Options, main
from console.worker.system import take_priority
from console.worker.thread_host import ThreadHost
from control.log_row import LogRow
from control.orders import Alarm, Answer, Order
from control.readings import DriveCommand, Measurements

PLACES = ("bare", "thread", "worker")
COLUMNS = ("p50_ms", "p99_ms", "p999_ms", "max_ms", "busy_p50_ms", "busy_max_ms", "skipped", "ticks")
LOAD = ("cpu_percent", "load")


class StandInTick(NamedTuple):
    row: LogRow
    command: DriveCommand = DriveCommand(0.0, 20.0)
    enabled: bool = False
    alarms: tuple[Alarm, ...] = ()
    dropped_heads: tuple[int, ...] = ()
    metres_left_m: float | None = None
    area_ha: float = 0.0
    applied_kg: float = 0.0
    gnss_age_s: float | None = None
    gnss_hz: float | None = None
    usable_speed_mps: float | None = None
    look_ahead: bool = True
    flow_trim_on: bool = True
    place_m: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()


class StandIn:
    """Bench, loop and log in one: a fixed amount of work a tick, everything else empty."""

    ok = True
    trouble = ""

    def __init__(self, work: int) -> None:
        self._work = work

    def measure(self, now_s: float) -> Measurements:
        return Measurements(now_s)

    def command(self, now_s: float, command: DriveCommand | None, enabled: bool) -> None:
        pass

    def status(self, now_s: float) -> tuple[()]:
        return ()

    def order(self, order: Order) -> Answer:
        return Answer(True)

    def tick(self, measurements: Measurements, console_age_s: float | None, log_ok: bool) -> StandInTick:
        total = 0.0
        for k in range(self._work):
            total += k * 0.5
        return StandInTick(LogRow(measurements.time_s, speed_mps=total, shaft_rpm=70.0, opening_mm=25.0))

    def append(self, row: LogRow) -> None:
        pass

    def close(self) -> None:
        pass


def chosen(given: argparse.Namespace) -> Assemble:
    if given.real:
        from console.worker.assemble import assemble
        return assemble

    def stand_in(options: Options, clock: Clock) -> Assembly:
        part = StandIn(given.work)
        return Assembly(part, part, part, Names(machine="stand-in"))

    return stand_in


def host_of(given: argparse.Namespace) -> Host:
    began = time.monotonic()

    def clock() -> float:
        return time.monotonic() - began

    log = str(Path(given.folder) / "loop.csv")
    parts = chosen(given)(Options(config=(), run_file=Path(given.folder) / "w.json", hz=given.hz, log=log), clock)
    return Host(parts, clock, time.sleep, hz=given.hz, orphan_s=1e9)


def measure_bare(given: argparse.Namespace) -> dict[str, float]:
    import threading
    host = host_of(given)
    threading.Timer(given.seconds, host.stop, ("enough",)).start()
    host.run()
    return host.period.summary()


def measure_under_a_console(given: argparse.Namespace) -> dict[str, float]:
    """A Textual console that draws in this process; the loop in its thread or in a worker."""
    from textual.app import App, ComposeResult
    from textual.containers import Grid
    from textual.widgets import DataTable, Digits, Static

    if given.place == "thread":
        link: Any = ThreadHost(host_of(given))
    else:
        folder = Path(given.folder)
        where = start_worker(["--hz", str(given.hz), "--log", str(folder / "loop.csv"), "--orphan-s", "1e9"],
                             folder / "trouble", run_file=folder / "run" / "w.json",
                             program=("-P", *sys.argv, "--place", "serve", "--"))
        link = Link(where)
    said: dict[str, float] = {}

    class Console(App[None]):
        CSS = "Grid { grid-size: 6; height: 30; } DataTable { height: 12; }"

        def compose(self) -> ComposeResult:
            with Grid():
                for k in range(24):
                    yield Digits("0", id=f"n{k}")
            yield Static(id="plot")
            yield DataTable(id="table")

        def on_mount(self) -> None:
            table = self.query_one(DataTable)
            table.add_columns(*"abcdef")
            for _ in range(10):
                table.add_row(*"------")
            self.set_interval(0.2, self.numbers)
            self.set_interval(0.5, self.pictures)
            self.ran = asyncio.create_task(link.run())
            self.set_timer(given.seconds, self.finish)

        def numbers(self) -> None:
            frame = link.newest
            if frame is not None:
                for k in range(24):
                    self.query_one(f"#n{k}", Digits).update(f"{(frame.seq * (k + 1)) % 1000:.1f}")

        def pictures(self) -> None:
            frame = link.newest
            if frame is None:
                return
            line = "".join("▁▂▃▄▅▆▇█"[(frame.seq + k * k) % 8] for k in range(118))
            self.query_one("#plot", Static).update("\n".join([line] * 8))
            table = self.query_one(DataTable)
            for row in range(10):
                for column in range(6):
                    table.update_cell_at((row, column), f"{frame.seq + row * column}")        # type: ignore[arg-type]

        async def finish(self) -> None:
            said.update(await link.stats(5.0))
            await link.stop_worker()
            self.ran.cancel()
            self.exit()

    Console().run(headless=True, size=(120, 40))
    return said


def cpu_times() -> tuple[float, float] | None:
    """(busy, all) seconds of all cores so far, where the system tells."""
    try:
        fields = [float(f) for f in Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:9]]
    except OSError:
        return None
    return sum(fields) - fields[3] - fields[4], sum(fields)


def one(place: str, arguments: Sequence[str]) -> dict[str, float]:
    """One measurement in processes of its own, with the machine's load while it ran."""
    with tempfile.TemporaryDirectory() as folder:
        before = cpu_times()
        ended = subprocess.run([sys.executable, __file__, *arguments, "--place", place, "--folder", folder],
                               capture_output=True, text=True)
        after = cpu_times()
    if ended.returncode:
        sys.exit(f"{place}: {ended.stderr[-2000:]}")
    said: dict[str, float] = json.loads(ended.stdout.strip().split("\n")[-1])
    if before and after:
        said["cpu_percent"] = 100.0 * (after[0] - before[0]) / (after[1] - before[1])
    if hasattr(os, "getloadavg"):
        said["load"] = os.getloadavg()[0]
    return said


def run() -> None:
    parser = argparse.ArgumentParser(description="Period error of the control loop: bare, thread, worker.")
    parser.add_argument("--hz", type=float, default=20.0)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=1, help="each place once a round")
    parser.add_argument("--work", type=int, default=20_000, help="additions a tick of the stand-in loop")
    parser.add_argument("--real", action="store_true", help="the real loop on the simulated machine")
    parser.add_argument("--json", type=Path, help="write all measurements there")
    parser.add_argument("--place", choices=(*PLACES, "serve"), help=argparse.SUPPRESS)
    parser.add_argument("--folder", default=".", help=argparse.SUPPRESS)
    cut = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    given = parser.parse_args(sys.argv[1:cut])
    if given.place == "serve":
        sys.exit(main(sys.argv[cut + 1:], chosen(given)))
    if given.place == "bare":
        take_priority(os.environ.get("TOPDRESS_FIFO"))
        print(json.dumps(measure_bare(given)))
        return
    if given.place:
        print(json.dumps(measure_under_a_console(given)))
        return
    found = []
    print(f"{given.hz:g} Hz, {given.seconds:g} s each, "
          f"{'simulated machine' if given.real else f'{given.work} additions a tick'}, {os.cpu_count()} cores, "
          f"real-time priority {'wanted' if os.environ.get('TOPDRESS_FIFO') else 'off'}")
    print(f"{'place':8}" + "".join(f"{c:>12}" for c in (*COLUMNS, *LOAD)))
    for _ in range(given.rounds):
        for place in PLACES:
            said = one(place, sys.argv[1:])
            found.append({"place": place} | said)
            print(f"{place:8}" + "".join(f"{said.get(c, float('nan')):12.3f}" for c in (*COLUMNS, *LOAD)), flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


if __name__ == "__main__":
    run()
