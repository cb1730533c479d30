"""What a drive that does not stop when commanded to costs, and when it is said: `python -m benchmarks drives_disobey`

Worker's loop, cab and drivers against the virtual machine's bytes, on an injected clock. In each state the board turns
the shaft at 70 r/min for 30 s, whatever the command; or opens the gate; or a section's valve stays open. Printed: what
left the machine (plant), what the console counted, what the log's events tell, and after how many seconds it was said.
"""
from __future__ import annotations

import datetime as dt
import sys
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from verdict import exit_code

from control.field.job import Simulated
from control.loop.tick import Tick
from control.machine.planting import parse_planted
from control.orders import Do, Order, State, TargetSource
from control.readings import DriveCommand
from control.simulation.assembly import control_loop, simulated_machine, with_simulated_field
from control.simulation.plant import Plant, Sensed
from drivers.cab_config import BoardConfig
from drivers.files.setup import load_setup
from drivers.virtual.machine import virtual_cab
from drivers.virtual.runaway import RUNAWAY_MM, RUNAWAY_RPM, Runaway, VirtualRunaway

DT_S = 0.05
LASTS_S = 30.0
SETTLED_S = 5.0             # after the shaft has come to a stand again
SHAFT_SAID_S, GATE_SAID_S, VALVE_SAID_S = 1.2, 2.0, 5.0     # at the latest
APART_SHARE = 0.02          # counted against plant


class Lying:
    """The plant as the bytes have it: its sensors through `lie`."""

    dt_s = DT_S

    def __init__(self, plant: Plant, lie: Callable[[Sensed], Sensed]) -> None:
        self._plant, self._lie = plant, lie

    def step(self, command: DriveCommand, enabled: bool) -> Sensed:
        return self._lie(self._plant.step(command, enabled))


class Machine:
    """The whole way from the loop to the plant and back. `runaway` may be set at any time. lie: what the sensors make
    of what they sense; effects: of the plant, as `topdress simulate --effect` has them; sim: of the job's simulation,
    where it differs."""

    def __init__(self, machine: str = "huanghai", job: str = "demo", seed: int = 1, *,
                 lie: Callable[[Sensed], Sensed] = lambda sensed: sensed, effects: Iterable[str] = (),
                 **sim: Any) -> None:
        setup = load_setup(machine, job, dt.date(2026, 4, 1))
        simulated = Simulated.model_validate(setup.job.simulated.model_dump() | sim)
        self.job = with_simulated_field(setup.job.model_copy(update={"simulated": simulated}), setup.machine)
        self.now_s, self.runaway, self.switch_up = 0.0, Runaway(), False
        self.plant = simulated_machine(setup.machine, self.job, seed, DT_S, [parse_planted(text) for text in effects])
        self.cab, self.virtual = virtual_cab(
            Lying(self.plant, lie), lambda: self.now_s, heads=setup.machine.geometry.heads, board=BoardConfig(port=""),
            opening_mm=setup.machine.set_points.opening_mm, extras=[VirtualRunaway(lambda at_s: self.runaway, 0.0)])
        self.loop = control_loop(setup.machine, setup.crop, setup.rule, self.job)
        self.ticks: list[Tick] = []

    def run(self, seconds: float, each: Callable[[], object] = lambda: None) -> Tick:
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.plant.parked = self.loop.safety.state in (State.OFF, State.READY, State.CALIBRATING)
            self.virtual.advance(self.now_s)
            each()
            m = self.cab.measure(self.now_s)
            tick = self.loop.tick(m._replace(work_switch=False) if self.switch_up else m, 0.0, True)
            self.cab.command(self.now_s, tick.command, tick.enabled)
            self.ticks.append(tick)
        return self.ticks[-1]

    def order(self, do: Do, value: Any = None) -> None:
        answer = self.loop.order(Order(do, value))
        assert answer.accepted, (do, answer)

    def work(self, seconds: float = 15.0) -> None:
        self.run(2.0)
        self.order(Do.READY)
        self.run(2.0)
        self.order(Do.START)
        tick = self.run(seconds)
        assert tick.row.state == "working" and (tick.row.applied_rate_kg_ha or 0.0) > 50.0, tick.row

    @property
    def hopper_kg(self) -> float:
        assert self.plant.truth is not None
        return self.plant.truth.hopper_kg


def _off(it: Machine) -> None:
    it.run(2.0)


def _ready(it: Machine) -> None:
    _off(it)
    it.order(Do.READY)
    it.run(2.0)


def _calibrating(it: Machine) -> None:
    _ready(it)
    it.order(Do.CALIBRATE)
    it.run(0.2)


def _held(it: Machine) -> None:
    it.work()
    it.order(Do.HOLD)


def _stopped(it: Machine) -> None:
    it.work()
    it.order(Do.STOP)


def _held_long(it: Machine) -> None:
    _held(it)
    it.run(5.0)


def _switch_up(it: Machine) -> None:
    it.work()
    it.switch_up = True


def _rate_zero(it: Machine) -> None:
    it.work()
    it.order(Do.MANUAL_RATE, 0.0)
    it.order(Do.SOURCE, TargetSource.MANUAL.value)


def _fault(it: Machine) -> None:
    it.work()
    it.virtual.board.driver_fault = True
    it.run(5.0)


STATES: dict[str, Callable[[Machine], None]] = {
    "off, from the start": _off, "ready": _ready, "calibrating, shaft at 0": _calibrating,
    "held, from the order on": _held, "held, later": _held_long, "off, from STOP on": _stopped,
    "working, switch up": _switch_up, "working, rate 0": _rate_zero, "fault": _fault}


class Found(NamedTuple):
    plant_kg: float
    counted_kg: float
    entered_kg: float
    said_s: float | None
    zeros_hz: float             # frames with shaft 0 that the board took, a second
    state: str                  # after the alarm


def lied_to(begin: Callable[[Machine], None], runaway: Runaway, alarm: str, machine: str = "huanghai",
            job: str = "demo", stuck: dict[int, bool] | None = None) -> Found:
    it = Machine(machine, job)
    begin(it)
    first, from_kg, counted_kg, frames = len(it.ticks), it.hopper_kg, it.loop.totals.applied_kg, \
        it.virtual.board.counts.accepted
    if stuck and it.plant.valves is not None:
        it.plant.valves.stuck = stuck
    it.runaway = runaway
    holds = (lambda: it.loop.order(Order(Do.CALIBRATE))) if begin is _calibrating else (lambda: None)
    tick = it.run(LASTS_S, holds)
    zeros_hz = (it.virtual.board.counts.accepted - frames) / LASTS_S
    state = str(tick.row.state)
    it.runaway = Runaway()
    it.run(SETTLED_S)
    said = [k for k, one in enumerate(it.ticks[first:]) if alarm in {a.id for a in one.alarms}]
    entered = sum(float(event.split()[1]) for one in it.ticks[first:] for event in (one.row.events or "").split(";")
                  if event.startswith("released_stopped"))
    assert all(one.command.shaft_rpm == 0.0 for one in it.ticks[first + 1:]) or alarm == "valve_open"
    return Found(from_kg - it.hopper_kg, it.loop.totals.applied_kg - counted_kg, entered,
                 (said[0] + 1) * DT_S if said else None, zeros_hz, state)


def promised(who: str, found: Found, said_s: float) -> dict[str, object]:
    apart_kg = abs(found.counted_kg - found.plant_kg)
    return {f"{who}: said after {found.said_s} s: at most {said_s:g}": found.said_s is not None
            and found.said_s <= said_s,
            f"{who}: {found.counted_kg:.2f} kg counted of {found.plant_kg:.2f}: within {APART_SHARE:.0%} and 20 g":
            apart_kg <= APART_SHARE * found.plant_kg + 0.02,
            f"{who}: set-point zero at {found.zeros_hz:.0f} Hz: at least 10": found.zeros_hz >= 10.0}


def main() -> int:
    promises: dict[str, object] = {}
    print("| drive | state | kg by the plant | kg counted | kg in the log's events | said after s | zeros a s | state "
          "then |\n|---|---|---|---|---|---|---|---|")

    def show(drive: str, name: str, found: Found, said_s: float) -> None:
        after = "never" if found.said_s is None else f"{found.said_s:.2f}"
        kg = f"{found.plant_kg:.2f} | {found.counted_kg:.2f} | {found.entered_kg:.2f}"
        print(f"| {drive} | {name} | {kg} | {after} | {found.zeros_hz:.0f} | {found.state} |", flush=True)
        promises.update(promised(f"{drive}, {name}", found, said_s))

    for name, begin in STATES.items():
        show("shaft turns", name, lied_to(begin, Runaway(shaft_rpm=RUNAWAY_RPM), "shaft_turns"), SHAFT_SAID_S)
    for name in ("off, from the start", "ready", "held, from the order on", "working, switch up", "fault"):
        show("gate opens", name, lied_to(STATES[name], Runaway(opening_mm=RUNAWAY_MM), "gate_opens"), GATE_SAID_S)
    for name in ("off, from the start", "ready", "held, from the order on", "working, switch up"):
        show("valve 2 open", name, lied_to(STATES[name], Runaway(), "valve_open", "huanghai_sections", "sections_demo",
                                           {2: True}), VALVE_SAID_S)
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
