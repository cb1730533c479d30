"""A key means one thing: digits are values, a refused question swallows its answer, what cannot
be done says why."""

from __future__ import annotations

from dataclasses import replace

import pytest
from textual.widgets import Input
from topdress.console.app import actions
from topdress.console.app.dialogs import ChoiceDialog, Confirm
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.type_ahead_guard import HeldEnter, TypeAheadGuard
from topdress.console.app.widgets.key_bar import KeyBar, place_actions
from topdress.control.orders import Do, Order

from tests.app.harness import in_state, settled

SIZE = (120, 40)


def test_no_digit_is_bound_on_any_page():
    keys = {key for action in actions.ACTIONS for key in actions.find_keys(action, {})}
    assert not [key for key in keys if key.isdigit()]


async def test_no_digit_does_anything_on_any_page(full, source, turned, pilot):
    for where in full.pages:
        await turned(full, pilot, where)
        await pilot.press(*"0123456789")
        assert full.page.where == where and full.screen is full.page and source.orders == []


async def test_a_refused_question_lets_nothing_of_its_answer_through(full, source, clock):
    """Locked: the question for a rate is not asked; what is typed for it opens no page and
    gives no order."""
    full.locked = True
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("m")
        assert full.screen is full.page and "locked" in full.notice_text
        full.locked = False
        await pilot.press("1", "8", "full_stop", "5", "plus", "minus", "enter")
        assert full.screen is full.page and source.orders == []
        await pilot.press("space", "x")
        assert [order.do for order in source.orders] == [Do.HOLD, Do.STOP], (
            "these are never swallowed"
        )
        clock.now_s += 3.0
        await pilot.press("plus")
        assert full.screen is not full.page, "after a pause a key is a key again"


async def test_a_refused_name_swallows_its_letters(full, source, turned, pilot):
    await turned(full, pilot, "calibrate")
    desk = full.page.calibration
    desk.forget_result()
    await pilot.press("e")
    assert full.screen is full.page
    at = full.page.at
    await pilot.press("s", "o", "y", "5", "right_square_bracket")
    assert full.screen is full.page and full.page.at == at and source.orders == []


def test_stray_typing_ends_with_another_key_or_a_pause():
    stray = TypeAheadGuard()
    stray.note_refusal("number", 0.0)
    assert stray.is_swallowed("5", 1.0) and stray.is_swallowed("enter", 2.5), (
        "each key begins the pause anew"
    )
    assert not stray.is_swallowed("s", 2.6) and not stray.is_swallowed("5", 2.7), (
        "something else is meant"
    )
    stray.note_refusal("number", 10.0)
    assert not stray.is_swallowed("5", 12.0)
    stray.note_refusal("", 20.0)
    assert not stray.is_swallowed("5", 20.1)


def test_a_held_enter_answers_one_question():
    held = HeldEnter()
    assert not held.is_repeat("rate", 0.0)
    assert held.is_repeat("use it now?", 0.5) and held.is_repeat("use it now?", 0.53), (
        "the key's own repeats"
    )
    assert not held.is_repeat("use it now?", 1.3)
    assert not held.is_repeat("use it now?", 1.35), "the same question again is its own affair"


async def test_enter_held_down_does_not_confirm_the_question_that_follows(
    full, source, clock, pilot
):
    full.live = True
    await pilot.press("m", "1", "8", "0", "enter", "enter", "enter")
    assert source.orders == [Order(Do.MANUAL_RATE, 180.0)] and isinstance(full.screen, Confirm)
    clock.now_s += 1.0
    await pilot.press("enter")
    assert source.orders[-1] == Order(Do.SOURCE, "manual")


@pytest.mark.parametrize("key", ["u", "g"])
async def test_units_and_language_ask_while_working(full, source, key, pilot):
    units = full.units
    await pilot.press(key)
    assert isinstance(full.screen, Confirm)
    await pilot.press("escape")
    assert full.units is units
    in_state(source, "held")
    full.show_newest()
    await pilot.press(key)
    assert full.screen is full.page


async def test_a_space_is_a_space_in_text(full, source, pilot):
    full.push_screen(NameDialog("Name", "north"))
    await pilot.pause()
    await pilot.press("space", "5", "0")
    assert full.screen.query_one(Input).value == "north 50" and source.orders == []
    await pilot.press("ctrl+space", "f12")
    assert [order.do for order in source.orders] == [Do.HOLD, Do.STOP]


@pytest.mark.parametrize(
    ("state", "off"), [("working", {"start", "ready"}), ("off", {"start"}), ("held", set())]
)
async def test_what_cannot_be_done_is_in_brackets_and_says_why(full, source, shown, state, off):
    in_state(source, state)
    async with full.run_test(size=SIZE):
        assert {"start", "ready"} & full.page.query_one("#keys", KeyBar).view.off == off
        last = shown(full)[-1]
        assert ("(S start)" in last) == ("start" in off) and ("(R ready)" in last) == (
            "ready" in off
        )
        help_of = {one.title: one.help for one in full.get_system_commands(full.screen)}
        assert ("not now: the machine is" in help_of["start"]) == ("start" in off)


async def test_a_greyed_order_goes_out_all_the_same(full, source):
    """The worker's state is newer than the frame: S pressed right after R must not be lost."""
    in_state(source, "off")
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("r", "s")
        assert [order.do for order in source.orders] == [Do.READY, Do.START]


async def test_a_map_that_the_job_has_not_is_greyed_with_the_way_to_one(full, source, shown, pilot):
    await settled(full, pilot)
    picture = full.fields.find_picture(source.current_frame)
    full.fields._known = {key: replace(picture, planned=None) for key in full.fields._known}
    await pilot.press("o", "2", "enter")
    assert isinstance(full.screen, ChoiceDialog) and source.orders == []
    assert "this job has no map; F10, P takes one" in " ".join(" ".join(shown(full)).split())
    await pilot.press("4", "enter", "enter")
    assert source.orders == [Order(Do.SOURCE, "manual")]


async def test_start_from_another_page_asks(full, source, turned):
    in_state(source, "held")
    async with full.run_test(size=SIZE) as pilot:
        for where in full.pages:
            await turned(full, pilot, where)
            await pilot.press("ctrl+s")
            assert isinstance(full.screen, Confirm) and source.orders == []
            await pilot.press("escape")
        await pilot.press("ctrl+s", "enter")
        assert source.orders == [Order(Do.START)]


async def test_undo_takes_the_last_change_back_and_asks(full, source, pilot):
    await pilot.press("ctrl+z")
    assert full.screen is full.page and "nothing was changed" in full.notice_text
    await pilot.press("t", "2", "enter", "plus", "enter", "ctrl+z")
    assert isinstance(full.screen, Confirm) and "nudge +0 %" in full.screen.text
    await pilot.press("enter", "ctrl+z", "enter")
    assert source.orders == [
        Order(Do.STRATEGY, "speed_first"),
        Order(Do.NUDGE, 5.0),
        Order(Do.NUDGE, 0.0),
        Order(Do.STRATEGY, "opening_first"),
    ]
    assert full.undo.newest is None


async def test_a_setting_is_taken_back_too(full, turned):
    store = full.services.settings
    before = store.settings
    async with full.run_test(size=SIZE) as pilot:
        await turned(full, pilot, "settings")
        full.page.use_settings(before.model_copy(update={"sound": not before.sound}))
        await pilot.press("ctrl+z", "enter")
        assert store.settings == before


@pytest.mark.parametrize(
    "size",
    [(60, 20), *(pytest.param(size, marks=pytest.mark.exam) for size in ((120, 40), (80, 24)))],
)
async def test_every_page_is_reached_without_f_keys_at_every_size(full, size, pilot):
    for digit, where in enumerate((one.id.removesuffix("_screen") for one in full.page_actions), 1):
        bar = full.page.query_one("#keys", KeyBar)
        place = next(
            one for one in place_actions(bar.view.actions, bar.size.width) if one[0].id == "pages"
        )
        await pilot.click("#keys", offset=(place[1] + 1, 0)) if digit == 3 else await pilot.press(
            "tab"
        )
        await pilot.press(str(digit), "enter")
        assert full.page.where == where and full.screen is full.page


async def test_a_number_out_of_range_stays_and_reaches_no_page(full, source, pilot):
    await pilot.press("m", "9", "9", "9", "enter", "5", "0", "enter", "enter")
    assert (
        isinstance(full.screen, NumberDialog) and source.orders == [] and full.page.where == "run"
    )
