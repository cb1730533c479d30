"""The Map screen: what keys and mouse do to it, what it says of a place, and how little it
draws again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.field_picture import FieldPicture, PlannedRates
from topdress.console.app.map_image import (
    DONE_ENTRY,
    OVERLAY_ENTRY,
    PASSAGE_ENTRY,
    PLAN_ENTRY,
    make_image,
)
from topdress.console.app.map_layers import MapLayer
from topdress.console.app.pages.map.map_pane import MapPane
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.replay_source import ReplaySource
from topdress.console.app.services import Services
from topdress.console.app.widgets.base_panel import Panel
from topdress.console.app.widgets.canvas import Canvas
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.app.widgets.map_legend import MapLegend

from tests.app.gallery import Picture, StillSource, settle, still_app
from tests.app.harness import later, settled
from tests.app.made_up.run import run_frames, sample_field, sample_services

SIZE = (120, 40)
ON_MAP = Picture("map", SIZE, screen="map")


@pytest.fixture
def app(frames, clock):
    """A minute of a run on its field."""
    app = TopdressApp(
        StillSource(frames[-1]), clock, live=False, utc_offset_s=0.0, services=sample_services()
    )
    for frame in frames[:-1]:
        app.history.add_frame(frame)
    return app


def reading(app) -> dict[str, str]:
    return {part.label: part.text for part in app.page.query_one("#map-reading", Panel).view.parts}


def states(app) -> tuple[str, ...]:
    return app.page.query_one("#map-bar", Panel).view.states


async def opened(app, pilot):
    await settle(app, ON_MAP, pilot.pause)
    return app.page.query_one("#map-pane", MapPane)


@pytest.fixture
async def pane(app, pilot):
    return await opened(app, pilot)


async def test_colours_by_key_and_by_click(app, pilot, pane):
    legend = app.page.query_one("#map-scale", MapLegend)
    seen = []
    for _press in MapLayer:
        seen.append((pane.view.scale.layer, legend.view.scale.unit))
        await pilot.press("v")
    assert seen == [
        (MapLayer.APPLIED, "kg/ha"),
        (MapLayer.TARGET, "kg/ha"),
        (MapLayer.ERROR, "%"),
        (MapLayer.NDVI, ""),
        (MapLayer.PASSES, "x"),
    ]
    assert pane.view.scale.layer is MapLayer.APPLIED
    await pilot.click("#map-bar", offset=(22, 0))
    assert pane.view.scale.layer is MapLayer.ERROR


async def test_nearer_farther_and_the_whole_field(app, pilot, pane):
    whole = pane.view.camera
    assert states(app) == ("whole field",)
    box = sample_field().box
    pixels = pane.make_grid()
    for corner in ((box.west_m, box.south_m), (box.east_m, box.north_m)):
        column, row = pixels.find_pixel(*corner)
        assert 0 <= column < pixels.columns and 0 <= row < pixels.rows
    await pilot.press("plus", "plus")
    assert pane.view.camera.metres < whole.metres and states(app) == ("following",)
    place = pane.view.place
    column, row = pane.make_grid().find_pixel(*place)
    assert 0 <= column < pixels.columns and 0 <= row < pixels.rows, "the machine stays in sight"
    await pilot.press("minus")
    assert pane.view.camera.metres == whole.zoom_steps(1).metres
    await pilot.press("z")
    assert pane.view.camera == whole and states(app) == ("whole field",)


async def test_arrows_move_the_map_and_mark_a_place(app, pilot, pane):
    before = pane.view.camera
    await pilot.press("right")
    assert pane.view.camera.east_m > before.east_m and pane.view.camera.north_m == before.north_m
    await pilot.press("left", "up")
    assert pane.view.camera.east_m == before.east_m and pane.view.camera.north_m > before.north_m
    assert pane.view.cross == (pane.view.camera.east_m, pane.view.camera.north_m)
    assert states(app) == ("standing",)
    assert app.page.query_one("#map-reading", Panel).view.where == "mark +"
    await pilot.press("y")
    assert states(app) == ("following",) and pane.view.cross is None
    await pilot.press("y")
    assert states(app) == ("standing",)


@pytest.mark.exam
async def test_drag_and_wheel(pilot, pane):
    before = pane.view.camera
    under = pane.make_grid().find_middle(20, 20)
    await pilot.mouse_down("#map-pane", offset=(20, 10))
    await pilot.hover("#map-pane", offset=(30, 13))
    await pilot.mouse_up("#map-pane", offset=(30, 13))
    await pilot.pause()
    assert pane.make_grid().find_pixel(*under) == (30, 26), "the place stays under the pointer"
    assert pane.view.camera.metres == before.metres
    under = pane.make_grid().find_middle(40, 20)
    pane.post_message(MapPane.Wheeled(1, under))
    await pilot.pause()
    assert pane.view.camera.metres < before.metres
    column, row = pane.make_grid().find_pixel(*under)
    assert abs(column - 40) <= 1 and abs(row - 20) <= 1


async def test_what_lies_under_the_pointer_is_told(app, pilot, pane):
    worked, field = app.history.worked, sample_field()
    at_machine = reading(app)
    assert at_machine["applied"].endswith("kg/ha") and at_machine["applied"] != "-- kg/ha"
    place = (50.0, 20.0)
    column, row = pane.make_grid().find_pixel(*place)
    await pilot.hover("#map-pane", offset=(column, row // 2))
    told = reading(app)
    assert told["applied"] == "-- kg/ha" and told["error"] == "--", "not worked there yet"
    near = pane.make_grid().find_middle(column, 2 * (row // 2) + 0.5)
    assert told["planned"] == f"{field.planned.find_rate(*near):.0f} kg/ha"
    assert told["east"] == f"{near[0]:.0f} m" and told["north"] == f"{near[1]:.0f} m"
    assert worked.rate_ends is not None
    await pilot.hover("#status")
    assert reading(app) == at_machine


async def test_a_file_is_laid_on_the_map_by_its_key_and_taken_off_again(app, shown, pilot, pane):
    before = [pane.render_line(row).text for row in range(pane.content_size.height)]
    legend = app.page.query_one("#map-laid", Canvas)
    assert not legend.display and "file" not in reading(app)
    await pilot.press("j")
    assert any("autumn.geojson" in row for row in shown(app))
    await pilot.press("enter")
    await settled(app, pilot)
    assert legend.display and pane.view.laid is not None
    assert any("file autumn.geojson: applied " in row and "kg/ha" in row for row in shown(app))
    column, row = pane.make_grid().find_pixel(54.0, 30.0)  # not worked yet, and there in autumn
    await pilot.hover("#map-pane", offset=(column, row // 2))
    east, north = pane.make_grid().find_middle(column, 2 * (row // 2) + 0.5)
    told = float(reading(app)["file"].removesuffix(" kg/ha"))
    assert told == pytest.approx(220.0 + 12.0 * round(north / 6.0) + 40.0 * east / 60.0, abs=8.0)
    assert reading(app)["applied"] == "-- kg/ha"
    await pilot.press("v", "v", "v")
    assert pane.view.laid is None, "no NDVI in it"
    assert any("file autumn.geojson: no NDVI in it" in row for row in shown(app))
    await pilot.press("v", "v", "j", "up", "enter")
    assert not legend.display and pane.view.laid is None
    assert [pane.render_line(row).text for row in range(pane.content_size.height)] == before


@pytest.mark.exam
async def test_escape_leaves_the_map_as_it_is(app, pilot, pane):
    await pilot.press("j", "escape")
    assert pane.view.laid is None and not app.page.laid.path
    await pilot.press("j", "enter")
    await settled(app, pilot)
    await pilot.press("j", "escape")
    assert pane.view.laid is not None


async def test_what_is_no_such_file_is_said_in_one_line(app, shown):
    async with app.run_test(size=(80, 24)) as pilot:
        pane = await opened(app, pilot)
        await pilot.press("j", "2", "enter")
        await settled(app, pilot)
        assert "zones.geojson: shapes of type Polygon" in shown(app)[-1]
        assert pane.view.laid is None and not app.page.query_one("#map-laid", Canvas).display


async def test_the_work_lies_over_a_laid_file_and_the_plan_under_it(app, pilot, pane):
    app.page.overlay_file("/logs/autumn.geojson")
    await settled(app, pilot)
    view = pane.view
    seen = make_image(view.worked, view.picture, view.scale, pane.make_grid(), True, view.laid)
    bare = make_image(view.worked, view.picture, view.scale, pane.make_grid(), True)
    done = (bare >= DONE_ENTRY) & (bare < PLAN_ENTRY) | (bare == PASSAGE_ENTRY)
    assert (seen[done] == bare[done]).all()
    assert (seen[~done] >= OVERLAY_ENTRY).sum() > 100 and (
        (seen[~done] >= PLAN_ENTRY) & (seen[~done] < OVERLAY_ENTRY)
    ).any()


@pytest.mark.exam
async def test_the_plan_can_be_hidden_and_its_legend_goes_with_it(app, shown, pilot, pane):
    assert any("faint: planned" in row for row in shown(app))
    with_plan = pane.rows_drawn
    await pilot.press("p")
    assert not any("faint: planned" in row for row in shown(app))
    assert pane.rows_drawn > with_plan


async def test_area_and_product_done_and_left(app, pilot):
    await opened(app, pilot)
    items = {item.label: item.value.text for item in app.page.query_one("#map-job", Panel).view}
    frame, field = app.arrival.frame, sample_field()
    assert items["left"] == f"{field.area_ha - frame.area_ha:.2f} ha"
    assert " min  " in items["time left"] and items["time left"].endswith(" m")
    assert items["still needed"] == f"{field.planned.planned_mass_kg - frame.applied_kg:.0f} kg"
    assert items["done"] == f"{frame.area_ha:.2f} ha  {100 * frame.area_ha / field.area_ha:.0f} %"
    await pilot.press("u", "enter")
    items = {item.label: item.value.text for item in app.page.query_one("#map-job", Panel).view}
    assert " ac" in items["left"]


@pytest.mark.exam
@pytest.mark.usefixtures("drawn_at_once")
async def test_only_rows_that_changed_are_drawn_again(clock):
    frames = run_frames(seconds=40.0)
    source = StillSource(frames[0])
    app = TopdressApp(source, clock, live=False, services=sample_services())
    async with app.run_test(size=SIZE) as pilot:
        pane = await opened(app, pilot)
        await pilot.press("plus")
        drawn = []
        for frame in frames[1:]:
            source.current_frame = frame
            clock.now_s += 0.2
            before = pane.rows_drawn
            app.show_newest()
            drawn.append(pane.rows_drawn - before)
        redrawn = [rows for rows in drawn if rows]
        assert 35 <= len(redrawn) <= 42, "once a second"
        # New pictures: the map moves on four times, the pass to come appears and goes.
        assert sum(rows <= 8 for rows in redrawn) >= len(redrawn) - 6


async def test_a_map_drawn_row_by_row_looks_as_one_drawn_at_once(clock):
    frames = run_frames(seconds=30.0)
    source = StillSource(frames[0])
    app = TopdressApp(source, clock, live=False, services=sample_services())
    async with app.run_test(size=SIZE) as pilot:
        pane = await opened(app, pilot)
        for frame in frames[1:]:
            source.current_frame = frame
            clock.now_s += 0.2
            app.show_newest()
        await later(app, pilot, 1.0)
        grown = [pane.render_line(row).text for row in range(pane.content_size.height)]
        styles = [
            [segment.style for segment in pane.render_line(row)]
            for row in range(pane.content_size.height)
        ]
        pane.refresh()
        await pilot.pause()
        assert [pane.render_line(row).text for row in range(pane.content_size.height)] == grown
        assert [
            [segment.style for segment in pane.render_line(row)]
            for row in range(pane.content_size.height)
        ] == styles


async def test_locked_nothing_moves(app, pilot, pane):
    await pilot.press("f8")
    before = pane.view
    await pilot.press("plus", "v", "left", "y", "z", "p")
    await pilot.click("#map-bar", offset=(22, 0))
    pane.post_message(MapPane.Wheeled(1, (0.0, 0.0)))
    pane.post_message(MapPane.Dragged(5, 5))
    await pilot.pause()
    assert pane.view == before and app.source.orders == []
    await pilot.press("space", "x")
    assert [order.do.value for order in app.source.orders] == ["hold", "stop"]


async def test_no_position_and_no_field_are_said(clock, shown):
    frame = run_frames(seconds=1.0)[-1]
    app = TopdressApp(StillSource(replace(frame, place_m=None)), clock, live=False)
    async with app.run_test(size=(80, 24)) as pilot:
        await opened(app, pilot)
        text = "\n".join(shown(app))
        assert text.count("no position yet") == 2
        await pilot.press("y", "plus", "left", "z")
        assert app.page.where == "map"


async def test_a_field_that_cannot_be_read_is_said_in_one_line(clock, shown):
    def load(frame):
        raise ValueError("map_demo.geojson: no features")

    app = TopdressApp(
        StillSource(run_frames(seconds=1.0)[-1]), clock, live=False, services=Services(field=load)
    )
    async with app.run_test(size=SIZE) as pilot:
        await opened(app, pilot)
        assert "map_demo.geojson: no features" in shown(app)[-1]


@pytest.mark.exam
async def test_a_field_is_loaded_once_for_each_job(clock):
    asked = []

    def load(frame):
        asked.append(frame.job)
        return FieldPicture(
            "f",
            (((0.0, 0.0), (10.0, 0.0), (0.0, 10.0)),),
            0.01,
            3.0,
            PlannedRates(0.0, 0.0, 5.0, np.full((2, 2), 100.0, dtype=np.float32)),
        )

    frame = run_frames(seconds=1.0)[-1]
    source = StillSource(frame)
    app = TopdressApp(source, clock, live=False, services=Services(field=load))
    async with app.run_test(size=SIZE) as pilot:
        await opened(app, pilot)
        for k in range(1, 8):
            clock.now_s += 1.0
            source.current_frame = replace(
                frame, seq=frame.seq + k, job="other" if k > 4 else frame.job
            )
            await later(app, pilot)
        assert asked == [frame.job, "other"]
        assert app.history.worked.width_m == 3.0


async def test_old_values_are_grey(app, clock, pilot, pane):
    assert not pane.view.stale
    await later(app, pilot, 5.0)
    assert pane.view.stale
    assert all(item.value.stale for item in app.page.query_one("#map-job", Panel).view)


async def test_without_colours_levels_are_characters_with_a_legend(app, shown, pilot):
    app.no_color = True
    await opened(app, pilot)
    app.page.redraw_all()
    await later(app, pilot)
    text = "\n".join(shown(app))
    assert "░▒▓█" in text and "1234 planned" in text
    assert any(character in text for character in ("3333", "4444", "3434", "3343"))
    await pilot.press("v", "v")
    assert "Ll.hH" in "\n".join(shown(app))


@pytest.mark.exam
async def test_the_log_of_the_replay_and_the_machine(frames, clock, shown):
    log = ReplaySource(frames, clock)
    log.seek_time(20.0)
    source = StillSource(run_frames(seconds=200.0)[-1])
    app = TopdressApp(source, clock, live=False, replay=ReplayJob(log, "run.csv"))
    async with app.run_test(size=SIZE) as pilot:
        pane = await opened(app, pilot)
        assert pane.view.place == source.current_frame.place_m and "REPLAY" not in shown(app)[0]
        await pilot.press("q", "1", "enter")
        assert pane.view.place == log.current_frame.place_m
        assert pane.view.worked.box.north_m == pytest.approx(log.current_frame.place_m[1], abs=0.5)
        assert "REPLAY" in shown(app)[0] and "MACHINE: WORKING" in shown(app)[0]
        await pilot.press("space")
        assert [order.do.value for order in source.orders] == ["hold"], "hold is for the machine"
        await pilot.press("q", "1", "enter")
        assert pane.view.place == source.current_frame.place_m


async def test_in_a_replay_alone_the_map_is_the_log_s_and_space_plays(frames, clock, shown):
    log = ReplaySource(frames, clock)
    app = TopdressApp(None, clock, live=False, replay=ReplayJob(log, "run.csv"))
    async with app.run_test(size=SIZE) as pilot:
        pane = await opened(app, pilot)
        await pilot.press("space")
        assert log.playing
        clock.now_s += 30.0
        app.show_newest()
        assert pane.view.worked.box.north_m == pytest.approx(56.7, abs=1.0)
        log.seek_time(5.0)
        clock.now_s += 1.0
        app.show_newest()
        assert pane.view.worked.box.north_m == pytest.approx(11.3, abs=1.0), (
            "back in the log, the ground goes back"
        )
        await pilot.press("q", "1", "enter")
        assert "no machine is connected" in "\n".join(shown(app))


@pytest.mark.parametrize(
    ("size", "language"), [((80, 24), "en"), ((80, 24), "zh"), ((100, 30), "en"), ((200, 50), "en")]
)
async def test_at_every_size_the_map_its_legend_and_its_reading_are_there(shown, size, language):
    picture = Picture("map", size, screen="map", language=language, alarms=True)
    app, _clock = still_app(picture)
    async with app.run_test(size=size) as pilot:
        await settle(app, picture, pilot.pause)
        pane = app.page.query_one("#map-pane", MapPane)
        assert pane.content_size.height >= size[1] - 14 and pane.content_size.width >= size[0] - 32
        assert app.page.query_one("#map-right").display == (size[0] >= 100)
        rows = shown(app)
        assert any("kg/ha" in row and "▀▀▀▀▀▀" in row for row in rows)
        for widget in ("#map-bar", "#map-pane", "#map-scale", "#map-reading"):
            region = app.page.query_one(widget).region
            assert region.height >= 1 and region.right <= size[0] and region.bottom <= size[1] - 1


@pytest.mark.exam
async def test_the_small_map_opens_the_page_by_a_click_on_its_title(picture):
    app = picture(size=SIZE)
    async with app.run_test(size=SIZE) as pilot:
        await settle(app, Picture("run", SIZE), pilot.pause)
        assert app.page.query_one("#map", FieldMap).view.picture is not None
        await pilot.click("#map-title", offset=(3, 0))
        assert app.page.where == "map"
