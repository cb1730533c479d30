"""The guided tour goes on when a step is done by the operator, never by itself, and gives no
order."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.guided_tour import STEP_READING_TIME_S, TOUR_STEPS, Tour
from topdress.console.app.widgets.status_line import TourBar

SIZE = (120, 40)


@pytest.fixture
def frame_of(frames):
    def make(state="off", strategy="opening_first", applied_kg_ha=0.0):
        row = frames[-1].row._replace(
            state=state, strategy=strategy, applied_rate_kg_ha=applied_kg_ha
        )
        return replace(frames[-1], row=row, simulated=True)

    return make


def test_every_step_waits_for_its_deed_and_the_last_ends_it(frame_of):
    tour = Tour()
    deeds = [
        ({"state": "ready"}, "run", 1.0),
        ({"state": "working", "applied_kg_ha": 300.0}, "run", 1.0),
        ({"state": "working"}, "run", STEP_READING_TIME_S + 1.0),
        ({"state": "working", "strategy": "speed_first"}, "run", 1.0),
        ({"state": "working", "strategy": "speed_first"}, "map", 1.0),
        ({"state": "held"}, "map", 1.0),
        ({"state": "working"}, "run", 1.0),
        ({"state": "off"}, "run", 1.0),
    ]
    assert len(deeds) == len(TOUR_STEPS)
    before, where, now_s = {"state": "off"}, "run", 0.0
    for number, (deed, page, lasts_s) in enumerate(deeds):
        for _ in range(3):
            tour.follow_frame(frame_of(**before), where, now_s)
            assert tour.index == number, "a step went on by itself"
        now_s += lasts_s
        tour.follow_frame(frame_of(**deed), page, now_s)
        assert tour.index == number + 1
        before, where = deed, page
    assert tour.is_over and tour.text == ""


async def test_it_is_shown_on_every_page_and_orders_nothing(frame_of, source, clock, shown):
    source.current_frame = frame_of()
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0, tour=True)
    async with app.run_test(size=SIZE) as pilot:
        for where in app.pages:
            app.turn_to_page(where)
            await pilot.pause()
            app.show_newest()
            await pilot.pause()
            assert "Press R" in "\n".join(shown(app)), where
        app.turn_to_page("run")
        await pilot.press("ctrl+n")
        assert "Press S" in "\n".join(shown(app)) and "2/8" in "\n".join(shown(app))
        await pilot.press("ctrl+e")
        assert "Press S" not in "\n".join(shown(app)) and app.tour is None
        assert source.orders == []


async def test_the_tour_is_refused_on_a_real_machine(frame_of, source, clock):
    source.current_frame = replace(frame_of(), simulated=False)
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0)
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("ctrl+t")
        assert app.tour is None and "simulated" in app.notice_text


async def test_a_click_ends_it(frame_of, source, clock):
    source.current_frame = frame_of()
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0, tour=True)
    async with app.run_test(size=SIZE) as pilot:
        bar = app.page.query_one("#tour")
        await pilot.click(bar, offset=(bar.size.width - 3, 1))
        assert app.tour is None


@pytest.mark.parametrize("size", [(160, 50), (80, 24), (60, 20)])
async def test_every_step_is_read_to_its_end_at_any_size(app, source, shown, size):
    source.current_frame = None  # no step is done by itself
    async with app.run_test(size=size) as pilot:
        app.tour = Tour()
        for step in app.tour.steps:
            app.show_changes()
            await pilot.pause()
            await pilot.pause()
            bar = app.page.query_one(TourBar)
            rows = shown(app)[bar.region.y : bar.region.bottom]
            assert " ".join(" ".join(rows[:-1]).split()) == step.text and "end the tour" in rows[-1]
            app.tour.skip_step()
