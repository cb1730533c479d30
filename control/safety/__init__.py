"""Decides whether material may flow: states, interlocks, alarms, and the last check before the
drives. Pure; see docs/safety.md.

Files:

- `alarm_conditions`: Which alarms have their cause in this tick?
- `alarms`: Which alarms exist, and what is their life cycle?
- `drive_gate`: Which command may be sent to a drive?
- `interlocks`: What forbids flow in this tick?
- `limits`: Which time-outs and thresholds do the safety rules use?
- `memory`: What does safety remember between ticks?
- `motion`: Has the machine started, since when does it stand, and does it reverse?
- `order_handlers`: What does each of the operator's orders to safety need, and why is it refused?
- `safety_interface`: Which values does safety exchange with the loop?
- `sensor_validity`: Which sensors can be trusted in this tick?
- `standstill_monitor`: Do shaft, gate and valves stand while they are commanded to?
- `watchdog`: In which state is the machine, and may material flow?
- `work_watch`: Do shaft and gate follow at work, is the rate on its target
"""

from __future__ import annotations

from topdress.control.safety.alarms import ALARMS, AlarmKind
from topdress.control.safety.drive_gate import limit_command, limit_dose, limit_valves
from topdress.control.safety.interlocks import INTERLOCKS
from topdress.control.safety.limits import (
    LOW_SUPPLY_SHARE,
    DriveLimits,
    SafetyLimits,
    select_machine_limits,
)
from topdress.control.safety.memory import Allowances
from topdress.control.safety.order_handlers import (
    BENCH_ORDERS,
    BenchRun,
    BenchSetting,
    apply_bench_order,
)
from topdress.control.safety.safety_interface import (
    POWERED_STATES,
    REFUSALS,
    STATE_REASONS,
    PreviousCommands,
    SafetySituation,
    SafetyVerdict,
    make_refusal,
    read_refusal,
)
from topdress.control.safety.watchdog import Safety

__all__ = [
    "ALARMS",
    "BENCH_ORDERS",
    "INTERLOCKS",
    "LOW_SUPPLY_SHARE",
    "POWERED_STATES",
    "REFUSALS",
    "STATE_REASONS",
    "AlarmKind",
    "Allowances",
    "BenchRun",
    "BenchSetting",
    "DriveLimits",
    "PreviousCommands",
    "Safety",
    "SafetyLimits",
    "SafetySituation",
    "SafetyVerdict",
    "apply_bench_order",
    "limit_command",
    "limit_dose",
    "limit_valves",
    "make_refusal",
    "read_refusal",
    "select_machine_limits",
]
