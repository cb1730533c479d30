"""Safety: states, interlocks, alarms, and the last gate before the drives. Pure; see
docs/safety.md."""

from __future__ import annotations

from control.safety.alarms import ALARMS, AlarmKind
from control.safety.drive_gate import limited, limited_dose, limited_valves
from control.safety.interlocks import INTERLOCKS
from control.safety.limits import DriveLimits, SafetyLimits
from control.safety.memory import Allowances
from control.safety.order_handlers import SETTINGS, BenchRun, BenchSetting, after_setting
from control.safety.watchdog import Safety
from control.safety.words import (
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
