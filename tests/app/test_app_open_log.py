"""The Replay page opens a log from a list; what cannot be read is said and the log before stays."""
from __future__ import annotations

import asyncio

import pytest

from console.app.app import TopdressApp
from console.app.pages.replay.log_files import LogFile
from console.app.replay_job import ReplayJob
from console.app.services import Services
from console.app.widgets.field_map import FieldMap
from console.app.widgets.trend import Trend


class Shelf:
    def __init__(self, job, names=("new.csv", "broken.csv")):
        self.job, self.names = job, names

    def logs(self):
        return tuple(LogFile(f"/logs/{name}", name, "2026-03-18 14:02", "1.2 MB") for name in self.names)

    def open(self, path):
        if "broken" in path:
            raise ValueError(f"{path}, row 3: time_s: 'x' is not a number")
        return self.job


async def until(pilot, true):
    for _ in range(100):
        await pilot.pause()
        if true():
            return
        await asyncio.sleep(0.02)
    raise AssertionError("not in time")


@pytest.fixture
def app_with(source, clock, replay_source):
    def make(names=("new.csv", "broken.csv")):
        shelf = Shelf(ReplayJob(replay_source, "new.csv"), names)
        return TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=Services(logs=shelf))
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
