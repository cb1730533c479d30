"""How is the control loop run again on the measurements of a log, with the operator's recorded
orders?
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from topdress.console.services.field import find_job_folder
from topdress.control.field.job import make_rule
from topdress.control.loop import Tick
from topdress.control.orders import Do, Order, State, Strategy
from topdress.control.simulation.assembly import make_control_loop
from topdress.drivers import day_clock
from topdress.drivers.files.config import validate_config
from topdress.drivers.files.config_kinds import CROP_KIND, JOB_KIND, MACHINE_KIND
from topdress.drivers.files.prescriptions.job_targets import read_loop_targets
from topdress.drivers.files.read_log import RunLog
from topdress.drivers.files.replay import iter_measurements
from topdress.drivers.files.run_setup import Setup, load_setup

MIN_MOVING_MPS = 0.6


def rerun_loop(recorded: RunLog, setup: Setup) -> Iterator[Tick]:
    """Yields one tick for each row. Orders come from the log's events; a log without events gets
    ready, and start when the machine moves."""
    loop = make_control_loop(
        setup.machine,
        setup.crop,
        setup.rule,
        setup.job,
        obeyed=False,
        **read_loop_targets(setup.job, setup.folder, setup.machine, setup.crop.index),
    )
    orders = [parse_events(text) for text in recorded.texts("events")]
    own = any(orders)
    state = State.OFF.value
    speed = 0.0
    for at, m in zip(orders, iter_measurements(recorded), strict=True):
        given = at if own else _decide_operator_orders(state, speed)
        for order in given:
            loop.handle_order(order)
        tick = loop.run_tick(m)
        state, speed = tick.row.state or state, tick.sensed.speed_mps or 0.0
        yield tick


def parse_events(text: object) -> list[Order]:
    """Returns the orders in a log's events cell; other events (marks, notes) are omitted."""
    found: list[Order] = []
    for part in str(text or "").split(";"):
        word, _, value = part.strip().partition(" ")
        if word in list(Do) and word not in (Do.MARK, Do.ACKNOWLEDGE):
            found.append(Order(Do(word), _parse_order_value(value)))
    return found


def _parse_order_value(text: str) -> str | float | bool | None:
    if text in ("", "None"):
        return None
    if text in ("True", "False"):
        return text == "True"
    try:
        return float(text)
    except ValueError:
        return text


def _decide_operator_orders(state: str, speed_mps: float) -> list[Order]:
    if state == State.OFF:
        return [Order(Do.READY)]
    if state == State.READY and speed_mps > MIN_MOVING_MPS:
        return [Order(Do.START)]
    return []


def load_rerun_setup(
    recorded: RunLog, machine: str | None, job: str | None, strategy: Strategy | None
) -> Setup:
    """Returns machine, crop and job: as given, else as in the log's sidecar, else the shipped
    files."""
    meta = recorded.meta
    setup = load_setup(machine or "huanghai", job or "demo", day_clock.read_today())
    label = str(recorded.path.with_suffix(".yaml"))
    if meta is not None and machine is None and meta.machine is not None:
        setup = dataclasses.replace(
            setup, machine=validate_config(meta.machine, MACHINE_KIND, label)
        )
    if meta is not None and job is None and meta.job is not None and meta.crop is not None:
        crop = validate_config(meta.crop, CROP_KIND, label)
        own = validate_config(meta.job, JOB_KIND, label)
        setup = dataclasses.replace(
            setup,
            crop=crop,
            job=own,
            rule=make_rule(crop, own),
            folder=find_job_folder(meta, own, recorded.path.parent),
        )
    if strategy is not None:
        setup = dataclasses.replace(setup, job=setup.job.model_copy(update={"strategy": strategy}))
    return setup
