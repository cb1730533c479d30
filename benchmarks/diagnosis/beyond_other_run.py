"""A machine file on another run of the hidden machine: which part of what the hidden term does
does it predict?

Every channel is predicted from the measured output of the stage before, as in the diagnosis,
with the machine file as it was shipped and with what was adopted. The generator knows what the
hidden term changed in each reading, without noise; the file should change the prediction by the
same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.machine import Machine

Floats = npt.NDArray[np.float64]
# s.d. of the noise of each channel, in which errors of several are added; the scale's by its
# change over FLOW_S.
NOISE = {"shaft": 0.3, "gate": 0.1, "scale": 0.2, "speed": 0.036}
READING = {"shaft": "shaft", "gate": "gate", "flow": "scale", "scale": "scale", "speed": "speed"}
LEAST = 1e-9
# the scale is read for flow, over windows of this length
FLOW_S = 10.0


class Seen(NamedTuple):
    """One channel of a log through a machine file; arrays on its even grid (m,)."""

    time_s: Floats
    step_s: float
    measured: Floats
    predicted: Floats


def seen(columns: dict[str, Any], machine: Machine) -> dict[str, Seen]:
    """Every channel of a log, by name."""
    from topdress.control.diagnosis.runs.channels import make_channels
    from topdress.control.diagnosis.runs.hypothesis import list_stages, make_schedule
    from topdress.control.diagnosis.runs.log import clean_run_log
    from topdress.control.diagnosis.runs.stages import make_run_data
    from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S

    plan = make_schedule(list_stages(machine), ())
    return {
        name: Seen(c.grid.even_s, c.grid.step_s, c.measured, c.predict(plan, MAX_MODEL_STEP_S))
        for name, c in make_channels(
            make_run_data(clean_run_log(columns), machine), machine
        ).items()
    }


def tolerated(columns: dict[str, Any], machine: Machine) -> dict[str, Seen]:
    """The same with each stage's gain off by one standard deviation of its tolerance."""
    t = machine.tolerance
    moved = {
        "shaft": machine.shaft._replace(gain_percent=machine.shaft.gain_percent + t.shaft_percent),
        "gate": machine.gate._replace(home_error_mm=machine.gate.home_error_mm + t.opening_mm),
        "flow": machine.flow._replace(gain_percent=machine.flow.gain_percent + t.flow_percent),
        "speed": machine.speed._replace(
            radius_percent=machine.speed.radius_percent + t.wheel_percent
        ),
    }
    return seen(columns, machine.model_copy(update=moved))


def on_grid(readings: dict[str, Floats], channel: str, rows_s: Floats, grid: Seen) -> Floats:
    """A difference of readings (rows,) as it shows in a channel (m,): of the scale the mean
    over each of its bins."""
    of_rows = readings["wheel"] - readings["gnss"] if channel == "speed" else readings[channel]
    if channel != "scale":
        return np.interp(grid.time_s, rows_s, of_rows)
    summed = np.r_[0.0, np.cumsum(of_rows[:-1] * np.diff(rows_s))]
    half = 0.5 * grid.step_s
    return (
        np.interp(grid.time_s + half, rows_s, summed)
        - np.interp(grid.time_s - half, rows_s, summed)
    ) / grid.step_s


def errors_of(channel: str, series: Floats, step_s: float) -> Floats:
    """What counts of an error (m,): of the scale its change over FLOW_S, for its level is not
    known."""
    if channel != "scale":
        return series
    hop = max(1, round(FLOW_S / step_s))
    return np.asarray(series[hop:] - series[:-hop])


class Truth(NamedTuple):
    """One channel of another run, noise-free (m,): what is hidden changes, what this machine's
    tolerances do, and what one standard deviation of its stage's tolerance would do."""

    name: str
    step_s: float
    hidden: Floats
    tolerance: Floats
    one_sd: Floats

    def removable(self, said: Floats | float) -> float:
        """Mean square, in units of the noise, of what `said` leaves of the hidden change and no
        tolerated gain does.

        As z is counted: a gain within the tolerances is taken off under its prior.
        """
        error = errors_of(self.name, self.hidden - said, self.step_s) / NOISE[self.name]
        level = errors_of(self.name, self.one_sd, self.step_s) / NOISE[self.name]
        along = float(level @ error) ** 2 / (float(level @ level) + 1.0)
        return (float(error @ error) - along) / max(1, error.size)

    def error(self, said: Floats | float) -> float:
        """Mean square, in units of the noise, of all that `said` leaves, tolerances and all."""
        error = (
            errors_of(self.name, self.hidden + self.tolerance - said, self.step_s)
            / NOISE[self.name]
        )
        return float(np.mean(error**2)) if error.size else 0.0


def worth(truths: Sequence[Truth], said: Mapping[str, Floats]) -> dict[str, Any]:
    """What changes of the predictions (by channel, those without are 0) are worth.

    `removable`, `left`: added over the channels, the error that only the hidden term makes
    without and with them; `share` = 1 - left / removable, None where nothing is removable.
    `nominal`, `adopted`: the whole errors.
    """
    removable = sum(t.removable(0.0) for t in truths)
    left = sum(t.removable(said.get(t.name, 0.0)) for t in truths)
    return {
        "removable": removable,
        "left": left,
        "share": 1.0 - left / removable if removable > LEAST else None,
        "nominal": sum(t.error(0.0) for t in truths),
        "adopted": sum(t.error(said.get(t.name, 0.0)) for t in truths),
    }


def truths(
    columns: dict[str, Any],
    changed: Any,
    stage: str,
    before: Mapping[str, Seen],
    off: Mapping[str, Seen],
) -> list[Truth]:
    """Every channel of another run. before, off : through the nominal file, and with its gains
    off."""
    rows_s = columns["time_s"] - columns["time_s"][0]
    found = []
    for name, one in before.items():
        if name in NOISE:
            own = name == READING[stage]
            hidden = (
                on_grid(changed.hidden, name, rows_s, one) if own else np.zeros(len(one.time_s))
            )
            found.append(
                Truth(
                    name,
                    one.step_s,
                    hidden,
                    on_grid(changed.tolerance, name, rows_s, one),
                    off[name].predicted - one.predicted,
                )
            )
    return found


def judged(
    columns: dict[str, Any], changed: Any, stage: str, nominal: Machine, adopted: Machine
) -> dict[str, Any]:
    """`worth` of a file; `rms`: of the hidden channel as measured, in its unit, under the
    nominal file, the adopted one, and with the truth taken off."""
    before = seen(columns, nominal)
    after = before if adopted == nominal else seen(columns, adopted)
    said = {
        name: after[name].predicted - one.predicted for name, one in before.items() if name in after
    }
    known = truths(columns, changed, stage, before, tolerated(columns, nominal))
    own = next(t for t in known if t.name == READING[stage])
    one = before[own.name]
    rest = one.measured - one.predicted
    rms = {
        word: float(np.sqrt(np.mean(errors_of(own.name, series, one.step_s) ** 2)))
        for word, series in (
            ("nominal", rest),
            ("adopted", rest - said[own.name]),
            ("true", rest - own.hidden),
        )
    }
    return {**worth(known, said), "rms": rms}
