"""Predicts a log with any machine file, on the judged rows."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.effects import EFFECT_ROWS
from topdress.control.diagnosis.runs.channels import (
    make_channels,
    make_hopper_channel,
    make_speed_channel,
    simulate_drive_rows,
)
from topdress.control.diagnosis.runs.drives import Drive
from topdress.control.diagnosis.runs.held_out import FLOW_WINDOW_S, HeldOut, list_held_out_errors
from topdress.control.diagnosis.runs.hopper import sum_term_flows
from topdress.control.diagnosis.runs.hypothesis import (
    Hypothesis,
    Schedule,
    list_stages,
    make_schedule,
)
from topdress.control.diagnosis.runs.inputs import make_log_rows, make_term_inputs
from topdress.control.diagnosis.runs.log import CleanLog
from topdress.control.diagnosis.runs.model import shape_over_time
from topdress.control.diagnosis.runs.stages import RunData
from topdress.control.machine.compiled import run_term
from topdress.control.machine.machine import Machine
from topdress.control.machine.stage_runner import MAX_MODEL_STEP_S
from topdress.control.machine.term_sums import (
    average_commands_over_log,
    calc_dead_times_s,
    sum_over_log,
)
from topdress.control.machine.terms import COMMANDED_MM, COMMANDED_RPM

Array = npt.NDArray[np.float64]
# Maps a schedule and a model step, s, to a series (m,).
Predict = Callable[[Schedule, float], Array]


class LogPredictor:
    """A cleaned log with its channels, and the machine file of its diagnosis.

    seen : its channels by name. inputs : inputs of terms at every row (n,).
    """

    def __init__(self, log: CleanLog, data: RunData, machine: Machine) -> None:
        self.machine, self.data, self.settled = machine, data, log.held
        self._every = make_log_rows(log, machine)
        self.time_s = self._every.time_s
        with np.errstate(all="ignore"):
            self.seen = make_channels(data, machine)
            self.inputs = make_term_inputs(log, self._every, machine)

    def predict(
        self, machine: Machine, only: Collection[str] | None = None, parts: Hypothesis = ()
    ) -> dict[str, Array]:
        """Predict each channel: (m,) by channel. only : the channels to predict. parts : further
        effects, with their time course."""
        steady = tuple(part for part in parts if not part.grows)
        found = self._run_machine(machine, only, steady)
        for part in parts:
            if part.grows:
                own = tuple(name for name in EFFECT_ROWS[part.id].channels if name in found)
                grown = self._run_machine(
                    machine, own, (*steady, part._replace(onset_s=None, grows=False))
                )
                without = self._run_machine(machine, own, steady)
                for name in own:
                    found[name] = found[name] + shape_over_time(
                        grown[name] - without[name], self.seen[name], part
                    )
        return found

    def calc_errors(self, channel: str, predicted: Array) -> Array:
        """Return measured minus predicted of a channel, in the unit of its published figure: of the
        scale the flow, which the scale is there to measure."""
        series = self.seen[channel]
        whole = HeldOut(series, series, (slice(0, len(series.measured)),))
        found = list_held_out_errors(whole, series.measured, series.measured - predicted)[3]
        # The errors of several heads are ordered by time.
        return np.ascontiguousarray(found.reshape(series.copies, -1).T).ravel()

    def align_with_errors(self, channel: str, variable: str, count: int) -> Array:
        """Return a recorded variable at the `count` samples of a channel's errors."""
        even_s = self.seen[channel].grid.even_s
        time_s = np.interp(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, len(even_s)), even_s)
        values = self.inputs[variable]
        return values[np.minimum(np.searchsorted(self.time_s, time_s), len(values) - 1)]

    def find_unit(self, channel: str) -> str:
        """Return the unit of a channel's errors."""
        return "kg/s" if channel == "scale" else self.seen[channel].unit

    def calc_noise(self, channel: str) -> float:
        """Return the standard deviation of a channel's errors under a correct machine file, by the
        file's own values."""
        prior = self.seen[channel].prior
        # A flow is the difference of two readings.
        of_two = np.sqrt(2.0) / FLOW_WINDOW_S if channel == "scale" else 1.0
        return float(
            of_two * np.sqrt(prior.fast_sd**2 * (1.0 + prior.slow_share**2) + prior.floor_sd**2)
        )

    def _run_machine(
        self, machine: Machine, only: Collection[str] | None, parts: Hypothesis
    ) -> dict[str, Array]:
        plan = make_schedule(list_stages(machine), parts)
        made = self._predict_with_terms(machine)
        return {
            name: made.get(name, series.predict)(plan, MAX_MODEL_STEP_S)
            for name, series in self.seen.items()
            if only is None or name in only
        }

    def _predict_with_terms(self, machine: Machine) -> dict[str, Predict]:
        """Return predictors for the channels that the file's terms affect, where its terms differ
        from those of the log's own file."""
        if machine.terms == self.machine.terms and (
            not machine.terms or calc_dead_times_s(machine) == calc_dead_times_s(self.machine)
        ):
            return {}
        data, every = self.data, self._every
        inputs = dict(self.inputs)
        for name, command, dead_s in zip(
            (COMMANDED_RPM, COMMANDED_MM),
            (every.command_rpm, every.command_mm),
            calc_dead_times_s(machine),
            strict=True,
        ):
            if np.isfinite(command).all():
                inputs[name] = average_commands_over_log(command, every.time_s, dead_s)
        more = sum_over_log(machine.terms, inputs, every.time_s, run_term)
        found: dict[str, Predict] = {}

        def at(quantity: str, time_s: Array) -> Array | float:
            return (
                more[quantity][np.searchsorted(every.time_s, time_s)] if quantity in more else 0.0
            )

        if (shaft := data.shaft) is not None:
            found["shaft"] = _predict_drive(
                shaft._replace(
                    more=at("shaft_percent", shaft.time_s), more_rpm=at("shaft_rpm", shaft.time_s)
                )
            )
        if (gate := data.gate) is not None:
            found["gate"] = _predict_drive(gate._replace(more=at("gate_mm", gate.time_s)))
        if (hopper := data.hopper) is not None:
            percent, kg_s, kg = sum_term_flows(every._replace(more=more), hopper.time_s)
            found["scale"] = make_hopper_channel(
                hopper._replace(more_percent=percent, more_kg_s=kg_s, more_kg=kg), self.machine
            ).predict
        if (speed := data.speed) is not None:
            found["speed"] = make_speed_channel(
                speed._replace(more_percent=at("wheel_percent", speed.time_s)), self.machine
            ).predict
        return found


def _predict_drive(drive: Drive) -> Predict:
    run = simulate_drive_rows(drive)
    return lambda plan, step_s: drive.grid.interpolate(run(plan, step_s)[:, 1])
