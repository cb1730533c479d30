"""Closed-loop step responses on the virtual machine: every byte through the real drivers, both strategies.

    python -m benchmarks step_responses

The set-point of the manual rate steps at a steady 1.25 m/s; speed first answers with the shaft, opening first with the
gate. Judged on the true shaft and gate: delay (order to 10 %), 10 to 90 % rise time, overshoot, mean error of the last
5 s of 20 s against what the flow model asks for at that speed. Once on the nominal machine, once on machines whose
drives do not do as they are told (the host's trim has to bring them there).
"""
from __future__ import annotations

import datetime as dt
import sys
from typing import NamedTuple

from verdict import exit_code

from control.loop import ControlLoop
from control.machine.planting import parse_planted
from control.orders import Do, Order, Strategy, TargetSource
from control.simulation.assembly import control_loop, simulated_machine
from drivers.files.setup import load_setup
from drivers.virtual.machine import virtual_cab

DT_S, PLANT_S = 0.05, 0.01
STEPS_KG_HA = ((200.0, 300.0), (300.0, 200.0))
CASES = (("nominal", ()), ("shaft 5 % slow", ("shaft.gain=-5",)), ("gate 1 mm off, read back", ("gate.home_error=1",)))

MOST_ERROR, SLOW_S = {"r/min": 1.0, "mm": 0.3}, 2.0         # three times what the ground speed's noise makes of it


class Response(NamedTuple):
    delay_s: float
    rise_s: float
    overshoot: float
    error: float


class Run:
    """Cab, loop and virtual machine on a clock set by hand; the manual rate holds everywhere."""

    def __init__(self, strategy: Strategy, effects: tuple[str, ...]) -> None:
        setup = load_setup("huanghai", "demo", dt.date(2026, 4, 1))
        quiet = setup.job.simulated.model_copy(update={"run_in_m": 0.0, "speed_wander_percent": 0.0,
                                                       "pass_length_m": 4000.0})
        job = setup.job.model_copy(update={"strategy": strategy, "simulated": quiet, "flow_trim": False})
        self.now_s = 0.0
        self.plant = simulated_machine(setup.machine, job, 3, PLANT_S, [parse_planted(text) for text in effects])
        self.cab, self.machine = virtual_cab(self.plant, lambda: self.now_s,
                                             opening_mm=setup.machine.set_points.opening_mm)
        self.loop: ControlLoop = control_loop(setup.machine, setup.crop, setup.rule, job)
        self.loop.order(Order(Do.SOURCE, TargetSource.MANUAL))
        self.true: list[float] = []
        self.told: list[float] = []
        self.shaft = strategy is Strategy.SPEED_FIRST

    def go(self, seconds: float) -> None:
        """Ticks of the loop; the plant's true value every 10 ms."""
        for _ in range(round(seconds / DT_S)):
            for _ in range(round(DT_S / PLANT_S)):
                self.now_s += PLANT_S
                self.machine.advance(self.now_s)
                assert self.plant.truth is not None
                truth = self.plant.truth
                self.true.append(truth.shaft_rpm if self.shaft else truth.opening_mm)
            tick = self.loop.tick(self.cab.measure(self.now_s), 0.0, True)
            self.cab.command(self.now_s, tick.command, tick.enabled)
            self.told.append(tick.row.shaft_rpm_cmd if self.shaft else tick.row.opening_mm_cmd)  # type: ignore[arg-type]
            if tick.row.state in ("off", "ready"):
                self.loop.order(Order(Do.READY if tick.row.state == "off" else Do.START))


def step(run: Run, before_kg_ha: float, after_kg_ha: float, width_m: float, speed_mps: float) -> Response:
    run.loop.order(Order(Do.MANUAL_RATE, before_kg_ha))
    run.go(15.0)
    start = sum(run.true[-300:]) / 300.0
    run.true.clear()
    run.loop.order(Order(Do.MANUAL_RATE, after_kg_ha))
    run.go(20.0)
    true, end = run.true, sum(run.true[-500:]) / 500.0
    up = 1.0 if end > start else -1.0

    def first(share: float) -> float:
        level = start + share * (end - start)
        return next(place for place, value in enumerate(true) if up * (value - level) >= 0.0) * PLANT_S

    flow_kg_s = after_kg_ha * width_m * speed_mps / 10_000.0
    wanted = flow_kg_s * 60.0 / (0.0055 * (25.0 if run.shaft else 70.0))
    overshoot = max(0.0, *(up * (value - end) for value in true))
    return Response(first(0.1), first(0.9) - first(0.1), overshoot, end - wanted)


def main() -> int:
    promises: dict[str, object] = {}
    print("| machine | strategy, drive | step kg/ha | delay, s | rise 10-90 %, s | overshoot | steady error |")
    print("|---|---|---|---|---|---|---|")
    for name, effects in CASES:
        for strategy, unit in ((Strategy.SPEED_FIRST, "r/min"), (Strategy.OPENING_FIRST, "mm")):
            run = Run(strategy, effects)
            run.go(8.0)
            for before, after in STEPS_KG_HA:
                found = step(run, before, after, 2.4, 1.25)
                print(f"| {name} | {strategy.value}, {'shaft' if run.shaft else 'gate'} | {before:g} to {after:g} | "
                      f"{found.delay_s:.2f} | {found.rise_s:.2f} | {found.overshoot:.2f} {unit} | "
                      f"{found.error:+.2f} {unit} |", flush=True)
                promises[f"{name}, {strategy.value}, {before:g} to {after:g}: steady error {found.error:+.2f} {unit}: "
                         f"at most {MOST_ERROR[unit]:g}"] = abs(found.error) <= MOST_ERROR[unit]
                promises[f"{name}, {strategy.value}, {before:g} to {after:g}: there after {SLOW_S:g} s"] = (
                    0.0 < found.delay_s + found.rise_s <= SLOW_S)
    return exit_code(promises)


if __name__ == "__main__":
    sys.exit(main())
