"""Which shaft speed and opening are expected now? The model follows the untrimmed set-points."""

from __future__ import annotations

from typing import Any

from topdress.control.machine.gate import GateInput, make_gate_start, step_gate
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import convert_to_lists
from topdress.control.machine.shaft import ShaftInput, make_shaft_start, step_shaft
from topdress.control.machine.steps import CompiledSteps
from topdress.control.machine.term_sums import NO_TERMS, TermTotals
from topdress.control.metering.inverse_model import Conditions
from topdress.control.metering.strategies import DrivePair
from topdress.control.readings import DriveCommand


class ExpectedDrives:
    """Simulates the drives with the model. `pair`: shaft speed and opening expected now."""

    def __init__(self, machine: Machine, steps: CompiledSteps | None = None) -> None:
        """Creates the drives at rest. steps: compiled steps for long runs."""
        self._machine = machine
        self._steps = steps
        self._drives: Any = None
        self.start_at(machine.set_points.opening_mm, 0.0)

    def start_at(self, opening_mm: float, now_s: float) -> None:
        """Sets a standing shaft and the gate at `opening_mm`."""
        shaft, gate = make_shaft_start(0.0, now_s), make_gate_start(opening_mm, now_s)
        self._shaft, self._gate = (
            shaft._replace(line=convert_to_lists(shaft.line)),
            gate._replace(line=convert_to_lists(gate.line)),
        )
        self.pair = DrivePair(0.0, opening_mm)
        if self._steps is not None:
            self._drives = self._steps.drives(shaft, gate)
            self._drives.set_stages(self._machine.shaft, self._machine.gate)

    def advance_drives(
        self,
        command: DriveCommand,
        conditions: Conditions,
        dt_s: float,
        more: TermTotals = NO_TERMS,
    ) -> None:
        """Advances the drives. `command`: without trims; `conditions`: the supply and the pitch;
        `more`: sums of the machine's terms."""
        if dt_s <= 0.0:
            return
        supply, pitch_deg = conditions.supply_v, conditions.pitch_deg
        if supply is None:
            supply = self._machine.shaft.nominal_supply_v
        if self._drives is not None:
            self.pair = DrivePair(
                *self._drives.step_drives(
                    command.shaft_rpm, command.opening_mm, supply, dt_s, more, pitch_deg
                )
            )
            return
        self._shaft, shaft = step_shaft(
            self._machine.shaft,
            self._shaft,
            ShaftInput(
                command.shaft_rpm,
                self.pair.opening_mm,
                supply,
                more.shaft_percent,
                more.shaft_rpm,
                pitch_deg,
            ),
            dt_s,
        )
        self._gate, gate = step_gate(
            self._machine.gate, self._gate, GateInput(command.opening_mm, more.gate_mm), dt_s
        )
        self.pair = DrivePair(shaft.rpm, gate.opening_mm)
