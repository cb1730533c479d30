"""In which state is the machine, and may material flow? `Safety` is the only object that the
loop calls; it holds one frozen memory and replaces it whole.

Transitions: causes of alarms and time at each tick, orders in between.

    off -> ready -> working <-> held -> ready / off, calibrating from ready,
    fault from anywhere but off"""

from __future__ import annotations

from collections.abc import Mapping

from topdress.control.orders import Answer, Order, State
from topdress.control.safety.alarm_conditions import ConditionFacts, find_causes
from topdress.control.safety.alarms import ALARMS, update_alarms
from topdress.control.safety.interlocks import find_interlocks
from topdress.control.safety.limits import SafetyLimits
from topdress.control.safety.memory import SafetyMemory
from topdress.control.safety.motion import MotionState, update_motion
from topdress.control.safety.order_handlers import handle_order
from topdress.control.safety.safety_interface import Details, SafetySituation, SafetyVerdict
from topdress.control.safety.sensor_validity import (
    ValidReadings,
    find_since_s,
    has_lasted,
    judge_readings,
)
from topdress.control.safety.standstill_monitor import update_standstill
from topdress.control.safety.work_watch import watch_drives, watch_hopper, watch_rate


class Safety:
    """Runs states, interlocks and alarms of one run. All times are seconds on the loop's clock.

    `has_work_switch`: whether a switch is fitted, so that its silence counts as raised.
    """

    def __init__(self, limits: SafetyLimits | None = None, has_work_switch: bool = False) -> None:
        self._limits = limits if limits is not None else SafetyLimits()
        self._has_work_switch = has_work_switch
        self._memory = SafetyMemory()

    @property
    def memory(self) -> SafetyMemory:
        """Returns the present memory, which is frozen."""
        return self._memory

    @property
    def state(self) -> State:
        return self._memory.state

    def start_is_held(self, now_s: float) -> bool:
        """Returns whether START was reported as held recently enough to count as held."""
        return now_s - self._memory.start_held_s < self._limits.launch_confirm_s

    def handle_order(self, order: Order, now_s: float) -> Answer:
        """Executes or refuses an order on state, alarms or permissions, with immediate effect.

        `read_refusal` reads `Answer.why`. Orders for other packages are answered with
        `not_for_safety`.
        """
        self._memory, answer = handle_order(self._memory, order, now_s, self._limits)
        return answer

    def check_tick(self, now_s: float, s: SafetySituation) -> SafetyVerdict:
        """Processes one tick: changes the state, updates the alarms, and decides whether
        material may flow."""
        m, limits = self._memory, self._limits
        seen = judge_readings(now_s, s, limits)
        start_held = m.state is State.WORKING and self.start_is_held(now_s)
        wheel_dead = s.wheel_standstill or seen.wheel_speed_mps is None
        by_gnss = m.allow.no_wheel and wheel_dead and _can_gnss_serve(s, seen, limits)
        if by_gnss:
            s = s._replace(wheel_standstill=False)
        motion = update_motion(
            m.motion, now_s, s, seen, m.allow.reverse, limits, start_held, by_gnss
        )
        at_work = m.flowing and m.state is State.WORKING
        beyond_range = m.state is State.WORKING and motion.moving and s.range_breach is not None
        m = m._replace(
            motion=motion,
            rate=watch_rate(m.rate, now_s, s, at_work, limits),
            follow=watch_drives(m.follow, now_s, s, seen, at_work, limits),
            hopper=watch_hopper(m.hopper, now_s, seen.hopper_kg, limits),
            stand=update_standstill(m.stand, now_s, s, seen, limits),
            scale_heard=m.scale_heard or seen.hopper_kg is not None,
            heads_full_since_s=find_since_s(m.heads_full_since_s, now_s, seen.heads_full),
            supply_low_since_s=find_since_s(
                m.supply_low_since_s,
                now_s,
                seen.supply_v is not None and seen.supply_v < limits.supply_low_v,
            ),
            beyond_range_since_s=find_since_s(m.beyond_range_since_s, now_s, beyond_range),
        )
        found = find_causes(ConditionFacts(m, now_s, s, seen, limits))
        state, why = find_next_state(m, now_s, s, motion, found, limits)
        allow = m.allow._replace(unlogged=False) if s.log_ok and m.allow.unlogged else m.allow
        if state is State.OFF and m.state is not State.OFF:
            allow = SafetyMemory().allow
        forbidden = find_interlocks(
            state,
            s,
            seen,
            motion,
            allow,
            self._has_work_switch,
            "rate_below_range" in found,
            limits,
        )
        live = update_alarms(m.live, now_s, found, limits.alarm_clear_s)
        self._memory = m._replace(
            state=state,
            why_state=why,
            entered_s=m.entered_s if state is m.state else now_s,
            allow=allow,
            flowing=not forbidden,
            live=live,
            checked_s=now_s,
            still=_is_still(seen, limits),
            fault_cause=find_cause_leading_to(found, State.FAULT),
            log_ok=s.log_ok,
        )
        return SafetyVerdict(
            state, not forbidden, forbidden, tuple([entry.alarm for entry in live]), why
        )


def _can_gnss_serve(s: SafetySituation, seen: ValidReadings, limits: SafetyLimits) -> bool:
    """Returns whether GNSS alone can measure the machine's speed."""
    return (
        seen.gnss_speed_mps is not None
        and s.gnss_period_s <= limits.gnss_alone_period_s
        and s.speed_doubt is None
    )


def _is_still(seen: ValidReadings, limits: SafetyLimits) -> bool:
    wheel, gnss = seen.wheel_speed_mps, seen.gnss_speed_mps
    if wheel is None or gnss is None:
        known = gnss if wheel is None else wheel
        return (
            known is not None
            and not limits.both_speeds_to_start
            and known < limits.calibrate_speed_mps
        )
    return wheel < limits.calibrate_speed_mps and gnss < limits.calibrate_speed_mps


def find_next_state(
    m: SafetyMemory,
    now_s: float,
    s: SafetySituation,
    motion: MotionState,
    troubles: Mapping[str, Details],
    limits: SafetyLimits,
) -> tuple[State, str]:
    """Returns the state after this tick and its reason. Fault has priority over off, off over held.

    No tick leaves fault. A tick leaves held only for fault, or for off when no console has
    returned.
    """
    if m.state is State.OFF:
        return m.state, m.why_state
    cause = find_cause_leading_to(troubles, State.FAULT)
    if m.state is State.FAULT or cause is not None:
        return State.FAULT, m.why_state if m.state is State.FAULT else cause or ""
    if s.console_age_s is not None and s.console_age_s > limits.console_off_s:
        return State.OFF, "console_gone"
    if m.state is State.CALIBRATING:
        return _leave_calibrating(m, now_s, limits)
    if m.state is State.WORKING:
        return _leave_working(m, now_s, motion, troubles, limits)
    return m.state, m.why_state


def find_cause_leading_to(troubles: Mapping[str, Details], state: State) -> str | None:
    """Returns the first alarm with a cause that leads to `state`, or None."""
    return next((i for i in troubles if ALARMS[i].leads_to is state), None) if troubles else None


def _leave_calibrating(m: SafetyMemory, now_s: float, limits: SafetyLimits) -> tuple[State, str]:
    if not now_s - m.calibrate_s < limits.calibrate_confirm_s:
        return State.READY, "released"
    if not now_s < m.calibrate_until_s:
        return State.READY, "calibration_time"
    return m.state, m.why_state


def _leave_working(
    m: SafetyMemory,
    now_s: float,
    motion: MotionState,
    troubles: Mapping[str, Details],
    limits: SafetyLimits,
) -> tuple[State, str]:
    cause = find_cause_leading_to(troubles, State.HELD)
    if cause is not None:
        return State.HELD, cause
    if motion.standing_since_s is not None and has_lasted(
        max(motion.standing_since_s, m.entered_s), now_s, limits.standstill_hold_s
    ):
        return State.HELD, "standstill"
    return m.state, m.why_state
