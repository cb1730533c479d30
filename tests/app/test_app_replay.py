"""The Replay screen and its source: where it stands, how fast it runs, what it refuses, what-if."""

from __future__ import annotations

import asyncio
import threading
import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.console.app.app import TopdressApp
from topdress.console.app.pages.replay.service import LogFile, ReplayJob, WhatIf
from topdress.console.app.replay_source import MAX_PLAY_SPEED, MIN_PLAY_SPEED, ReplaySource
from topdress.console.app.services import Services
from topdress.console.app.units import METRIC
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.app.widgets.rate_panels import RatesPanel
from topdress.console.app.widgets.rate_trend import Trend
from topdress.control.orders import Alarm, Answer, Do, Order, Severity

from tests.app.gallery import StillClock, StillSource
from tests.app.harness import later, until
from tests.app.made_up.run import run_frames

SIZE = (100, 30)


def test_it_plays_at_the_log_s_own_pace(replay_source, clock):
    replay_source.start_playing()
    clock.now_s += 1.0
    assert replay_source.current_frame.row.time_s == pytest.approx(1.0)
    clock.now_s += 0.19
    assert replay_source.current_frame.row.time_s == pytest.approx(1.0), (
        "the row in force, not the next one"
    )
    assert replay_source.frame_age_s == pytest.approx(0.19)


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0, 1000.0])
def test_it_plays_as_fast_as_it_is_told(replay_source, clock, speed):
    replay_source.set_speed(speed)
    replay_source.start_playing()
    clock.now_s += 0.05
    assert replay_source.at_s == pytest.approx(min(replay_source.end_s, 0.05 * speed))


def test_a_change_of_speed_keeps_the_place(replay_source, clock):
    replay_source.start_playing()
    clock.now_s += 4.0
    replay_source.set_speed(100.0)
    assert replay_source.at_s == pytest.approx(4.0)
    clock.now_s += 0.1
    assert replay_source.at_s == pytest.approx(14.0)


def test_speeds_stay_between_a_tenth_and_a_thousand(replay_source):
    replay_source.set_speed(0.001)
    assert replay_source.speed == MIN_PLAY_SPEED
    replay_source.set_speed(1e9)
    assert replay_source.speed == MAX_PLAY_SPEED
    replay_source.change_speed(1)
    assert replay_source.speed == MAX_PLAY_SPEED
    replay_source.change_speed(-1)
    assert replay_source.speed == 500.0


def test_pause_stands_and_step_moves_by_one_row(replay_source, clock):
    replay_source.start_playing()
    clock.now_s += 2.0
    replay_source.pause_playing()
    clock.now_s += 50.0
    assert replay_source.at_s == pytest.approx(2.0)
    replay_source.step_rows(1)
    assert replay_source.current_frame.row.time_s == pytest.approx(2.2)
    replay_source.step_rows(-2)
    assert replay_source.current_frame.row.time_s == pytest.approx(1.8)
    replay_source.step_rows(-999)
    assert replay_source.frame_index == 0


def test_it_stops_at_the_end_and_plays_again_from_the_start(replay_source, clock):
    replay_source.start_playing()
    clock.now_s += 1e6
    assert replay_source.is_at_end and replay_source.current_frame is replay_source.frames[-1]
    replay_source.toggle_playing()
    assert replay_source.at_s == replay_source.start_s and replay_source.playing


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["play", "pause", "seek", "step", "faster", "slower", "wait"]),
            st.floats(-200, 200),
        ),
        max_size=20,
    )
)
def test_whatever_is_pressed_it_stays_inside_the_log(moves):
    clock = StillClock()
    source = ReplaySource(_SHORT, clock)
    for move, number in moves:
        match move:
            case "play":
                source.start_playing()
            case "pause":
                source.pause_playing()
            case "seek":
                source.seek_time(number)
            case "step":
                source.step_rows(int(number))
            case "faster":
                source.change_speed(1)
            case "slower":
                source.change_speed(-1)
            case "wait":
                clock.now_s += abs(number)
        assert source.start_s <= source.at_s <= source.end_s
        assert source.current_frame.row.time_s <= source.at_s + 1e-9
        later = source.frame_index + 1
        assert later == len(source.frames) or source.frames[later].row.time_s > source.at_s


_SHORT = run_frames(seconds=5.0)


def test_a_gap_in_the_log_makes_its_values_old(frames, clock):
    source = ReplaySource([*frames[:10], *frames[100:]], clock)
    source.seek_time(15.0)
    assert source.frame_age_s == pytest.approx(15.0 - 1.8)


def test_next_alarm_finds_the_row_on_which_it_begins(frames, clock):
    alarm = Alarm("hopper_low", Severity.AMBER, 8.0)
    source = ReplaySource(
        [replace(f, alarms=(alarm,)) if 40 <= i < 60 else f for i, f in enumerate(frames)], clock
    )
    assert source.seek_next_alarm() and source.frame_index == 40
    assert not source.seek_next_alarm() and source.frame_index == 40


def test_orders_are_refused(replay_source):
    assert asyncio.run(replay_source.order(Order(Do.START))) == Answer(False, "replay")


def test_a_log_without_rows_is_refused(clock):
    with pytest.raises(ValueError, match="no rows"):
        ReplaySource([], clock)


async def test_the_keys_of_the_screen(replay_app, replay_source, clock, shown):
    async with replay_app.run_test(size=SIZE) as pilot:
        assert "REPLAY" in shown(replay_app)[0]
        await pilot.press("y")
        assert replay_source.playing
        clock.now_s += 10.0
        await pilot.press("space")
        assert not replay_source.playing and replay_source.at_s == pytest.approx(10.0)
        await pilot.press("right")
        assert replay_source.at_s == pytest.approx(10.2)
        await pilot.press("left", "left")
        assert replay_source.at_s == pytest.approx(9.8)
        await pilot.press("pagedown")
        assert replay_source.at_s == pytest.approx(39.8)
        await pilot.press("right_square_bracket", "right_square_bracket", "left_square_bracket")
        assert replay_source.speed == 2.0
        await pilot.press("end")
        assert replay_source.at_s == replay_source.end_s
        await pilot.press("home")
        await later(replay_app, pilot)
        rates = replay_app.page.query_one("#rates", RatesPanel)
        first = replay_source.frames[0].row.target_rate_kg_ha
        assert rates.view.target.text == f"{first:.0f}"
        assert replay_app.notice_text == ""


async def test_a_click_on_the_time_line_seeks(replay_app, replay_source):
    async with replay_app.run_test(size=SIZE) as pilot:
        await pilot.click("#replay-bar", offset=(50, 1))
        assert replay_source.at_s == pytest.approx(30.0, abs=2.0)


async def test_findings_are_counted_and_can_be_read(replay_app, shown):
    async with replay_app.run_test(size=SIZE) as pilot:
        assert any("findings 1" in row for row in shown(replay_app))
        await pilot.press("q", "2", "enter")
        assert any("3 rows had no time" in row for row in shown(replay_app))


async def test_what_if_shows_the_recomputed_frames_at_the_same_place_and_back(
    frames, replay_source, clock, shown
):
    asked = []

    def what_if(options, cancelled, tell):
        asked.append(options)
        return [replace(f, row=f.row._replace(target_rate_kg_ha=123.0)) for f in frames]

    app = TopdressApp(
        None,
        clock,
        live=False,
        replay=ReplayJob(replay_source, "run.csv", what_if=what_if, crops=("durum",)),
    )
    async with app.run_test(size=SIZE) as pilot:
        replay_source.seek_time(12.0)
        await pilot.press("q", "1", "enter", "2", "enter")
        await until(pilot, lambda: app.replay_page.chosen != WhatIf())
        await later(app, pilot)
        assert asked == [WhatIf(strategy="speed_first")]
        assert replay_source.at_s == pytest.approx(12.0)
        assert app.page.query_one("#rates", RatesPanel).view.target.text == "123"
        assert any("what if: speed first" in row for row in shown(app))
        assert any(
            "off the target by" in row
            and f"instead of {METRIC.mass.format_with_name(frames[-1].applied_kg)}" in row
            for row in shown(app)
        ), "what it would have changed"
        await pilot.press("q", "1", "enter", "3", "enter")
        await until(pilot, lambda: len(asked) == 2 and app.replay_page.computing is None)
        assert asked[1] == WhatIf(strategy="speed_first", crop="durum"), "changes add up"
        await pilot.press("delete")
        app.show_newest()
        assert app.page.query_one("#rates", RatesPanel).view.target.text != "123"
        assert app.replay_page.chosen == WhatIf()


async def test_a_what_if_that_fails_says_why_in_one_line(replay_source, clock, shown):
    def what_if(options, cancelled, tell):
        raise ValueError("crop durum: no day count in this log")

    app = TopdressApp(
        None, clock, live=False, replay=ReplayJob(replay_source, "run.csv", what_if=what_if)
    )
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("q", "1", "enter", "1", "enter")
        await until(pilot, lambda: app.notice_text)
        await pilot.pause()
        assert "no day count" in shown(app)[-1]
        assert app.replay_page.chosen == WhatIf() and app.replay_page.computing is None


@pytest.mark.parametrize("how", ["key", "click", "palette"])
async def test_a_what_if_is_cancelled_and_its_thread_ends(frames, replay_source, clock, shown, how):
    begun, ended, steps = threading.Event(), threading.Event(), []

    def what_if(options, cancelled, tell):
        while not cancelled() and len(steps) < 2_000:
            steps.append(1)
            tell(0.43)
            begun.set()
            time.sleep(0.002)
        ended.set()
        return frames

    app = TopdressApp(
        None, clock, live=False, replay=ReplayJob(replay_source, "run.csv", ("a finding",), what_if)
    )
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("q", "1", "enter", "2", "enter")
        await until(pilot, begun.is_set)
        await later(app, pilot, 0.2)
        assert any("computing 43 %, Esc cancels" in row for row in shown(app))
        if how == "key":
            await pilot.press("escape")
        elif how == "click":
            await pilot.click("#replay-bar", offset=(SIZE[0] - 5, 0))
        else:
            await app.action_do("cancel_what_if")
        await until(pilot, ended.is_set)
        assert len(steps) < 2_000, "the thread itself ends"
        await later(app, pilot, 0.2)
        assert app.replay_page.computing is None and app.replay_page.chosen == WhatIf()
        assert not any("computing" in row for row in shown(app))


async def test_a_machine_at_work_keeps_hold_stop_and_alarms_on_the_replay_screen(
    frames, clock, replay_source, shown
):
    source = StillSource(replace(frames[-1], alarms=(Alarm("shaft_silent", Severity.RED, 0.0),)))
    app = TopdressApp(source, clock, live=False, replay=ReplayJob(replay_source, "run.csv"))
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("f7")
        rows = shown(app)
        assert "REPLAY" in rows[0] and "MACHINE: WORKING" in rows[0]
        assert "ALARM" in rows[1] and "MACHINE" in rows[1]
        await pilot.press("y", "space", "x")
        assert source.orders == [Order(Do.HOLD), Order(Do.STOP)]
        assert replay_source.playing, "hold is for the machine"
        await pilot.press("s")
        assert len(source.orders) == 2, "start belongs to the Run screen"


async def test_without_a_log_the_screen_says_how_to_open_one(app, shown, pilot):
    await pilot.press("f7")
    assert any("J opens one" in row for row in shown(app))
    await pilot.press("y")
    await pilot.press("f2")
    assert app.page is app.pages["run"]


# --- The Replay page opens a log from a list; what cannot be read is said and the log before
# stays -------------------


class Shelf:
    def __init__(self, job, names=("new.csv", "broken.csv")):
        self.job, self.names = job, names

    def list_logs(self):
        return tuple(
            LogFile(f"/logs/{name}", name, "2026-03-18 14:02", "1.2 MB") for name in self.names
        )

    def open_log(self, path):
        if "broken" in path:
            raise ValueError(f"{path}, row 3: time_s: 'x' is not a number")
        return self.job


@pytest.fixture
def app_with(source, clock, replay_source):
    def make(names=("new.csv", "broken.csv")):
        shelf = Shelf(ReplayJob(replay_source, "new.csv"), names)
        return TopdressApp(
            source, clock, live=False, utc_offset_s=0.0, services=Services(logs=shelf)
        )

    return make


async def test_a_log_is_chosen_and_shown_while_the_machine_goes_on(app_with, source):
    app = app_with()
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f7", "j", "enter")
        await until(pilot, lambda: app.replay_page.job is not None)
        assert app.replay_page.job.name == "new.csv" and app.page.where == "replay"
        assert source.orders == []


async def test_a_broken_log_is_said_and_the_one_before_stays(app_with):
    app = app_with()
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f7", "j", "enter")
        await until(pilot, lambda: app.replay_page.job is not None)
        before = app.replay_page.job
        await pilot.press("j", "2", "enter")
        await until(pilot, lambda: "row 3" in app.notice_text)
        assert app.replay_page.job is before


async def test_no_log_yet_is_said(app_with):
    app = app_with(())
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f7", "j")
        assert "no log yet" in app.notice_text


async def test_before_a_log_is_open_nothing_of_the_machine_is_shown_as_its_own(app_with):
    app = app_with()
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("f7")
        page = app.replay_page
        assert page.query_one("#trend", Trend).view.points == ()
        assert page.query_one("#map", FieldMap).view.worked.box is None
        assert page.query_one("#map", FieldMap).view.picture is None
