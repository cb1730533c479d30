"""The one builder of run logs in which tests plant something: what was commanded, what
answered, how it was read.

The logs of the examination come from `hidden`, which shares nothing with this and nothing with
the program.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter
from topdress.control.log_row import COMMANDS_HELD_EVENT
from topdress.control.machine.compiled import run_flow, run_gate, run_scale, run_shaft, run_speed
from topdress.control.machine.flow import FlowInput, FlowOutput, make_flow_start
from topdress.control.machine.gate import GateInput, GateOutput, make_gate_start
from topdress.control.machine.machine import Flow, Limits, Machine, Noise, Tolerance, add_effect
from topdress.control.machine.model_elements import round_to_step
from topdress.control.machine.scale import ScaleInput
from topdress.control.machine.shaft import Shaft, ShaftInput, ShaftOutput, make_shaft_start
from topdress.control.machine.speed import SpeedInput, SpeedOutput, make_speed_start
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S, make_input_rows, make_no_switch
from topdress.drivers.files.config import load_config
from topdress.drivers.files.config_kinds import MACHINE_KIND

Array = npt.NDArray[np.float64]
Columns = dict[str, npt.NDArray[Any]]
Rng = np.random.Generator
STEP_S = 0.1
HUANGHAI: Machine = load_config("huanghai", MACHINE_KIND).model


# --- Machines
# --------------------------------------------------------------------------------------------------


def wrong(effects: dict[str, float], machine: Machine | None = None) -> Machine:
    """A machine, else the nominal one, with effects of the catalogue at a size each."""
    found = machine or Machine()
    for effect, size in effects.items():
        found = add_effect(found, effect, size)
    return found


def drive(
    full_rpm: float,
    noise_rpm: float,
    stages: tuple[str, ...] = ("shaft",),
    tolerance: Tolerance | None = None,
    **shaft: float,
) -> Machine:
    """A shaft alone that follows its command as quickly as its time constant lets it."""
    return Machine(
        id="drive",
        stages=stages,
        shaft=Shaft(acceleration_rpm_s=1e6, full_rpm=full_rpm, **shaft),
        flow=Flow(full_rpm=full_rpm),
        limits=Limits(shaft_low_rpm=0.0, shaft_high_rpm=full_rpm),
        noise=Noise(shaft_rpm=noise_rpm),
        tolerance=tolerance or Tolerance(),
    )


# A small motor of which only its data sheet is known.
DRIVE = drive(
    650.0,
    2.0,
    Machine().stages,
    Tolerance(shaft_percent=0.5, time_constant_s=0.015),
    dead_time_s=0.02,
    time_constant_s=0.06,
)


# --- What is commanded, and what answers
# -----------------------------------------------------------------------------


def held(rng: Rng, time_s: Array, low: float, high: float, hold_s: float) -> Array:
    """Random set-points to a tenth, each held for `hold_s`."""
    values = rng.uniform(low, high, int(time_s[-1] / hold_s) + 2)
    return np.round(values[(time_s / hold_s).astype(int)], 1)


def followed(
    goal: Array,
    share: float = 1.0,
    most: npt.ArrayLike = np.inf,
    late: int = 0,
    start: float | None = None,
) -> Array:
    """A drive that goes a share of its way in each row, `most` at most, some rows late."""
    at, found = float(goal[0]) if start is None else start, []
    late_goal = np.concatenate((np.full(late, goal[0]), goal[: len(goal) - late]))
    for aim, limit in zip(
        late_goal.tolist(), np.broadcast_to(most, len(goal)).tolist(), strict=True
    ):
        found.append(at)
        at += min(max((aim - at) * share, -limit), limit)
    return np.array(found)


def lagged(goal: Array, tau_s: float, step_s: float) -> Array:
    """Of first order."""
    return followed(goal, -float(np.expm1(-step_s / tau_s)))


def wandering(rng: Rng, count: int, kept: float, begins: bool = False) -> Array:
    """Noise of spread 1 of which so much is kept from row to row; from 0 on, or as it has long
    been."""
    kicks = np.sqrt(1.0 - kept**2) * rng.standard_normal(count)
    if begins:
        kicks[0] = 0.0
    return np.asarray(lfilter([1.0], [1.0, -kept], kicks))


def gate_answers(machine: Machine, time_s: Array, command_mm: Array) -> Array:
    """True and read opening (rows, 2) of the compiled model."""
    first = float(command_mm[0])
    return run_gate(
        (machine.gate,),
        make_no_switch(),
        make_gate_start(first),
        GateOutput(first, first),
        make_input_rows(GateInput, len(time_s), command_mm=command_mm),
        time_s,
        MAX_MODEL_STEP_S,
    )


def shaft_answers(
    machine: Machine, time_s: Array, first_rpm: float = 0.0, **inputs: npt.ArrayLike
) -> Array:
    """True and read speed (rows, 2) of the compiled model, at the nominal supply where none is
    given."""
    rows = make_input_rows(
        ShaftInput, len(time_s), **{"supply_v": machine.shaft.nominal_supply_v, **inputs}
    )
    return run_shaft(
        (machine.shaft,),
        make_no_switch(),
        make_shaft_start(first_rpm),
        ShaftOutput(first_rpm, first_rpm),
        rows,
        time_s,
        MAX_MODEL_STEP_S,
    )


def half_way(rows: Array) -> Array:
    """What moves on from row to row, on the mean from each row to the next."""
    return np.append(0.5 * (rows[1:] + rows[:-1]), rows[-1])


def hopper_answers(
    machine: Machine,
    time_s: Array,
    full_kg: float,
    pitch_deg: npt.ArrayLike = 0.0,
    **inputs: npt.ArrayLike,
) -> tuple[Array, Array]:
    """Mass in the hopper and what its scale reads without noise, by the compiled model."""
    rows = make_input_rows(FlowInput, len(time_s), pitch_deg=pitch_deg, **inputs)
    left_kg = run_flow(
        (machine.flow,),
        make_no_switch(),
        make_flow_start(full_kg),
        FlowOutput(0.0, full_kg),
        rows,
        time_s,
        MAX_MODEL_STEP_S,
    )[:, 1]
    return left_kg, run_scale(
        machine.scale,
        make_input_rows(
            ScaleInput, len(time_s), hopper_kg=left_kg, time_s=time_s, pitch_deg=pitch_deg
        ),
    )


# --- Logs of machines of the compiled model
# --------------------------------------------------------------------------


def whole_run(
    seed: int = 1,
    seconds: float = 600.0,
    machine: Machine | None = None,
    still_opening: bool = False,
    shaft: tuple[float, float] = (30.0, 90.0),
) -> Columns:
    """Every stage, with noise: random set-points, headlands, a slope, a wandering supply."""
    machine = machine or Machine()
    rng, time_s, sd = np.random.default_rng(seed), np.arange(0.0, seconds, STEP_S), machine.noise
    n = len(time_s)
    working = time_s % 120.0 > 12.0
    rpm = np.where(working, held(rng, time_s, *shaft, 4.0), 0.0)
    mm = np.full(n, 25.0) if still_opening else held(rng, time_s, 15.0, 40.0, 5.0)
    supply_v, pitch_deg = 13.2 + 0.5 * np.sin(time_s / 40.0), 3.0 * np.sin(time_s / 60.0)
    gate = gate_answers(machine, time_s, mm)
    turns = shaft_answers(
        machine, time_s, command_rpm=rpm, opening_mm=half_way(gate[:, 0]), supply_v=supply_v
    )
    _, scale_kg = hopper_answers(
        machine, time_s, 280.0, pitch_deg, shaft_rpm=turns[:, 0], opening_mm=gate[:, 0]
    )
    speed = run_speed(
        (machine.speed,),
        make_no_switch(),
        make_speed_start(1.3),
        SpeedOutput(1.3, 1.3),
        make_input_rows(
            SpeedInput,
            n,
            speed_mps=1.3 + 0.2 * np.sin(time_s / 7.0),
            working=working.astype(float),
            pitch_deg=pitch_deg,
        ),
        time_s,
        MAX_MODEL_STEP_S,
    )
    keep = np.exp(-STEP_S / sd.scale_correlation_s)
    first_kg = sd.scale_kg * rng.standard_normal()
    kicks = sd.scale_kg * np.sqrt(1.0 - keep * keep) * rng.standard_normal(n)
    slow_kg = lfilter([1.0], [1.0, -keep], np.concatenate(([first_kg], kicks[1:])))
    ndvi = 0.5 + 0.05 * np.sin(time_s / 11.0)
    columns = {
        "time_s": time_s,
        "shaft_rpm_cmd": rpm,
        "opening_mm_cmd": mm,
        "supply_v": supply_v,
        "pitch_deg": pitch_deg,
        "roll_deg": np.cos(time_s / 33.0),
        "heading_deg": np.where(np.floor(time_s / 120.0) % 2 < 1, 0.0, 180.0),
        "shaft_rpm": turns[:, 1] + sd.shaft_rpm * rng.standard_normal(n),
        "opening_mm": gate[:, 1] + sd.opening_mm * rng.standard_normal(n),
        "hopper_kg": np.round((scale_kg + slow_kg) / 0.05) * 0.05,
        "wheel_speed_mps": speed[:, 0] + sd.wheel_mps * rng.standard_normal(n),
        "speed_mps": speed[:, 1] + sd.gnss_mps * rng.standard_normal(n),
    }
    return columns | {
        f"ndvi_{head}": ndvi + sd.ndvi * rng.standard_normal(n) for head in range(1, 7)
    }


def drive_run(machine: Machine, seed: int = 1) -> Columns:
    """Five minutes of a shaft alone, over its whole range, 50 rows a second, stopped for 3 s of
    every 30."""
    rng, time_s, high_rpm = (
        np.random.default_rng(seed),
        np.arange(0.0, 300.0, 0.02),
        machine.limits.shaft_high_rpm,
    )
    command = np.where(time_s % 30.0 < 3.0, 0.0, held(rng, time_s, 0.0, high_rpm, 1.5))
    turns = shaft_answers(machine, time_s, command_rpm=command, opening_mm=0.0)[:, 0]
    read = turns + machine.noise.shaft_rpm * rng.standard_normal(len(time_s))
    read = np.where(turns > 0.005 * high_rpm, read, 0.0)  # no counts while it stands
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": command,
        "shaft_rpm": np.array([round_to_step(one, machine.shaft.encoder_step_rpm) for one in read]),
    }


def metering_run(
    machine: Machine,
    seed: int = 1,
    seconds: float = 900.0,
    stands_s: float = 12.0,
    of_s: float = 120.0,
) -> Columns:
    """Shaft, gate and hopper over the middle of their ranges; the shaft stands for `stands_s`
    of every `of_s`."""
    rng, time_s, sd, limits = (
        np.random.default_rng(seed),
        np.arange(0.0, seconds, STEP_S),
        machine.noise,
        machine.limits,
    )
    n, full_kg, step_kg = len(time_s), 0.98 * machine.flow.full_kg, machine.scale.resolution_kg
    rpm = held(
        rng,
        time_s,
        max(limits.shaft_low_rpm, 0.3 * limits.shaft_high_rpm),
        0.9 * limits.shaft_high_rpm,
        4.0,
    )
    rpm = np.where(time_s % of_s < stands_s, 0.0, rpm)
    mm = held(rng, time_s, 0.2 * limits.opening_high_mm, 0.6 * limits.opening_high_mm, 5.0)
    gate = gate_answers(machine, time_s, mm)
    turns = shaft_answers(machine, time_s, command_rpm=rpm, opening_mm=half_way(gate[:, 0]))
    left_kg, scale_kg = hopper_answers(
        machine, time_s, full_kg, shaft_rpm=turns[:, 0], opening_mm=gate[:, 0]
    )
    assert left_kg[-1] > 0.02 * full_kg
    slow = wandering(rng, n, float(np.exp(-STEP_S / sd.scale_correlation_s)), begins=True)
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": rpm,
        "opening_mm_cmd": mm,
        "shaft_rpm": turns[:, 1] + sd.shaft_rpm * rng.standard_normal(n),
        "opening_mm": gate[:, 1] + sd.opening_mm * rng.standard_normal(n),
        "hopper_kg": np.round((scale_kg + sd.scale_kg * slow) / step_kg) * step_kg,
    }


# --- Logs that no model of ours made
# ---------------------------------------------------------------------------------


def speeds(
    seed: int,
    time_s: Array,
    true_mps: Array,
    wheel: npt.ArrayLike = 1.0,
    gnss_mps: Array | None = None,
) -> Columns:
    """Wheel and GNSS: the wheel reads so many times the ground's speed, the receiver that speed
    or another."""
    rng, n = np.random.default_rng(seed), len(time_s)
    gnss = true_mps if gnss_mps is None else gnss_mps
    return {
        "time_s": time_s,
        "speed_mps": gnss + 0.03 * rng.standard_normal(n),
        "wheel_speed_mps": wheel * true_mps + 0.02 * rng.standard_normal(n),
    }


def settled(commands: Array, answers: Array, row_s: float = 1.1, said: bool = True) -> Columns:
    """A command and the speed it came to in each row, a row later; a calibration says so in its
    events, or does not."""
    events = np.full(len(commands) + 1, "", object)
    events[0] = COMMANDS_HELD_EVENT if said else ""
    return {
        "time_s": row_s * np.arange(len(commands) + 1.0),
        "shaft_rpm_cmd": np.append(commands, commands[-1]),
        "shaft_rpm": np.append(0.0, answers),
        "events": events,
    }


def staircase(seed: int) -> Columns:
    """A settled answer a row: a motor that saturates and turns from 110 r/min of its command on."""
    asked_rpm = np.concatenate((np.arange(0.0, 640.0, 16.0), np.arange(632.0, 0.0, -16.0)))
    turns = 610.0 * (1.0 - np.exp(-np.maximum(0.0, asked_rpm - 110.0) / 110.0))
    read = turns + 2.0 * np.random.default_rng(seed).standard_normal(len(asked_rpm)) * (turns > 0.0)
    return settled(asked_rpm, read) | {"shaft_rpm": np.append(np.nan, read)}


def steps(seed: int) -> Columns:
    """Random steps, rows of 20 ms: most of an answer comes at once, the rest with 1.2 s; it
    drifts."""
    rng = np.random.default_rng(seed)
    asked_rpm = np.repeat(rng.uniform(60.0, 600.0, 150), 40)
    goal = 1.4 * np.maximum(0.0, asked_rpm - 90.0)
    read = 0.85 * lagged(goal, 0.03, 0.02) + 0.15 * lagged(goal, 1.2, 0.02)
    walks = lagged(40.0 * rng.standard_normal(len(asked_rpm)), 1.0, 0.02)
    return {
        "time_s": np.arange(0.0, 120.0, 0.02),
        "shaft_rpm_cmd": asked_rpm,
        "shaft_rpm": read + walks + 2.0 * rng.standard_normal(len(asked_rpm)),
    }


@cache
def stairs_work() -> Columns:
    """Ten minutes of both drives on stairs of their own and a scale, 20 rows a second. Nobody
    writes in it."""
    rng, time_s = np.random.default_rng(5), np.arange(0.0, 600.0, 0.05)
    rpm, mm = (
        np.round(rng.uniform(low, high, 200)[(time_s / every_s).astype(int)], 1)
        for low, high, every_s in ((30.0, 95.0, 7.0), (12.0, 45.0, 9.0))
    )
    shaft, opening = followed(rpm, 1.0 - np.exp(-0.05 / 0.05), 10.0, 7), followed(mm, 1.0, 1.0, 2)
    left_kg = 290.0 - np.cumsum(5.5e-3 * shaft * opening / 60.0) * 0.05
    return {
        "time_s": time_s,
        "shaft_rpm_cmd": rpm,
        "opening_mm_cmd": mm,
        "shaft_rpm": shaft + rng.normal(0.0, 0.3, len(time_s)),
        "opening_mm": opening + rng.normal(0.0, 0.1, len(time_s)),
        "hopper_kg": np.round((left_kg + rng.normal(0.0, 0.15, len(time_s))) / 0.05) * 0.05,
    }


# --- What is planted in a log
# ----------------------------------------------------------------------------------------


def planted_in(log: Columns, **by: Callable[[Any], npt.ArrayLike]) -> Columns:
    """The log with columns made anew, each by a function of the log, of which they are
    attributes."""
    return log | {name: np.asarray(change(SimpleNamespace(**log))) for name, change in by.items()}


def taken(log: Columns, rows: Any) -> Columns:
    """Those rows of a log."""
    return {name: values[rows] for name, values in log.items()}
