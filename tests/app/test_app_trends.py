"""The Trends screen: channels, spans, freezing, reading at a time, fixed scales; live and of a
log."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta

import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.braille import PlotPiece, trace_cells
from topdress.console.app.pages.replay.service import ReplayJob
from topdress.console.app.pages.trends.channel_plots import Plots
from topdress.console.app.pages.trends.page import ChannelDialog
from topdress.console.app.replay_source import ReplaySource

from tests.app.gallery import Picture, StillClock, StillSource, settle, still_app
from tests.app.harness import dots, looked
from tests.app.made_up.run import run_frames

SIZE = (100, 30)
ON_TRENDS = Picture("trends", SIZE, screen="trends")
FRAMES = run_frames(seconds=130.0)


@pytest.fixture
def app():
    """130 s of a run, its clock in step with it."""
    clock = StillClock(FRAMES[-1].row.time_s)
    app = TopdressApp(StillSource(FRAMES[-1]), clock, live=False, utc_offset_s=0.0)
    for frame in FRAMES[:-1]:
        app.history.add_frame(frame)
    return app


async def opened(app, pilot) -> Plots:
    await settle(app, ON_TRENDS, pilot.pause)
    return app.page.query_one("#plots", Plots)


def bar(app):
    return app.page.query_one("#trends-bar").view


@pytest.fixture
async def plots(app, pilot):
    return await opened(app, pilot)


async def test_three_channels_at_first_with_their_sums(plots):
    assert [plot.label for plot in plots.view.plots] == [
        "target rate",
        "applied rate",
        "speed used",
    ]
    shown = [frame.row for frame in FRAMES if frame.row.time_s >= FRAMES[-1].row.time_s - 120.0]
    applied = [row.applied_rate_kg_ha for row in shown]
    target, second, speed = plots.view.plots
    assert target.value == f"{FRAMES[-1].row.target_rate_kg_ha:.0f}" and target.unit == "kg/ha"
    assert second.sums == (
        f"min {min(applied):.0f}   mean {sum(applied) / len(applied):.0f}   max {max(applied):.0f}"
    )
    assert (target.low, target.high) == (second.low, second.high), "rates share their scale"
    assert speed.unit == "km/h" and plots.view.end == "06:14:09"


async def test_spans_by_key_and_by_wheel(app, pilot, plots):
    assert bar(app).span == "span 02:00"
    await pilot.press("plus", "plus")
    assert bar(app).span == "span 00:30" and app.page.find_window().length_s == 30.0
    begin, end = plots.view.plots[0].pieces[0].at, plots.view.plots[0].pieces[-1].at
    assert -0.02 <= begin <= 0.02 and end == pytest.approx(1.0)
    await pilot.press("minus")
    assert bar(app).span == "span 01:00"
    plots.post_message(Plots.Wheeled(-1))
    await pilot.pause()
    assert bar(app).span == "span 02:00"
    await pilot.press("z")
    assert bar(app).span == "whole run, 02:09"
    assert app.page.find_window().from_s == 0.0
    for _press in range(20):
        await pilot.press("plus")
    assert bar(app).span == "span 00:10"


async def go_on(app, seconds):
    last = app.source.current_frame
    for step in range(1, int(seconds / 0.2) + 1):
        utc = datetime.fromisoformat(last.row.utc.replace("Z", "+00:00")) + timedelta(
            seconds=0.2 * step
        )
        row = last.row._replace(
            time_s=round(last.row.time_s + 0.2 * step, 3),
            utc=utc.isoformat().replace("+00:00", "Z"),
        )
        app.source.current_frame = replace(last, seq=last.seq + step, row=row, at_s=row.time_s)
        app.clock.now_s += 0.2
        app.show_newest()


async def test_frozen_plots_stand_while_the_run_goes_on(app, pilot, plots):
    await pilot.press("y")
    assert bar(app).states == ("FROZEN",) and bar(app).standing
    before = plots.view
    await go_on(app, 10.0)
    assert plots.view == before
    await pilot.press("pageup")
    assert app.page.find_window().to_s == pytest.approx(FRAMES[-1].row.time_s - 60.0)
    await pilot.press("pagedown", "pagedown")
    assert app.page.find_window().to_s == pytest.approx(app.history.series.end_s), (
        "not beyond the newest"
    )
    await pilot.press("y")
    await go_on(app, 1.0)
    assert bar(app).states == ("running",)
    assert app.page.find_window().to_s == app.history.series.end_s


async def test_the_cursor_reads_the_values_at_its_time(app, shown, pilot, plots):
    for _press in range(30):
        await pilot.press("left")
    at_s = app.page.cursor_s
    assert app.page.ends_s is not None, "a cursor freezes the plots"
    read = [frame.row for frame in FRAMES if frame.row.time_s <= at_s + 1e-9][-1]
    assert plots.view.plots[0].value == f"{read.target_rate_kg_ha:.0f}"
    assert plots.view.cursor == pytest.approx((at_s - 9.8) / 120.0, abs=0.01)
    assert any("│" in row for row in shown(app))
    before = at_s
    await pilot.press("shift+left")
    assert app.page.cursor_s == pytest.approx(before - 12.0)
    await pilot.press("right")
    assert app.page.cursor_s > before - 12.0
    await pilot.press("escape")
    assert app.page.cursor_s is None and plots.view.cursor is None
    assert plots.view.plots[0].value == f"{FRAMES[-1].row.target_rate_kg_ha:.0f}"


async def test_a_click_sets_the_cursor_and_a_click_on_a_name_opens_the_list(app, pilot, plots):
    columns = plots.count_columns(plots.content_size.width)
    await pilot.click("#plots", offset=(9 + columns // 2, 3))
    assert plots.view.cursor == pytest.approx(0.5, abs=0.02)
    await pilot.click("#plots", offset=(5, 0))
    assert isinstance(app.screen, ChannelDialog)


async def test_channels_are_taken_and_dropped(app, pilot, plots):
    await pilot.press("v")
    await pilot.press("down", "down", "enter")
    assert app.page.channels == ("applied_rate_kg_ha", "speed_used_mps", "rate_error_percent")
    await pilot.press("up", "enter")
    assert app.page.channels == ("speed_used_mps", "rate_error_percent")
    await pilot.press("escape")
    assert [plot.label for plot in plots.view.plots] == ["speed used", "rate error"]
    assert plots.view.plots[1].unit == "%"
    await pilot.press("v")
    assert len(app.screen.choices) == 35
    await pilot.press("space")
    assert [order.do.value for order in app.source.orders] == ["hold"], "hold works over the list"


async def test_no_channel_says_how_to_choose_one(app, shown, pilot):
    await opened(app, pilot)
    app.page.channels = ()
    await looked(app, pilot)
    assert any("V chooses what is plotted" in row for row in shown(app))
    await pilot.press("left", "plus", "z", "q", "2", "enter", "y", "pageup")


async def test_a_fixed_scale_stays_and_a_free_one_follows_the_values(app, pilot, plots):
    before = plots.view.plots[0].high
    await pilot.press("q", "2", "enter")
    row = app.source.current_frame.row
    app.source.current_frame = replace(
        app.source.current_frame, row=row._replace(target_rate_kg_ha=900.0)
    )
    await go_on(app, 2.0)
    assert plots.view.plots[0].high == before and plots.view.plots[0].fixed
    assert "fixed scale" in bar(app).states
    await pilot.press("q", "2", "enter")
    await go_on(app, 1.0)
    assert float(plots.view.plots[0].high) >= 900.0 and not plots.view.plots[0].fixed
    assert plots.view.plots[1].high == plots.view.plots[0].high, "rates share their scale"
    assert float(plots.view.plots[2].high) < 10.0


async def test_plots_are_drawn_twice_a_second_and_only_where_they_changed(app, plots):
    start = plots.redraws
    await go_on(app, 10.0)
    assert 16 <= plots.redraws - start <= 20
    app.clock.now_s += 0.5
    app.show_newest()
    start = plots.redraws
    for _tick in range(10):
        app.clock.now_s += 0.04
        app.show_newest()
    assert plots.redraws == start, "no new value, nothing drawn"


async def test_units_change_value_and_axis(app, pilot, plots):
    await pilot.press("u", "enter")
    app.page.refresh_all_next_tick()
    app.show_newest()
    target = plots.view.plots[0]
    assert target.unit == "lb/ac"
    assert float(target.value) == pytest.approx(FRAMES[-1].row.target_rate_kg_ha * 0.8922, abs=0.6)
    assert float(target.high) < 400.0


async def test_old_values_are_grey_and_gaps_are_gaps(app, plots):
    app.clock.now_s += 10.0
    app.show_newest()
    assert plots.view.stale
    last = app.source.current_frame
    row = last.row._replace(time_s=last.row.time_s + 10.0)
    app.source.current_frame = replace(last, seq=last.seq + 1, row=row)
    app.clock.now_s += 0.5
    app.show_newest()
    assert not plots.view.stale
    assert [piece.joined for piece in plots.view.plots[0].pieces[-2:]] == [True, False]


async def test_locked_nothing_changes(app, pilot, plots):
    await pilot.press("f8")
    await pilot.press("plus", "y", "left", "v", "z")
    await pilot.click("#plots", offset=(50, 3))
    plots.post_message(Plots.Wheeled(1))
    plots.post_message(Plots.Named())
    await pilot.pause()
    assert (bar(app).span, app.page.ends_s, app.page.cursor_s) == ("span 02:00", None, None)
    assert app.screen is app.page


async def test_of_a_log_it_is_what_was_played_or_the_whole_log(frames, clock, shown):
    log = ReplaySource(frames, clock)
    log.seek_time(30.0)
    app = TopdressApp(None, clock, live=False, replay=ReplayJob(log, "run.csv"), utc_offset_s=0.0)
    async with app.run_test(size=SIZE) as pilot:
        plots = await opened(app, pilot)
        assert bar(app).states == ("log", "running") and "REPLAY" in shown(app)[0]
        assert plots.view.plots[0].value == f"{log.current_frame.row.target_rate_kg_ha:.0f}"
        assert plots.view.end == "06:12:30"
        await pilot.press("z")
        assert plots.view.end == "06:12:59" and bar(app).span == "whole run, 00:59"
        await pilot.press("plus")
        log.seek_time(40.0)
        app.page.refresh_all_next_tick()
        app.show_newest()
        assert plots.view.end == "06:12:40"


async def test_the_cursor_reads_a_row_not_the_mean_of_a_wide_span(clock):
    """A rate that turns every second, on a span whose columns hold several seconds."""
    made = run_frames(seconds=400.0)
    turned = [
        replace(
            frame,
            row=frame.row._replace(target_rate_kg_ha=100.0 if int(frame.row.time_s) % 2 else 300.0),
        )
        for frame in made
    ]
    app = TopdressApp(
        None, clock, live=False, replay=ReplayJob(ReplaySource(turned, clock), "run.csv")
    )
    async with app.run_test(size=SIZE) as pilot:
        plots = await opened(app, pilot)
        await pilot.press("z", "left", "left", "left")
        for _press in range(6):
            await pilot.press("left")
            at_s = app.page.cursor_s
            row = [frame.row for frame in turned if frame.row.time_s <= at_s + 1e-9][-1]
            assert plots.view.plots[0].value == f"{row.target_rate_kg_ha:.0f}"


async def test_machine_or_log(frames, clock):
    log = ReplaySource(frames, clock)
    app = TopdressApp(StillSource(FRAMES[-1]), clock, live=False, replay=ReplayJob(log, "run.csv"))
    async with app.run_test(size=SIZE) as pilot:
        await opened(app, pilot)
        assert "log" not in bar(app).states
        await pilot.press("q", "1", "enter")
        assert "log" in bar(app).states
        await pilot.press("q", "1", "enter")
        assert "log" not in bar(app).states


@pytest.mark.parametrize(
    ("size", "language"), [((80, 24), "en"), ((80, 24), "zh"), ((120, 40), "en")]
)
async def test_at_every_size_three_plots_and_the_time_axis_are_there(shown, size, language):
    picture = Picture("trends", size, screen="trends", language=language, alarms=True)
    app, _clock = still_app(picture)
    async with app.run_test(size=size) as pilot:
        await settle(app, picture, pilot.pause)
        plots = app.page.query_one("#plots", Plots)
        assert min(plots.count_plot_rows(plots.content_size.height)) >= 5
        rows = shown(app)
        assert sum("kg/ha" in row for row in rows) == 2 and any(
            "14:18:39" in row and "14:16:39" in row for row in rows
        )
        assert any(0x2800 < ord(character) < 0x2900 for row in rows for character in row)


# --- drawing
# --------------------------------------------------------------------------------------------------


def test_a_piece_goes_from_its_lowest_to_its_highest_and_joins_the_next():
    seen = dots(
        trace_cells((PlotPiece(0.0, 0.0, 0.0, False), PlotPiece(1.0, 1.0, 1.0, True)), 2, 1)
    )
    assert seen == {(0, 3), (1, 3), (2, 3), (3, 0), (3, 1), (3, 2), (3, 3)}
    assert dots(trace_cells((PlotPiece(0.5, 0.0, 1.0, False),), 1, 1)) == {(0, y) for y in range(4)}


def test_a_gap_and_what_lies_outside_are_not_drawn():
    seen = dots(
        trace_cells(
            (
                PlotPiece(-0.4, 0.5, 0.5, False),
                PlotPiece(0.0, 0.0, 0.0, True),
                PlotPiece(1.0, 0.0, 0.0, False),
            ),
            3,
            1,
        )
    )
    assert {x for x, _y in seen} == {0, 5}
