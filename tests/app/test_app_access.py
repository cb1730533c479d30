"""Everybody can use it: contrast, few colours, colour-blind eyes, keyboard alone, mouse alone,
the lock everywhere."""

from __future__ import annotations

from inspect import isawaitable
from math import dist

import pytest
from rich.color import Color, ColorSystem
from textual.command import CommandPalette
from textual.events import Click, MouseDown, MouseUp
from textual.widgets import OptionList
from topdress.console.app import actions, frame_words, themes
from topdress.console.app.action import ANYWHERE, RUN, Action
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import TextDialog
from topdress.console.app.screens.help_screen import HelpScreen
from topdress.console.app.widgets.key_bar import KeyBar, place_actions
from topdress.console.app.widgets.status_line import StatusLine
from topdress.control.orders import Do

from tests.app.gallery import StillSource
from tests.app.harness import lab, linear, tell
from tests.app.made_up.run import sample_alarms, sample_services

THEMES = pytest.mark.parametrize("theme", themes.THEMES, ids=lambda theme: theme.name)
XTERM = (
    "#000000",
    "#cd0000",
    "#00cd00",
    "#cdcd00",
    "#0000ee",
    "#cd00cd",
    "#00cdcd",
    "#e5e5e5",
    "#7f7f7f",
    "#ff0000",
    "#00ff00",
    "#ffff00",
    "#5c5cff",
    "#ff00ff",
    "#00ffff",
    "#ffffff",
)
CHIPS = ("alarm-red", "alarm-amber", *(f"state-{state}" for state in frame_words.STATE_NAMES))
TEXTS = (
    ("on-select", "select"),
    ("on-stop", "stop"),
    ("foreground", "background"),
    ("muted", "background"),
    ("stale", "background"),
    ("target", "background"),
    ("primary", "background"),
    ("foreground", "surface"),
    ("muted", "surface"),
    ("primary", "surface"),
    ("foreground", "panel"),
    ("background", "primary"),
    ("background", "stale"),
    ("keybar-key", "keybar"),
    ("on-keybar", "keybar"),
    *((f"on-{chip}", chip) for chip in CHIPS),
)
OFF = (("stale", "keybar"),)  # what cannot be done now: also told by brackets


def colours(theme):
    plain = {
        name: getattr(theme, name)
        for name in ("background", "foreground", "primary", "surface", "panel")
    }
    return theme.variables | plain


def luminance(text):
    return sum(
        weight * channel
        for weight, channel in zip((0.2126, 0.7152, 0.0722), linear(text), strict=True)
    )


def contrast(a, b):
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@THEMES
def test_every_text_has_a_contrast_of_4_5(theme):
    """WCAG 2.1, 1.4.3; 3 for what cannot be done now."""
    v = colours(theme)
    assert {
        pair: round(contrast(v[pair[0]], v[pair[1]]), 2)
        for pair in TEXTS
        if contrast(v[pair[0]], v[pair[1]]) < 4.5
    } == {}
    assert all(contrast(v[a], v[b]) >= 3.0 for a, b in OFF)
    assert contrast(v["target"], v["background"]) >= 5.5  # rates are read in sunlight
    assert contrast(v["foreground"], v["background"]) >= (7 if theme.name == "night" else 15)


@THEMES
@pytest.mark.parametrize("grey", [False, True], ids=["16 colours", "NO_COLOR in 16 colours"])
def test_every_text_can_be_read_in_16_colours(theme, grey):
    """As xterm draws them: a contrast of 3."""

    def drawn(text):
        if grey:
            whole = round(
                sum(
                    w * int(text[i : i + 2], 16) for w, i in ((0.2126, 1), (0.7152, 3), (0.0722, 5))
                )
            )
            text = f"#{whole:02x}{whole:02x}{whole:02x}"
        return XTERM[Color.parse(text).downgrade(ColorSystem.STANDARD).number or 0]

    v = colours(theme)
    seen = {
        pair: round(contrast(drawn(v[pair[0]]), drawn(v[pair[1]])), 1) for pair in (*TEXTS, *OFF)
    }
    assert {pair: value for pair, value in seen.items() if value < 3.0} == {}
    alarms = drawn(v["alarm-red"]), drawn(v["alarm-amber"])
    assert drawn(v["background"]) not in (*alarms, drawn(v["applied"])) and (
        grey or alarms[0] != alarms[1]
    )


# Machado, Oliveira, Fernandes 2009, severity 1: on linear RGB
BLIND = {
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
}


@THEMES
@pytest.mark.parametrize("eye", list(BLIND))
def test_colour_blind_eyes_keep_what_matters_apart(theme, eye):
    """CIE 1976 distances: 20 is far more than a glance needs (2.3 is just seen)."""

    def seen(text):
        mixed = [sum(w * c for w, c in zip(row, linear(text), strict=True)) for row in BLIND[eye]]
        return lab([min(1.0, max(0.0, c)) for c in mixed])

    v = colours(theme)
    pairs = (
        ("alarm-red", "alarm-amber", 60.0),
        ("target", "applied", 20.0),
        ("stale", "foreground", 20.0),
        ("alarm-red", "background", 60.0),
        ("alarm-amber", "background", 40.0),
        ("alarm-red", "state-working", 20.0),
    )
    assert {
        (a, b): round(dist(seen(v[a]), seen(v[b])))
        for a, b, least in pairs
        if dist(seen(v[a]), seen(v[b])) < least
    } == {}


async def test_every_action_is_in_the_palette_of_its_page(full, turned, pilot):
    found = {"palette"}
    for where in full.pages:
        await turned(full, pilot, where)
        titles = {command.title for command in full.get_system_commands(full.screen)}
        own = {action for action in actions.list_page_actions(where) if action.id != "palette"}
        assert {*(action.label for action in own), "who is at this machine"} == titles, where
        found |= {action.id for action in own}
    assert found == set(actions.BY_ID)


@pytest.mark.exam
async def click_palette(app, pilot):
    bar = app.page.query_one("#keys", KeyBar)
    palette = next(
        place
        for place in place_actions(bar.view.actions, bar.size.width)
        if place[0].id == "palette"
    )
    await pilot.click("#keys", offset=(palette[1] + 1, 0))


@pytest.mark.exam
async def test_every_page_s_key_bar_leads_to_the_palette_by_mouse_at_every_width(full, turned):
    """So that what is not on the bar or the page can be clicked in the palette."""
    async with full.run_test(size=(80, 24)) as pilot:
        for where in full.pages:
            await turned(full, pilot, where)
            for width in (40, 80, 120):
                ids = {
                    place[0].id for place in place_actions(actions.list_page_actions(where), width)
                }
                assert {"hold", "stop", "palette"} <= ids, (where, width)
            await click_palette(full, pilot)
            assert isinstance(full.screen, CommandPalette), where
            full.pop_screen()
            await pilot.pause()


async def test_an_action_is_run_by_two_clicks(full, source):
    async with full.run_test(size=(80, 24)) as pilot:
        await click_palette(full, pilot)
        await pilot.pause(0.3)
        options = full.screen.query_one(OptionList)
        assert options.option_count > 0
        first = options.get_option_at_index(0)
        await pilot.click(OptionList, offset=(4, 1))
        await pilot.pause(0.3)
        assert not isinstance(full.screen, CommandPalette), first.prompt


@pytest.mark.exam
async def test_no_colour_tells_states_and_alarms_in_symbol_and_word_on_every_page(
    monkeypatch, frames, clock, shown, turned
):
    monkeypatch.setenv("NO_COLOR", "1")
    source = StillSource(frames[-1])
    tell(source, alarms=sample_alarms(frames[-1].at_s))
    app = TopdressApp(source, clock, live=False, services=sample_services())
    assert app.no_color
    async with app.run_test(size=(80, 24)) as pilot:
        for where in app.pages:
            await turned(app, pilot, where)
            text = "\n".join(shown(app))
            assert "ALARM" in text and "STOP" in text, where
            status = app.page.query_one("#status", StatusLine)
            assert status.region.area > 0
            segments = [
                segment
                for y in range(24)
                for segment in app.screen._compositor.render_strips()[y]
                if segment.style and segment.style.color and segment.text.strip()
            ]
            assert segments


LOOKS = frozenset({"hold", "stop"})


async def test_locked_no_action_of_any_page_orders_asks_or_works(full, source, turned):
    async with full.run_test(size=(100, 30)) as pilot:
        full.locked = True
        for where in full.pages:
            await turned(full, pilot, where)
            for action in actions.list_page_actions(where):
                if action.locked:
                    continue
                depth = len(full.screen_stack)
                await full.action_do(action.id)
                assert len(full.screen_stack) == depth, (where, action.id)
            await pilot.pause()
        assert source.orders == [] and source.device_orders == [] and source.lag_tests == []
        assert full.locked and full.is_running


async def test_locked_what_stays_only_holds_stops_unlocks_and_looks(full, source, turned):
    async with full.run_test(size=(100, 30)) as pilot:
        full.locked = True
        for where in full.pages:
            stays = [
                action
                for action in actions.list_page_actions(where)
                if action.locked and action.id != "lock"
            ]
            for action in (
                stays if where == RUN else [action for action in stays if action.where == where]
            ):
                if full.page.where != where:
                    await turned(full, pilot, where)
                before = len(source.orders)
                await full.action_do(action.id)
                if action.id in LOOKS or action.id == "pages":
                    await pilot.pause()
                given = {order.do for order in source.orders[before:]}
                assert given <= {Do.HOLD, Do.STOP} and (not given or action.id in LOOKS), (
                    where,
                    action.id,
                )
                assert full.locked, action.id
                while full.screen is not full.page:
                    full.pop_screen()
        assert source.device_orders == [] and source.lag_tests == []


def clickable(page):
    """Widgets of ours that take a mouse button."""
    handlers = ("on_click", "on_mouse_down")
    return [
        widget
        for widget in page.query("*").results()
        if type(widget).__module__.startswith("topdress.console.app")
        and widget.region.area
        and any(hasattr(widget, name) for name in handlers)
    ]


async def test_locked_no_click_on_any_page_orders_or_asks(full, source, turned):
    async with full.run_test(size=(80, 24)) as pilot:
        full.locked = True
        for where in full.pages:
            await turned(full, pilot, where)
            for widget in clickable(full.page):
                # actions by their ids: held by the tests above
                if widget.id in ("keys", "pages"):
                    continue
                for y in range(widget.size.height):
                    for x in range(1, widget.size.width, 13):
                        for kind, name in (
                            (MouseDown, "on_mouse_down"),
                            (Click, "on_click"),
                            (MouseUp, "on_mouse_up"),
                        ):
                            handler = getattr(widget, name, None)
                            if handler is not None:
                                done = handler(
                                    kind(widget, x, y, 0, 0, 1, False, False, False, x, y)
                                )
                                if isawaitable(done):
                                    await done
                        while full.screen is not full.page:
                            assert isinstance(full.screen, (HelpScreen, TextDialog)), (
                                where,
                                widget,
                                full.screen,
                            )
                            full.pop_screen()
            await pilot.pause()
            assert full.page.where == where and full.screen is full.page
        assert (
            source.orders == []
            and source.device_orders == []
            and source.lag_tests == []
            and full.locked
        )


def test_what_a_key_does_stands_beside_it():
    for action in actions.ACTIONS:
        home = (
            "topdress.console.app.common_keys"
            if action.where == ANYWHERE
            else f"topdress.console.app.pages.{action.where}.keys"
        )
        assert action.do.__module__ == home, action.id
    with pytest.raises(TypeError, match="do"):
        Action("id", "f1", "F1", "label", "help")
