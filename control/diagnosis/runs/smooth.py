"""Models a smooth, nameless dependence of a stage on one recorded variable, with the model's own
tables and a few shapes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis import effects
from topdress.control.machine.compiled import run_table
from topdress.control.machine.effect import HOPPER_CAPACITY, OPENING_RANGE, SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal
from topdress.control.machine.model_elements import Table
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

from .channels import ChannelSeries, make_hopper_channel
from .hopper import Hopper
from .hypothesis import EffectInstance, StageParams, make_schedule
from .stages import RunData

Array = npt.NDArray[np.float64]

# Number of nodes of a table.
NODE_COUNT = 8
# Number of half-waves over the range of the variable: slope, curvature, and two finer shapes.
SHAPE_COUNT = 4
# Minimum range of a variable for a dependence to show; for the variables in NOMINAL_RANGES on the
# nominal machine.
MIN_RANGE = {
    "time_s": 60.0,
    "shaft_rpm": 2.0,
    "opening_mm": 1.0,
    "supply_v": 0.2,
    "pitch_deg": 0.5,
    "roll_deg": 0.5,
    "speed_mps": 0.15,
    "hopper_kg": 10.0,
    "heading_deg": 30.0,
}
NOMINAL_RANGES = {
    "shaft_rpm": SHAFT_RANGE,
    "opening_mm": OPENING_RANGE,
    "hopper_kg": HOPPER_CAPACITY,
}

# Recorded variables that depend on a stage's own reading, so that the reading's noise would return
# through them. Control sets shaft and gate by the measured speed, and by the scale through the flow
# trim; shaft_rpm and opening_mm are commands here (drives see them before they answer). A gate does
# not depend on the shaft; the shaft bears the load of the opening.
DOWNSTREAM_VARIABLES: dict[str, frozenset[str]] = {
    "shaft": frozenset(),
    "gate": frozenset({"shaft_rpm"}),
    "flow": frozenset(),
    "scale": frozenset({"hopper_kg", "shaft_rpm", "opening_mm"}),
    "speed": frozenset({"speed_mps", "shaft_rpm", "opening_mm"}),
    # The effort is predicted from these readings, so their noise is in the residual, the more so
    # the better the loop holds its speed.
    "effort": frozenset({"shaft_rpm", "opening_mm", "supply_v"}),
    "gate_effort": frozenset({"opening_mm", "supply_v"}),
}


def list_stage_variables(data: RunData) -> tuple[str, ...]:
    """Return the variables on which a stage may depend: the published variables, and the log's
    further columns."""
    return (*MIN_RANGE, *(name for name in data.variables if name not in MIN_RANGE))


class StageTable(NamedTuple):
    """The smooth extension of one stage: the channel that shows it, and the effect whose column it
    multiplies."""

    channel: str
    unit: EffectInstance


STAGE_TABLES: dict[str, StageTable] = {
    "shaft": StageTable("shaft", EffectInstance(effects.SHAFT_GAIN.id, 1.0)),
    "gate": StageTable("gate", EffectInstance(effects.GATE_HOME_ERROR.id, 1.0)),
    "flow": StageTable("scale", EffectInstance(effects.FLOW_GAIN.id, 1.0)),
    "scale": StageTable("scale", EffectInstance(effects.SCALE_DRIFT.id, 1.0)),
    "speed": StageTable("speed", EffectInstance(effects.SPEED_WHEEL_RADIUS.id, 1.0)),
}


class VariableSpan(NamedTuple):
    """Nodes of a table over the excited range of a variable."""

    variable: str
    nodes: Table


def find_variable_span(data: RunData, variable: str, machine: Machine) -> VariableSpan | None:
    """Return eight evenly spaced nodes between the variable's 1st and 99th percentile; None where
    its range is too small."""
    values = data.variables.get(variable)
    if values is None:
        return None
    low, high = np.percentile(values, (1.0, 99.0))
    least = scale_nominal(machine, NOMINAL_RANGES.get(variable, ())) * MIN_RANGE.get(
        variable, float(np.finfo(float).tiny)
    )
    if not high - low >= least:
        return None
    return VariableSpan(variable, tuple(np.linspace(low, high, NODE_COUNT).tolist()))


def make_half_wave(k: int) -> Table:
    """Return the k-th half-wave at the nodes, k from 1."""
    return tuple(np.cos(np.pi * k * (np.arange(NODE_COUNT) + 0.5) / NODE_COUNT).tolist())


def interpolate_variable(data: RunData, variable: str, time_s: Array) -> Array:
    return np.interp(time_s, data.time_s, data.variables[variable])


def calc_flow_change(hopper: Hopper, machine: Machine, base: StageParams, percent: Array) -> Array:
    """Return the change of the scale's reading from further per cent of the flow in each bin
    (m+1,): (m,)."""
    nothing = make_schedule(base, ())
    changed = hopper._replace(more_percent=hopper.more_percent + percent)
    return np.asarray(
        make_hopper_channel(changed, machine).predict(nothing, MAX_MODEL_STEP_S)
        - make_hopper_channel(hopper, machine).predict(nothing, MAX_MODEL_STEP_S)
    )


def list_shape_series(
    stage: str,
    over: VariableSpan,
    channel: ChannelSeries,
    unit: Array,
    *,
    data: RunData,
    base: StageParams,
    machine: Machine,
    own: Array | None = None,
) -> Array:
    """Return the change of the channel for one unit of each shape: (SHAPE_COUNT, m).

    `unit`: change for one unit of the stage's own constant (STAGE_TABLES). The model integrates the
    flow; the other stages answer at once, so their unit column is multiplied by the table. own :
    the variable at the channel's samples, where it is the output of the stage's drive.
    """
    if stage == "flow" and data.hopper is not None:
        values = interpolate_variable(data, over.variable, data.hopper.time_s)
        rows = [
            calc_flow_change(
                data.hopper, machine, base, run_table(over.nodes, make_half_wave(k), values)
            )
            for k in range(1, SHAPE_COUNT + 1)
        ]
        return np.array(rows)
    values = interpolate_variable(data, over.variable, channel.grid.even_s) if own is None else own
    shaped = np.array(
        [np.interp(values, over.nodes, make_half_wave(k)) for k in range(1, SHAPE_COUNT + 1)]
    )
    return shaped if stage == "scale" else shaped * unit
