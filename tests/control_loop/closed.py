"""A simulated machine closed with its loop: ticked by hand, or run through."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from typing import Any

from topdress.control.field.job import Simulated
from topdress.control.loop.tick import Tick
from topdress.control.orders import Answer, Do, Order
from topdress.control.readings import DriveCommand, Measurements
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import MeasurementHold, SimulatedTick, simulate_run
from topdress.control.simulation.plant import PlantTruth
from topdress.drivers.files.run_setup import Setup, load_setup

STEP_S = 0.05
SETUP = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
Change = Callable[[Measurements], Measurements]


class Closed:
    """sim: changes of the job's simulated part; `job`: of the job; loop: what else
    `make_control_loop` takes; known: the setup as control has it. `ticks`, `truths`: of all that
    was ticked by hand."""

    def __init__(
        self,
        setup: Setup = SETUP,
        *,
        sim: dict[str, Any] | None = None,
        loop: dict[str, Any] | None = None,
        known: dict[str, Any] | None = None,
        seed: int = 1,
        **job: Any,
    ) -> None:
        simulated = Simulated.model_validate(setup.job.simulated.model_dump() | (sim or {}))
        self.job = add_simulated_field(
            setup.job.model_copy(update={"simulated": simulated, **job}), setup.machine
        )
        self.plant = make_plant(setup.machine, self.job, seed, STEP_S)
        control = {
            "machine": setup.machine,
            "crop": setup.crop,
            "rule": setup.rule,
            "job": self.job,
        } | (known or {})
        self.loop = make_control_loop(**control, **loop or {})
        self.ticks: list[Tick] = []
        self.truths: list[PlantTruth] = []
        self._measuring, self._command, self._enabled = (
            MeasurementHold(6),
            DriveCommand(0.0, 25.0),
            False,
        )

    def order(self, do: Do, value: Any = None) -> Answer:
        return self.loop.handle_order(Order(do, value))

    def measured(self) -> Measurements:
        """One step of the machine, as its sensors tell it."""
        m = self._measuring.take_readings(self.plant.advance_plant(self._command, self._enabled))
        assert self.plant.truth is not None
        self.truths.append(self.plant.truth)
        return m

    def tick(self, change: Change = lambda m: m) -> Tick:
        """change: what of the measurements is told otherwise."""
        tick = self.loop.run_tick(change(self.measured()))
        self._command, self._enabled = tick.command, tick.is_enabled
        self.ticks.append(tick)
        return tick

    def run(self, seconds: float, change: Change = lambda m: m) -> Tick:
        for _ in range(round(seconds / STEP_S)):
            self.tick(change)
        return self.ticks[-1]

    def start(self) -> Closed:
        self.run(0.1)
        assert self.order(Do.READY).accepted
        self.run(0.1)
        assert self.order(Do.START).accepted
        return self

    def through(
        self, seconds: float, orders: list[tuple[float, Order]] | None = None
    ) -> list[SimulatedTick]:
        """A run by the simulated operator, or by these orders; instead of ticks by hand."""
        return list(simulate_run(self.plant, self.loop, seconds, orders))
