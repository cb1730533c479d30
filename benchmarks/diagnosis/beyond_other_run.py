"""A machine file on another run of the hidden machine: which part of what the hidden term does does it predict?

Every channel is predicted from the measured output of the stage before, as in the diagnosis, with the machine file as it
was shipped and as it is with what was adopted. The generator knows what the hidden term changed in each reading,
without noise; the file should change the prediction by the same.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from control.machine.machine import Machine

Floats = npt.NDArray[np.float64]
# s.d. of the noise of each channel, in which errors of several are added; the scale's by its change over FLOW_S.
NOISE = {"shaft": 0.3, "gate": 0.1, "scale": 0.2, "speed": 0.036, "heads": 0.009}
READING = {"shaft": "shaft", "gate": "gate", "flow": "scale", "scale": "scale", "speed": "speed"}
FLOW_S = 10.0                     # the scale is read for flow, over windows of this length


class Seen(NamedTuple):
    """One channel of a log through a machine file; arrays on its even grid (m,)."""

    time_s: Floats
    step_s: float
    measured: Floats
    predicted: Floats


def seen(columns: dict[str, Any], machine: Machine) -> dict[str, Seen]:
    """Every channel of a log, by name."""
    from control.diagnosis.runs.channels import channels
    from control.diagnosis.runs.hypothesis import schedule, stages_of
    from control.diagnosis.runs.log import gate
    from control.diagnosis.runs.stages import run_data
    from control.machine.over_log import MOST_STEP_S

    plan = schedule(stages_of(machine), ())
    return {name: Seen(c.grid.even_s, c.grid.step_s, c.measured, c.predict(plan, MOST_STEP_S))
            for name, c in channels(run_data(gate(columns), machine), machine).items()}


def on_grid(changed: dict[str, Floats], channel: str, rows_s: Floats, grid: Seen) -> Floats:
    """What is hidden changes in a channel (m,): of the scale the mean over each of its bins."""
    of_rows = changed["wheel"] - changed["gnss"] if channel == "speed" else changed[channel]
    if channel != "scale":
        return np.interp(grid.time_s, rows_s, of_rows)
    summed = np.r_[0.0, np.cumsum(of_rows[:-1] * np.diff(rows_s))]
    half = 0.5 * grid.step_s
    return (np.interp(grid.time_s + half, rows_s, summed) - np.interp(grid.time_s - half, rows_s, summed)) / grid.step_s


def errors_of(channel: str, series: Floats, step_s: float) -> Floats:
    """What counts of an error (m,): of the scale its change over FLOW_S, for its level is not known."""
    if channel != "scale":
        return series
    hop = max(1, round(FLOW_S / step_s))
    return np.asarray(series[hop:] - series[:-hop])


def power(channel: str, series: Floats, step_s: float) -> float:
    """Mean square in units of the noise."""
    errors = errors_of(channel, series, step_s)
    return float(np.mean(errors ** 2)) / NOISE[channel] ** 2 if errors.size else 0.0


def judged(columns: dict[str, Any], changed: dict[str, Floats], stage: str, nominal: Machine,
           adopted: Machine) -> dict[str, Any]:
    """`removable`, `left`: mean square errors that the hidden term makes under each file, in units of the noise, added
    over the channels; `share` = 1 - left / removable (None where nothing is removable). `rms`: of the hidden channel as
    measured, in its unit, under the nominal file, the adopted one, and with the truth taken off."""
    own = READING[stage]
    before = seen(columns, nominal)
    after = before if adopted == nominal else seen(columns, adopted)
    rows_s = columns["time_s"] - columns["time_s"][0]
    removable, left, rms = 0.0, 0.0, {}
    for name, one in before.items():
        if name not in after or name not in NOISE:
            continue
        truth = on_grid(changed, own, rows_s, one) if name == own else np.zeros_like(one.predicted)
        said = after[name].predicted - one.predicted
        removable += power(name, truth, one.step_s)
        left += power(name, truth - said, one.step_s)
        if name == own:
            rest = one.measured - one.predicted
            rms = {word: float(np.sqrt(np.mean(errors_of(name, series, one.step_s) ** 2)))
                   for word, series in (("nominal", rest), ("adopted", rest - said), ("true", rest - truth))}
    return {"removable": removable, "left": left, "share": 1.0 - left / removable if removable > 1e-9 else None,
            "rms": rms}
