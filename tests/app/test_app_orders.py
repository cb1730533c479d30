"""Keys become orders: what is sent, what is asked first, what a lock lets through."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.dialogs import Confirm, NudgeDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.widgets.alarm_bar import AlarmBar
from topdress.console.app.widgets.key_bar import KeyBar, place_actions
from topdress.control.orders import Answer, Do, Order

from tests.app.harness import later, tell

SIZE = (120, 40)


async def press(app, *keys):
    """Press keys in a running app and let the orders go out."""
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press(*keys)
        return app.source.orders if app.source else []


async def test_one_key_one_order(app):
    wanted = {
        "space": Order(Do.HOLD),
        "x": Order(Do.STOP),
        "f12": Order(Do.STOP),
        "s": Order(Do.START),
        "r": Order(Do.READY),
        "k": Order(Do.MARK, "mark"),
    }
    assert await press(app, *wanted) == list(wanted.values())


@pytest.mark.exam
@pytest.mark.parametrize("dialog_key", ["plus", "m", "f1"])
async def test_space_holds_and_stop_stops_under_any_dialog(app, dialog_key, pilot):
    await pilot.press(dialog_key)
    await pilot.press("space", "f12")
    assert app.source.orders == [Order(Do.HOLD), Order(Do.STOP)]
    assert len(app.screen_stack) == 2, "the dialog stays"


@pytest.mark.exam
async def test_x_stops_under_a_dialog(app):
    assert await press(app, "m", "x") == [Order(Do.STOP)]


async def test_space_holds_even_where_a_button_has_the_focus(app, pilot):
    await pilot.press("l", "tab")
    assert app.focused is not None
    await pilot.press("space")
    assert app.source.orders == [Order(Do.HOLD)]
    assert isinstance(app.screen, Confirm)


ASKED = [
    (("plus", "enter"), Order(Do.NUDGE, 5.0)),
    (("minus", "minus", "enter"), Order(Do.NUDGE, -10.0)),
    (("l", "enter"), Order(Do.LOOK_AHEAD, False)),
    (("w", "enter"), Order(Do.FLOW_TRIM, False)),
    (("t", "down", "enter"), Order(Do.STRATEGY, "speed_first")),
    (("o", "4", "enter"), Order(Do.SOURCE, "manual")),
    (("h", "2", "enter"), Order(Do.ALLOW_OUTSIDE, True)),
    (("h", "1", "enter"), Order(Do.ALLOW_REVERSE, True)),
    (("h", "4", "enter"), Order(Do.NO_DOUBLE, False)),
    # The machine of the sample moves, so the refill is asked again.
    (("f", "2", "5", "0", "enter", "enter"), Order(Do.REFILL, 250.0)),
]


async def test_what_changes_the_dose_is_asked_once(app, source, pilot):
    """Nothing goes out before Enter."""
    tell(source, sources=("manual",), source_rates=(source.current_frame.row.target_rate_kg_ha,))
    await later(app, pilot)
    for keys, order in ASKED:
        await pilot.press(*keys[:-1])
        assert app.source.orders == [], keys
        await pilot.press("enter")
        assert app.source.orders == [order], keys
        app.source.orders.clear()


@pytest.mark.parametrize(("side", "error_m"), [("1", 0.12), ("2", -0.12)])
async def test_a_dose_error_is_asked_by_its_side_and_in_metres(app, source, side, error_m):
    source.current_frame = replace(
        source.current_frame, sources=(*source.current_frame.sources, "point")
    )
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("semicolon", side, "enter", "0", "full_stop", "1", "2", "enter")
        assert source.orders == [Order(Do.DOSE_ERROR, pytest.approx(error_m))]


async def test_a_job_without_plants_has_no_dose_error(app, source):
    source.current_frame = replace(source.current_frame, sources=("canopy", "manual", "fallback"))
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("semicolon")
        assert source.orders == [] and len(app.screen_stack) == 1 and "no plants" in app.notice_text


async def test_no_sends_nothing(app, pilot):
    for keys in (("plus",), ("l",), ("t", "2"), ("m", "9", "0")):
        await pilot.press(*keys, "escape")
    await pilot.pause()
    assert app.source.orders == []


def test_a_nudge_stays_within_30_percent():
    dialog = NudgeDialog(20.0, 1)
    assert dialog.percent == 25.0
    dialog.action_step(5)
    assert dialog.percent == 30.0
    dialog.action_step(-99)
    assert dialog.percent == -30.0


async def test_a_nudge_begins_at_the_one_in_force(app, source):
    row = source.current_frame.row._replace(nudge_percent=10.0)
    source.current_frame = replace(source.current_frame, row=row)
    assert await press(app, "minus", "enter") == [Order(Do.NUDGE, 5.0)]


async def test_a_manual_rate_is_asked_again_before_it_takes_the_place_of_the_canopy(app):
    orders = await press(app, "m", "1", "8", "0", "enter", "enter")
    assert orders == [Order(Do.MANUAL_RATE, 180.0), Order(Do.SOURCE, "manual")]


async def test_a_number_outside_its_range_is_not_taken(app, pilot):
    await pilot.press("m")
    for typed in ("601", "9999", "", "."):
        await pilot.press("delete", *("full_stop" if c == "." else c for c in typed), "enter")
        assert isinstance(app.screen, NumberDialog), typed
    assert app.source.orders == []


async def test_a_manual_rate_in_pounds_an_acre_is_sent_in_kg_ha(app):
    orders = await press(app, "u", "enter", "m", "1", "0", "0", "enter", "escape")
    assert orders[0].value == pytest.approx(112.085, abs=1e-3)


async def test_the_pad_can_be_clicked(app, pilot):
    await pilot.press("m")
    for key in ("1", "5", "0"):
        button = next(b for b in app.screen.query("Button").results() if b.name == key)
        await pilot.click(button)
    await pilot.click("#yes")
    assert app.source.orders == [Order(Do.MANUAL_RATE, 150.0)]


async def test_a_choice_of_what_is_already_so_sends_nothing(app):
    assert await press(app, "t", "1", "enter") == []


async def test_the_lock_leaves_hold_and_stop_and_asks_before_it_opens(app, pilot):
    await pilot.press("f8")
    assert app.locked
    for key in ("s", "r", "plus", "t", "l", "m", "a", "ctrl+p", "ctrl+q", "o"):
        await pilot.press(key)
    await pilot.pause()
    assert app.source.orders == [] and len(app.screen_stack) == 1
    assert app.notice_text
    await pilot.press("space", "x", "f12")
    assert [order.do for order in app.source.orders] == [Do.HOLD, Do.STOP, Do.STOP]
    await pilot.press("f8", "escape")
    assert app.locked
    await pilot.press("f8", "enter")
    assert not app.locked


async def test_the_lock_is_said_on_the_screen(app, shown, pilot):
    await pilot.press("f8")
    assert "LOCKED" in shown(app)[0]


async def test_keys_are_clickable(app, pilot):
    bar = app.page.query_one("#keys", KeyBar)
    stop = next(
        place for place in place_actions(bar.view.actions, bar.size.width) if place[0].id == "stop"
    )
    await pilot.click("#keys", offset=(stop[1] + 1, 0))
    assert app.source.orders == [Order(Do.STOP)]


async def test_hold_and_stop_stand_on_the_key_bar_at_every_size(app, shown, pilot):
    for size in ((40, 10), (60, 16), (80, 24), (100, 30), (120, 40)):
        await pilot.resize_terminal(*size)
        last = shown(app)[-1]
        assert "hold" in last and "STOP" in last, size


async def test_a_refusal_is_said_in_words_and_goes_after_a_while(app, source, clock, shown):
    source.answer = Answer(False, "not_from_state;state=working")
    async with app.run_test(size=SIZE) as pilot:
        await pilot.press("s")
        assert "Not possible in state WORKING." in shown(app)[-1]
        await later(app, pilot, 5.0)
        assert "Not possible" not in shown(app)[-1]


async def test_acknowledge_names_each_red_alarm_that_stands(app, source):
    from tests.app.made_up.run import sample_alarms

    source.current_frame = replace(
        source.current_frame, alarms=sample_alarms(source.current_frame.at_s)
    )
    assert await press(app, "a") == [Order(Do.ACKNOWLEDGE, "shaft_silent")]


async def test_a_click_on_the_alarms_acknowledges(app, source):
    from tests.app.made_up.run import sample_alarms

    source.current_frame = replace(
        source.current_frame, alarms=sample_alarms(source.current_frame.at_s)
    )
    async with app.run_test(size=SIZE) as pilot:
        await pilot.click(AlarmBar)
        assert source.orders == [Order(Do.ACKNOWLEDGE, "shaft_silent")]


async def test_a_keymap_moves_keys(source, clock):
    from topdress.console.app.app import TopdressApp

    app = TopdressApp(source, clock, live=False, keymap={"start": "f9"})
    assert await press(app, "s", "f9") == [Order(Do.START)]


async def test_quit_asks_while_the_machine_works(app, pilot):
    await pilot.press("ctrl+q")
    assert isinstance(app.screen, Confirm)


async def test_a_start_key_that_stays_down_is_told_as_held(app):
    """A press is START; its repeats say that it is held. Two presses far apart are two presses."""
    now = [100.0]
    app.clock = lambda: now[0]
    async with app.run_test(size=SIZE) as pilot:
        for step_s in (0.0, 0.4, 0.1, 3.0):
            now[0] += step_s
            await pilot.press("s")
        assert app.source.orders == [
            Order(Do.START),
            Order(Do.START, True),
            Order(Do.START, True),
            Order(Do.START),
        ]
