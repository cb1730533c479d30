"""A browser's tab: it looks until the key is typed, and the worker refuses what slips through."""

from __future__ import annotations

from dataclasses import replace

import pytest
from textual.widgets import Button
from topdress.console.app import actions
from topdress.console.app.action import ANYWHERE, CALIBRATE, DIAGNOSIS, JOB, MAP, RUN, SETTINGS
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.guide_line_store import make_line_record
from topdress.console.app.pages.job.service import EarlierRun
from topdress.console.app.screens.worker_lost_screen import WorkerLostScreen
from topdress.console.app.services import Services
from topdress.console.app.tablet_app import WRITING_PAGES, KeyDialog, TabletApp, TabletKey
from topdress.console.app.widgets.field_map import FieldMap
from topdress.console.app.widgets.key_bar import KeyBar
from topdress.console.services.line_files import ReadOnlyGuideLineFiles, StoredGuideLineFiles
from topdress.control.orders import Do

from tests.app.gallery import StillClock, StillSource
from tests.app.harness import settled, turned, until
from tests.app.made_up.diagnosis import MadeUpDiagnosis
from tests.app.test_app_nothing_cut import cut_on


@pytest.fixture
def tab(source, clock):
    """A tab on a still source; `tab.links` says with which right each link was asked for."""
    links: list[bool] = []

    def make(key: str | None = "abcd2345", start: StillSource | None = source) -> TabletApp:
        async def link_to(operating: bool) -> StillSource:
            links.append(operating)
            return source

        app = TabletApp(
            start,
            link_to,
            TabletKey(key, clock),
            clock=clock,
            live=False,
            utc_offset_s=0.0,
            services=Services(diagnosis=MadeUpDiagnosis()),
        )
        app.links = links
        return app

    return make


@pytest.mark.exam
async def test_nothing_is_ordered_by_any_key_of_any_page_without_the_key(tab, source, shown):
    app = tab(None)
    async with app.run_test(size=(120, 40)) as pilot:
        app.show_newest()
        assert "VIEW ONLY" in shown(app)[0]
        for page in [name for name in app.pages if name not in WRITING_PAGES]:
            await turned(app, pilot, page)
            for action in actions.list_page_actions(page):
                if action.id != "quit":
                    await app.action_do(action.id)
                    await pilot.press("escape")
            await pilot.press("space", "x", "s", "r", "plus", "enter")
        assert source.orders == [] and source.device_orders == [] and source.lag_tests == []


async def test_a_refusal_is_said_in_words(tab, shown):
    app = tab(None)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("s")
        assert "view only: hold" in shown(app)[-1]
        assert len(app.screen_stack) == 1


async def test_pages_that_write_files_are_closed(tab):
    app = tab(None)
    async with app.run_test(size=(120, 40)) as pilot:
        assert WRITING_PAGES == {CALIBRATE, DIAGNOSIS, SETTINGS}
        for page in WRITING_PAGES:
            await app.action_do(f"{page}_screen")
            await turned(app, pilot, page)
            assert app.page.where == RUN


async def test_what_only_looks_is_allowed(tab):
    app = tab(None)
    allowed = {action.id for action in actions.ACTIONS if app.is_allowed(action)}
    everywhere = {
        action.id for action in actions.ACTIONS if action.where == ANYWHERE and action.id in allowed
    }
    assert not {"hold", "stop", "acknowledge", "lock", "tour"} & everywhere
    assert {
        "help",
        "theme",
        "units",
        "language",
        "run_screen",
        "devices_screen",
        "replay_screen",
    } <= everywhere
    assert not [name for name in allowed if actions.BY_ID[name].where == RUN and name != "connect"]


async def test_the_key_turns_it_into_one_that_operates(tab, source, shown):
    app = tab()
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("s")
        assert isinstance(app.screen, KeyDialog) and source.orders == []
        await pilot.press(*"wrong", "enter")
        assert "This is not the tablet's key." in "\n".join(shown(app)) and app.is_view_only
        assert "wrong" not in "\n".join(shown(app)).replace("Wrong", "")
        app.clock.now_s += 2.0
        for _letter in "wrong":
            await pilot.press("backspace")
        await pilot.press(*"abcd2345", "enter")
        await until(pilot, lambda: app.links)
        assert not app.is_view_only and app.links == [True]
        app.show_newest()
        await pilot.press("s")
        assert [order.do for order in source.orders] == [Do.START]
        await app.action_do("diagnosis_screen")
        assert app.page.where == DIAGNOSIS
        app.page.refresh_all_next_tick()
        app.show_newest()
        assert "TABLET" in app.list_status_marks()


@pytest.mark.parametrize("row", [0, 2])
async def test_keys_are_three_rows_high_under_a_finger(tab, source, row):
    app = tab()
    async with app.run_test(size=(128, 36)) as pilot:
        app.is_view_only = False
        app.page.refresh_all_next_tick()
        app.show_newest()
        bar = app.page.query_one(KeyBar)
        (at,) = [
            x
            for x in range(bar.size.width)
            if bar.find_action(x) == "stop" and bar.find_action(x - 1) != "stop"
        ]
        assert bar.region.height == 3
        await pilot.click(KeyBar, offset=(at, row))
        assert [order.do for order in source.orders] == [Do.STOP]
        await pilot.press("m")
        await pilot.pause()
        assert {key.region.height for key in app.screen.query(Button)} == {3}


@pytest.mark.parametrize("looking", [True, False])
@pytest.mark.parametrize(
    ("page", "under", "rows"), [(RUN, FieldMap, 18), (MAP, FieldMap, 23), (JOB, "#job-totals", 12)]
)
async def test_a_tablet_on_end_uses_its_height_and_cuts_nothing(tab, page, under, rows, looking):
    app = tab()
    async with app.run_test(size=(65, 43)) as pilot:
        app.is_view_only = looking
        app.page.refresh_all_next_tick()
        app.show_newest()
        await turned(app, pilot, page)
        assert app.page.query_one(under).region.height >= rows
        assert cut_on(app) == []


async def test_a_key_that_has_to_wait_is_tried_by_itself(tab, clock):
    """As it was entered: what is typed anew is not."""
    app = tab("abcd2345")
    async with app.run_test(size=(120, 40)) as pilot:
        app.key.find_fault("guess of another tab")
        await pilot.press("asterisk", *"abcd", "enter")
        assert isinstance(app.screen, KeyDialog) and app.key.wait_left_s == 1.0
        await pilot.press(*"2345")
        clock.now_s += 1.1
        await pilot.pause(1.3)
        assert app.is_view_only, "half of a key"
        app.key.find_fault("guess of another tab")
        await pilot.press("enter")
        assert app.is_view_only and app.key.wait_left_s
        clock.now_s += 10.0
        await until(pilot, lambda: not app.is_view_only)
        assert not isinstance(app.screen, KeyDialog)


async def test_without_a_worker_the_tab_says_so_and_starts_none(tab, shown):
    app = tab(start=None)
    async with app.run_test(size=(120, 40)) as pilot:
        assert isinstance(app.screen, WorkerLostScreen) and app.start is None
        text = " ".join("\n".join(shown(app)).split())
        assert "The console on the machine is not running" in text and "start it again" not in text
        await pilot.press("1", "enter")
        await until(pilot, lambda: app.links)
        assert app.links == [False] and app.is_view_only


def test_wrong_keys_make_one_wait_longer_each_time(clock):
    key = TabletKey("abcd2345", clock)
    assert key.find_fault("abcd2346") == "This is not the tablet's key."
    assert key.find_fault("abcd2345") == "The last key was wrong: wait 2 s."
    clock.now_s += 1.0
    assert key.find_fault("") == "This is not the tablet's key."
    clock.now_s += 1.5
    assert key.find_fault("abcd2345").startswith("The last key was wrong")
    clock.now_s += 0.5
    assert key.find_fault(" abcd2345\n") == ""
    assert (
        TabletKey(None, clock).find_fault("")
        == "There is no key: this server was started for viewing only."
    )


async def test_a_tab_that_comes_late_shows_the_ground_and_the_line_of_before(frames, tmp_path):
    """The machine had worked for hours when the tablet was switched on; what the tab sets is
    its own alone."""
    log = tmp_path / "run.csv"
    frame = replace(frames[-1], log_path=str(log))
    files = StoredGuideLineFiles()
    files.append_record(str(log), make_line_record(GuideLine((0.0, 0.0), (0.0, 50.0), 2.4)))
    files.close_files()
    before = EarlierRun((), tuple((500.0, float(k), 0.0, 300.0) for k in range(40)))
    app = TabletApp(
        StillSource(frame),
        None,
        TabletKey(None, StillClock()),
        clock=StillClock(),
        live=False,
        services=Services(
            earlier=lambda path: before if path == str(log) else None,
            lines=ReadOnlyGuideLineFiles(),
        ),
    )
    async with app.run_test(size=(120, 40)) as pilot:
        await settled(app, pilot)
        assert app.history.worked.box.east_m > 400.0 and app.guide.b == (0.0, 50.0)
        app.guide.clear_ends()
        app.keep_line_record(make_line_record(app.guide))
        app.services.lines.close_files()
    assert StoredGuideLineFiles().read_lines(str(log)).guide.is_set
