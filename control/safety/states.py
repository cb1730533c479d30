"""The states and what moves between them: troubles and time at each tick, orders in between.

    off -> ready -> working <-> held -> ready / off, calibrating from ready, fault from anywhere but off
"""
from __future__ import annotations

from collections.abc import Mapping

from control.orders import State
from control.safety.alarms import ALARMS
from control.safety.limits import SafetyLimits
from control.safety.memory import Memory
from control.safety.motion import Motion
from control.safety.senses import lasted
from control.safety.words import Details, Situation


def after_tick(m: Memory, now_s: float, s: Situation, motion: Motion, troubles: Mapping[str, Details],
               limits: SafetyLimits) -> tuple[State, str]:
    """The state after this tick and what led to it. Fault before off, off before held.

    No tick leaves fault, and a tick leaves held only for fault, or for off when no console came back.
    """
    if m.state is State.OFF:
        return m.state, m.why_state
    cause = leading_to(troubles, State.FAULT)
    if m.state is State.FAULT or cause is not None:
        return State.FAULT, m.why_state if m.state is State.FAULT else cause or ""
    if s.console_age_s is not None and s.console_age_s > limits.console_off_s:
        return State.OFF, "console_gone"
    if m.state is State.CALIBRATING:
        return _calibrating(m, now_s, limits)
    if m.state is State.WORKING:
        return _working(m, now_s, motion, troubles, limits)
    return m.state, m.why_state


def leading_to(troubles: Mapping[str, Details], state: State) -> str | None:
    """The first trouble whose alarm leads to `state`, or None."""
    return next((i for i in troubles if ALARMS[i].leads_to is state), None) if troubles else None


def _calibrating(m: Memory, now_s: float, limits: SafetyLimits) -> tuple[State, str]:
    if not now_s - m.calibrate_s < limits.calibrate_confirm_s:
        return State.READY, "released"
    if not now_s < m.calibrate_until_s:
        return State.READY, "calibration_time"
    return m.state, m.why_state


def _working(m: Memory, now_s: float, motion: Motion, troubles: Mapping[str, Details],
             limits: SafetyLimits) -> tuple[State, str]:
    cause = leading_to(troubles, State.HELD)
    if cause is not None:
        return State.HELD, cause
    if motion.standing_since_s is not None and lasted(max(motion.standing_since_s, m.entered_s), now_s,
                                                      limits.standstill_hold_s):
        return State.HELD, "standstill"
    return m.state, m.why_state
