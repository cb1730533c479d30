"""No question leaves a screen that waits for what never comes; no note keeps a key from its
page."""

from __future__ import annotations

from dataclasses import replace

import pytest
from textual import events
from textual.widgets import Input
from topdress.console.app.app import TopdressApp
from topdress.console.app.attach_notice import JoinedMachineFacts
from topdress.console.app.dialogs import ChoiceDialog, TextDialog
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.pages.job.service import JobOffer
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.screens.worker_lost_screen import WorkerLostScreen
from topdress.console.app.services import Services
from topdress.console.link import WorkerGone

from tests.app.gallery import StillSource
from tests.app.harness import looked, settled
from tests.app.made_up.job import SampleJobService

SIZES = ((120, 40), (80, 24), (60, 20))
OFFER = JobOffer(
    "/logs/a.resume.json", "2026-03-18T06:18:00Z", "2026-03-18T07:02:00Z", "division 2", 1.2
)
JOINED = JoinedMachineFacts(
    "2026-11-23T07:12:00+00:00",
    "/logs/run.csv",
    ("/jobs/north.yaml",),
    ("/jobs/south.yaml",),
    named=("/jobs/south.yaml",),
)


@pytest.mark.parametrize("size", SIZES)
async def test_escape_at_the_resume_question_says_what_connects_for_as_long_as_nothing_does(
    clock, shown, size
):
    """ "Waiting for the first values", for ever."""
    desk = SampleJobService(cut_off=OFFER)
    app = TopdressApp(
        None, clock, live=False, services=Services(job=desk), start=desk.restart_worker
    )
    async with app.run_test(size=size) as pilot:
        await pilot.press("escape")
        for _minute in range(3):
            clock.now_s += 60.0
            await looked(app, pilot)
            text = " ".join("\n".join(shown(app)).split())
            assert "no machine is connected" in text and "X connects" in text, text
            assert "waiting for the first values" not in text
        await pilot.press("f10")
        await looked(app, pilot)
        assert "no machine is connected" in "\n".join(shown(app))
        await pilot.press("f2", "c")
        assert isinstance(app.screen, WorkerLostScreen)


@pytest.mark.parametrize(
    ("keys", "asked"), [(("enter",), None), (("escape",), None), (("2", "enter"), "south")]
)
async def test_files_on_the_command_line_may_take_the_place_of_a_machine_that_runs(
    source, frames, clock, keys, asked
):
    """They were only said not to be used."""
    desk = SampleJobService()
    desk.next = StillSource(frames[-1])
    source.current_frame = replace(
        source.current_frame, row=source.current_frame.row._replace(state="off")
    )
    app = TopdressApp(source, clock, live=False, services=Services(job=desk), joined=JOINED)
    async with app.run_test(size=(80, 24)) as pilot:
        assert isinstance(app.screen, ChoiceDialog)
        await pilot.press(*keys)
        await settled(app, pilot)
        wanted = [one for one in desk.asked if one[0] in ("recent", "restart")]
        assert wanted == ([] if asked is None else [("recent", "/jobs/south.yaml"), ("restart",)])
        assert (app.source is desk.next) is (asked is not None)


async def test_a_machine_at_work_is_not_ended_for_other_files(source, clock):
    desk = SampleJobService()
    app = TopdressApp(source, clock, live=False, services=Services(job=desk), joined=JOINED)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2", "enter")
        assert (
            isinstance(app.screen, ChoiceDialog)
            and "hold or stop it first" in app.screen.choices[1].why
        )
        assert not any(one[0] == "recent" for one in desk.asked)


async def test_a_machine_that_ends_by_itself_is_started_anew_with_the_files_of_the_command_line(
    source, frames, clock
):
    desk = SampleJobService()
    desk.next = StillSource(frames[-1])
    app = TopdressApp(
        source,
        clock,
        live=False,
        services=Services(job=desk),
        joined=JOINED,
        start=desk.restart_worker,
    )
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("escape")
        source.end.set_exception(WorkerGone("gone"))
        await pilot.pause()
        await pilot.pause()
        assert isinstance(app.screen, WorkerLostScreen)
        await pilot.press("1", "enter")
        await settled(app, pilot)
        assert ("recent", "/jobs/south.yaml") in desk.asked and app.source is desk.next


@pytest.mark.parametrize(
    "note",
    [lambda: TextDialog("Read", "this"), lambda: HelpScreen(()), lambda: AlarmList("Alarms", ())],
)
async def test_a_note_closes_by_any_page_key_which_does_what_it_says(full, note):
    async with full.run_test(size=(100, 30)) as pilot:
        for action in full.page_actions:
            answers = []
            full.push_screen(note(), answers.append)
            await pilot.pause()
            await pilot.press(action.keys)
            await pilot.pause()
            assert full.screen is full.page and full.page.where == action.id.removesuffix(
                "_screen"
            ), action.id
            assert answers == [None], "who asked for the note hears that it is closed"


async def test_what_is_typed_before_a_name_s_field_is_up_is_part_of_the_name(full, source):
    """The space of `my field` held the machine where it came before the dialog."""
    async with full.run_test(size=(100, 30)) as pilot:
        names = []
        dialog = NameDialog("Name", "")
        full.push_screen(dialog, names.append)
        assert not isinstance(full.focused, Input), "it is not up yet"
        for key, character in (("a", "a"), ("space", " "), ("x", "x"), ("enter", "\r")):
            await full.on_event(events.Key(key, character))
        await pilot.pause()
        assert source.orders == [] and full.screen is dialog
        assert full.screen.query_one("#name-input", Input).value == "a x"
        await pilot.press("y", "enter")
        assert names == ["a xy"]
