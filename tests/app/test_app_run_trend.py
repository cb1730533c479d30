"""The trend of the Run page is read off at a time, by keys and by a tap; small graphs stand
under the tiles."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.frame_history import TrendPoint, make_point
from topdress.console.app.panel_views import find_applied_kg_ha
from topdress.console.app.widgets.rate_trend import Trend, TrendView
from topdress.console.app.widgets.value_tiles import TileGraphs, make_graph

from tests.app.gallery import StillSource

SIZE = (120, 40)


@pytest.fixture
def app(frames, clock):
    """The Run page after 60 s of work: every frame was seen."""
    app = TopdressApp(StillSource(frames[0]), clock, live=False, utc_offset_s=0.0)
    app.drive = lambda: _driven(app, frames)
    return app


def _driven(app, frames):
    for frame in frames:
        app.source.current_frame = frame
        app.show_newest()
    app.show_changes()


def title_of(app, shown):
    return next(row for row in shown(app) if " trend " in row)


async def test_keys_read_the_trend_and_escape_ends_it(app, frames, shown, pilot):
    app.drive()
    await pilot.pause()
    without = shown(app)
    await pilot.press("escape")
    assert app.notice_text == "no cursor is set"
    app.notice_text = ""
    await pilot.press("left")
    page = app.page
    near = next(
        point for point in reversed(page.list_trend_points()) if point.time_s <= page.cursor_s
    )
    said = title_of(app, shown)
    assert f"target {near.target_kg_ha:.0f}" in said and f"applied {near.applied_kg_ha:.0f}" in said
    at_s = page.cursor_s
    await pilot.press("shift+left")
    assert page.cursor_s == pytest.approx(at_s - 10 * (frames[-1].row.time_s - at_s), abs=0.2), (
        "ten steps"
    )
    far = next(
        point for point in reversed(page.list_trend_points()) if point.time_s <= page.cursor_s
    )
    assert f"target {far.target_kg_ha:.0f}" in title_of(app, shown)
    assert any("│" in row for row in shown(app))
    await pilot.press("escape")
    assert page.cursor_s is None and shown(app)[:-1] == without[:-1], "as it was"
    assert app.source.orders == []


async def test_a_tap_on_the_trend_reads_it_and_one_on_its_title_ends_it(app, shown, pilot):
    app.drive()
    await pilot.pause()
    trend = app.page.query_one(Trend)
    await pilot.click(trend, offset=(trend.size.width - 12, 3))
    assert (
        app.page.cursor_s is not None
        and app.page.cursor_s < app.page.list_trend_points()[-1].time_s
    )
    await pilot.click(trend, offset=(5, 0))
    assert app.page.cursor_s is None


async def test_the_cursor_stays_at_its_time_and_goes_when_the_trend_has_run_past_it(
    app, frames, pilot
):
    app.drive()
    await pilot.press("shift+left")
    page, last = app.page, frames[-1]
    at_s = page.cursor_s
    for later_s in (30.0, 200.0):
        row = last.row._replace(time_s=last.row.time_s + later_s)
        app.source.current_frame = type(last)(
            **{name: getattr(last, name) for name in last.__dataclass_fields__}
            | {"seq": last.seq + int(later_s), "row": row, "at_s": last.at_s + later_s}
        )
        app.show_changes()
        assert page.cursor_s == (at_s if later_s < 100.0 else None)


async def test_where_there_is_no_trend_the_key_says_so(app):
    async with app.run_test(size=(100, 30)) as pilot:
        app.drive()
        await pilot.press("left")
        assert "36 rows" in app.notice_text and app.page.cursor_s is None


async def test_where_there_is_no_room_tiles_stand_without_graphs(app, pilot):
    app.drive()
    await pilot.pause()
    assert not app.page.query_one(TileGraphs).display


async def test_graphs_stand_under_the_tiles_of_a_large_terminal(app, shown):
    async with app.run_test(size=(160, 50)) as pilot:
        app.drive()
        await pilot.pause()
        graphs = app.page.query_one(TileGraphs)
        assert graphs.display and len(graphs.view.graphs) == 4 and all(graphs.view.graphs)
        first = graphs.region.y
        assert any(
            "\u2801" <= letter <= "\u28ff"
            for row in shown(app)[first : first + 2]
            for letter in row[:100]
        )


def test_a_graph_breaks_where_nothing_is_known_and_noise_is_no_mountain():
    nan = float("nan")
    assert make_graph((0.0, 60.0, 120.0), (1.0, nan, 3.0), 0.0, 120.0) == (
        (0.0, 0.0),
        (0.5, None),
        (1.0, 1.0),
    )
    level = make_graph((0.0, 60.0), (100.0, 100.1), 0.0, 120.0)
    assert all(0.4 < share < 0.6 for _at, share in level)
    assert make_graph((), (), 0.0, 120.0) == ()


@pytest.mark.parametrize("size", [(120, 40)])
async def test_held_the_target_is_no_dots_and_the_applied_rate_is(app, size):
    """HELD they lie apart; the target was drawn with the dots of the applied rate."""
    points = tuple(TrendPoint(float(k), 300.0, 0.0) for k in range(100))
    async with app.run_test(size=size):
        app.page.query_one("#trend", Trend).show_view(TrendView(points, app.units.rate))
        drawn = app.page.query_one("#trend", Trend).draw_rows(
            TrendView(points, app.units.rate), 80, 12
        )
    rows = [strip.text[6:] for strip in drawn[1:-1]]
    dotted = [row for row in rows if any(0x2800 < ord(one) <= 0x28FF for one in row)]
    solid = [row for row in rows if set(row) & set("▀▄█")]
    assert dotted == [rows[-1]] and solid and rows[-1] not in solid, rows
    assert "▄▄▄ target" in drawn[0].text and "⠤⠤⠤ applied" in drawn[0].text, (
        "the legend is drawn as the lines are"
    )


@pytest.mark.parametrize(
    ("state", "rpm", "kg_ha"),
    [
        ("held", 1.4, 0.0),
        ("off", 0.3, 0.0),
        ("held", 6.0, 4.2),
        ("working", 1.4, 4.2),
        (None, 0.0, 4.2),
        ("held", None, 4.2),
        ("held", -6.0, 4.2),
    ],
)
def test_the_noise_of_a_standing_shaft_is_no_rate_but_a_turning_one_is(frames, state, rpm, kg_ha):
    row = frames[-1].row._replace(state=state, shaft_rpm=rpm, applied_rate_kg_ha=4.2)
    assert (
        find_applied_kg_ha(row) == kg_ha == make_point(replace(frames[-1], row=row)).applied_kg_ha
    )
