"""A machine, a crop and short simulated runs that several tests look at."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.field.job import Job, Simulated
from topdress.control.machine.fault_injection import parse_planted
from topdress.control.machine.parameter_uncertainty import make_plausible_machine
from topdress.control.orders import Order, Strategy
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, SimulatedTick, simulate_run
from topdress.control.simulation.error_metrics import RunErrors, judge_run
from topdress.drivers.files.run_setup import load_setup


class Run:
    """One simulated run and everything there is to say about it."""

    def __init__(
        self, steps: list[SimulatedTick], record: RunRecord, width_m: float, rule: CropRule
    ) -> None:
        self.steps = steps
        self.record = record
        self.width_m = width_m
        self.rule = rule

    @property
    def errors(self) -> RunErrors:
        return judge_run(
            self.record.make_columns(), self.record.fired, self.width_m, rule=self.rule
        )

    def alarms(self) -> set[str]:
        return {alarm.id for step in self.steps for alarm in step.tick.alarms}


@pytest.fixture(scope="session")
def simulated() -> Callable[..., Run]:
    """`simulated(seconds, strategy=..., effects=[...], **job changes)` -> Run; equal calls are
    run once.

    plant: a plausible machine that is driven while control knows the shipped file. shaft:
    figures that both have."""
    setup = load_setup("huanghai", "demo", dt.date(2014, 3, 7))
    kept: dict[str, Run] = {}

    def run(
        seconds: float,
        strategy: str = "opening_first",
        effects: Sequence[str] = (),
        seed: int = 1,
        *,
        orders: Sequence[tuple[float, Order]] | None = None,
        sim: dict[str, Any] | None = None,
        plant: str = "",
        shaft: dict[str, float] | None = None,
        **changes: Any,
    ) -> Run:
        key = repr(
            (
                seconds,
                strategy,
                tuple(effects),
                seed,
                orders,
                sim,
                plant,
                shaft,
                sorted(changes.items()),
            )
        )
        known = setup.machine.model_copy(
            update={"shaft": setup.machine.shaft._replace(**(shaft or {}))}
        )
        if key not in kept:
            job: Job = setup.job.model_copy(update={"strategy": Strategy(strategy), **changes})
            if sim:
                values = job.simulated.model_dump() | sim
                job = job.model_copy(update={"simulated": Simulated.model_validate(values)})
            job = add_simulated_field(job, known)
            true = make_plausible_machine(known, plant) if plant else known
            driven = make_plant(true, job, seed, 0.05, [parse_planted(text) for text in effects])
            loop = make_control_loop(known, setup.crop, setup.rule, job)
            record, steps = RunRecord(), []
            for step in simulate_run(driven, loop, seconds, orders):
                record.add_tick(step)
                steps.append(step)
            kept[key] = Run(steps, record, setup.machine.geometry.working_width_m, setup.rule)
        return kept[key]

    return run
