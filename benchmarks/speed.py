"""What is to be fast, here and in another tree, in one run: `python -m benchmarks speed
--against TREE [--only PART]`

The table of all that was promised to be fast: the median and the range of both, and old over
new. Short work is taken five times, in turns with the other tree's; what takes long once. Where
a row says so it is the processor's time, which a busy machine stretches less. Whole some twenty
minutes, most of them for what is simulated (`rows`, `simulate`); on a busy machine take parts.
Linux only.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
import hashlib
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import yaml
from terminals import Console, Tap, Terminal, console, machine, state, to_work, took, wait
from topdress.console.link import Link, WorkerGone
from topdress.console.running import WorkerAddress
from trees import environment_of, trees, worked
from verdict import exit_code

PROGRAM = Path(sys.executable).parent / "topdress"
TIMES = 5
LOG_S = 1200.0  # 24,000 rows
MANY = "TOPDRESS_MANY_ROWS"  # environment: a log of 1e6 rows
SIMULATED_S = 300.0
HOUR_S = 3600.0
KEYS = 15
LOOP_S, LOOP_HZ = 8.0, 100.0
IDLE_S, WORK_S, SETTLE_S = 8.0, 20.0, 3.0  # looked at; and before, for caches and pictures
F2, F3, F4, F5, ESCAPE = "\x1bOQ", "\x1bOR", "\x1bOS", "\x1b[15~", "\x1b"
PAGES = {"Run": F2, "Map": F3, "Trends": F4, "Devices": F5}
ELAPSED = re.compile(r"\d\d:\d\d  \d\d:\d\d:\d\d")
EFFECTS = (
    "flow.gain=8",
    "gate.backlash=1@60",
    "shaft.dead_time=0.1",
    "speed.gnss_latency=0.4",
    "flow.pulsation=5",
    "shaft.coarse_encoder=1",
    "flow.bridging=5",
)
# as Typer says it: an older tree, which simulates no such machine
UNKNOWN = "No such option"
SET_UP_S = "610"  # long enough for compiled steps
SET_UPS: dict[str, tuple[str, ...]] = {
    "demo": ("--seconds", SET_UP_S, "--seed", "7"),
    "speed first": ("--seconds", SET_UP_S, "--seed", "2", "--strategy", "speed_first"),
    "carried along": ("--seconds", SET_UP_S, "--seed", "3", "--plant", "carried_along"),
    "no look-ahead, no trim": (
        "--seconds",
        SET_UP_S,
        "--seed",
        "4",
        "--look-ahead",
        "off",
        "--flow-trim",
        "off",
    ),
    "seven effects": (
        "--seconds",
        SET_UP_S,
        "--seed",
        "5",
        *(word for one in EFFECTS for word in ("--effect", one)),
    ),
    "a term": (
        "--seconds",
        SET_UP_S,
        "--seed",
        "6",
        "--term",
        "flow_percent bend speed_mps bend=-4.4 at=1.2",
    ),
    "map": ("--job", "map_demo", "--seconds", SET_UP_S, "--seed", "7"),
    "points": (
        "--job",
        "points_demo",
        "--machine",
        "planter",
        "--seconds",
        SET_UP_S,
        "--seed",
        "8",
    ),
    "sections": (
        "--job",
        "sections_demo",
        "--machine",
        "huanghai_sections",
        "--seconds",
        SET_UP_S,
        "--seed",
        "9",
    ),
    "spreader, falling singly": (
        "--job",
        "spreader_demo",
        "--machine",
        "spreader",
        "--seconds",
        SET_UP_S,
        "--seed",
        "10",
        "--plant",
        "singly",
    ),
}

Values = dict[str, list[float]]  # by tree


class Row(NamedTuple):
    work: str
    unit: str
    goal: str
    found: Values
    more_is_better: bool = False

    def text(self) -> str:
        cells = [
            _spread(self.found[name]) if self.found.get(name) else "-" for name in ("old", "new")
        ]
        return (
            f"| {self.work}, {self.unit} | {self.goal} | {cells[0]} | {cells[1]} | "
            f"{self._ratio()} |"
        )

    def _ratio(self) -> str:
        if not (self.found.get("old") and self.found.get("new")):
            return "-"
        old, new = (statistics.median(self.found[name]) for name in ("old", "new"))
        if not (old and new):
            return "-"
        return f"{new / old if self.more_is_better else old / new:.2f}"


class Ran(NamedTuple):
    clock_s: float
    processor_s: float
    memory_mb: float


def _spread(values: Sequence[float]) -> str:
    wide = 0 if max(values) >= 100.0 else 1 if max(values) >= 10.0 else 2
    if len(values) == 1:
        return f"{values[0]:.{wide}f}"
    return (
        f"{statistics.median(values):.{wide}f} ({min(values):.{wide}f} to "
        f"{max(values):.{wide}f}, {len(values)})"
    )


def ran(tree: Path, *words: str, **environment: str) -> Ran:
    """A command of a tree, with its time and its memory. Raises RuntimeError where it fails."""
    started_s = time.monotonic()
    child = subprocess.Popen(
        [str(PROGRAM), *words],
        env=environment_of(tree) | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    assert child.stderr is not None
    said = child.stderr.read()
    _, ended, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(ended)
    if child.returncode != 0:
        raise RuntimeError(
            f"{tree}: topdress {' '.join(words)}: {said.decode(errors='replace')[-500:]}"
        )
    return Ran(time.monotonic() - started_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def of_runs(work: str, found: dict[str, list[Ran]], *goals: str) -> Iterator[Row]:
    """A row each for time, processor and, with a third goal, memory."""
    for unit, goal, place in zip(("s", "s of processor", "MB"), goals, range(3), strict=False):
        yield Row(
            work, unit, goal, {name: [one[place] for one in some] for name, some in found.items()}
        )


def in_turns(both: dict[str, Path], times: int, measure: Callable[[Path], float]) -> Values:
    found: Values = {name: [] for name in both}
    for _time in range(times):
        for name, tree in both.items():
            found[name].append(measure(tree))
    return found


def simulated(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """A short run, in which coming up counts, and an hour, which takes compiled steps where a
    tree has them."""
    out = str(folder / "sim.csv")

    def speed(seconds: float) -> Callable[[Path], float]:
        return lambda tree: (
            seconds
            / ran(
                tree,
                "simulate",
                "--seconds",
                f"{seconds:g}",
                "--seed",
                "7",
                "--force",
                "--out",
                out,
            ).processor_s
        )

    what = "x real time, {:g} s, whole process, processor"
    yield Row(
        "simulate", what.format(SIMULATED_S), "500", in_turns(both, times, speed(SIMULATED_S)), True
    )
    for tree in both.values():
        # its steps are compiled
        ran(tree, "simulate", "--seconds", SET_UP_S, "--force", "--out", out)
    yield Row("simulate", what.format(HOUR_S), "500", in_turns(both, 1, speed(HOUR_S)), True)


def log_of(both: dict[str, Path], folder: Path) -> Path:
    """24,000 rows, made once by the older tree: both judge the same file, and the older one
    knows every key of it."""
    path = folder / "log.csv"
    if not path.exists():
        ran(
            both.get("old", both["new"]),
            "simulate",
            "--seconds",
            f"{LOG_S:g}",
            "--seed",
            "7",
            "--out",
            str(path),
        )
    return path


def diagnosed(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    log = str(log_of(both, folder))
    runs: dict[str, list[Ran]] = {name: [] for name in both}
    for k in range(times + 1):
        for name, tree in both.items():
            once_more = ran(tree, "diagnose", log)
            if k:  # the first one compiles
                runs[name].append(once_more)
    yield from of_runs("diagnose, 24,000 rows, warm", runs, "3", "", "")


def diagnosed_first(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """With no compiled code of the model on this machine, but for what `make run` and `make
    test` compile where a tree has that; and what that takes."""
    log, runs, installed = str(log_of(both, folder)), {}, {}
    for name, tree in both.items():
        with tempfile.TemporaryDirectory() as empty:
            if (tree / "console" / "warm_up.py").exists():
                started_s = time.monotonic()
                subprocess.run(
                    [sys.executable, "-m", "topdress.console.warm_up"],
                    check=True,
                    stdout=subprocess.DEVNULL,
                    env=environment_of(tree) | {"XDG_CACHE_HOME": empty},
                    cwd=tree,
                )
                installed[name] = [time.monotonic() - started_s]
            runs[name] = [ran(tree, "diagnose", log, XDG_CACHE_HOME=empty)]
    yield from of_runs("diagnose, 24,000 rows, first time", runs, "6", "")
    yield Row("compiled when installing", "s", "", installed)


def diagnosed_many(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """Of a log that was made before: to simulate one takes some five minutes."""
    log = os.environ.get(MANY, "")
    if not log:
        raise RuntimeError(
            f"1e6 rows: {MANY} names no log: topdress simulate --seconds 50000 --seed 7 "
            "--out LOG.csv"
        )
    runs = {name: [ran(tree, "diagnose", log)] for name, tree in both.items()}
    yield from of_runs("diagnose, 1e6 rows", runs, "10", "", "1000")


def fleet(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    logs, found = folder / "logs", dict[str, list[Ran]]()
    logs.mkdir()
    for one in (log_of(both, folder), log_of(both, folder).with_suffix(".yaml")):
        (logs / one.name).symlink_to(one)
    for name, tree in both.items():
        ran(tree, "fleet", str(logs), "--out", str(folder / f"warm_{name}"))
        found[name] = [ran(tree, "fleet", str(logs), "--out", str(folder / f"fleet_{name}"))]
    yield from of_runs("fleet, one log of 24,000 rows", found, "as diagnose", "")


def rows_stay(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """Of the set-ups that both trees know run log and truth, by sha256: how many are the same.
    What a tree does not know, and where rows begin to differ, is said on stderr."""
    if len(both) < 2:
        return
    same, known = 0, 0
    for what, options in SET_UPS.items():
        logs: dict[str, Path] = {}
        for name, tree in both.items():
            logs[name] = folder / f"rows_{name}.csv"
            try:
                ran(tree, "simulate", "--force", "--out", str(logs[name]), *options)
            except RuntimeError as error:
                if UNKNOWN not in str(error):
                    raise
                print(
                    f"rows: {what}: {error_line(error)} in the {name} tree: left out",
                    file=sys.stderr,
                    flush=True,
                )
                break
        else:
            known += 1
            apart = [
                line
                for of in (lambda log: log, lambda log: log.with_suffix(".truth.csv"))
                if (line := first_apart(of(logs["old"]), of(logs["new"])))
            ]
            same += not apart
            for line in apart:
                print(f"rows: {what}: {line}", file=sys.stderr, flush=True)
    yield Row(
        "simulate, the same rows",
        f"of {known} set-ups that both know",
        str(known),
        {"new": [float(same)]},
    )


def error_line(error: Exception) -> str:
    """The line of an error that says why: a usage message has three before it."""
    return next(
        (line for line in str(error).splitlines() if UNKNOWN in line), str(error).splitlines()[-1]
    )


def first_apart(old: Path, new: Path) -> str:
    """Where two tables begin to differ: line, column, both values; "" where they are the same
    to the last byte."""
    if hashlib.sha256(old.read_bytes()).digest() == hashlib.sha256(new.read_bytes()).digest():
        return ""
    with (
        old.open(newline="", encoding="utf-8") as one,
        new.open(newline="", encoding="utf-8") as other,
    ):
        head: list[str] = []
        for number, (first, second) in enumerate(
            zip_longest(csv.reader(one), csv.reader(other), fillvalue=[]), 1
        ):
            head = head or first
            for column, a, b in zip_longest(head, first, second, fillvalue="nothing"):
                if a != b:
                    return (
                        f"{new.name.replace('rows_new', 'rows')} line {number}, {column}: "
                        f"{a} -> {b}"
                    )
    return f"{new.name.replace('rows_new', 'rows')}: the same values, written in another way"


class Start(NamedTuple):
    """Seconds to the first picture with numbers and to the first number that moved, processor's
    time till the first."""

    seen_s: float
    moved_s: float
    console_s: float
    worker_s: float


def once(tree: Path) -> Start:
    """The console of a tree, from the command to its first moving number: the worker's running
    time."""
    with environment(tree), tempfile.TemporaryDirectory() as folder:
        started_s = time.monotonic()
        one = Console(Path(folder))
        terminal = one.terminal
        try:
            wait(lambda: ELAPSED.search(terminal.text()) is not None, 60.0, "numbers", terminal)
            seen_s, first = time.monotonic() - started_s, terminal.text()
            used = {what: taken(pid).cpu_s for what, pid in pids_of(one).items()}
            wait(
                lambda: terminal.text() != first and ELAPSED.search(terminal.text()) is not None,
                60.0,
                "movement",
                terminal,
            )
            return Start(seen_s, time.monotonic() - started_s, used["console"], used["worker"])
        finally:
            terminal.end()
            one.end_worker()


def started(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """Cold: the kernel's file cache is emptied before each, which root alone may do on Linux."""
    for tree in both.values():
        once(tree)
    for word, prepared in (("cold", empty_the_cache), ("warm", lambda: True)):
        runs: dict[str, list[Start]] = {name: [] for name in both}
        for _time in range(times):
            for name, tree in both.items():
                if prepared():
                    runs[name].append(once(tree))
        for what, goal, place in (
            ("numbers shown, s", "0.8" * (word == "warm"), 0),
            ("a number moved, s", "", 1),
            ("processor of the console till then, s", "", 2),
            ("processor of the worker till then, s", "", 3),
        ):
            if runs["new"]:
                yield Row(
                    f"console, {word}",
                    what,
                    goal,
                    {name: [one[place] for one in some] for name, some in runs.items()},
                )


def empty_the_cache() -> bool:
    try:
        Path("/proc/sys/vm/drop_caches").write_text("3\n")
    except OSError:
        return False
    return True


class Taken(NamedTuple):
    cpu_s: float
    resident_mb: float


def taken(pid: int) -> Taken:
    """Processor's seconds so far and resident memory of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return Taken((int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), resident / 2**20)


def shares(pids: dict[str, int], seconds: float) -> dict[str, float]:
    """Percent of one core over the next seconds."""
    before, started_s = {name: taken(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - started_s
    return {
        name: 100.0 * (taken(pid).cpu_s - before[name].cpu_s) / took_s for name, pid in pids.items()
    }


def pids_of(one: Console) -> dict[str, int]:
    return {"console": one.terminal.process.pid, "worker": one.where().pid}


def idle(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """While nothing moves."""
    found: dict[str, Values] = {"console": {}, "worker": {}}
    for _time in range(times):
        for name, tree in both.items():
            with environment(tree), console() as one:
                time.sleep(SETTLE_S)
                for what, percent in shares(pids_of(one), IDLE_S).items():
                    found[what].setdefault(name, []).append(percent)
    for what, values in found.items():
        yield Row(f"idle, {what}", "% of a core", "4", values)


def working(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """At work, each page looked at for a while."""
    found: dict[tuple[str, str], Values] = {}
    for name, tree in both.items():
        with environment(tree), console() as one:
            to_work(one.terminal)
            pids = pids_of(one)
            for page, key in PAGES.items():
                one.terminal.type(key)
                time.sleep(SETTLE_S)
                percent = shares(pids, WORK_S)
                found.setdefault((f"at work, {page} page, console", "% of a core"), {})[name] = [
                    percent["console"]
                ]
                if page == "Run":
                    found.setdefault(("at work, worker", "% of a core"), {})[name] = [
                        percent["worker"]
                    ]
            for what, pid in pids.items():
                found.setdefault((f"at work, {what}", "MB"), {})[name] = [taken(pid).resident_mb]
    for (what, unit), values in found.items():
        yield Row(what, unit, "", values)


def stopped(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """From STOP's key to the drive frame that forbids the drives, through a served machine."""
    found: Values = {}
    for name, tree in both.items():
        with environment(tree), machine() as urls:
            tap = Tap(urls["board"])
            tap.start()
            cab = folder / f"cab_{name}.yaml"
            cab.write_text(
                yaml.safe_dump(
                    {
                        "format": "topdress-cab/1",
                        "virtual": True,
                        "gnss": {"port": urls["gnss"]},
                        "heads": {"ports": [urls[f"head_{n}"] for n in range(1, 7)]},
                        "board": {"port": tap.url},
                    }
                )
            )
            with console("--config", str(cab)) as one:
                found[name] = [1000.0 * stop_s(one.terminal, tap, k) for k in range(KEYS)]
    yield from _latency("STOP to zero on the wire", found)


def stop_s(terminal: Terminal, tap: Tap, number: int) -> float:
    to_work(terminal)
    wait(lambda: tap.turning, 60.0, "drives that turn", terminal)
    time.sleep(0.37 + 0.037 * (number % 7))  # not in step with the ticks
    pressed_s = time.monotonic()
    terminal.type("x")
    wait(lambda: not tap.turning, 30.0, "a frame that forbids the drives", terminal)
    wait(lambda: state("OFF")(terminal.text()), 30.0, "off on the screen", terminal)
    return tap.stopped_s - pressed_s


def keys(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """From a key until the screen shows what it does: hold and STOP go by the worker, a page
    and a dialog do not."""
    pressed: dict[str, tuple[str, Callable[[str], bool], str]] = {
        "hold": (" ", state("HELD"), ""),
        "STOP": ("x", state("OFF"), ""),
        "page": (F3, lambda text: "whole field" in text, F2),
        "dialog": ("m", lambda text: "Manual rate" in text, ESCAPE),
    }
    found: dict[str, Values] = {what: {} for what in pressed}
    for name, tree in both.items():
        with environment(tree), console() as one:
            for number in range(KEYS):
                for what, (key, seen, back) in pressed.items():
                    to_work(one.terminal)
                    time.sleep(0.3 + 0.037 * (number % 7))  # not in step with the ticks
                    found[what].setdefault(name, []).append(1000.0 * took(one.terminal, key, seen))
                    if back:
                        took(one.terminal, back, lambda text, seen=seen: not seen(text))  # type: ignore[misc]
    for what, values in found.items():
        yield from _latency(f"{what} until the screen shows it", values)


def _latency(what: str, found: Values) -> Iterator[Row]:
    yield Row(what, "ms", "not slower", found)
    yield Row(
        f"{what}, p95",
        "ms",
        "not slower",
        {
            name: [sorted(some)[round(0.95 * (len(some) - 1))]]
            for name, some in found.items()
            if some
        },
    )


def loop(both: dict[str, Path], folder: Path, times: int) -> Iterator[Row]:
    """p99.9 of the loop's period in the worker, a console at work attached, over that of this
    tree's loop alone."""
    found: Values = {}
    for name, tree in both.items():
        alone = subprocess.run(
            [sys.executable, __file__, "--loop-alone", str(folder / f"loop_{name}")],
            check=True,
            env=environment_of(Path(__file__).parents[1]),
            stdout=subprocess.PIPE,
            text=True,
        )
        with environment(tree), console("--hz", f"{LOOP_HZ:g}") as one:
            to_work(one.terminal)
            time.sleep(LOOP_S)
            found[name] = [
                asyncio.run(stats_of(one.where()))["p999_ms"] / float(alone.stdout.splitlines()[-1])
            ]
    yield Row("loop p99.9 over a bare loop", "times, 100 Hz", "1.1 to 1.2", found)


async def stats_of(where: WorkerAddress) -> dict[str, float]:
    """What the worker says of its own punctuality."""
    link = Link(where)
    run = asyncio.create_task(link.run_connection())
    try:
        await asyncio.wait_for(link.attached.wait(), 5.0)
        return await link.request_stats(5.0)
    finally:
        run.cancel()
        with suppress(asyncio.CancelledError, WorkerGone):
            await run


def loop_alone(folder: Path) -> float:
    """p99.9 of the period, ms, of the same loop at work with no console, here."""
    folder.mkdir()
    host = worked(
        ["--hz", f"{LOOP_HZ:g}", "--log", str(folder / "loop.csv")],
        time.monotonic,
        time.sleep,
        time.monotonic() + LOOP_S,
        hz=LOOP_HZ,
        orphan_s=1e9,
    )
    return float(host.period.summary()["p999_ms"])


@contextmanager
def environment(tree: Path) -> Iterator[None]:
    """What is started within takes the code of the tree."""
    before = dict(os.environ)
    os.environ.update(environment_of(tree))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


PARTS: dict[str, Callable[[dict[str, Path], Path, int], Iterator[Row]]] = {
    "simulate": simulated,
    "rows": rows_stay,
    "diagnose": diagnosed,
    "first": diagnosed_first,
    "many": diagnosed_many,
    "fleet": fleet,
    "start": started,
    "idle": idle,
    "work": working,
    "wire": stopped,
    "keys": keys,
    "loop": loop,
}


def run() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, help="another tree, measured in the same run")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=PARTS,
        default=list(PARTS),
        metavar="PART",
        help=f"these alone: {', '.join(PARTS)}",
    )
    parser.add_argument("--times", type=int, default=TIMES, help="that short work is taken")
    parser.add_argument("--loop-alone", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.loop_alone:
        print(loop_alone(given.loop_alone))
        return 0
    both, started_s, missing = trees(given.against), time.monotonic(), []
    # modules are compiled, as an installer leaves them
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    print(f"load average at the start: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
    print(
        "| work | to reach | old: median (range, times) | new | old / new |\n|---|---|---|---|---|",
        flush=True,
    )
    with tempfile.TemporaryDirectory(prefix="topdress-speed-") as place:
        os.environ["PYTHONPYCACHEPREFIX"] = f"{place}/compiled"
        for name in given.only:
            part_s = time.monotonic()
            try:
                for row in PARTS[name](both, Path(place), given.times):
                    print(row.text(), flush=True)
            except (RuntimeError, OSError, TimeoutError, subprocess.SubprocessError) as error:
                missing.append(name)
                print(
                    f"| {name}: "
                    f"{str(error).splitlines()[0][:200] if str(error) else type(error).__name__} "
                    "| | | | |",
                    flush=True,
                )
            print(f"{name}: {time.monotonic() - part_s:.0f} s", file=sys.stderr, flush=True)
    print(
        f"\n{time.monotonic() - started_s:.0f} s in all, load average at the end "
        f"{os.getloadavg()[0]:.1f}"
    )
    return exit_code({f"{name}: measured": name not in missing for name in given.only})


if __name__ == "__main__":
    sys.exit(run())
