"""What the peers get of a log: what the nominal machine file's prediction leaves of each channel, and all recorded.

Means over bins of about STEP_S, so that a peer's own dictionary stays small; the prediction is the diagnosis's own.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from beyond_other_run import Truth, seen, tolerated, truths

from control.machine.machine import Machine

Floats = npt.NDArray[np.float64]
STEP_S = {"shaft": 0.5, "gate": 1.0, "scale": 1.0, "speed": 1.0}
# The log's columns and what the diagnosis calls them; not the time, over which every drift of a sensor is a
# dependence. In place of an angle come its sine and cosine.
FEATURES = {"shaft_rpm": "told_rpm", "opening_mm": "told_mm", "supply_v": "supply_v", "pitch_deg": "pitch_deg",
            "roll_deg": "roll_deg", "speed_mps": "speed_mps"}
LATER_S = 0.1                     # of a GNSS reading; less is lost between two steps of the model
ANGLES = ("heading_deg", "shaft_angle_deg")


class Channel(NamedTuple):
    """`residual` (n,), in the channel's unit; `values` (k, n) of the `features`; `weight` (n,): the residual's change
    by 1 % of the shaft's, the flow's or the wheel's value (flow: in each bin, kg); `nuisances` (j, n): what tolerated
    times and speeds of the drives change; `truth`: of another run."""

    time_s: Floats
    step_s: float
    residual: Floats
    features: tuple[str, ...]
    values: Floats
    weight: Floats
    nuisances: Floats
    truth: Truth | None


def column_of(feature: str) -> str:
    """The log's column that a feature is made of."""
    return feature.split(" ")[-1]


def off_nominal(machine: Machine) -> tuple[Machine, ...]:
    """The machine with what its tolerances leave open beside gains off: of each stage one. How far does not matter."""
    t, shaft, gate, speed = machine.tolerance, machine.shaft, machine.gate, machine.speed
    return (machine.model_copy(update={
                "shaft": shaft._replace(dead_time_s=shaft.dead_time_s + t.dead_time_s),
                "gate": gate._replace(dead_time_s=gate.dead_time_s + t.dead_time_s),
                "speed": speed._replace(gnss_latency_s=speed.gnss_latency_s + LATER_S)}),
            machine.model_copy(update={
                "shaft": shaft._replace(time_constant_s=shaft.time_constant_s + t.time_constant_s),
                "gate": gate._replace(slew_mm_s=gate.slew_mm_s * (1.0 + t.gate_slew_percent / 100.0))}))


def problem_of(columns: dict[str, Any], machine: Machine, stage: str,
               changed: Any) -> dict[str, Channel]:
    """Every channel but the canopy heads. stage, changed : of the hidden term in another run; None of a first run."""
    from control.diagnosis.runs.log import gate
    from control.diagnosis.runs.stages import run_data

    data = run_data(gate(columns), machine)
    rows_s, series = data.row_s, dict(data.inputs)
    if "speed_mps" in data.variables:           # of both sensors: GNSS alone shares its noise with the residual
        series["speed_mps"] = np.interp(rows_s, data.time_s, data.variables["speed_mps"])
    features = {name: series[source] for name, source in FEATURES.items() if source in series}
    further = sorted(set(series) - {*FEATURES, *FEATURES.values(), *ANGLES, "hopper_kg", "time_s"})
    features |= {name: series[name] for name in further}
    for name in ANGLES:
        if name in series:
            turned = np.radians(series[name])
            features |= {f"sin {name}": np.sin(turned), f"cos {name}": np.cos(turned)}
    told = series.get("told_rpm", np.zeros(len(rows_s)))
    flow = machine.flow.grams_per_rev_mm / 60_000.0 * series.get("shaft_rpm", told) * series.get("opening_mm", 0.0)
    before = seen(columns, machine)
    known = {} if changed is None else {t.name: t for t in truths(columns, changed, stage, before,
                                                                   tolerated(columns, machine))}
    off = [] if changed is not None else [seen(columns, other) for other in off_nominal(machine)]
    found = {}
    for name, one in before.items():
        if name not in STEP_S:
            continue
        width = max(1, round(STEP_S[name] / one.step_s))
        use = {key: x for key, x in features.items() if name == "shaft" or not key.endswith("shaft_angle_deg")}
        weight = {"shaft": told / 100.0, "scale": -flow * one.step_s * width / 100.0,
                  "speed": series.get("speed_mps", told) / 100.0}.get(name, np.ones(len(rows_s)))
        truth = known.get(name)
        stack = np.array([one.time_s, one.measured - one.predicted, np.interp(one.time_s, rows_s, weight),
                          *(np.interp(one.time_s, rows_s, x) for x in use.values()),
                          *(other[name].predicted - one.predicted for other in off),
                          *(() if truth is None else truth[2:])])
        binned = stack[:, :stack.shape[1] // width * width].reshape(len(stack), -1, width).mean(axis=2)
        values = binned[3:3 + len(use)].astype(np.float32)
        found[name] = Channel(binned[0], one.step_s * width, binned[1], tuple(use), values, binned[2],
                              binned[3 + len(use):3 + len(use) + len(off)],
                              None if truth is None else Truth(name, one.step_s * width, *binned[-3:]))
    return found
