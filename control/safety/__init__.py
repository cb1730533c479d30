"""Safety: states, interlocks, alarms, and the last gate before the drives. Pure; see
docs/safety.md.

Files:

- `alarm_conditions`: The table of losses: which alarms have their cause at this tick
- `alarms`: The published list of alarms, and how they live
- `drive_gate`: The last gate before every drive
- `interlocks`: What forbids flow at this tick
- `limits`: Every time-out and threshold of the safety rules, with its unit in its name
- `memory`: All that safety remembers from one tick to the next, in one frozen value
- `motion`: What must be remembered of the movement
- `order_handlers`: The operator's orders that concern safety
- `sensor_validity`: Which of the sensors can be believed at this tick
- `standstill_monitor`: Do the drives stand while they are commanded to?
- `watchdog`: `Safety`: the one object the loop talks to
- `words`: The words of this package
- `work_watch`: What is watched at work: do shaft and gate follow, is the rate on its target
"""

from __future__ import annotations

from topdress.control.safety.alarms import ALARMS, AlarmKind
from topdress.control.safety.drive_gate import limited, limited_dose, limited_valves
from topdress.control.safety.interlocks import INTERLOCKS
from topdress.control.safety.limits import DriveLimits, SafetyLimits
from topdress.control.safety.memory import Allowances
from topdress.control.safety.order_handlers import SETTINGS, BenchRun, BenchSetting, after_setting
from topdress.control.safety.watchdog import Safety
from topdress.control.safety.words import (
    POWERED,
    REFUSALS,
    STATE_REASONS,
    Commanded,
    Situation,
    Verdict,
    read_refusal,
    refusal,
)

__all__ = [
    "ALARMS",
    "INTERLOCKS",
    "POWERED",
    "REFUSALS",
    "SETTINGS",
    "STATE_REASONS",
    "AlarmKind",
    "Allowances",
    "BenchRun",
    "BenchSetting",
    "Commanded",
    "DriveLimits",
    "Safety",
    "SafetyLimits",
    "Situation",
    "Verdict",
    "after_setting",
    "limited",
    "limited_dose",
    "limited_valves",
    "read_refusal",
    "refusal",
]
