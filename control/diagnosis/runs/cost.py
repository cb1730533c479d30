"""What a named effect does in the field when nobody compensates it: dose and place."""
from __future__ import annotations

import numpy as np

from control.diagnosis import effects
from control.diagnosis.result import FieldCost
from control.machine.machine import Machine
from control.machine.over_log import MOST_STEP_S

from .channels import shaft_channel
from .hypothesis import Part, schedule, stages_of
from .stages import RunData

FLOW_PERCENT = {         # relative change of the dose where the size is one in percent already
    effects.FLOW_GAIN.id: 1.0, effects.FLOW_BATCH.id: 1.0, effects.FLOW_BLOCKED_OUTLET.id: -1.0,
    effects.FLOW_BRIDGING.id: -1.0,
    effects.SPEED_WHEEL_SLIP.id: 1.0, effects.SPEED_WHEEL_RADIUS.id: 1.0, effects.SPEED_MISSED_PULSES.id: -1.0,
}
LATE_S = (effects.SHAFT_DEAD_TIME.id, effects.SHAFT_SLOW.id, effects.SPEED_GNSS_LATENCY.id)


def field_cost(part: Part, machine: Machine, data: RunData) -> FieldCost:
    """Mean change of the dose over the working rows, %, and of the landing place, m (late positive).

    Wheel effects are counted as if the wheel alone told the speed. None: this effect has no such cost.
    """
    if part.id in LATE_S:
        return FieldCost(0.0, round(part.size * _speed(data), 3))
    if part.id in FLOW_PERCENT:
        return FieldCost(round(FLOW_PERCENT[part.id] * part.size, 2), 0.0)
    rate = _rate_percent(part, machine, data)
    return FieldCost(None if rate is None else round(rate, 2), 0.0)


def _speed(data: RunData) -> float:
    speed = data.variables.get("speed_mps")
    if speed is None:
        return 1.25
    moving = speed[(data.working > 0.0) & (speed > 0.3)]
    return float(np.mean(moving)) if len(moving) else 1.25


def _rate_percent(part: Part, machine: Machine, data: RunData) -> float | None:
    stage = effects.ROWS[part.id].stage
    if stage in ("scale", "heads") or data.hopper is None:
        return None
    h = data.hopper
    on = h.shaft_rpm > 0.0
    if not on.any():
        return None
    rpm, opening, pitch = h.shaft_rpm[on], h.opening_mm[on], h.pitch_deg[on]
    turned = np.sum(rpm * opening)
    if part.id in (effects.GATE_OFFSET.id, effects.GATE_HOME_ERROR.id):
        sign = -1.0 if part.id == effects.GATE_OFFSET.id else 1.0
        return float(100.0 * sign * part.size * np.sum(rpm) / turned)
    if part.id == effects.FLOW_ZERO_OFFSET.id:
        return float(100.0 * part.size * np.sum(rpm) / (turned * machine.flow.grams_per_rev_mm))
    if part.id == effects.FLOW_FILL_FALLOFF.id:
        return float(-part.size * np.sum(rpm * opening * (rpm / 100.0) ** 3) / turned)
    if part.id == effects.FLOW_SLOPE.id:
        return float(part.size * np.sum(rpm * opening * pitch) / turned)
    if part.id == effects.FLOW_MOISTURE_DRIFT.id:
        return float(part.size * np.sum(rpm * opening * h.time_s[on] / 3600.0) / turned)
    if part.id == effects.FLOW_HOPPER_HEAD.id:
        level = np.interp(h.time_s[on], data.time_s, data.variables.get("hopper_kg", data.time_s * 0.0))
        return float(-part.size * np.sum(rpm * opening * (1.0 - level / machine.flow.full_kg)) / turned)
    if part.id == effects.FLOW_LEAK.id:
        kg = turned * machine.flow.grams_per_rev_mm / 60_000.0 * float(np.median(np.diff(h.time_s)))
        return float(100.0 * part.size / 3600.0 * data.duration_s / kg)
    if stage == "shaft" and data.shaft is not None:
        channel = shaft_channel(data.shaft, machine)
        base = stages_of(machine)
        with_it = channel.predict(schedule(base, (part,)), MOST_STEP_S)
        without = channel.predict(schedule(base, ()), MOST_STEP_S)
        return float(100.0 * np.sum(with_it - without) / max(1e-9, float(np.sum(without))))
    return 0.0
