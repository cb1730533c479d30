"""A normal day of eight hours, simulated: alarms (none should be), wall time, log size. `python benchmarks/day.py`

`--through model` (default): `topdress simulate`, as a user runs it. `--through bytes`: the control worker's host, the
cab's drivers and the virtual machine behind its bytes, on an injected clock, refills and restarts by an operator.
"""
from __future__ import annotations

import argparse
import datetime as dt
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from verdict import exit_code

from console.worker.assemble import assemble
from console.worker.host import Host
from console.worker.program import Options
from control.orders import Answer, Do, Order
from drivers.files.read_log import read_log
from drivers.files.setup import load_setup

TICK_S = 0.05
WIDTH_M = 2.4               # of the demo machine, about: only whether anything was spread is asked of it
LEAST_WORKED = 0.5          # of the rows; a day has refills and turns
STEADY_MPS = 0.6            # the operator starts again once the machine moves


def through_model(seconds: float, strategy: str, folder: Path) -> Path:
    """The real command. Prints what it says."""
    log = folder / "day.csv"
    command = [sys.executable, "-P", "-c", "from console.cli import main; main()", "simulate", "--seconds",
               f"{seconds:g}", "--strategy", strategy, "--out", str(log), "--json"]
    said = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print(f"rate error {said['rate_error_percent']:.2f} %, place error {said['place_error_m']:.3f} m (p95 "
          f"{said['place_p95_m']:.3f}), {said['steps']} steps, {said['steps_lost']} lost, {said['released_kg']:.1f} kg "
          f"released, {said['landed_kg']:.1f} kg landed, {said['area_ha']:.2f} ha")
    print(f"alarms: {said['alarm_ticks'] or 'none'}; {said['realtime_factor']:.0f} simulated seconds a second")
    return log


def through_bytes(seconds: float, strategy: str, folder: Path) -> Path:
    """Host, cab, virtual machine. The operator acknowledges nothing: an alarm would stay."""
    now_s, begun = 0.0, time.perf_counter()
    parts = assemble(Options((), folder / "w.json", log=str(folder / "day.csv")), lambda: now_s)
    host = Host(parts, lambda: now_s, lambda s: None)
    said: list[Answer] = []
    alarms: Counter[str] = Counter()

    def order(do: Do, value: str | float | None = None) -> None:
        host.ask(Order(do, value), lambda answer, _: said.append(answer))

    order(Do.STRATEGY, strategy)
    order(Do.READY)
    hopper_kg, asked_s = 300.0, 0.0
    while now_s < seconds:
        now_s += TICK_S
        host.console_heard()
        host.tick(now_s)
        frame = host.newest
        assert frame is not None
        row = frame.row
        alarms.update(alarm.id for alarm in frame.alarms)
        if row.hopper_kg is not None:
            if row.hopper_kg > hopper_kg + 20.0:
                order(Do.REFILL, row.hopper_kg - hopper_kg)
            hopper_kg = row.hopper_kg
        moves = (row.speed_used_mps or 0.0) > STEADY_MPS
        if row.state in ("ready", "held") and (moves or row.state == "ready") and now_s > asked_s + 1.0:
            order(Do.START)
            asked_s = now_s
    host.close("done")
    took_s = time.perf_counter() - begun
    print(f"{frame.applied_kg:.1f} kg on {frame.area_ha:.2f} ha, {sum(not a.accepted for a in said)} of {len(said)} "
          f"orders refused")
    print(f"alarms: {dict(alarms) or 'none'}; {seconds / took_s:.0f} simulated seconds a second")
    return parts.writer.path                                       # type: ignore[attr-defined, no-any-return]


def promised(states: Counter[str], rows: int, kg: float, alarmed: int) -> dict[str, object]:
    """A day of work: something spread, the machine at work, no alarm."""
    worked = states["working"] / max(1, rows)
    return {f"{worked:.0%} of the rows at work: at least {LEAST_WORKED:.0%}": worked >= LEAST_WORKED,
            f"{kg:.2f} kg spread: above 0": kg > 0.0, f"{alarmed} rows with an alarm: none": not alarmed}


def run() -> None:
    parser = argparse.ArgumentParser(description="A normal day: alarms, wall time, log size.")
    parser.add_argument("--seconds", type=float, default=28_800.0)
    parser.add_argument("--strategy", default="opening_first")
    parser.add_argument("--through", choices=("model", "bytes"), default="model")
    given = parser.parse_args()
    machine = load_setup("huanghai", "demo", dt.date(2014, 3, 7)).machine
    print(f"{given.seconds / 3600.0:g} h, {given.strategy}, through {given.through}, {machine.title}")
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        drive = through_model if given.through == "model" else through_bytes
        log = drive(given.seconds, given.strategy, Path(folder))
        took_s = time.perf_counter() - begun
        states: Counter[str] = Counter()
        events: Counter[str] = Counter()
        rows, alarmed, read_kg, before_s = 0, 0, 0.0, 0.0
        for row in read_log(log).rows():
            rows += 1
            states[row.state or "?"] += 1
            alarmed += bool(row.alarms)
            read_kg += WIDTH_M * (row.speed_used_mps or 0.0) * (row.applied_rate_kg_ha or 0.0) * (
                row.time_s - before_s) / 10_000.0
            before_s = row.time_s
            for event in (row.events or "").split(";"):
                if event:
                    events[event.split(" ")[0]] += 1
        size = log.stat().st_size
        print(f"wall time {took_s:.0f} s; log {size / 1e6:.1f} MB, {rows} rows, {size / max(1, rows):.0f} bytes a row; "
              f"rows with an alarm: {alarmed}")
        print("states: " + ", ".join(f"{name} {100.0 * n / max(1, rows):.2f} %" for name, n in states.most_common())
              + "; events: " + (", ".join(f"{name} {n}" for name, n in events.most_common()) or "none"))
    sys.exit(exit_code(promised(states, rows, read_kg, alarmed)))


if __name__ == "__main__":
    run()
