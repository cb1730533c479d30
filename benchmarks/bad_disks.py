"""The flow while the log's disk is slow, and a log that is cut short: `python -m benchmarks bad_disks [--against TREE]`

The simulated machine works in real time for `--seconds`, in manual mode at one rate. Every write of its log takes 8 s;
or 30 s after the start another program cuts the log to nothing. What lies along the way is the plant's own.
"""
from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from trees import environment_of, trees, worked

WRITE_S = 8.0
CUT_S = 30.0
RUN_IN_M = 8.0              # from where the first material lands on
BARE_KG_HA = 50.0           # of 300: less is a stripe
KINDS = ("sound", "slow", "cut")


class Seen(NamedTuple):
    kind: str
    switches: int           # of the ordered flow, off or on, after the first start
    state: str              # at the end
    metres: int
    bare_m: int
    cv_percent: float       # of the metres' doses
    alarms: tuple[str, ...]
    logs: tuple[tuple[str, int, int, bool], ...]    # name, rows that can be read, zero bytes, begins with its header


class Slow:
    """A log's file on a disk of which every write takes `WRITE_S`."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def write(self, data: bytearray) -> int:
        time.sleep(WRITE_S)
        taken: int = self._file.write(data)
        return taken

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def of_this_tree(kind: str, seconds: float, folder: Path) -> Seen:
    from console.worker import assemble as rooms
    from control.orders import Do, Order
    from drivers.files.atomic import create
    from drivers.files.log_text import HEADER
    if kind == "slow":
        rooms.RunLogWriter = partial(rooms.RunLogWriter,                            # type: ignore[misc,assignment]
                                     create=lambda path, overwrite: Slow(create(path, overwrite)))
    began_s, log = time.monotonic(), folder / "run.csv"
    kg_by_m: dict[int, float] = {}
    frames: list[Any] = []
    cuts = [log] if kind == "cut" else []
    width_m = 0.0

    def clock() -> float:
        return time.monotonic() - began_s

    def take(plant: Any, truth: Any) -> None:
        nonlocal width_m
        width_m = plant.machine.geometry.working_width_m
        at = int(truth.driven_m + truth.speed_mps * truth.drop_s)
        kg_by_m[at] = kg_by_m.get(at, 0.0) + truth.flow_kg_s * plant.dt_s

    def each(host: Any) -> None:
        if host.newest is not None and clock() > 2.0:
            frames.append(host.newest)
            if host.newest.row.state == "ready":            # by hand at one rate
                for one in (Order(Do.SOURCE, "manual"), Order(Do.MANUAL_RATE, 300.0)):
                    host.ask(one, lambda answer, _: None)
        if cuts and clock() > CUT_S:
            os.truncate(cuts.pop(), 0)

    worked(["--log", str(log)], clock, time.sleep, seconds, each, take)
    flows = [bool(frame.row.shaft_rpm_cmd) for frame in frames[:-3]]                # at the end it is stopped
    flows = flows[flows.index(True):]
    alarms = {alarm.id for frame in frames for alarm in frame.alarms}
    first_m, last_m = min(kg_by_m), max(kg_by_m)
    laid = [m for m in range(first_m, last_m) if kg_by_m.get(m, 0.0) > 0.0]
    doses = np.array([kg_by_m.get(m, 0.0) * 10_000.0 / width_m for m in range(int(laid[0] + RUN_IN_M), last_m - 2)])
    logs = []
    for log in sorted(folder.glob("run*.csv")):
        text = log.read_bytes()
        logs.append((log.name, text.replace(b"\0", b"").count(b"\n") - text.startswith(HEADER.encode()[:20]),
                     text.count(b"\0"), text.startswith(HEADER.encode()[:20])))
    return Seen(kind, sum(a != b for a, b in pairwise(flows)), frames[-3].row.state,
                len(doses), int((doses < BARE_KG_HA).sum()), float(100.0 * doses.std() / doses.mean()),
                tuple(sorted(alarms & {"log_failed", "log_cut"})), tuple(logs))


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--against", type=Path, metavar="TREE", help="the same with the code of another tree")
    options.add_argument("--seconds", type=float, default=80.0)
    options.add_argument("--one", choices=KINDS, help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.one:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(of_this_tree(given.one, given.seconds, Path(folder))))
            sys.stdout.flush()
            os._exit(0)                     # a write that takes 8 s is not waited for
    words = ["--seconds", f"{given.seconds:g}", "--one"]
    running = [(name, kind, subprocess.Popen([sys.executable, __file__, *words, kind], env=environment_of(tree),
                                             stdout=subprocess.PIPE, text=True))
               for name, tree in trees(given.against).items() for kind in KINDS]
    print("| code, disk | flow switched | state | metres | bare m | CV | said | logs: rows, zero bytes, header |")
    print("|---|---|---|---|---|---|---|---|")
    for name, kind, process in running:
        seen = Seen(*json.loads(process.communicate()[0].splitlines()[-1]))
        logs = "; ".join(f"{log} {rows}, {zeros}, {('no', 'yes')[header]}" for log, rows, zeros, header in seen.logs)
        print(f"| {name}, {kind} | {seen.switches} | {seen.state} | {seen.metres} | {seen.bare_m} | "
              f"{seen.cv_percent:.1f} % | {' '.join(seen.alarms)} | {logs} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
