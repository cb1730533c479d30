"""How do shaft, gate and flow of a control tick run compiled, for long simulations?

The steps are the stages' own; compiled, interpreted and over logs they agree to the last bit.
Changing state is stored in arrays, because passing the stages' named tuples at each tick would take
longer than the steps. Importing this module loads the compiler.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .compiled import compile_function, mark_compilable, to_fixed_tuple
from .flow import Flow, FlowInput, FlowState, step_flow
from .gate import Gate, GateInput, GateOutput, GateState, step_gate
from .model_elements import LINE_SIZE, Array, DelayLine
from .shaft import Shaft, ShaftInput, ShaftOutput, ShaftState, step_shaft
from .term_sums import NO_TERMS, TermTotals

_SHAFT_FIELD_COUNT, _GATE_FIELD_COUNT, _FLOW_FIELD_COUNT = (
    len(Shaft._fields),
    len(Gate._fields),
    len(Flow._fields),
)
# Layout of the stored numbers: time, speed, newest and current index of the shaft; time, driven,
# carried, travelled, newest and current index of the gate; two outputs of each; the flow's state;
# the rate of change of the shaft's speed. The delay lines hold times and values of the shaft, then
# of the gate.
_STATE_COUNT, _OUTPUT_INDEX, _HOPPER_INDEX, _SLOPE_INDEX = 19, 10, 14, 18


@mark_compilable
def _unpack_shaft(kept: Any, lines: Any) -> Any:
    return ShaftState(
        kept[0],
        kept[1],
        DelayLine(lines[0], lines[1], int(kept[2]), int(kept[3])),
        kept[_SLOPE_INDEX],
    )


@mark_compilable
def _unpack_gate(kept: Any, lines: Any) -> Any:
    return GateState(
        kept[4],
        kept[5],
        kept[6],
        kept[7],
        DelayLine(lines[2], lines[3], int(kept[8]), int(kept[9])),
    )


@mark_compilable
def _pack_states(kept: Any, shaft: Any, gate: Any, turned: Any, stood: Any) -> None:
    kept[0], kept[1], kept[2], kept[3] = (
        shaft.time_s,
        shaft.rpm,
        shaft.line.newest,
        shaft.line.in_force,
    )
    kept[4], kept[5], kept[6], kept[7] = (
        gate.time_s,
        gate.driven_mm,
        gate.carried_mm,
        gate.travelled_mm,
    )
    kept[_SLOPE_INDEX] = shaft.rpm_s
    kept[8], kept[9] = gate.line.newest, gate.line.in_force
    kept[10], kept[11], kept[12], kept[13] = (
        turned.rpm,
        turned.measured_rpm,
        stood.opening_mm,
        stood.measured_mm,
    )


@compile_function
def step_drives(
    of_shaft: Any,
    of_gate: Any,
    kept: Any,
    lines: Any,
    rpm: float,
    opening_mm: float,
    supply_v: float,
    pitch_deg: float,
    more: Any,
    dt_s: float,
) -> tuple[float, float]:
    """Advances both drives by one step, and returns true speed and opening at its end.

    more: sums of the terms, % and r/min of the shaft, mm of the gate.
    """
    shafts, gates = (
        Shaft(*to_fixed_tuple(of_shaft, _SHAFT_FIELD_COUNT)),
        Gate(*to_fixed_tuple(of_gate, _GATE_FIELD_COUNT)),
    )
    shaft, turned = step_shaft(
        shafts,
        _unpack_shaft(kept, lines),
        ShaftInput(rpm, kept[12], supply_v, more[0], more[1], pitch_deg),
        dt_s,
    )
    gate, stood = step_gate(gates, _unpack_gate(kept, lines), GateInput(opening_mm, more[2]), dt_s)
    _pack_states(kept, shaft, gate, turned, stood)
    return turned.rpm, stood.opening_mm


@compile_function
def step_tick(
    of_shaft: Any,
    of_gate: Any,
    of_flow: Any,
    kept: Any,
    lines: Any,
    rpm: Any,
    opening_mm: float,
    supply_v: float,
    pitch_deg: float,
    refill_kg: float,
    more: Any,
    dt_s: float,
) -> float:
    """Runs the model steps of a tick, and returns the mean flow, kg/s.

    rpm: command of each step. more: sums of the terms as for `step_drives`, then % and kg/s of the
    flow.
    """
    shafts, gates = (
        Shaft(*to_fixed_tuple(of_shaft, _SHAFT_FIELD_COUNT)),
        Gate(*to_fixed_tuple(of_gate, _GATE_FIELD_COUNT)),
    )
    flows = Flow(*to_fixed_tuple(of_flow, _FLOW_FIELD_COUNT))
    shaft, gate = _unpack_shaft(kept, lines), _unpack_gate(kept, lines)
    hopper = FlowState(kept[14], kept[15], kept[16], kept[17])
    turned, stood = ShaftOutput(kept[10], kept[11]), GateOutput(kept[12], kept[13])
    total = 0.0
    for k in range(len(rpm)):
        shaft, turned = step_shaft(
            shafts,
            shaft,
            ShaftInput(rpm[k], stood.opening_mm, supply_v, more[0], more[1], pitch_deg),
            dt_s,
        )
        gate, stood = step_gate(gates, gate, GateInput(opening_mm, more[2]), dt_s)
        hopper, flow = step_flow(
            flows,
            hopper,
            FlowInput(turned.rpm, stood.opening_mm, pitch_deg, refill_kg, more[3], more[4]),
            dt_s,
        )
        refill_kg = 0.0
        total += flow.flow_kg_s
    _pack_states(kept, shaft, gate, turned, stood)
    kept[14], kept[15], kept[16], kept[17] = (
        hopper.time_s,
        hopper.hopper_kg,
        hopper.angle_rev,
        hopper.refills,
    )
    return total / len(rpm)


def _make_numbers(stage: Any) -> Array:
    return np.array([float(value) for value in stage])


class TickResult(NamedTuple):
    """Holds the result of a tick."""

    # Mean flow over the tick, kg/s.
    flow_kg_s: float
    shaft: ShaftOutput
    gate: GateOutput
    hopper: FlowState


class CompiledDrives:
    """Advances the drives of one machine and its hopper. `shaft`, `gate`: initial positions at
    rest, under a constant command."""

    def __init__(self, shaft: ShaftState, gate: GateState, hopper: FlowState | None = None) -> None:
        self._kept, self._lines = np.zeros(_STATE_COUNT), np.empty((4, LINE_SIZE))
        self._lines[:] = np.array(
            [shaft.line.times_s, shaft.line.values, gate.line.times_s, gate.line.values]
        )
        _pack_states(
            self._kept,
            shaft,
            gate,
            ShaftOutput(shaft.rpm, shaft.rpm),
            GateOutput(gate.driven_mm, gate.driven_mm),
        )
        if hopper is not None:
            self._kept[_HOPPER_INDEX:_SLOPE_INDEX] = hopper
        self._stages: tuple[Shaft, Gate, Flow | None] | None = None
        self._of_shaft = self._of_gate = self._of_flow = np.empty(0)

    def set_stages(self, shaft: Shaft, gate: Gate, flow: Flow | None = None) -> None:
        """Replaces the stages from this time on."""
        stages = shaft, gate, flow
        if stages != self._stages:
            self._stages = stages
            self._of_shaft, self._of_gate, self._of_flow = (
                _make_numbers(one or ()) for one in stages
            )

    def step_drives(
        self,
        rpm: float,
        opening_mm: float,
        supply_v: float,
        dt_s: float,
        more: TermTotals = NO_TERMS,
        pitch_deg: float = 0.0,
    ) -> tuple[float, float]:
        """Returns true speed, r/min, and opening, mm, at the end of a step of `dt_s` seconds."""
        found: tuple[float, float] = step_drives(
            self._of_shaft,
            self._of_gate,
            self._kept,
            self._lines,
            rpm,
            opening_mm,
            supply_v,
            pitch_deg,
            (more.shaft_percent, more.shaft_rpm, more.gate_mm),
            dt_s,
        )
        return found

    def step_tick(
        self,
        rpm: tuple[float, ...],
        opening_mm: float,
        supply_v: float,
        pitch_deg: float,
        refill_kg: float,
        more: TermTotals,
        dt_s: float,
    ) -> TickResult:
        """Runs a step of `dt_s` seconds for each commanded speed."""
        flow = step_tick(
            self._of_shaft,
            self._of_gate,
            self._of_flow,
            self._kept,
            self._lines,
            rpm,
            opening_mm,
            supply_v,
            pitch_deg,
            refill_kg,
            (
                more.shaft_percent,
                more.shaft_rpm,
                more.gate_mm,
                more.flow_percent,
                more.flow_kg_min / 60.0,
            ),
            dt_s,
        )
        kept = self._kept.tolist()
        return TickResult(
            flow,
            ShaftOutput(kept[10], kept[11]),
            GateOutput(kept[12], kept[13]),
            FlowState(*kept[_HOPPER_INDEX:_SLOPE_INDEX]),
        )
