"""Every order is taken back by the one place that knows how, or is named there as one that is
not; the newest change is the one that is offered."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
from topdress.console import app as console_app
from topdress.console.app.dialogs import Confirm
from topdress.console.app.pages.job.page import JobScreen
from topdress.console.app.undo_stack import (
    WHY_NOT_UNDOABLE,
    describe_undo,
    find_ordered_source,
    reverse_orders,
)
from topdress.console.app.units import METRIC
from topdress.console.frame import Frame
from topdress.console.worker.run_interfaces import FRAME_FIELDS
from topdress.control.agronomy.reference_strips import ReferenceStrips, StripMean
from topdress.control.log_row import LogRow
from topdress.control.orders import Answer, Do, Order, TargetSource
from topdress.control.safety import Allowances
from topdress.control.simulation.closed_loop import simulate_run
from topdress.drivers.files.run_setup import load_setup

from tests.app.harness import feed, settled
from tests.control_loop.closed import Closed

SIZE = (120, 40)
CHANGES = {
    Do.STRATEGY: "speed_first",
    Do.SOURCE: "manual",
    Do.NUDGE: 10.0,
    Do.MANUAL_RATE: 123.0,
    Do.REFILL: 40.0,
    Do.ALLOW_REVERSE: True,
    Do.ALLOW_OUTSIDE: True,
    Do.ALLOW_MAP_ELSEWHERE: True,
    Do.GO_ON_UNLOGGED: True,
    Do.ALLOW_NO_WHEEL: True,
    Do.FLOW_TRIM: False,
    Do.LOOK_AHEAD: False,
    Do.NO_DOUBLE: False,
    Do.SECTION: "2 off",
    Do.STRIP: "nrich 0.7120 0.0041 38",
}


def test_each_order_is_taken_back_or_named_as_not():
    assert set(CHANGES) | set(WHY_NOT_UNDOABLE) == set(Do) and not set(CHANGES) & set(
        WHY_NOT_UNDOABLE
    )
    assert all(WHY_NOT_UNDOABLE.values())


class Bench:
    """The shipped machine with sections, ticking; `frame` is what its worker would tell."""

    def __init__(self) -> None:
        closed = Closed(load_setup("huanghai_sections", "sections_demo", dt.date(2014, 3, 7)))
        self.loop = closed.loop
        self.steps = simulate_run(closed.plant, closed.loop, 600.0)

    def frame(self) -> Frame:
        tick = list(islice(self.steps, 3))[-1].tick
        return Frame(seq=0, at_s=0.0, **{name: getattr(tick, name) for name in FRAME_FIELDS})


def chosen(frame: Frame) -> tuple[object, ...]:
    return (
        frame.row.strategy,
        frame.ordered_source,
        frame.manual_rate_kg_ha,
        frame.row.nudge_percent,
        frame.allow,
        frame.flow_trim_on,
        frame.look_ahead,
        frame.no_double,
        [one.why == "hand" for one in frame.sections],
        frame.strips,
    )


@pytest.mark.parametrize("do", CHANGES)
def test_what_takes_an_order_back_leaves_all_as_it_was(do):
    """By the control loop itself."""
    bench = Bench()
    before = bench.frame()
    order = Order(do, CHANGES[do])
    back = reverse_orders([order], before)
    assert back and describe_undo(back, METRIC)
    if do is Do.GO_ON_UNLOGGED:  # refused while the log works, taken back or not
        assert back == (Order(do, False),)
        return
    assert bench.loop.handle_order(order).accepted
    after = bench.frame()
    assert chosen(after) != chosen(before) or do is Do.REFILL
    for one in back:
        assert bench.loop.handle_order(one).accepted, one
    assert chosen(bench.frame()) == chosen(before)


def test_all_sections_given_back_are_closed_again_one_by_one():
    bench = Bench()
    for text in ("1 off", "3 off"):
        assert bench.loop.handle_order(Order(Do.SECTION, text)).accepted
    frame = bench.frame()
    back = reverse_orders([Order(Do.SECTION, "all auto")], frame)
    assert bench.loop.handle_order(Order(Do.SECTION, "all auto")).accepted
    for one in back:
        assert bench.loop.handle_order(one).accepted
    assert chosen(bench.frame()) == chosen(frame) and len(back) == 2


def test_what_stands_in_for_a_silent_source_is_not_the_one_that_was_ordered(frames):
    """While the heads are silent a row tells the fallback rate: taken back, that had become the
    target for good."""
    row = frames[-1].row._replace(target_source=TargetSource.FALLBACK)
    frame = replace(frames[-1], row=row, ordered_source="canopy")
    assert reverse_orders([Order(Do.SOURCE, "manual")], frame) == (Order(Do.SOURCE, "canopy"),)
    assert (
        find_ordered_source(
            replace(frame, ordered_source="", row=row._replace(target_source="index_map"))
        )
        == "canopy"
    )


async def test_a_manual_rate_is_taken_back_and_no_older_change(full, source):
    """`M` and a rate was no change, and an older one was offered as the last."""
    source.current_frame = replace(
        source.current_frame, manual_rate_kg_ha=90.0, ordered_source="manual"
    )
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("t", "2", "enter", "m", "1", "1", "5", "enter")
        assert source.orders[-1] == Order(Do.MANUAL_RATE, 115.0)
        await pilot.press("ctrl+z")
        assert isinstance(full.screen, Confirm) and "manual rate 90 kg/ha" in full.screen.text
        await pilot.press("enter")
        assert source.orders[-1] == Order(Do.MANUAL_RATE, 90.0)
        await pilot.press("ctrl+z")
        assert "strategy opening first" in full.screen.text


async def test_rate_and_source_of_a_preset_are_one_change(full, source):
    source.current_frame = replace(
        source.current_frame, manual_rate_kg_ha=90.0, ordered_source="canopy"
    )
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("full_stop", "enter", "ctrl+z")
        assert "target from canopy, manual rate 90 kg/ha" in full.screen.text
        await pilot.press("enter")
        assert source.orders[-2:] == [Order(Do.SOURCE, "canopy"), Order(Do.MANUAL_RATE, 90.0)]
        assert full.undo.newest is None


async def test_what_was_refused_is_no_change(full, source):
    source.answer = Answer(False, "rate_out_of_range")
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("full_stop", "enter")
        assert source.orders == [Order(Do.MANUAL_RATE, 150.0)], (
            "the source stays where the rate was refused"
        )
        await pilot.press("ctrl+z")
        assert full.screen is full.page and full.undo.newest is None


async def test_no_page_gives_an_order_past_the_one_place():
    """`source.send_order` is called where changes are noted, and by the calibration's runs, which
    order no change."""
    root = Path(console_app.__file__).parent
    texts = {
        str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in root.rglob("*.py")
    }
    callers = {name for name, text in texts.items() if ".send_order(" in text}
    assert callers == {"app.py", "pages/calibrate/page.py"}
    adders = {name for name, text in texts.items() if "undo.add_change(" in text}
    assert adders == {"app.py", "pages/settings/page.py"}


# --- a strip says what becomes of the field
# ---------------------------------------------------------------------------


def drive(app, metres, **values):
    """At 1 m/s, five rows a second."""
    time_s = app.source.current_frame.row.time_s
    feed(
        app,
        (
            {"time_s": time_s + 0.2 * step, "speed_used_mps": 1.0, **values}
            for step in range(1, 5 * metres + 1)
        ),
    )


@pytest.fixture
def strip_desk(full):
    """The shipped crop's rule, whose strip reads 0.75."""
    desk = full.services.job
    desk.known = replace(desk.known, setup=load_setup("huanghai", "demo", dt.date(2014, 3, 7)))
    return desk


async def test_a_strip_says_the_target_before_and_after_and_can_be_taken_back(
    full, source, strip_desk
):
    source.current_frame = replace(
        source.current_frame,
        strips=ReferenceStrips(0.75),
        row=source.current_frame.row._replace(state="ready"),
    )
    rule = strip_desk.known.setup.rule
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("f10")
        await settled(full, pilot)
        drive(full, 40, ndvi=0.5)
        await pilot.press("b")
        drive(full, 30, ndvi=0.70)
        await pilot.press("b")
        low = round(replace(rule, ndvi_nrich=0.70).decide_rate(0.5).rate_kg_ha)
        now = round(replace(rule, ndvi_nrich=0.75).decide_rate(0.5).rate_kg_ha)
        assert now > low > 0
        text = full.screen.text
        assert (
            f"Target from canopy in this field, NDVI 0.500: {now} kg/ha now, {low} kg/ha with it."
            in text
        )
        assert "hardly richer" not in text
        await pilot.press("enter")
        await settled(full, pilot)
        assert source.orders[-1].do is Do.STRIP and strip_desk.asked[-1] == (
            "strip",
            "nrich",
            "0.700",
        )
        await pilot.press("ctrl+z")
        assert "N-rich strip NDVI 0.750" in full.screen.text
        await pilot.press("enter")
        await settled(full, pilot)
        assert source.orders[-1] == Order(Do.STRIP, "nrich 0.7500")
        assert strip_desk.asked[-1] == ("strip", "nrich", "0.750")


async def test_a_strip_as_poor_as_the_field_is_warned_of(full, source, strip_desk):
    """B, twenty metres of the field itself and B: one Enter took it from its rate to none, in
    silence."""
    source.current_frame = replace(
        source.current_frame,
        strips=ReferenceStrips(0.75),
        row=source.current_frame.row._replace(state="ready"),
    )
    async with full.run_test(size=(60, 20)) as pilot:
        await pilot.press("f10")
        await settled(full, pilot)
        drive(full, 40, ndvi=0.5)
        await pilot.press("b")
        drive(full, 30, ndvi=0.51)
        await pilot.press("b")
        assert isinstance(full.screen, Confirm)
        assert "hardly richer than the field (NDVI 0.500)" in full.screen.text
        assert "kg/ha now, " in full.screen.text


def test_the_field_is_what_is_no_strip_and_keeps_no_samples(full):
    page = JobScreen()
    for k in range(1000):
        page.field.add_row(LogRow(0.2 * k, ndvi=0.5, speed_used_mps=1.0))
    assert page.field.ndvi == pytest.approx(0.5) and not hasattr(page.field, "_samples")


async def test_where_there_was_no_strip_none_counts_again(full, source, strip_desk):
    source.current_frame = replace(
        source.current_frame, strips=ReferenceStrips(), allow=Allowances()
    )
    assert reverse_orders([Order(Do.STRIP, "nrich 0.7")], source.current_frame) == (
        Order(Do.STRIP, StripMean("nrich", None).event_text),
    )
    assert describe_undo((Order(Do.STRIP, "nrich none"),), METRIC) == "no N-rich strip"
