"""The control loop once more over the measurements of a log, with the operator's recorded orders."""
from __future__ import annotations

from collections.abc import Iterator

from control.loop import Tick
from control.orders import Do, Order, State
from control.simulation.assembly import control_loop
from drivers.files.read_log import RunLog
from drivers.files.replay import measurements
from drivers.files.setup import Setup

MOVES_MPS = 0.6


def rerun(recorded: RunLog, setup: Setup) -> Iterator[Tick]:
    """A tick a row. Orders come from the log's events; a log without any gets ready and start when it moves."""
    loop = control_loop(setup.machine, setup.crop, setup.rule, setup.job)
    orders = [parse_events(text) for text in recorded.texts("events")]
    own = any(orders)
    state = State.OFF.value
    speed = 0.0
    for at, m in zip(orders, measurements(recorded), strict=True):
        given = at if own else _operator(state, speed)
        for order in given:
            loop.order(order)
        tick = loop.tick(m)
        state, speed = tick.row.state or state, tick.sensed.speed_mps or 0.0
        yield tick


def parse_events(text: object) -> list[Order]:
    """Orders in a log's events cell; what is no order (marks, notes) is left out."""
    found: list[Order] = []
    for part in str(text or "").split(";"):
        word, _, value = part.strip().partition(" ")
        if word in list(Do) and word not in (Do.MARK, Do.ACKNOWLEDGE):
            found.append(Order(Do(word), _value(value)))
    return found


def _value(text: str) -> str | float | bool | None:
    if text in ("", "None"):
        return None
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text)
    except ValueError:
        return text


def _operator(state: str, speed_mps: float) -> list[Order]:
    if state == State.OFF:
        return [Order(Do.READY)]
    if state == State.READY and speed_mps > MOVES_MPS:
        return [Order(Do.START)]
    return []
