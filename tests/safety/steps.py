"""A machine at work, ticked on an injected clock; and steps of a table of cases: what happens
to such a run, in order, and what must be so after each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from topdress.control.orders import Answer, Do, Order, State, TargetSource
from topdress.control.readings import GnssFix, Measurements, Reading, ValvePositions
from topdress.control.safety import Safety, SafetyLimits, SafetySituation, SafetyVerdict

Step = Callable[[Any], None]
NEVER = object()  # in place of an age: never received


def good_situation(now_s: float, **changes: Any) -> SafetySituation:
    """All is well at 1.25 m/s due east. `changes`: fields of SafetySituation, or of the machine by
    the names below.

    speed_mps, gnss_mps, wheel_mps, course_deg, hopper_kg, supply_v, work_switch, fix_quality,
    drive_fault, drive_stopped, old_orders, heads_heard, ndvi, shaft_rpm, opening_mm, valves
    (read open or not), and for each sensor an age (gnss_age_s, wheel_age_s, shaft_age_s,
    gate_age_s, scale_age_s, supply_age_s) or NEVER.
    """
    speed = changes.pop("speed_mps", 1.25)
    gnss_mps, wheel_mps = changes.pop("gnss_mps", speed), changes.pop("wheel_mps", speed)
    course, quality = changes.pop("course_deg", 90.0), changes.pop("fix_quality", 4)
    hopper_kg, switch = changes.pop("hopper_kg", 200.0), changes.pop("work_switch", None)
    heard, ndvi = changes.pop("heads_heard", 6), changes.pop("ndvi", 0.5)
    rpm, opening_mm = changes.pop("shaft_rpm", 70.0), changes.pop("opening_mm", 15.0)
    valves, supply_v = changes.pop("valves", None), changes.pop("supply_v", 13.5)
    seen = None if valves is None else ValvePositions(now_s, valves)
    faults = {
        name: changes.pop(name, False)
        for name in ("drive_fault", "drive_stopped", "old_orders", "control_failed")
    }
    faults["log_cut"] = changes.pop("log_cut", "")
    faults["put_aside"] = changes.pop("put_aside", ())
    ages = {
        name: changes.pop(f"{name}_age_s", 0.0)
        for name in ("gnss", "wheel", "shaft", "gate", "scale", "supply")
    }

    def reading(name: str, value: float) -> Reading | None:
        return None if ages[name] is NEVER else Reading(value, now_s - ages[name])

    fix = (
        None
        if ages["gnss"] is NEVER
        else GnssFix(
            now_s - ages["gnss"], 40.0, 116.0, quality, speed_mps=gnss_mps, heading_deg=course
        )
    )
    s = SafetySituation(
        measurements=Measurements(
            now_s,
            ndvi=(Reading(ndvi, now_s),) * heard + (None,) * (6 - heard),
            gnss=fix,
            wheel_speed_mps=reading("wheel", wheel_mps),
            shaft_rpm=reading("shaft", rpm),
            opening_mm=reading("gate", opening_mm),
            hopper_kg=reading("scale", hopper_kg),
            supply_v=reading("supply", supply_v),
            work_switch=switch,
            valves=seen,
            **faults,
        ),
        speed_used_mps=speed,
        gnss_period_s=0.2,
        wheel_standstill=wheel_mps == 0.0,
        target_source=TargetSource.CANOPY,
        position_ok=True,
        landing_inside=True,
        valid_heads=6,
        ndvi_age_s=0.1,
        expected_rate_kg_ha=300.0,
        applied_rate_kg_ha=301.0,
        target_rate_kg_ha=300.0,
        metres_left_m=1234.0,
        usable_speed_mps=None,
        console_age_s=0.1,
        log_ok=True,
    )
    return s._replace(**changes)


class Run:
    """Safety with a clock: orders and ticks."""

    def __init__(
        self, has_work_switch: bool = False, period_s: float = 0.05, **limits: Any
    ) -> None:
        self.limits = replace(SafetyLimits(), **limits)
        self.safety = Safety(self.limits, has_work_switch)
        self.period_s = period_s
        self.ticks = 0
        self.origin_s = 100.0
        self.hopper_kg = 200.0
        self.verdict: SafetyVerdict | None = None

    @property
    def now_s(self) -> float:
        return self.origin_s + self.ticks * self.period_s

    def order(self, do: Do, value: Any = None) -> Answer:
        return self.safety.handle_order(Order(do, value), self.now_s)

    def tick(self, seconds: float = 0.0, **changes: Any) -> SafetyVerdict:
        """One tick, or ticks for so many seconds; the hopper empties unless told otherwise."""
        for _ in range(max(1, round(seconds / self.period_s))):
            self.ticks += 1
            situation = good_situation(self.now_s, **({"hopper_kg": self.hopper_kg} | changes))
            self.hopper_kg -= 0.1 * self.period_s
            self.verdict = self.safety.check_tick(self.now_s, situation)
        assert self.verdict is not None
        return self.verdict

    def until(self, done: Any, most_s: float, **changes: Any) -> float:
        """Seconds ticked until `done(verdict)`, or `most_s` if it never was."""
        begun_s = self.now_s
        while not done(self.tick(**changes)):
            if self.now_s - begun_s >= most_s:
                return most_s
        return self.now_s - begun_s

    def alarm_ids(self) -> list[str]:
        assert self.verdict is not None
        return [a.id for a in self.verdict.alarms]


def tick(
    seconds: float = 0.0,
    *,
    state: State | None = None,
    why_state: str | None = None,
    why: tuple[str, ...] | None = None,
    flows: bool | None = None,
    alarms: tuple[str, ...] | None = None,
    **changes: Any,
) -> Step:
    """Ticks with `changes` of a good situation; then the state, why it is, why nothing flows,
    whether anything does, the alarms, worst first."""

    def step(run: Any) -> None:
        verdict = run.tick(seconds, **changes)
        seen = {
            "state": verdict.state,
            "why_state": verdict.why_state,
            "why": verdict.why_no_flow,
            "flows": verdict.flow_allowed,
            "alarms": tuple(run.alarm_ids()),
        }
        wanted = {
            "state": state,
            "why_state": why_state,
            "why": why,
            "flows": flows,
            "alarms": alarms,
        }
        assert {name: seen[name] for name, value in wanted.items() if value is not None} == {
            name: value for name, value in wanted.items() if value is not None
        }

    return step


def order(do: Do, value: Any = None, refused: str = "") -> Step:
    def step(run: Any) -> None:
        answer = run.order(do, value)
        assert (answer.accepted, answer.why) == (not refused, refused)

    return step


def creep(
    seconds: float = 0.2,
    why: tuple[str, ...] | None = None,
    flows: bool | None = None,
    **changes: Any,
) -> Step:
    """At walking pace with START held."""

    def step(run: Any) -> None:
        for _ in range(max(1, round(seconds / 0.2))):
            run.order(Do.START, True)
            run.tick(0.2, **({"speed_mps": 0.25} | changes))
        assert why is None or run.verdict.why_no_flow == why
        assert flows is None or run.verdict.flow_allowed is flows

    return step


def stop_and_go(course_deg: float, **wanted: Any) -> Step:
    def step(run: Any) -> None:
        run.tick(2.0, speed_mps=0.0, course_deg=course_deg)
        tick(0.5, course_deg=course_deg, **wanted)(run)

    return step


def play(run: Any, steps: tuple[Step, ...]) -> None:
    for step in steps:
        step(run)
