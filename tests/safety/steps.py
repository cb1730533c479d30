"""Steps of a table of cases: what happens to a run of safety, in order, and what must be so after each."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from control.orders import Do, State

Step = Callable[[Any], None]
NEVER = object()    # in place of an age: never received


def tick(seconds: float = 0.0, *, state: State | None = None, why_state: str | None = None,
         why: tuple[str, ...] | None = None, flows: bool | None = None, alarms: tuple[str, ...] | None = None,
         **changes: Any) -> Step:
    """Ticks with `changes` of a good situation; then the state, why it is, why nothing flows, whether anything does,
    the alarms, worst first."""
    def step(run: Any) -> None:
        verdict = run.tick(seconds, **changes)
        seen = {"state": verdict.state, "why_state": verdict.why_state, "why": verdict.why_no_flow,
                "flows": verdict.flow_allowed, "alarms": tuple(run.alarm_ids())}
        wanted = {"state": state, "why_state": why_state, "why": why, "flows": flows, "alarms": alarms}
        assert {name: seen[name] for name, value in wanted.items() if value is not None} == {
            name: value for name, value in wanted.items() if value is not None}
    return step


def order(do: Do, value: Any = None, refused: str = "") -> Step:
    def step(run: Any) -> None:
        answer = run.order(do, value)
        assert (answer.accepted, answer.why) == (not refused, refused)
    return step


def creep(seconds: float = 0.2, why: tuple[str, ...] | None = None, flows: bool | None = None, **changes: Any) -> Step:
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
