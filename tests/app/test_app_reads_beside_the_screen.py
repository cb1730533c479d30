"""Opening a page or a question reads no file and no module in the thread that draws: a slow
disk must not stop STOP.

Python tells of each file, folder and module that is looked at (`sys.addaudithook`), and in
which thread: no time is measured here. The files are real ones, by the same services as in the
cab.
"""

from __future__ import annotations

import asyncio
import datetime as dt
import os
import sys
import threading
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
import textual
from rich.cells import cell_len
from topdress.console.app.app import PRELOADED_MODULES, WIDE_CHARACTER, TopdressApp
from topdress.console.app.pages.page_registry import SCREEN_CLASSES
from topdress.console.cli.screens import make_run_services
from topdress.console.services.job import JobFiles
from topdress.console.services.launcher import Launcher
from topdress.console.services.settings import read_settings_store
from topdress.drivers.files.run_setup import build_setup, load_by_kind

WATCHED = {
    "open",
    "import",
    "os.listdir",
    "os.scandir",
    "os.mkdir",
    "os.rename",
    "subprocess.Popen",
}
PAGES = ("run", "map", "trends", "devices", "calibrate", "replay", "diagnosis", "job", "settings")
# orders; a diagnosis is a process of its own
NOT_TRIED = {"job_ready", "job_start", "dia_begin"}
# how tests wait; what Textual says of an error
NOT_OURS = ("/proc/self/", str(Path(textual.__file__).parent))
SIZE = (120, 40)


class Looks:
    """What was looked at in the thread that draws, while `on`. A hook cannot be taken away
    again, and each `id()` costs its process a call from then on: one for all tests, when the
    first of them begins."""

    def __init__(self) -> None:
        self.on, self.thread, self.hooked = False, 0, False
        self.seen: list[str] = []

    def _heard(self, event: str, what: tuple[object, ...]) -> None:
        if (
            self.on
            and event in WATCHED
            and threading.get_ident() == self.thread
            and not str(what[0]).startswith(NOT_OURS)
        ):
            self.seen.append(f"{event} {what[0]}")

    def begin(self) -> None:
        if not self.hooked:
            sys.addaudithook(self._heard)
            self.hooked = True
        self.seen.clear()
        self.on, self.thread = True, threading.get_ident()

    def end(self) -> list[str]:
        self.on = False
        return list(self.seen)


LOOKS = Looks()


@pytest.fixture
def app(source, clock, tmp_path, monkeypatch):
    for name in ("HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "topdress" / "logs" / "run.csv"
    log.parent.mkdir(parents=True)
    log.write_text("time_s\n0.0\n")
    launcher = Launcher((), (), 1, 20.0, None, tmp_path / "trouble.log")
    found = load_by_kind(())
    setup = build_setup(found, dt.date(2026, 3, 18))
    services = replace(
        make_run_services(lambda: (setup, found)),
        job=JobFiles(launcher),
        settings=read_settings_store(),
    )
    source.current_frame = replace(source.current_frame, log_path=str(log))
    return TopdressApp(source, clock, live=False, utc_offset_s=0.0, services=services)


async def ready(app, pilot, *wanted):
    """As some seconds after the start: the modules of all pages are read, the pages are made.
    wanted: were seen."""
    await pilot.pause()
    app.services.make_late_services()
    for where in app.pages:
        app.pages.import_page(where)
        app.pages[where]
    app.services.make_late_services()
    for module in PRELOADED_MODULES:
        import_module(module)
    cell_len(WIDE_CHARACTER)
    # what a page reads in threads of its own is there
    for where in wanted:
        app.turn_to_page(where)
        await settled(app, pilot)
    app.turn_to_page("run")
    await pilot.pause()


async def settled(app, pilot):
    await pilot.pause()
    at_work = [one for one in app.workers if one.group != "source" and not one.is_finished]
    if at_work:
        await asyncio.wait([asyncio.ensure_future(one.wait()) for one in at_work])
        await pilot.pause()


async def looked_at(app, pilot, key):
    LOOKS.begin()
    try:
        await pilot.press(key)
        await settled(app, pilot)
    finally:
        seen = LOOKS.end()
    while app.screen is not app.page:
        app.pop_screen()
        await pilot.pause()
    return seen


@pytest.mark.parametrize(
    "where",
    [
        where
        if where in ("run", "map", "diagnosis", "job", "settings")
        else pytest.param(where, marks=pytest.mark.exam)
        for where in PAGES
    ],
)
async def test_a_page_and_its_questions_look_at_no_file_in_the_thread_that_draws(app, where):
    async with app.run_test(size=SIZE) as pilot:
        await ready(app, pilot, where)
        found = {}
        LOOKS.begin()
        app.turn_to_page(where)
        await settled(app, pilot)
        found["turned to"] = LOOKS.end()
        app.turn_to_page(where)
        for action in [
            one
            for one in app.list_offered_actions(where)
            if one.where == where and one.id not in NOT_TRIED
        ]:
            app.turn_to_page(where)
            found[action.id] = await looked_at(app, pilot, action.keys.split(",")[0])
    assert {name: seen for name, seen in found.items() if seen} == {}


async def test_what_lies_over_any_page_looks_at_no_file_in_the_thread_that_draws(app):
    async with app.run_test(size=SIZE) as pilot:
        await ready(app, pilot)
        found = {
            key: await looked_at(app, pilot, key)
            for key in ("f1", "exclamation_mark", "ctrl+p", "tab", "apostrophe", "u", "d")
        }
    assert {key: seen for key, seen in found.items() if seen} == {}


async def test_the_hook_hears_a_file_of_this_thread_and_none_of_another(tmp_path):
    """Else the tests above could not fail."""
    LOOKS.begin()
    try:
        os.listdir(tmp_path)
        (tmp_path / "one").write_text("1")
        await asyncio.to_thread(Path.read_text, tmp_path / "one")
    finally:
        seen = LOOKS.end()
    assert seen == [f"os.listdir {tmp_path}", f"open {tmp_path / 'one'}"]


async def test_a_job_that_was_cut_off_is_looked_for_beside_the_screen(app):
    async with app.run_test(size=SIZE) as pilot:
        await ready(app, pilot)
        LOOKS.begin()
        app.ask_to_resume_job(app.services.job)
        seen = LOOKS.end()
    assert seen == []


async def test_settings_that_cannot_be_kept_are_those_of_the_file_again(app):
    def full(_settings):
        raise OSError(28, "No space left on device")

    async with app.run_test(size=SIZE) as pilot:
        await ready(app, pilot)
        store = app.services.settings
        page = app.pages["settings"]
        page.use_settings(store.settings.model_copy(update={"sound": False}))
        await settled(app, pilot)
        kept = store.settings
        store.write = full
        page.use_settings(kept.model_copy(update={"units": "imperial"}))
        page.use_settings(store.settings.model_copy(update={"theme": "night"}))
        await settled(app, pilot)
        assert (
            store.settings == kept and app.units.id == "metric" and "No space left" in store.trouble
        )


def test_all_pages_are_tried():
    assert set(PAGES) == set(SCREEN_CLASSES)
