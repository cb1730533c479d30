"""Prepares inputs that several stages share, at every row of a log: commands, measured inputs, and
the inputs of terms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.effect import SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.term_form import SHAFT_ANGLE
from topdress.control.machine.term_sums import (
    average_commands_over_log,
    calc_angle_over_log,
    calc_dead_times_s,
)
from topdress.control.machine.terms import COMMANDED_MM, COMMANDED_RPM
from topdress.control.recordings.row_times import GAP_STEPS

from .grid import bridge_gaps, hold_last_value, smooth_input
from .log import CleanLog

Array = npt.NDArray[np.float64]

# Longest gap of a reading, s, that interpolation bridges; in a longer gap the command is the better
# estimate.
MAX_READING_GAP_S = 2.0
# Maximum row distance, s, at which a log contains every command of control, which runs ten times a
# second.
MAX_FINE_STEP_S = 0.15
# A shaft that reads less, r/min, stands still: the reading cannot fall below 0. The value is that
# of the nominal machine and is scaled to another machine's range.
STOPPED_RPM = 1.0
# A shaft that reads more than this, r/min, certainly turns.
WORKING_RPM = 2.0 * STOPPED_RPM


class LogRows(NamedTuple):
    """Inputs that several stages share, at every row of the log: (n,) each, gaps bridged."""

    time_s: Array
    step_s: float
    command_rpm: Array
    command_mm: Array
    # Measured speed, or the command where no reading exists, r/min.
    shaft_rpm: Array
    opening_mm: Array
    # Opening that loads the shaft between this row and the next, mm.
    loads_mm: Array
    # Smoothed (`INPUT_SMOOTHING_S`), V.
    supply_v: Array
    # Smoothed, deg.
    pitch_deg: Array
    # 1 while working, else 0: from the log's state, or from whether the shaft turns.
    working: Array
    # Rows before which commands may be missing from the log.
    lost: npt.NDArray[np.bool_]
    # Sums of the machine file's terms by quantity (`term_sums.sum_over_log`).
    more: dict[str, Array] = {}


def make_log_rows(log: CleanLog, machine: Machine) -> LogRows:
    time, c = log.time_s, log.columns
    command_rpm, command_mm = (
        hold_last_value(c["shaft_rpm_cmd"]),
        hold_last_value(c["opening_mm_cmd"]),
    )
    shaft_rpm = bridge_gaps(time, c["shaft_rpm"], command_rpm, MAX_READING_GAP_S)
    supply_v = bridge_gaps(time, c["supply_v"], np.full(len(time), machine.shaft.nominal_supply_v))
    # The neutral opening replaces a missing command.
    opening_mm = np.where(np.isfinite(command_mm), command_mm, machine.set_points.opening_mm)
    turning = np.abs(np.nan_to_num(shaft_rpm)) > scale_nominal(machine, SHAFT_RANGE) * WORKING_RPM
    working = np.where(np.isfinite(log.working_flags), log.working_flags, turning)
    opening_mm = bridge_gaps(time, c["opening_mm"], opening_mm, MAX_READING_GAP_S)
    return LogRows(
        time,
        log.step_s,
        command_rpm,
        command_mm,
        shaft_rpm,
        opening_mm,
        find_loading_opening_mm(time, opening_mm, machine),
        smooth_input("supply_v", supply_v, log.step_s),
        smooth_input(
            "pitch_deg", bridge_gaps(time, c["pitch_deg"], np.zeros(len(time))), log.step_s
        ),
        working.astype(np.float64),
        np.zeros(len(time), bool)
        if log.held
        else find_lost_commands(time, log.step_s, machine.has_stage("flow")),
    )


def find_loading_opening_mm(time: Array, opening_mm: Array, machine: Machine) -> Array:
    """Return the opening that loads the shaft between each row and the next, mm: (n,).

    A gate starts after its dead time and moves at its own speed. Earlier openings count by exp(-t /
    T) with the shaft's time constant T: about half in rows shorter than both times, hardly at all
    in rows of a second.
    """
    ways_mm, spans_s = np.diff(opening_mm), np.diff(time)
    still_s = np.minimum(
        0.5 * spans_s, machine.gate.dead_time_s + 0.5 * np.abs(ways_mm) / machine.gate.slew_mm_s
    )
    tau_s = machine.shaft.time_constant_s
    counts = (np.exp((still_s - spans_s) / tau_s) - np.exp(-spans_s / tau_s)) / -np.expm1(
        -spans_s / tau_s
    )
    return np.append(opening_mm[1:] - counts * ways_mm, opening_mm[-1:])


def find_lost_commands(time: Array, step_s: float, meters: bool) -> npt.NDArray[np.bool_]:
    """Return the rows before which commands may be missing from the log: (n,).

    The control of a machine that meters commands ten times a second. A drive alone is of another
    program, which logs as it commands.
    """
    if step_s > MAX_FINE_STEP_S and meters:
        return np.ones(len(time), bool)
    return np.diff(time, prepend=time[0]) > GAP_STEPS * step_s


def make_term_inputs(log: CleanLog, every: LogRows, machine: Machine) -> dict[str, Array]:
    """Return the inputs of terms at every row of a log (n,): readings, and the commands that the
    drives follow at that row.

    A term over an unlogged variable is left out.
    """
    time, found = every.time_s, {"time_s": every.time_s}
    for name, written, command, dead_s in zip(
        ("shaft_rpm", "opening_mm"),
        (COMMANDED_RPM, COMMANDED_MM),
        (every.command_rpm, every.command_mm),
        calc_dead_times_s(machine),
        strict=True,
    ):
        if np.isfinite(command).all():
            found[written] = average_commands_over_log(command, time, dead_s)
        if log.has_column(name):
            found[name] = every.shaft_rpm if name == "shaft_rpm" else every.opening_mm
            if written not in found:
                found[written] = found[name]
    if log.has_column("shaft_rpm"):
        found[SHAFT_ANGLE] = calc_angle_over_log(every.shaft_rpm, time)
    further = {name: bridge_gaps(time, series, series) for name, series in log.further.items()}
    return found | read_slow_sensors(log, every) | further


def read_slow_sensors(log: CleanLog, every: LogRows) -> dict[str, Array]:
    """Return smoothed readings of the sensors other than the drives', (n,) by name: their noise is
    no motion of the machine."""
    found = {
        name: series
        for name, series in (("supply_v", every.supply_v), ("pitch_deg", every.pitch_deg))
        if log.has_column(name)
    }
    for name in ("roll_deg", "hopper_kg", "speed_mps"):
        if log.has_column(name):
            found[name] = smooth_input(
                name,
                bridge_gaps(every.time_s, log.columns[name], np.zeros(len(every.time_s))),
                log.step_s,
            )
    if log.has_column("heading_deg"):
        found["heading_deg"] = np.mod(hold_last_value(log.columns["heading_deg"]), 360.0)
    return found


def list_variables(log: CleanLog, every: LogRows) -> dict[str, Array]:
    """Return the recorded variables on which an effect may depend, (n,) by name; commands replace
    the drives' readings."""
    found = {"time_s": every.time_s}
    if "shaft" in log.stages or "flow" in log.stages:
        found["shaft_rpm"] = np.where(
            np.isfinite(every.command_rpm), every.command_rpm, every.shaft_rpm
        )
    if "gate" in log.stages or "flow" in log.stages:
        found["opening_mm"] = np.where(
            np.isfinite(every.command_mm), every.command_mm, every.opening_mm
        )
    return found | read_slow_sensors(log, every)
