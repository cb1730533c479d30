"""STOP is had with any form of its key, on every page and under every dialog; so is every
letter; no STOP that stops nothing is shown."""

from __future__ import annotations

import asyncio

import pytest
from textual._xterm_parser import XTermParser
from textual.command import CommandPalette
from textual.events import InputEvent
from textual.screen import ModalScreen
from textual.widgets import Input
from topdress.console.app import actions, key_normaliser
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import (
    Choice,
    ChoiceDialog,
    Confirm,
    Dialog,
    NudgeDialog,
    TextDialog,
)
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.job.map_dialog import MapDialog
from topdress.console.app.pages.job.service import MapReading
from topdress.console.app.pages.settings import page as settings_page
from topdress.console.app.pages.trends.page import ChannelDialog
from topdress.console.app.screens.alarm_list import AlarmList
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.screens.jump_letters import JumpScreen
from topdress.console.app.screens.worker_lost_screen import WorkerLostScreen
from topdress.console.app.settings import find_keymap_fault
from topdress.console.app.tablet_app import KeyDialog, TabletApp, TabletKey
from topdress.console.app.units import METRIC
from topdress.console.app.widgets.key_bar import KeyBar, place_actions
from topdress.console.link import WorkerGone
from topdress.control.orders import Answer, Do, Order

from tests.app.gallery import StillSource
from tests.app.harness import later, looked, tell, turned
from tests.app.made_up.job import SampleJobService
from tests.app.made_up.run import sample_alarms, sample_services

SIZE = (120, 40)
STOP, HOLD = Order(Do.STOP), Order(Do.HOLD)

# What terminals send for X and F12: plain, Shift, Caps Lock, Ctrl, Alt, the kitty protocol,
# older ones.
SENT_FOR_F12 = (
    "\x1b[24~",
    "\x1b[24;2~",
    "\x1b[24;5~",
    "\x1b[24;6~",
    "\x1b[24;3~",
    "\x1b[24;65~",
    "\x1b[24;66~",
    "\x1b[24$",
    "\x1b[24^",
)
SENT_FOR_X = (
    "x",
    "X",
    "\x1b[120;2u",
    "\x1b[120;65u",
    "\x1b[88;2u",
    "\x1b[120;2;88u",
    "\x1b[27;2;88~",
    "\x1b[120;6u",
    "\x18",
    "\x1bx",
    "\x1bX",
    "ｘ",
    "Ｘ",
    "ч",
    "Ч",
    "\x1b[1095;2u",
    "χ",
    "Χ",
    "х",
    "Х",
    "џ",
    "ס",
    "ㅌ",
    "さ",
)
SENT_FOR_SPACE = (" ", "\x1b[32;2u", "\x1b[32;2;32u", "\x1b[32;5u", "\x00", "\u3000", "\u00a0")

DIALOGS = {
    Confirm: lambda: Confirm("Sure?"),
    NudgeDialog: lambda: NudgeDialog(0.0, 1),
    ChoiceDialog: lambda: ChoiceDialog("Which?", [Choice("a", "A"), Choice("b", "B")], "a"),
    NumberDialog: lambda: NumberDialog("How much?", "kg", 0, 100),
    TextDialog: lambda: TextDialog("Read", "this"),
    MapDialog: lambda: MapDialog(
        SampleJobService().preview_map("north.geojson", MapReading()), METRIC
    ),
    NameDialog: lambda: NameDialog("Name", "abc"),
    ChannelDialog: lambda: ChannelDialog((), METRIC, lambda chosen: None),
    WorkerLostScreen: lambda: WorkerLostScreen("gone", True, True),
    AlarmList: lambda: AlarmList("Alarms", ()),
    HelpScreen: lambda: HelpScreen(actions.list_page_actions("run")),
    JumpScreen: lambda: JumpScreen((), ()),
    settings_page.ThemeDialog: lambda: settings_page.ThemeDialog(
        "Theme", [Choice("day", "Day"), Choice("night", "N")], "day"
    ),
    settings_page.KeyPressDialog: lambda: settings_page.KeyPressDialog("start", "S"),
    KeyDialog: lambda: KeyDialog("Key", "", TabletKey("k", lambda: 0.0)),
    CommandPalette: CommandPalette,
}


def sent(text: str) -> list[InputEvent]:
    """The keys and mouse events that Textual makes of what a terminal sends."""
    parser = XTermParser()
    return [
        event for event in (*parser.feed(text), *parser.feed("")) if isinstance(event, InputEvent)
    ]


async def send(app, pilot, *texts):
    for text in texts:
        for event in sent(text):
            app.post_message(event)
        await pilot.pause()
        await pilot.pause()


async def click(app, pilot, x, y):
    """As a terminal sends it: a pilot's own clicks pass the app by."""
    await send(app, pilot, f"\x1b[<0;{x + 1};{y + 1}M", f"\x1b[<0;{x + 1};{y + 1}m")


def kinds(base=ModalScreen):
    """Every kind of dialog that the console has."""
    for kind in base.__subclasses__():
        if kind.__module__.startswith("topdress.console.") and kind is not Dialog:
            yield kind
        yield from kinds(kind)


async def test_stop_and_hold_are_had_with_every_form_of_their_keys(app, pilot):
    for order, texts in ((STOP, (*SENT_FOR_X, *SENT_FOR_F12)), (HOLD, SENT_FOR_SPACE)):
        for text in texts:
            app.source.orders.clear()
            await send(app, pilot, text)
            assert app.source.orders == [order], text


async def test_stop_reaches_the_worker_from_every_page(full, source, pilot):
    for where in full.pages:
        await turned(full, pilot, where)
        for text in ("x", "X", "\x1b[120;2u", "Ч", "\x1b[24~", "\x1b[24;2~"):
            source.orders.clear()
            await send(full, pilot, text)
            assert source.orders == [STOP], (where, text)
        source.orders.clear()
        await send(full, pilot, " ", "\u3000")
        assert source.orders == [HOLD, HOLD], where
        assert full.page.where == where and full.screen is full.page


def test_every_kind_of_dialog_is_tried_below():
    assert set(kinds()) <= set(DIALOGS), "a new kind of dialog belongs into DIALOGS"


QUICK = (Confirm, NumberDialog, NameDialog, WorkerLostScreen, CommandPalette)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(
            kind,
            id=f"{kind.__module__.rpartition('.')[2]}.{kind.__name__}",
            marks=() if kind in QUICK else pytest.mark.exam,
        )
        for kind in DIALOGS
    ],
)
async def test_stop_and_hold_reach_the_worker_under_every_dialog(full, source, kind, pilot):
    full.push_screen(DIALOGS[kind]())
    await pilot.pause(0.05)
    dialog = full.screen
    assert isinstance(dialog, kind)
    typing = isinstance(full.focused, Input)
    for text in (*SENT_FOR_F12[:3], *(() if typing else ("x", "X", "\x1b[120;2u", "Ч"))):
        source.orders.clear()
        await send(full, pilot, text)
        assert source.orders == [STOP], text
    for text in ("\x00", "\x1b[32;5u") if typing else (" ", "\u3000"):
        source.orders.clear()
        await send(full, pilot, text)
        assert source.orders == [HOLD], text
    assert full.screen is dialog, "the dialog stays"
    source.orders.clear()
    bar = full.page.query_one("#keys", KeyBar)
    for name, order in (("stop", STOP), ("hold", HOLD)):
        place = next(
            one for one in place_actions(bar.view.actions, bar.size.width) if one[0].id == name
        )
        await click(full, pilot, bar.region.x + place[1] + 1, bar.region.y)
        assert source.orders == [order] and full.screen is dialog, (
            f"a click on {name}, which is in sight"
        )
        source.orders.clear()


async def test_a_dialog_over_the_key_bar_hides_it_from_clicks(full, source):
    """Where a dialog lies over them, hold and STOP are not in sight, and a click is the
    dialog's."""
    async with full.run_test(size=(40, 10)) as pilot:
        full.push_screen(NumberDialog("How much?", "kg", 0, 100))
        await pilot.pause()
        dialog = full.screen.query_one(".dialog")
        # it leaves both in sight by itself
        dialog.styles.margin, dialog.styles.min_height = 0, 10
        await pilot.pause()
        assert dialog.region.contains(16, 9)
        await click(full, pilot, 16, 9)
        assert source.orders == []


async def test_in_a_text_field_a_letter_is_a_letter(full, source, pilot):
    full.push_screen(NameDialog("Name", ""))
    await pilot.pause()
    await send(full, pilot, "x", "X", "Ч", "ｘ", " ", "a", "S")
    assert full.screen.query_one(Input).value == "xXЧｘ aS" and source.orders == []


# --- every letter, on every page
# -------------------------------------------------------------------------------------


def forms(letter: str) -> tuple[str, ...]:
    """Caps Lock or Shift, kitty's two ways to say Shift, and a full-width input method."""
    wide = chr(ord(letter) + 0xFEE0)
    return (
        letter.upper(),
        f"\x1b[{ord(letter)};2u",
        f"\x1b[{ord(letter.upper())};2u",
        wide,
        chr(ord(letter.upper()) + 0xFEE0),
    )


async def done_by(app, pilot, text) -> list[str]:
    """The actions that something sent leads to; none is carried out."""
    done: list[str] = []

    async def note(name: str) -> None:
        done.append(name)

    app.action_do, before = note, app.action_do
    try:
        await send(app, pilot, text)
    finally:
        app.action_do = before
    return done


@pytest.mark.exam
async def test_every_letter_does_the_same_with_shift_caps_lock_and_full_width(full):
    tried, keymap = set(), full.services.settings.settings.keymap
    async with full.run_test(size=SIZE) as pilot:
        for where in full.pages:
            await turned(full, pilot, where)
            for action in actions.list_page_actions(where):
                for key in actions.find_keys(action, keymap):
                    if len(key) == 1 and key.isalpha():
                        for text in (key, *forms(key)):
                            assert await done_by(full, pilot, text) == [action.id], (where, text)
                        tried.add(action.id)
        letters = {
            action.id
            for action in actions.ACTIONS
            if any(len(key) == 1 and key.isalpha() for key in actions.find_keys(action, keymap))
        }
        assert tried == letters and len(letters) > 40
        assert await done_by(full, pilot, "\x1b[112;6u") == ["palette"], "Ctrl+Shift+P"


def test_no_built_in_binding_is_a_capital():
    """Else folding would hide it."""
    own = {key for action in actions.ACTIONS for key in actions.find_keys(action, {})}
    for kind in kinds():
        own |= {
            key.strip()
            for binding in kind.__dict__.get("BINDINGS", ())
            for key in binding.key.split(",")
        }
    assert not [key for key in own if key.rpartition("+")[2] != key.rpartition("+")[2].lower()]


async def test_digits_of_dialogs_work_full_width(full, pilot):
    answers = []
    full.push_screen(WorkerLostScreen("gone", True, True), answers.append)
    await pilot.pause()
    await send(full, pilot, "２", "\r")
    assert answers == ["attach"]
    full.push_screen(NumberDialog("How much?", "kg", 0, 100), answers.append)
    await pilot.pause()
    await send(full, pilot, "１", "２", "\r")
    assert answers == ["attach", 12.0]


async def test_a_remapped_key_works_with_caps_lock_too(source, clock):
    app = TopdressApp(
        source, clock, live=False, keymap={"start": "z", "stop": "p,ctrl+g", "hold": "v"}
    )
    async with app.run_test(size=SIZE) as pilot:
        for text, order in (
            ("Z", Order(Do.START)),
            ("P", STOP),
            ("\x1b[112;2u", STOP),
            ("V", HOLD),
            ("v", HOLD),
            ("\x1b[24;5~", STOP),
            ("\x07", STOP),
        ):
            source.orders.clear()
            await send(app, pilot, text)
            assert source.orders == [order], text
        source.orders.clear()
        await send(app, pilot, "\x10")
        assert isinstance(app.screen, CommandPalette) and source.orders == [], (
            "Ctrl+P is bound, and is not STOP"
        )


async def test_a_capital_that_the_user_bound_is_the_user_s(source, clock):
    assert find_keymap_fault({"mark": "S"}) == ""
    app = TopdressApp(source, clock, live=False, keymap={"mark": "S", "map_follow": "R"})
    async with app.run_test(size=SIZE) as pilot:
        await send(app, pilot, "s", "S", "\x1b[115;2u", "R")
        mark = Order(Do.MARK, "mark")
        assert source.orders == [Order(Do.START), mark, mark, Order(Do.READY)], (
            "R is the user's on the map alone"
        )


def test_f12_cannot_be_taken_from_stop():
    for key in ("f12", "shift+f12"):
        assert "F12 is STOP" in find_keymap_fault({"start": key, "stop": "p"})
    assert find_keymap_fault({"stop": "z,f12"}) == "key z: both whole field and STOP", (
        "no complaint about F12"
    )


def test_a_letter_alone_is_folded_and_nothing_else():
    kept = ("escape", "shift+left", "ctrl+c", "alt+shift+left", "plus", "shift+tab", "ß", "é", "f2")
    assert [
        key_normaliser.normalise_key(key, frozenset(), frozenset({"x", "space"})) for key in kept
    ] == list(kept)


# --- no STOP that stops nothing
# --------------------------------------------------------------------------------------


async def test_stop_is_in_its_place_beside_a_notice(app, source, shown):
    source.answer = Answer(False, "not_from_state;state=working")
    async with app.run_test(size=SIZE) as pilot:
        bar = app.page.query_one("#keys", KeyBar)
        place = next(
            one for one in place_actions(bar.view.actions, bar.size.width) if one[0].id == "stop"
        )
        await pilot.press("s")
        last = shown(app)[-1]
        assert "Not possible" in last and last[place[1] :].startswith(" X STOP ")
        await pilot.click("#keys", offset=(place[1] + 1, 0))
        assert source.orders == [Order(Do.START), STOP]


@pytest.mark.parametrize(
    ("key", "size"),
    [
        (None, (80, 24)),
        *(
            pytest.param(key, size, marks=pytest.mark.exam)
            for key, size in ((None, (120, 40)), ("abcd2345", (120, 40)), ("abcd2345", (80, 24)))
        ),
    ],
)
async def test_a_tab_that_only_looks_shows_no_stop_and_says_why(source, clock, shown, key, size):
    async def link_to(operating: bool) -> StillSource:
        return source

    app = TabletApp(
        source,
        link_to,
        TabletKey(key, clock),
        clock=clock,
        live=False,
        utc_offset_s=0.0,
        services=sample_services(),
    )
    async with app.run_test(size=size) as pilot:
        for where in ("run", "map", "trends", "devices", "replay", "job"):
            await turned(app, pilot, where)
            await later(app, pilot)
            last = shown(app)[-1]
            assert "hold and STOP: at the machine" in last and "X STOP" not in last, where
            offered = {action.id for action in app.list_offered_actions(where)}
            assert not {"hold", "stop"} & offered
            titles = {command.title for command in app.get_system_commands(app.screen)}
            assert not {"hold", "STOP"} & titles
            await pilot.press("f1")
            assert not any("Machine off, from any state" in row for row in shown(app))
            await pilot.press("escape")
            for text in ("x", "X", "\x1b[24~", " "):
                await send(app, pilot, text)
                assert app.screen is app.page, f"{text!r} asks for nothing while the machine runs"
                assert "hold and STOP: at the machine" in shown(app)[-1]
            for x in range(0, size[0], 9) if where == "run" else ():
                await pilot.click("#keys", offset=(x, 0))
                while app.screen is not app.page:
                    app.pop_screen()
                await turned(app, pilot, where)
        assert source.orders == [] and app.is_view_only
        app.is_view_only = False
        app.page.refresh_all_next_tick()
        app.show_newest()
        await turned(app, pilot, "run")
        assert "X STOP" in shown(app)[-1]
        await send(app, pilot, "X")
        assert source.orders == [STOP]


@pytest.mark.parametrize("size", [(120, 40), (80, 24)])
async def test_without_a_worker_stop_and_hold_ask_to_connect_on_every_page(
    source, clock, shown, size
):
    """Another console may have started the machine again: an X that does nothing must say so."""

    async def attach():
        return StillSource(source.current_frame)

    app = TopdressApp(source, clock, live=False, attach=attach, services=sample_services())
    tell(source, alarms=sample_alarms(source.current_frame.at_s))
    async with app.run_test(size=size) as pilot:
        await looked(app, pilot)
        source.end.set_exception(WorkerGone("the connection to the machine broke off"))
        await pilot.pause()
        await pilot.pause()
        await pilot.press("escape")
        for where in ("run",) if size == SIZE else app.pages:
            await turned(app, pilot, where)
            rows = shown(app)
            assert "STOP: at machine" in rows[-1] and "X connect" in rows[-1], where
            assert "X STOP" not in rows[-1] and "Space hold" not in rows[-1], where
            assert "No connection to the machine" in rows[1], "no old alarm hides it"
            orders = [one for one in app.list_offered_actions(where) if one.needs_machine]
            assert all("no connection" in app.explain_not_now(one) for one in orders), where
            await send(app, pilot, "X")
            assert isinstance(app.screen, WorkerLostScreen), where
            app.pop_screen()
        await turned(app, pilot, "run")
        for text in ("\x1b[24~", " "):
            await send(app, pilot, text)
            assert isinstance(app.screen, WorkerLostScreen), text
            app.pop_screen()
        for key in ("s", "r", "m", "plus", "comma", "l", "a"):
            await pilot.press(key)
            assert app.screen is app.page and "no connection" in app.notice_text, key
            app.show_notice("")
            clock.now_s += 5.0
        bar = app.page.query_one("#keys", KeyBar)
        place = next(at for at in range(bar.size.width) if bar.find_action(at) == "stop")
        await click(app, pilot, bar.region.x + place, bar.region.y)
        assert isinstance(app.screen, WorkerLostScreen) and source.orders == []
        await pilot.press("1", "enter")
        await looked(app, pilot)
        await send(app, pilot, "X")
        assert app.source is not source and app.source.orders == [STOP]
        assert "X STOP" in shown(app)[-1]


async def test_an_order_from_a_dialog_that_outlived_its_worker_is_not_lost_in_silence(
    source, clock, pilot, app
):
    await pilot.press("m", "1", "2", "0")
    source.end.set_exception(WorkerGone("the connection to the machine broke off"))
    await pilot.pause()
    await pilot.press("escape")
    assert isinstance(app.screen, NumberDialog)
    await pilot.press("enter")
    assert isinstance(app.screen, WorkerLostScreen)


async def test_a_question_about_the_connection_goes_when_there_is_one(source, clock):
    """X pressed again while the console connects."""
    ready = asyncio.Event()

    async def attach():
        await ready.wait()
        return StillSource(source.current_frame)

    app = TopdressApp(source, clock, live=False, attach=attach)
    async with app.run_test(size=SIZE) as pilot:
        source.end.set_exception(WorkerGone("gone"))
        await pilot.pause()
        await pilot.press("1", "enter", "x")
        assert isinstance(app.screen, WorkerLostScreen)
        ready.set()
        await pilot.pause()
        await pilot.pause()
        assert app.screen is app.page and not app.gone


async def test_while_the_machine_is_changed_over_stop_says_so_and_is_not_lost_after_a_failure(
    source, clock, shown
):
    ready = asyncio.Event()

    async def start():
        await ready.wait()
        raise RuntimeError("the machine did not start: no such port")

    app = TopdressApp(source, clock, live=False, start=start)
    async with app.run_test(size=SIZE) as pilot:
        app.restart_source(start)
        await pilot.pause()
        source.end.set_exception(WorkerGone("ended for new files"))
        await pilot.pause()
        app.show_notice("")
        await pilot.press("x")
        assert "comes back with the new files" in app.notice_text and app.screen is app.page
        ready.set()
        await pilot.pause()
        await pilot.pause()
        assert isinstance(app.screen, WorkerLostScreen)
        await pilot.press("escape")
        app.notice_text = ""
        await looked(app, pilot)
        assert "STOP: at machine" in shown(app)[-1] and "X STOP" not in shown(app)[-1]
