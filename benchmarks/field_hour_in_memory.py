"""An hour of field work in process: loop, cab and virtual machine on ports in memory, every device unplugged once.

    python -m benchmarks field_hour_in_memory --seconds 3600

As `field_work_over_tcp.py`, on a clock set by hand: each reaction is exact to one tick of 0.05 s.
"""
from __future__ import annotations

import argparse
import datetime as dt
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from verdict import exit_code

from control.loop import ControlLoop, Tick
from control.orders import Do, Order
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from drivers.cab import Cab, CabConfig
from drivers.files.read_log import read_log
from drivers.files.run_log import RunLogWriter
from drivers.files.run_meta import run_meta
from drivers.files.setup import load_setup
from drivers.ports import memory_pair
from drivers.virtual.faults import FaultyPort, PortFaults
from drivers.virtual.machine import VirtualMachine

DT_S = 0.05
NAMES = ("gnss", *(f"head_{n}" for n in range(1, 7)), "board")
UNPLUGGED_S = {"gnss": 8.0, "board": 3.0}       # heads: 4 s


class Watch:
    """What was first said after each unplugging, and how long after it, s."""

    def __init__(self, plan: dict[str, tuple[float, float]]) -> None:
        self.plan = plan
        self.seen: dict[tuple[str, str], float] = {}

    def look(self, now_s: float, said: set[str], state: str) -> None:
        for name, (begin_s, lasts_s) in self.plan.items():
            if not begin_s <= now_s < begin_s + lasts_s + 60.0:
                continue
            for what in said:
                self.seen.setdefault((name, what), now_s - begin_s)
            if state == "working" and (name, "fault") in self.seen:
                self.seen.setdefault((name, "working again"), now_s - begin_s)

    def missed(self) -> list[str]:
        """Devices whose loss was not reacted to, or after which work did not go on."""
        return [name for name in self.plan if (name, self.reaction(name)) not in self.seen
                or (name == "board" and (name, "working again") not in self.seen)]

    @staticmethod
    def reaction(name: str) -> str:
        return {"gnss": "gnss_silent", "board": "fault"}.get(name, f"head {name[-1]} dropped")

    def table(self) -> str:
        lines = ["| device | unplugged at s | for s | reaction | after s | working again after s |",
                 "|---|---|---|---|---|---|"]
        for name, (begin_s, lasts_s) in self.plan.items():
            reaction = self.reaction(name)
            after, again = self.seen.get((name, reaction)), self.seen.get((name, "working again"))
            lines.append(f"| {name} | {begin_s:.0f} | {lasts_s:.0f} | {reaction} | "
                         f"{'-' if after is None else f'{after:.2f}'} | "
                         f"{'worked on' if again is None else f'{again:.2f}'} |")
        return "\n".join(lines)


def start_again(loop: ControlLoop, tick: Tick) -> None:
    """As an operator would, once the machine moves and its shaft is heard."""
    state = str(tick.row.state)
    if state == "working" or (tick.row.speed_used_mps or 0.0) <= 0.5 or tick.row.shaft_rpm is None:
        return
    for alarm in tick.alarms:
        loop.order(Order(Do.ACKNOWLEDGE, alarm.id))
    loop.order(Order(Do.START if state == "ready" else Do.READY))


def run(seconds: float, log: Path) -> int:
    setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
    job = with_simulated_field(setup.job, setup.machine)
    now = [0.0]
    pairs = {name: memory_pair(name, lambda: now[0]) for name in NAMES}
    ends = {name: FaultyPort(pair[0], lambda: now[0]) for name, pair in pairs.items()}
    plant = simulated_machine(setup.machine, job, 3, DT_S)
    virtual = VirtualMachine(plant, pairs["gnss"][1], [pairs[f"head_{n}"][1] for n in range(1, 7)], pairs["board"][1],
                             0.0, opening_mm=setup.machine.set_points.opening_mm)
    cab = Cab(CabConfig.model_validate({"gnss": {"port": "gnss"}, "board": {"port": "board"},
                                        "heads": {"ports": NAMES[1:7]}}), lambda: now[0],
              lambda url, baud, clock: ends[url])
    loop = control_loop(setup.machine, setup.crop, setup.rule, job)
    writer = RunLogWriter(log, run_meta(setup.machine, setup.crop, job, seed=3, sha256={}))
    apart_s = (seconds - 60.0) / len(NAMES)
    plan = {name: (40.0 + apart_s * place, UNPLUGGED_S.get(name, 4.0)) for place, name in enumerate(NAMES)}
    watch = Watch(plan)
    states = Counter[str]()
    begun_s = time.perf_counter()
    for tick_number in range(round(seconds / DT_S)):
        now[0] += DT_S
        for name, (begin_s, lasts_s) in plan.items():
            ends[name].faults = PortFaults(unplugged=begin_s <= now[0] < begin_s + lasts_s)
        virtual.advance(now[0])
        tick = loop.tick(cab.measure(now[0]), 0.0, True)
        cab.command(now[0], tick.command, tick.enabled)
        writer.append(tick.row)
        if tick_number % 1000 == 0:
            time.sleep(0.002)               # the writer's thread is given a moment: this clock runs far ahead of it
        state = str(tick.row.state)
        states[state] += 1
        said = {alarm.id for alarm in tick.alarms} | {f"head {head} dropped" for head in tick.dropped_heads} | {state}
        watch.look(now[0], said, state)
        start_again(loop, tick)
    took_s = time.perf_counter() - begun_s
    writer.close()
    print(watch.table())
    rows = sum(1 for _ in read_log(log).rows())
    print(f"\n{seconds:g} s in {took_s:.1f} s; {round(seconds / DT_S)} ticks, {rows} rows in the log; states "
          + ", ".join(f"{state} {count}" for state, count in states.most_common())
          + f"; {tick.area_ha:.3f} ha, {tick.applied_kg:.1f} kg")
    print("rejected:", {status.name: status.rejected for status in cab.status(now[0]) if status.rejected} or "none")
    return exit_code({
        f"{round(seconds / DT_S)} ticks, {rows} rows in the log: as many": rows == round(seconds / DT_S) > 0,
        f"{tick.applied_kg:.1f} kg: above 0": tick.applied_kg > 0.0,
        f"each loss is reacted to, and work goes on: not {', '.join(watch.missed())}": not watch.missed()})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    with tempfile.TemporaryDirectory() as place:
        sys.exit(run(parser.parse_args().seconds, Path(place) / "run.csv"))
