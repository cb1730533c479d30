"""What does each of the operator's orders to safety need, and why is it refused?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import NamedTuple

from topdress.control.orders import Answer, Do, Order, State
from topdress.control.safety.alarms import acknowledge_alarms, find_unacknowledged_red
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import Allowances, SafetyMemory
from topdress.control.safety.safety_interface import make_refusal

ACCEPTED = Answer(True)
Outcome = tuple[SafetyMemory, Answer]


def handle_order(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Returns the memory after an order, and the answer. A refused order changes no state."""
    handler = _HANDLERS.get(order.do)
    if handler is None:
        return m, _refuse_order("not_for_safety")
    return handler(m, order, now_s, limits)


def _refuse_order(message_id: str, **details: str | float) -> Answer:
    return Answer(False, make_refusal(message_id, **details))


def _refuse_state(m: SafetyMemory) -> Outcome:
    return m, _refuse_order("not_from_state", state=m.state.value)


def _enter_state(m: SafetyMemory, state: State, why: Do, now_s: float) -> SafetyMemory:
    return m._replace(state=state, why_state=why.value, entered_s=now_s, flowing=False)


def _handle_ready(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if m.state is State.READY:
        return m, ACCEPTED
    if m.state not in (State.OFF, State.HELD, State.FAULT):
        return _refuse_state(m)
    if m.fault_cause is not None:
        return m, _refuse_order("cause_lives", alarm=m.fault_cause)
    if m.state is State.OFF:
        return _enter_state(m, State.READY, order.do, now_s)._replace(left_off_s=now_s), ACCEPTED
    return _enter_state(m, State.READY, order.do, now_s), ACCEPTED


def _handle_start(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles START. True means that the button is down; the console repeats the order. A press
    that continued beyond the end of work does not resume work: leaving held requires a new press.
    """
    held_down = now_s - m.start_held_s < limits.launch_confirm_s
    if order.value is True:
        m = m._replace(start_held_s=now_s)
    if m.state is State.WORKING:
        return m, ACCEPTED
    if order.value is True and held_down and m.why_state != Do.READY.value:
        return m, _refuse_order("start_held")
    if m.state not in (State.READY, State.HELD):
        return _refuse_state(m)
    alarm = find_unacknowledged_red(m.live)
    if alarm is not None:
        return m, _refuse_order("acknowledge_first", alarm=alarm)
    return _enter_state(m, State.WORKING, order.do, now_s), ACCEPTED


def _handle_hold(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles HOLD, which also ends calibrating and returns to ready."""
    if m.state is State.HELD:
        return m, ACCEPTED
    if m.state is State.WORKING:
        return _enter_state(m, State.HELD, order.do, now_s), ACCEPTED
    if m.state is State.CALIBRATING:
        return _enter_state(m, State.READY, order.do, now_s), ACCEPTED
    return _refuse_state(m)


def _handle_stop(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if m.state is State.OFF:
        return m._replace(allow=Allowances()), ACCEPTED
    return _enter_state(m, State.OFF, order.do, now_s)._replace(
        allow=Allowances(), fault_cause=None
    ), ACCEPTED


def _handle_calibrate(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Starts or continues a calibrating run: the console repeats the order while the button is
    down.

    A run that ended by itself does not start again under a button that was never released.
    """
    wanted_s = limits.calibrate_max_s if order.value is None else _read_number(order.value)
    if wanted_s is None or not 0.0 < wanted_s <= limits.calibrate_max_s:
        return m, _refuse_order("calibrate_seconds", max_s=limits.calibrate_max_s)
    held_down = now_s - m.calibrate_s < limits.calibrate_confirm_s
    down = m._replace(calibrate_s=now_s)
    if m.state is State.CALIBRATING:
        return (down, ACCEPTED) if held_down else (m, _refuse_order("release_first"))
    if m.state is not State.READY:
        return down, _refuse_order("not_from_state", state=m.state.value)
    if held_down:
        return down, _refuse_order("release_first")
    alarm = find_unacknowledged_red(m.live)
    if alarm is not None:
        return down, _refuse_order("acknowledge_first", alarm=alarm)
    if not m.still or not now_s - m.checked_s <= limits.calibrate_confirm_s:
        return down, _refuse_order("calibrate_moving", speed_mps=limits.calibrate_speed_mps)
    return _enter_state(down, State.CALIBRATING, order.do, now_s)._replace(
        calibrate_until_s=now_s + wanted_s
    ), ACCEPTED


def _handle_release(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    """Handles the release of the button, which is always accepted, also after a run that ended
    by itself."""
    up = m._replace(calibrate_s=SafetyMemory().calibrate_s)
    return (
        _enter_state(up, State.READY, order.do, now_s) if m.state is State.CALIBRATING else up
    ), ACCEPTED


def _handle_acknowledge(
    m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits
) -> Outcome:
    wanted = "" if order.value is None else str(order.value)
    if wanted and all(entry.alarm.id != wanted for entry in m.live):
        return m, _refuse_order("no_such_alarm", alarm=wanted.replace(";", " "))
    return m._replace(live=acknowledge_alarms(m.live, wanted)), ACCEPTED


def _handle_allowance(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if not isinstance(order.value, bool):
        return m, _refuse_order("yes_or_no")
    return m._replace(
        allow=m.allow._replace(**{_ALLOWANCE_FIELDS[order.do]: order.value})
    ), ACCEPTED


def _handle_unlogged(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    if order.value is True and m.log_ok:
        return m, _refuse_order("log_works")
    return _handle_allowance(m, order, now_s, limits)


def _handle_refill(m: SafetyMemory, order: Order, now_s: float, limits: SafetyLimits) -> Outcome:
    kg = None if order.value is None else _read_number(order.value)
    if kg is None or not kg > 0.0:
        return m, _refuse_order("refill_kg")
    return m, ACCEPTED


def _read_number(value: str | float | bool) -> float | None:
    if isinstance(value, bool | str):
        return None
    return float(value) if isfinite(value) else None


_ALLOWANCE_FIELDS = {
    Do.ALLOW_REVERSE: "reverse",
    Do.ALLOW_OUTSIDE: "outside",
    Do.ALLOW_MAP_ELSEWHERE: "map_elsewhere",
    Do.ALLOW_NO_WHEEL: "no_wheel",
    Do.GO_ON_UNLOGGED: "unlogged",
}
_HANDLERS: Mapping[Do, Callable[[SafetyMemory, Order, float, SafetyLimits], Outcome]] = {
    Do.READY: _handle_ready,
    Do.START: _handle_start,
    Do.HOLD: _handle_hold,
    Do.STOP: _handle_stop,
    Do.CALIBRATE: _handle_calibrate,
    Do.RELEASE: _handle_release,
    Do.ACKNOWLEDGE: _handle_acknowledge,
    **dict.fromkeys(_ALLOWANCE_FIELDS, _handle_allowance),
    Do.GO_ON_UNLOGGED: _handle_unlogged,
    Do.REFILL: _handle_refill,
}


BENCH_ORDERS = (Do.CALIBRATE_SHAFT, Do.CALIBRATE_OPENING)


class BenchSetting(NamedTuple):
    """Holds the wanted set-points of a calibrating run, before the drives' limits. A run starts
    with a standing shaft and an unmoved gate."""

    shaft_rpm: float = 0.0
    # Opening, mm; None leaves the gate unmoved.
    opening_mm: float | None = None


class BenchRun(NamedTuple):
    """Holds a calibrating run for the console."""

    # Set-points that were sent.
    shaft_rpm: float
    opening_mm: float
    elapsed_s: float
    left_s: float


def apply_bench_order(
    setting: BenchSetting, order: Order, state: State
) -> tuple[BenchSetting, Answer]:
    """Returns the set-points after one of `BENCH_ORDERS`. The order is refused unless calibrating,
    and for a value that is not a number of at least 0.

    A number above the drives' limits is accepted and limited by the last check (`limit_command`);
    the frame shows the sent set-points.
    """
    if state is not State.CALIBRATING:
        return setting, Answer(False, make_refusal("not_from_state", state=state.value))
    value = order.value
    if isinstance(value, bool | str) or value is None or not (isfinite(value) and value >= 0.0):
        return setting, Answer(False, make_refusal("calibrate_setting"))
    if order.do is Do.CALIBRATE_SHAFT:
        return setting._replace(shaft_rpm=float(value)), Answer(True)
    return setting._replace(opening_mm=float(value)), Answer(True)
