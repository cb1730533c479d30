"""What several stages are given, at every row of a log: commands, measured inputs, and what
terms are asked with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.effect import SHAFT_RANGE
from topdress.control.machine.form import SHAFT_ANGLE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.term_sums import (
    average_commands_over_log,
    calc_angle_over_log,
    calc_dead_times_s,
)
from topdress.control.machine.terms import COMMANDED_MM, COMMANDED_RPM
from topdress.control.recordings.times import GAP_STEPS

from .grid import bridge_gaps, hold_last_value, smooth_series
from .log import Clean

Array = npt.NDArray[np.float64]

# of a reading's gap: in a longer one the command is the better guess
ASKED_AFTER_S = 2.0
# rows closer than this hold every command that control, ten times a second, gave
FINE_LOG_S = 0.15
# r/min of the nominal machine: a share of another's range.
# a shaft read slower than this stands still: the reading cannot fall below 0
STOPPED_RPM = 1.0
WORKING_RPM = 2.0 * STOPPED_RPM  # and one read quicker surely turns


class LogRows(NamedTuple):
    """What several stages are given, at every row of the log: (n,) each, gaps bridged."""

    time_s: Array
    step_s: float
    command_rpm: Array
    command_mm: Array
    shaft_rpm: Array  # measured, where it is not the command
    opening_mm: Array
    # opening from a row to the next, by which the shaft is loaded
    loads_mm: Array
    supply_v: Array  # smoothed, as the pitch
    pitch_deg: Array
    # 1 or 0: as the log says, else whether the shaft turns
    working: Array
    # rows before which commands may be missing from the log
    lost: npt.NDArray[np.bool_]
    # what the machine file's terms add (`term_sums.over_log`)
    more: dict[str, Array] = {}


def make_log_rows(log: Clean, machine: Machine) -> LogRows:
    time, c = log.time_s, log.columns
    command_rpm, command_mm = (
        hold_last_value(c["shaft_rpm_cmd"]),
        hold_last_value(c["opening_mm_cmd"]),
    )
    shaft_rpm = bridge_gaps(time, c["shaft_rpm"], command_rpm, ASKED_AFTER_S)
    supply_v = bridge_gaps(time, c["supply_v"], np.full(len(time), machine.shaft.nominal_supply_v))
    # neutral
    opening_mm = np.where(np.isfinite(command_mm), command_mm, machine.set_points.opening_mm)
    turning = np.abs(np.nan_to_num(shaft_rpm)) > scale_nominal(machine, SHAFT_RANGE) * WORKING_RPM
    working = np.where(np.isfinite(log.working), log.working, turning)
    opening_mm = bridge_gaps(time, c["opening_mm"], opening_mm, ASKED_AFTER_S)
    return LogRows(
        time,
        log.step_s,
        command_rpm,
        command_mm,
        shaft_rpm,
        opening_mm,
        find_loading_opening_mm(time, opening_mm, machine),
        smooth_series(supply_v, log.step_s),
        smooth_series(bridge_gaps(time, c["pitch_deg"], np.zeros(len(time))), log.step_s),
        working.astype(np.float64),
        np.zeros(len(time), bool) if log.held else commands_lost(time, log.step_s),
    )


def find_loading_opening_mm(time: Array, opening_mm: Array, machine: Machine) -> Array:
    """Opening that loads the shaft from each row to the next, as its speed at the end remembers
    it: (n,).

    A gate sets out with the row, its dead time later, and goes at its own speed. What was
    before it has arrived counts by exp(-t / T) of the shaft's time constant T: half-way in rows
    shorter than both, hardly in one of a second.
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


def commands_lost(time: Array, step_s: float) -> npt.NDArray[np.bool_]:
    """Rows before which commands may have been given that no row holds: (n,)."""
    if step_s > FINE_LOG_S:
        return np.ones(len(time), bool)
    return np.diff(time, prepend=time[0]) > GAP_STEPS * step_s


def make_term_inputs(log: Clean, every: LogRows, machine: Machine) -> dict[str, Array]:
    """What terms are asked with, at every row of a log (n,): readings, and the commands that
    the drives follow by now.

    What a log lacks is left out, and so are the terms over it.
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
        if log.has(name):
            found[name] = every.shaft_rpm if name == "shaft_rpm" else every.opening_mm
            if written not in found:
                found[written] = found[name]
    if log.has("shaft_rpm"):
        found[SHAFT_ANGLE] = calc_angle_over_log(every.shaft_rpm, time)
    further = {name: bridge_gaps(time, series, series) for name, series in log.further.items()}
    return found | read_slowly(log, every) | further


def read_slowly(log: Clean, every: LogRows) -> dict[str, Array]:
    """Readings of other sensors than the drives', smoothed, (n,) by name: their noise is no
    motion of the machine."""
    found = {
        name: series
        for name, series in (("supply_v", every.supply_v), ("pitch_deg", every.pitch_deg))
        if log.has(name)
    }
    for name in ("roll_deg", "hopper_kg", "speed_mps"):
        if log.has(name):
            found[name] = smooth_series(
                bridge_gaps(every.time_s, log.columns[name], np.zeros(len(every.time_s))),
                log.step_s,
            )
    if log.has("heading_deg"):
        found["heading_deg"] = np.mod(hold_last_value(log.columns["heading_deg"]), 360.0)
    return found


def variables_of(log: Clean, every: LogRows) -> dict[str, Array]:
    """The recorded variables that something may depend on, (n,) by name; commands in place of
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
    return found | read_slowly(log, every)
