"""Numbers as operators type them: comma and point alike, the rest refused in words, nothing
dropped without a word."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import pytest
from textual import events
from topdress.console import app as console_app
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import Confirm, NudgeDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.calibrate.catch_calibration import CatchCalibration
from topdress.console.app.pages.calibrate.catch_test import ShaftTurns
from topdress.console.app.pages.calibrate.page import CalibrateScreen
from topdress.console.app.pages.job.refill import RefillWatch
from topdress.console.app.services import Services
from topdress.console.app.typed_number import (
    format_number,
    read_in_range,
    read_number,
    round_inwards,
)
from topdress.console.app.units import IMPERIAL, METRIC
from topdress.console.locale import use_language
from topdress.control.orders import Do, Order

from tests.app.harness import feed
from tests.app.made_up.calibrate import sample_calibrate_job

SIZE = (120, 40)

TAKEN = {
    "12,5": 12.5,
    "12.5": 12.5,
    "1,25": 1.25,
    "0,250": 0.25,
    " 180 ": 180.0,
    "１２，５": 12.5,
    "１２．５": 12.5,
    "12。5": 12.5,
    "12｡5": 12.5,
    "١٢٫٥": 12.5,
    "007": 7.0,
    "-5": -5.0,
    "−5": -5.0,
    "－５": -5.0,
    "1,250": 1.25,
}
REFUSED = {
    "": "Type a number.",
    "12,": "half",
    ",5": "half",
    ".": "half",
    "-": "half",
    "1.234,5": "two ways",
    "1,234.5": "two ways",
    "1.2.5": "one decimal sign",
    "1,2,5": "one decimal sign",
    "1 250": "blank",
    "1\u00a0250": "blank",
    "1e3": '"e"',
    "1E3": '"E"',
    "nan": '"n"',
    "inf": '"i"',
    "12,5kg": '"k"',
    "1-2": '"-"',
    "+5": '"+"',
    "1、5": '"、"',
    "12'5": '"\'"',
    "0x10": '"x"',
    "1_000": '"_"',
    "½": '"½"',
    "2²": '"²"',
    "一": '"一"',
    "1" * 30: "too long",
}


@pytest.mark.parametrize(("text", "value"), TAKEN.items())
def test_comma_and_point_are_the_same_in_every_script(text, value):
    assert read_number(text) == (value, "", False)


@pytest.mark.parametrize(("text", "why"), REFUSED.items())
def test_anything_else_is_refused_in_words(text, why):
    reading = read_number(text)
    assert reading.value is None and why in reading.why


@pytest.mark.parametrize("text", [*TAKEN, *REFUSED])
def test_a_refusal_in_chinese_too(text):
    use_language("zh")
    reading = read_number(text)
    assert reading.value is not None or any("\u4e00" <= one <= "\u9fff" for one in reading.why)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("601", "601 kg/ha is too much: 0 to 600 kg/ha is allowed."),
        ("-5", "-5 kg/ha is too little: 0 to 600 kg/ha is allowed."),
        ("999999999999999999999", "is too much: 0 to 600 kg/ha"),
    ],
)
def test_out_of_range_is_said_with_the_range(text, said):
    reading = read_in_range(text, 0, 600, "kg/ha")
    assert reading.value is None and said in reading.why


def test_what_may_part_thousands_is_asked_where_both_are_allowed():
    assert read_in_range("1,250", 0, 600, "kg").value == 1.25
    for text in ("1,250", "1.250"):
        reading = read_in_range(text, 0, 4000, "lb")
        assert reading.value is None and f"{text} can mean 1.25 or 1250 lb" in reading.why
    assert read_in_range("0,250", 0, 4000, "lb").value == 0.25
    assert read_in_range("1.25", 0, 4000, "lb").value == 1.25


@pytest.mark.parametrize("units", [METRIC, IMPERIAL])
@pytest.mark.parametrize("high", [250.0, 300.0, 400.0, 600.0, 0.3])
def test_what_the_range_shows_is_allowed_inside(units, high):
    low_shown, high_shown = round_inwards(units.rate, 0.1, high, 1)
    assert units.rate.convert_to_si(high_shown) <= high * (1 + 1e-8) and units.rate.convert_to_si(
        low_shown
    ) >= 0.1 * (1 - 1e-8)
    assert round_inwards(METRIC.rate, 0.0, 600.0, 0) == (0.0, 600.0)


def test_a_number_is_repeated_without_a_power_of_ten():
    assert [format_number(one) for one in (12.5, 1e6, 0.001, 300.0, 1e20)] == [
        "12.5",
        "1000000",
        "0.001",
        "300",
        "100000000000000000000",
    ]


def test_numbers_are_taken_by_one_field_only():
    """No other text field is made into one for numbers."""
    for path in Path(console_app.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == "Input"
            ):
                assert not {"type", "restrict"} & {one.arg for one in node.keywords}, path


# --- the dialog
# --------------------------------------------------------------------------------------------------


async def typed(app, pilot, text):
    for character in text:
        app.screen.post_message(events.Key(key=_key(character), character=character))
    await pilot.pause()
    await pilot.pause()


def _key(character):
    return {",": "comma", ".": "full_stop", "-": "minus", "+": "plus"}.get(character, character)


def wrong(app):
    shown = app.screen.query_one("#number-wrong")
    return str(shown.render()) if shown.display else ""


def yes(app):
    return str(app.screen.query_one("#yes").label)


async def test_a_refill_with_a_comma_is_that_refill(app, source, shown):
    async with app.run_test(size=(80, 24)) as pilot:
        at_s = source.current_frame.row.time_s
        feed(app, [{"time_s": at_s + 0.2, "speed_used_mps": 0.0, "state": "held"}])
        for text in ("12,5", "12.5", "１２，５", "12。5"):
            source.orders.clear()
            await pilot.press("f")
            await typed(app, pilot, text)
            await pilot.pause()
            assert "Enter  take 12.5 kg" in "\n".join(shown(app)), (
                f"{text}: seen whole, not only said"
            )
            await pilot.press("enter")
            assert (
                source.orders == [Order(Do.REFILL, 12.5)]
                and app.notice_text == "filled in: 12.5 kg"
            ), text


@pytest.mark.exam
async def test_nothing_is_dropped_from_what_is_no_number(app, source, pilot):
    for text in (
        "1e3",
        "1.2.5",
        "1.234,5",
        "nan",
        "inf",
        "12,",
        "1-2",
        "12345678901",
        "301",
        "0",
        "-5",
        "1" * 40,
    ):
        await pilot.press("f")
        await typed(app, pilot, text)
        await pilot.press("enter")
        assert isinstance(app.screen, NumberDialog) and source.orders == [], text
        assert wrong(app) and "take" not in yes(app), text
        await pilot.press("escape")


async def test_half_a_number_is_wrong_only_when_it_is_wanted(app, pilot):
    await pilot.press("f")
    await typed(app, pilot, "12,")
    assert wrong(app) == ""
    await typed(app, pilot, "e")
    assert "not part of a number" in wrong(app)
    await pilot.press("backspace", "5")
    assert wrong(app) == "" and "take 12.5 kg" in yes(app)


async def test_a_number_can_be_pasted(app, source, pilot):
    await pilot.press("f")
    app.screen.post_message(events.Paste("12,5\n"))
    await pilot.pause()
    assert "take 12.5 kg" in yes(app)
    await pilot.press("delete")
    app.screen.post_message(events.Paste("1 250"))
    await pilot.pause()
    await pilot.press("enter")
    assert "blank" in wrong(app) and source.orders == []


async def test_the_first_key_replaces_what_stood_there(app, pilot):
    answers = []
    app.push_screen(NumberDialog("Filled in", "kg", 0, 300, typed="250.0"), answers.append)
    await pilot.pause()
    await typed(app, pilot, "12")
    await pilot.press("enter")
    assert answers == [12.0]


async def test_the_question_after_a_rate_repeats_it(app, source, shown, pilot):
    await pilot.press("m")
    await typed(app, pilot, "120,5")
    await pilot.press("enter")
    assert source.orders == [Order(Do.MANUAL_RATE, 120.5)] and isinstance(app.screen, Confirm)
    assert "Use the manual rate of 120.5 kg/ha now?" in "\n".join(shown(app))


async def test_a_typed_number_is_no_nudge(app, source):
    """The 0 of `10` took the nudge away."""
    source.current_frame = replace(
        source.current_frame, row=source.current_frame.row._replace(nudge_percent=5.0)
    )
    async with app.run_test(size=SIZE) as pilot:
        app.show_newest()
        await pilot.press("plus")
        assert isinstance(app.screen, NudgeDialog) and app.screen.percent == 10.0
        await typed(app, pilot, "10")
        assert app.screen.percent == 10.0
        assert "steps" in str(app.screen.query_one("#nudge-value").render())
        await pilot.press("delete")
        await pilot.press("0")
        assert app.screen.percent == 0.0


# --- what differs grossly
# ---------------------------------------------------------------------------------------------


async def test_a_refill_that_the_scale_does_not_bear_out_is_asked_again(app, source, shown):
    source.current_frame = replace(
        source.current_frame, row=source.current_frame.row._replace(hopper_kg=50.0)
    )
    async with app.run_test(size=SIZE) as pilot:
        app.show_newest()
        app.job_page.refill.seen_kg = 250.0
        await pilot.press("f")
        await typed(app, pilot, "25")
        await pilot.press("enter")
        text = "\n".join(shown(app))
        assert (
            source.orders == []
            and "25 kg: is that right?" in text
            and "The scale saw 250 kg filled in." in text
        )
        await pilot.press("escape")
        assert isinstance(app.screen, NumberDialog)
        await pilot.press("enter")
        await pilot.press("enter")
        assert source.orders == [Order(Do.REFILL, 25.0)]


@pytest.mark.parametrize(
    ("hopper_kg", "typed_kg", "watched", "says"),
    [
        pytest.param(
            100.0,
            "250",
            False,
            "The scale says 100 kg are in the hopper: 200 kg more fit.",
            id="neither_before_nor_after",
        ),
        pytest.param(
            200.0,
            "180",
            True,
            "The scale says 200 kg are in the hopper: 100 kg more fit.",
            id="more_than_fits",
        ),
        pytest.param(
            285.0,
            "250",
            False,
            "The scale says 285 kg are in the hopper: 15 kg more fit.",
            id="it_may_be_in_already",
        ),
        pytest.param(200.0, "100", True, "", id="what_fits"),
    ],
)
async def test_a_refill_that_would_run_over_is_asked_again(
    app, source, hopper_kg, typed_kg, watched, says
):
    """watched: the console saw the machine work, and nothing filled in since."""
    async with app.run_test(size=SIZE) as pilot:
        at_s = source.current_frame.row.time_s
        feed(
            app,
            [
                {
                    "time_s": at_s + 0.2 * k,
                    "hopper_kg": hopper_kg,
                    "speed_used_mps": 0.0,
                    "state": "working" if watched and k < 10 else "held",
                }
                for k in range(1, 60)
            ],
        )
        if not watched:
            app.job_page.refill = RefillWatch()
        await pilot.press("f", *typed_kg, "enter")
        assert isinstance(app.screen, Confirm) == bool(says)
        assert source.orders == ([] if says else [Order(Do.REFILL, float(typed_kg))])
        if says:
            assert says in app.screen.text


async def test_a_refill_of_a_machine_that_moves_is_asked_again(app, source):
    async with app.run_test(size=SIZE) as pilot:
        at_s = source.current_frame.row.time_s
        feed(app, [{"time_s": at_s + 0.2, "hopper_kg": 100.0, "speed_used_mps": 1.2}])
        await pilot.press("f", *"50", "enter")
        assert isinstance(app.screen, Confirm) and "The machine moves" in app.screen.text
        assert source.orders == []


@pytest.mark.parametrize(
    ("before_kg", "text", "asked"),
    [
        (281.25, "125", "The hopper scale lost about 1.25 kg."),
        (281.25, "1,25", ""),
        (281.25, "1,5", ""),
        (None, "125", "By the machine file it would be about 4.95 kg."),
        (None, "4,1", ""),
        (None, "0,41", "machine file"),
    ],
)
async def test_a_catch_that_differs_grossly_is_asked_again(
    source, clock, shown, before_kg, text, asked
):
    app = TopdressApp(
        source,
        clock,
        live=False,
        utc_offset_s=0.0,
        services=Services(calibrate=sample_calibrate_job()),
    )
    async with app.run_test(size=SIZE) as pilot:
        app.turn_to_page("calibrate")
        await pilot.pause()
        page = app.page
        assert isinstance(page, CalibrateScreen) and isinstance(page.calibration, CatchCalibration)
        test = page.calibration.test
        test.phase, test.shaft_turns, test._before_kg = (
            "weigh",
            ShaftTurns(30.0, 30.0, 30.0 * 60.0, 30.0 * 30.0),
            before_kg,
        )
        test._resting_kg.extend([280.0] * 10)
        await pilot.press("q", "3", "enter")
        await typed(app, pilot, text)
        await pilot.press("enter")
        if asked:
            assert (
                isinstance(app.screen, Confirm)
                and not test.points
                and asked in "\n".join(shown(app))
            )
            await pilot.press("enter")
        assert [one.mass_kg for one in test.points] == [read_number(text).value]


@pytest.mark.parametrize(
    ("keys", "typed"),
    [("m" * 30 + "180", "180"), ("MMM7", "7"), ("1m", "1m"), ("vm1", "vm1"), ("m", "")],
)
async def test_the_key_that_asked_for_the_number_stays_down_and_is_no_part_of_it(
    full, keys, typed, pilot
):
    """Only while nothing else is typed: a letter within a number is refused in words, never
    dropped."""
    await pilot.press("m")
    await pilot.press(*keys)
    assert isinstance(full.screen, NumberDialog) and full.screen.typed == typed
