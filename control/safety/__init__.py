"""Safety: states, interlocks, alarms, and the last gate before the drives. Pure; see
docs/safety.md."""

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
