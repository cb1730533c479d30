"""What knowing a machine's effects gains in the field: two simulated runs of it. Apart from
`gain`, for loop and plant take as long to load as all else that a diagnosis needs of control."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.noa import Rule
from topdress.control.field.job import Job
from topdress.control.machine.fault_injection import PlantedEffect
from topdress.control.machine.machine import Machine
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import RunErrors, judge_run


class LoopGain(NamedTuple):
    """Rate and place error in the field of a machine that has the effects: controlled without
    and with knowing them."""

    before: RunErrors
    after: RunErrors


def closed_loop_gain(
    nominal: Machine,
    extended: Machine,
    planted: Sequence[PlantedEffect],
    crop: Crop,
    rule: Rule,
    job: Job,
    *,
    seconds: float = 600.0,
    seed: int = 1,
    dt_s: float = 0.05,
) -> LoopGain:
    """Rate and place error of two simulated runs of the same machine: control without and with
    knowing its effects.

    Parameters
    ----------
    nominal, extended
        The machine file that the loop knows in the first and in the second run.
    planted
        The effects that the simulated machine has in both.
    crop, rule, job
        What is to be spread where; a job without a field gets the simulated one.
    seconds, seed, dt_s
        Length of each run, s; seed of its noise; its tick, s.
    """
    at = add_simulated_field(job, nominal)
    found = []
    for known in (nominal, extended):
        record = RunRecord()
        plant = make_plant(nominal, at, seed, dt_s, planted)
        for step in simulate_run(plant, make_control_loop(known, crop, rule, at), seconds):
            record.add_tick(step)
        found.append(
            judge_run(
                record.make_columns(),
                record.fired,
                nominal.geometry.working_width_m,
                nominal.fall.lever_arm_m,
            )
        )
    return LoopGain(*found)
