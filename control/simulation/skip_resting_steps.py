"""Which model steps need not be computed? Those of drives that rest: they repeat the tick's
first step.

The result is the same to the last bit, so that a run's rows are unchanged. A machine that
stands, or works at one speed, takes a quarter of the steps' time."""

from __future__ import annotations

from topdress.control.machine.flow import Flow, FlowState
from topdress.control.machine.gate import GateState
from topdress.control.machine.shaft import ShaftState


def is_drive_resting(
    shaft_was: ShaftState, shaft: ShaftState, gate_was: GateState, gate: GateState
) -> bool:
    """Returns whether further steps with the same inputs leave both drives unchanged: no command
    is pending, and neither moved."""
    return (
        shaft.rpm == shaft_was.rpm
        and shaft.rpm_s == shaft_was.rpm_s
        and shaft.line.in_force == shaft.line.newest
        and gate.driven_mm == gate_was.driven_mm
        and gate.carried_mm == gate_was.carried_mm
        and gate.line.in_force == gate.line.newest
        and gate.driven_mm == gate.line.values[gate.line.newest]
    )


def advance_resting(
    shaft: ShaftState, gate: GateState, dt_s: float
) -> tuple[ShaftState, GateState]:
    """Returns resting drives a step later."""
    return (
        ShaftState(shaft.time_s + dt_s, shaft.rpm, shaft.line, shaft.rpm_s),
        GateState(
            gate.time_s + dt_s, gate.driven_mm, gate.carried_mm, gate.travelled_mm, gate.line
        ),
    )


def is_hopper_unchanged(flow: Flow, shaft_rpm: float, refill_kg: float) -> bool:
    """Returns whether nothing leaves the hopper and nothing is filled in."""
    return shaft_rpm == 0.0 and refill_kg == 0.0 and flow.leak_kg_h == 0.0


def advance_idle_hopper(flow: FlowState, dt_s: float) -> FlowState:
    """Returns an unchanged hopper a step later."""
    return FlowState(flow.time_s + dt_s, flow.hopper_kg, flow.angle_rev, flow.refills)
