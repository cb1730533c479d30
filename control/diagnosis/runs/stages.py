"""Prepares a run log for the machine model's stages: inputs and measured outputs of each channel on
an even time grid.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import Machine
from topdress.control.machine.term_sums import sum_over_log

from .drives import Drive, read_drives
from .effort import DriveEffort, read_efforts
from .grid import bridge_gaps, select_known_rows, smooth_input
from .hopper import Hopper, list_noted_refills, read_hopper
from .inputs import list_variables, make_log_rows, make_term_inputs
from .log import HEAD_COLUMNS, CleanLog
from .speed_and_heads import (
    HeadContrasts,
    TwoSpeeds,
    find_moving_rows,
    read_both_speeds,
    read_heads_channel,
)

Array = npt.NDArray[np.float64]


class RunData(NamedTuple):
    """Channels and variables of a run log, as the machine model's stages use them."""

    duration_s: float
    rows: int
    # Recorded variables over the log's rows (`select_known_rows`), gaps bridged.
    variables: dict[str, Array]
    # Time of those rows, s.
    time_s: Array
    working: Array
    shaft: Drive | None
    gate: Drive | None
    hopper: Hopper | None
    speed: TwoSpeeds | None
    heads: HeadContrasts | None
    efforts: tuple[DriveEffort, ...] = ()
    # Inputs of the machine file's terms (`terms.needed`), at `row_s`.
    inputs: dict[str, Array] = {}
    # Time of every row, s; of a long log only the `select_known_rows`.
    row_s: Array = np.empty(0)


def make_run_data(log: CleanLog, machine: Machine) -> RunData:
    """Build the channels of a cleaned log; None for each that the log cannot show."""
    every, c = make_log_rows(log, machine), log.columns
    time = every.time_s
    inputs = make_term_inputs(log, every, machine)
    every = every._replace(more=sum_over_log(machine.terms, inputs, time, run_term))
    variables = list_variables(log, every)
    hopper = speed = heads = None
    driven = read_drives(log, every, machine, whole=False)
    further = {
        name: smooth_input(name, bridge_gaps(time, series, series), log.step_s)
        for name, series in log.further.items()
    }
    if "flow" in log.stages:
        hopper = read_hopper(every, c["hopper_kg"], list_noted_refills(time, log.events), machine)
    if "speed" in log.stages:
        speed = read_both_speeds(every, c["speed_mps"], c["wheel_speed_mps"], machine)
        if speed is not None:
            variables["speed_mps"] = np.interp(time, speed.time_s, speed.true_mps)
    if "heads" in log.stages:
        heads = read_heads_channel(
            time,
            np.array([c[name] for name in HEAD_COLUMNS]),
            find_moving_rows(c["speed_mps"], c["wheel_speed_mps"]),
        )
    rows = select_known_rows(len(time))
    variables |= further
    return RunData(
        float(time[-1]),
        len(time),
        {name: series[rows] for name, series in variables.items()},
        time[rows],
        every.working[rows],
        driven.get("shaft"),
        driven.get("gate"),
        hopper,
        speed,
        heads,
        read_efforts(log, every, machine),
        {name: series[rows] for name, series in inputs.items()},
        time[rows],
    )
