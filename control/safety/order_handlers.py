"""What does each of the operator's orders to safety need, and why is it refused?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import NamedTuple

from topdress.control.orders import Answer, Do, Order, State
from topdress.control.safety.alarms import acknowledged, unacknowledged_red
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import Allowances, Memory
from topdress.control.safety.words import refusal

YES = Answer(True)
Outcome = tuple[Memory, Answer]


def after_order(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Returns the memory after an order, and the answer. A refused order changes no state."""
    handler = _HANDLERS.get(order.do)
    if handler is None:
        return m, _no("not_for_safety")
    return handler(m, order, now_s, limits)


def _no(message_id: str, **details: str | float) -> Answer:
    return Answer(False, refusal(message_id, **details))


def _wrong_state(m: Memory) -> Outcome:
    return m, _no("not_from_state", state=m.state.value)


def _entered(m: Memory, state: State, why: Do, now_s: float) -> Memory:
    return m._replace(state=state, why_state=why.value, entered_s=now_s, flowing=False)


def _ready(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if m.state is State.READY:
        return m, YES
    if m.state not in (State.OFF, State.HELD, State.FAULT):
        return _wrong_state(m)
    if m.fault_cause is not None:
        return m, _no("cause_lives", alarm=m.fault_cause)
    if m.state is State.OFF:
        return _entered(m, State.READY, order.do, now_s)._replace(left_off_s=now_s), YES
    return _entered(m, State.READY, order.do, now_s), YES


def _start(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles START. True: the button is down, and the console repeats the order. A press that
    outlived work does not resume it: leaving held needs a new press."""
    held_down = now_s - m.start_held_s < limits.launch_confirm_s
    if order.value is True:
        m = m._replace(start_held_s=now_s)
    if m.state is State.WORKING:
        return m, YES
    if order.value is True and held_down and m.why_state != Do.READY.value:
        return m, _no("start_held")
    if m.state not in (State.READY, State.HELD):
        return _wrong_state(m)
    alarm = unacknowledged_red(m.live)
    if alarm is not None:
        return m, _no("acknowledge_first", alarm=alarm)
    return _entered(m, State.WORKING, order.do, now_s), YES


def _hold(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles HOLD, which also ends calibrating and returns to ready."""
    if m.state is State.HELD:
        return m, YES
    if m.state is State.WORKING:
        return _entered(m, State.HELD, order.do, now_s), YES
    if m.state is State.CALIBRATING:
        return _entered(m, State.READY, order.do, now_s), YES
    return _wrong_state(m)


def _stop(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if m.state is State.OFF:
        return m._replace(allow=Allowances()), YES
    return _entered(m, State.OFF, order.do, now_s)._replace(
        allow=Allowances(), fault_cause=None
    ), YES


def _calibrate(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Begins a calibrating run or keeps it going: the console repeats the order while the button
    is down.

    A run that ended by itself does not begin again under a button that was never released."""
    wanted_s = limits.calibrate_max_s if order.value is None else _number(order.value)
    if wanted_s is None or not 0.0 < wanted_s <= limits.calibrate_max_s:
        return m, _no("calibrate_seconds", max_s=limits.calibrate_max_s)
    held_down = now_s - m.calibrate_s < limits.calibrate_confirm_s
    down = m._replace(calibrate_s=now_s)
    if m.state is State.CALIBRATING:
        return (down, YES) if held_down else (m, _no("release_first"))
    if m.state is not State.READY:
        return down, _no("not_from_state", state=m.state.value)
    if held_down:
        return down, _no("release_first")
    alarm = unacknowledged_red(m.live)
    if alarm is not None:
        return down, _no("acknowledge_first", alarm=alarm)
    if not m.still or not now_s - m.checked_s <= limits.calibrate_confirm_s:
        return down, _no("calibrate_moving", speed_mps=limits.calibrate_speed_mps)
    return _entered(down, State.CALIBRATING, order.do, now_s)._replace(
        calibrate_until_s=now_s + wanted_s
    ), YES


def _release(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles the release of the button, which is always accepted: after a run that ended by
    itself the button is released too."""
    up = m._replace(calibrate_s=Memory().calibrate_s)
    return (_entered(up, State.READY, order.do, now_s) if m.state is State.CALIBRATING else up), YES


def _acknowledge(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    wanted = "" if order.value is None else str(order.value)
    if wanted and all(entry.alarm.id != wanted for entry in m.live):
        return m, _no("no_such_alarm", alarm=wanted.replace(";", " "))
    return m._replace(live=acknowledged(m.live, wanted)), YES


def _allow(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if not isinstance(order.value, bool):
        return m, _no("yes_or_no")
    return m._replace(allow=m.allow._replace(**{_ALLOWED[order.do]: order.value})), YES


def _go_on_unlogged(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if order.value is True and m.log_ok:
        return m, _no("log_works")
    return _allow(m, order, now_s, limits)


def _refill(m: Memory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    kg = None if order.value is None else _number(order.value)
    if kg is None or not kg > 0.0:
        return m, _no("refill_kg")
    return m, YES


def _number(value: str | float | bool) -> float | None:
    if isinstance(value, bool | str):
        return None
    return float(value) if isfinite(value) else None


_ALLOWED = {
    Do.ALLOW_REVERSE: "reverse",
    Do.ALLOW_OUTSIDE: "outside",
    Do.ALLOW_MAP_ELSEWHERE: "map_elsewhere",
    Do.ALLOW_NO_WHEEL: "no_wheel",
    Do.GO_ON_UNLOGGED: "unlogged",
}
_HANDLERS: Mapping[Do, Callable[[Memory, Order, float, SafetyLimits], Outcome]] = {
    Do.READY: _ready,
    Do.START: _start,
    Do.HOLD: _hold,
    Do.STOP: _stop,
    Do.CALIBRATE: _calibrate,
    Do.RELEASE: _release,
    Do.ACKNOWLEDGE: _acknowledge,
    **dict.fromkeys(_ALLOWED, _allow),
    Do.GO_ON_UNLOGGED: _go_on_unlogged,
    Do.REFILL: _refill,
}


SETTINGS = (Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING)


class BenchSetting(NamedTuple):
    """Holds the wanted set-points of a calibrating run, before the drives' limits. A run begins
    with a standing shaft and the gate where it is."""

    shaft_rpm: float = 0.0
    # None: the gate stays.
    opening_mm: float | None = None


class BenchRun(NamedTuple):
    """Holds a calibrating run as the console shows it."""

    # Set-points as they were sent.
    shaft_rpm: float
    opening_mm: float
    elapsed_s: float
    left_s: float


def after_setting(setting: BenchSetting, order: Order, state: State) -> tuple[BenchSetting, Answer]:
    """Returns the set-points after one of `SETTINGS`. It is refused unless calibrating, and for
    a value that is not a number of at least 0.

    A number above the drives' limits is accepted and cut by the last gate (`limited`); the frame
    shows the set-points that were sent."""
    if state is not State.CALIBRATING:
        return setting, Answer(False, refusal("not_from_state", state=state.value))
    value = order.value
    if isinstance(value, bool | str) or value is None or not (isfinite(value) and value >= 0.0):
        return setting, Answer(False, refusal("calibrate_setting"))
    if order.do is Do.CALIBRATE_SHAFT:
        return setting._replace(shaft_rpm=float(value)), Answer(True)
    return setting._replace(opening_mm=float(value)), Answer(True)
