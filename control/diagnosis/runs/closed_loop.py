"""Measures the gain of known effects in the field by two simulated runs of the machine.

This module is separate from `gain`, because loop and plant take as long to import as everything
else that a diagnosis needs of control.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from topdress.control.agronomy.crop import Crop
from topdress.control.agronomy.nitrogen_rate import CropRule
from topdress.control.field.job import Job
from topdress.control.machine.fault_injection import InjectedEffect
from topdress.control.machine.machine import Machine
from topdress.control.simulation.assembly import (
    add_simulated_field,
    make_control_loop,
    make_plant,
)
from topdress.control.simulation.closed_loop import RunRecord, simulate_run
from topdress.control.simulation.error_metrics import RunErrors, judge_run


class LoopGain(NamedTuple):
    """Rate error and position error of a machine with the effects, controlled without and with
    knowledge of the effects."""

    before: RunErrors
    after: RunErrors


def measure_loop_gain(
    nominal: Machine,
    extended: Machine,
    planted: Sequence[InjectedEffect],
    crop: Crop,
    rule: CropRule,
    job: Job,
    *,
    seconds: float = 600.0,
    seed: int = 1,
    dt_s: float = 0.05,
) -> LoopGain:
    """Simulate the same machine twice, without and with knowledge of its effects, and return rate
    and position errors.

    Parameters
    ----------
    nominal, extended
        The machine file that the loop uses in the first and in the second run.
    planted
        The effects that the simulated machine has in both runs.
    crop, rule, job
        Crop, rate rule and job; a job without a field gets the simulated field.
    seconds, seed, dt_s
        Length of each run, s; seed of the noise; tick, s.
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
