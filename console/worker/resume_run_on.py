"""What left the outlets after the last row of a log: a board whose host fell silent goes on for a while.

By the machine model: the shaft turns on as in the last row until the board stops by itself, then through its dead time
and its ramp; the flow follows the shaft. Pure.
"""
from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from control.machine.fall import drop_s
from control.machine.machine import Machine
from control.machine.shaft import ShaftInput, shaft_start, shaft_step
from drivers.files.run_log import FLUSH_S

STEP_S = 0.05
UNLOGGED_S = 0.5 * FLUSH_S          # rows reach the system this often: half of it is missing in the mean
LONGEST_S = 30.0
STILL = 0.02                        # of the speed before: stands


class After(NamedTuple):
    """A moment after the last row. `share`: of the last row's flow; 0: only what is in the air still lands."""

    after_s: float
    share: float


def run_on(machine: Machine, shaft_rpm: float, stops_s: float) -> Iterator[After]:
    """In steps of `STEP_S`, until nothing lands any more. stops_s: a board stops after so long without its host."""
    if shaft_rpm <= 0.0:
        return
    shaft, time_s, share, stood_s = shaft_start(shaft_rpm), 0.0, 1.0, None
    supply_v = machine.shaft.nominal_supply_v
    while time_s < LONGEST_S:
        commanded_rpm = shaft_rpm if time_s < UNLOGGED_S + stops_s else 0.0
        shaft, turned = shaft_step(machine.shaft, shaft, ShaftInput(commanded_rpm, 0.0, supply_v), STEP_S)
        time_s += STEP_S
        share = min(1.0, max(0.0, turned.rpm / shaft_rpm))
        if share < STILL:
            stood_s = time_s if stood_s is None else stood_s
            share = 0.0
            if time_s - stood_s > drop_s(machine.fall, shaft_rpm):
                return
        yield After(time_s, share)
