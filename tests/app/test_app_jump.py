"""One key puts letters over what can be clicked; typing them clicks it. Hold and STOP work
meanwhile."""

from __future__ import annotations

import string

import pytest
from textual.widgets import Button, Input
from topdress.console.app import actions
from topdress.console.app.dialogs import ChoiceDialog
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.screens.jump_letters import (
    JumpScreen,
    choose_label_letters,
    find_click_places,
    make_jump_labels,
)
from topdress.console.app.widgets.key_bar import KeyBar
from topdress.console.app.widgets.status_line import PageBar
from topdress.control.orders import Do

SIZE = (120, 40)
PAGES = ("run", "map", "trends", "devices", "calibrate", "replay", "diagnosis", "job", "settings")


async def shown_letters(app, pilot):
    for _ in range(3):
        await pilot.pause()
    await pilot.press("apostrophe")
    assert isinstance(app.screen, JumpScreen)
    return app.screen.labelled


def label_of(app, wanted):
    return next(label for label, place in app.screen.labelled.items() if wanted(place))


def test_no_label_has_a_letter_that_acts_on_the_machine():
    bound = {
        where: actions.find_bound_keys(where, {})
        for where in {one.where for one in actions.ACTIONS}
    }
    assert not set(choose_label_letters(bound)) & (
        bound["run"] | bound["calibrate"] | bound["devices"]
    )
    assert len(choose_label_letters(bound)) >= 6, (
        "enough for labels of two: every letter of these pages has an action, no digit has"
    )
    other = {**bound, "run": bound["run"] | {"7"}}
    assert "7" in choose_label_letters(bound) and "7" not in choose_label_letters(other), (
        "nor one that the user's keymap gave such an action"
    )
    every = frozenset(string.ascii_lowercase + string.digits)
    assert (
        choose_label_letters({where: every for where in bound}) == ""
        and make_jump_labels(5, "") == ()
    )


def test_no_label_begins_another():
    for count in (1, 3, 6, 7, 36, 37, 90):
        made = make_jump_labels(count, "eijpqv")
        assert len(set(made)) == count and len({len(one) for one in made}) == 1


@pytest.mark.exam
@pytest.mark.parametrize("where", PAGES)
async def test_every_page_has_letters_and_stop_stays_stop(full, source, where, turned, pilot):
    await turned(full, pilot, where)
    bar = full.page.query_one(KeyBar)
    stop = [
        (x, bar.region.y) for x in range(bar.size.width) if bar.find_action(x) in ("stop", "hold")
    ]
    found = await shown_letters(full, pilot)
    assert len(found) > 8, "the tabs of the pages alone are nine"
    covered = {
        (place.seen.x + cell, place.seen.y)
        for label, place in found.items()
        for cell in range(len(label))
    }
    assert stop and not covered & set(stop)
    before = len(source.orders)
    await pilot.press("x")
    assert [order.do for order in source.orders[before:]] == [Do.STOP]
    await pilot.press("s")
    assert full.screen is full.page and len(source.orders) == before + 1, (
        "another letter ends it and does nothing"
    )


async def test_typing_a_label_clicks(full, pilot):
    await shown_letters(full, pilot)
    page_bar = full.page.query_one(PageBar)
    tabs = [label for label, place in full.screen.labelled.items() if place.widget is page_bar]
    await pilot.press(*tabs[2].upper())
    assert full.page.where == "trends", "Caps Lock types the same label"


async def test_rows_of_lists_are_clicked(full, turned, pilot):
    await turned(full, pilot, "settings")
    lines = full.page.query_one("SettingsList")
    await shown_letters(full, pilot)
    rows = [label for label, place in full.screen.labelled.items() if place.widget is lines]
    assert len(rows) > 5
    await pilot.press(*rows[0])
    assert isinstance(full.screen, ChoiceDialog), "as a click on the line: its question"


async def test_buttons_of_a_dialog_have_letters_too(full, pilot):
    await pilot.press("t")
    dialog = full.screen
    assert len(find_click_places(dialog)) == len(dialog.query(Button)) + len(dialog.choices)
    await shown_letters(full, pilot)
    await pilot.press(
        *label_of(full, lambda place: place.widget.id == "choices" and place.at.y == 1)
    )
    assert full.screen is dialog and dialog.at == 1
    await shown_letters(full, pilot)
    await pilot.press(*label_of(full, lambda place: place.widget.id == "cancel"))
    assert full.screen is full.page


@pytest.mark.parametrize("size", [(80, 24), (60, 20), (160, 50)])
async def test_letters_stand_only_where_something_is_in_sight(full, size, pilot):
    found = await shown_letters(full, pilot)
    assert found and all(
        0 <= one.seen.x < size[0] and 0 <= one.seen.y < size[1] for one in found.values()
    )
    await pilot.press("escape")
    assert full.screen is full.page


# --- The help page is searched by a word
# -----------------------------------------------------------------------------


async def test_a_word_leaves_the_lines_that_hold_it(app, source, shown, pilot):
    await pilot.press("f1")
    assert isinstance(app.screen, HelpScreen)
    await pilot.press("slash", *"hopper")
    text = "\n".join(shown(app))
    assert "scale trim" in text and "Machine off, from any state" not in text
    await pilot.press("enter")
    assert not isinstance(app.focused, Input)
    await pilot.press("x")
    assert [order.do for order in source.orders] == [Do.STOP], "letters are keys again"
    await pilot.press("slash", *"zzz")
    assert "no key does this on this page" in "\n".join(shown(app))
    await pilot.press("f12", "escape")
    assert source.orders[-1].do is Do.STOP and app.screen is app.page
