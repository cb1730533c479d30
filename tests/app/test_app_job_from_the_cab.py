"""A job from the cab: a map from a stick, looked at before it is taken; whose job it is; what
it still takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.dialogs import ChoiceDialog, Confirm
from topdress.console.app.field_picture import FieldPicture, PlannedRates
from topdress.console.app.frame_words import name_source
from topdress.console.app.map_ink import draw_small_map
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.job.map_dialog import MapDialog
from topdress.console.app.pages.job.service import FileChoice
from topdress.console.app.panel_views import format_time_left, is_off_map
from topdress.console.app.remaining_work import estimate_remaining
from topdress.console.app.units import METRIC
from topdress.console.colour_scale import find_rate_colour

from tests.app.harness import settled
from tests.app.made_up.job import FACTS, SampleJobService
from tests.app.made_up.run import sample_services

SIZE = (120, 40)


@pytest.fixture
def desk():
    return SampleJobService()


@pytest.fixture
def full(source, clock, desk):
    return TopdressApp(
        source, clock, live=False, utc_offset_s=0.0, services=replace(sample_services(), job=desk)
    )


async def opened(app, pilot):
    app.turn_to_page("job")
    await settled(app, pilot)


async def test_a_map_from_a_stick_is_shown_and_then_taken(full, desk, shown, pilot):
    await opened(full, pilot)
    await pilot.press("p")
    await settled(full, pilot)
    assert isinstance(full.screen, ChoiceDialog) and "STICK" in "\n".join(shown(full))
    await pilot.press("1", "enter")
    await settled(full, pilot)
    assert isinstance(full.screen, MapDialog)
    text = " ".join(" ".join(shown(full)).split())
    for said in (
        "1.20 ha, 312 kg in all",
        "column rate, read as kg/ha",
        "above the crop's limit",
        "200 ████████████████ 350 kg/ha",
    ):
        assert said in text, said
    assert not any(asked[0] == "map" for asked in desk.asked), "looking changes nothing"
    await pilot.press("enter")
    await settled(full, pilot)
    assert ("map", "/media/STICK/north.geojson", "rate", "") in desk.asked
    assert full.page.pending == "" and desk.asked[-1] == ("drop",), "the machine works now"


async def test_column_and_unit_are_chosen_on_the_screen(full, desk, shown, pilot):
    await opened(full, pilot)
    await pilot.press("p")
    await settled(full, pilot)
    await pilot.press("2", "enter")
    await settled(full, pilot)
    assert "rate column not chosen" in "\n".join(shown(full))
    assert "take it" not in [one.label for one in full.screen.choices], (
        "a question must be answered first"
    )
    await pilot.press("enter")
    await pilot.press("1", "enter")
    await settled(full, pilot)
    await pilot.press("3", "enter")
    await pilot.press("2", "enter")
    await settled(full, pilot)
    assert "column RATE_N, read as lb/ac" in "\n".join(shown(full))
    await pilot.press("enter")
    await settled(full, pilot)
    assert ("map", "/media/STICK/zones.shp", "RATE_N", "lb/ac") in desk.asked


@pytest.mark.exam
async def test_a_map_that_cannot_be_read_is_one_line(full, desk, pilot):
    await opened(full, pilot)
    await pilot.press("p")
    await settled(full, pilot)
    desk.trouble = "north.geojson: no polygon in it"
    await pilot.press("1", "enter")
    await settled(full, pilot)
    assert full.screen is full.page and "no polygon" in full.notice_text


async def test_whose_job_it_is(full, desk, shown, pilot):
    await opened(full, pilot)
    await pilot.press("q", "3", "enter")
    await pilot.press("1", "enter")
    assert isinstance(full.screen, NameDialog)
    await pilot.press(*"Li", "space", *"Ming", "enter")
    await pilot.press("5", "enter")
    await pilot.press(*"Ann", "enter")
    assert not any(asked[0] == "who" for asked in desk.asked)
    await pilot.press("6", "enter")
    await settled(full, pilot)
    assert ("who", "Li Ming", "", "division 2", "", "Ann", "") in desk.asked


@pytest.mark.exam
async def test_a_product_of_the_library_is_chosen_by_its_name(full, desk):
    """With its file, from which flow and N share come; a typed name has none."""
    desk.known = replace(
        FACTS,
        products=(
            FileChoice("products/mine.yaml", "mine"),
            FileChoice("products/can_27.yaml", "can_27"),
        ),
    )
    async with full.run_test(size=SIZE) as pilot:
        await opened(full, pilot)
        for keys in (("2", "enter"), ("3", "enter", *"lime", "enter")):
            await pilot.press("q", "3", "enter")
            await pilot.press("4", "enter")
            for key in keys:
                await pilot.press(key)
            await pilot.press("6", "enter")
            await settled(full, pilot)
            await pilot.press("escape")
        assert [asked[4:] for asked in desk.asked if asked[0] == "who"] == [
            ("can_27", "", "products/can_27.yaml"),
            ("lime", "", ""),
        ]


async def test_the_list_of_jobs_draws_their_fields(full, shown, pilot):
    await opened(full, pilot)
    await pilot.press("j")
    text = "\n".join(shown(full))
    assert all(
        part in text
        for part in ("division 2  winter_wheat", "map north.geojson", "1.18 ha done, 2026-03-18")
    )
    assert any(0x2800 < ord(letter) < 0x2900 for letter in text)


async def test_after_a_calibration_or_an_adoption_it_is_asked_whether_to_use_it_now(
    full, desk, source, pilot
):
    await opened(full, pilot)
    full.page.ask_to_use_machine("machines/new.yaml")
    await pilot.pause()
    assert isinstance(full.screen, Confirm)
    await pilot.press("escape")
    assert ("take", "machine", "machines/new.yaml") not in desk.asked
    full.page.ask_to_use_machine("machines/new.yaml")
    await pilot.pause()
    await pilot.press("enter")
    await settled(full, pilot)
    assert ("take", "machine", "machines/new.yaml") in desk.asked


def test_what_a_job_still_takes(frames):
    frame = frames[-1]
    picture = FieldPicture("", (), 2.0, 2.4)
    left = estimate_remaining(frame, picture)
    done = frame.area_ha
    assert left.area_ha == pytest.approx(2.0 - done) and left.way_m == pytest.approx(
        (2.0 - done) * 10_000 / 2.4
    )
    assert left.product_kg == pytest.approx((2.0 - done) * frame.applied_kg / done)
    spent_s = frame.totals.worked_s + frame.tally.held_s
    assert left.time_s == pytest.approx((2.0 - done) * spent_s / done)
    rates = np.full((10, 10), 300.0, np.float32)
    planned = estimate_remaining(
        frame, replace(picture, planned=PlannedRates(0.0, 0.0, 10.0, rates))
    )
    assert planned.product_kg == pytest.approx(300.0 - frame.applied_kg)
    assert estimate_remaining(frame, None).format_remaining(METRIC) == "--"


def test_what_a_part_map_still_takes_is_the_ground_that_has_a_rate(frames):
    frame, rates = frames[-1], np.full((10, 10), np.nan, np.float32)
    rates[:5], rates[5] = 300.0, 0.0
    # Fifty cells of 100 m2 of a field of 2 ha.
    picture = FieldPicture("", (), 2.0, 2.4, PlannedRates(0.0, 0.0, 10.0, rates))
    assert picture.work_ha == pytest.approx(0.5)
    left = estimate_remaining(frame, picture)
    assert left.area_ha == pytest.approx(0.5 - frame.area_ha)
    assert left.way_m == pytest.approx((0.5 - frame.area_ha) * 10_000 / 2.4)


@pytest.mark.parametrize(
    "seconds, text",
    [(None, "--"), (0.0, "0 min"), (61.0, "2 min"), (3600.0, "1 h 00 min"), (28_920, "8 h 02 min")],
)
def test_a_time_left_is_said_in_hours_and_minutes(seconds, text):
    assert format_time_left(seconds) == text


def test_a_long_time_left_is_said_in_hours_and_a_short_text_leaves_a_word_out():
    assert format_time_left(75_300.0) == "21 h" and format_time_left(36_000.0) == "10 h"
    assert format_time_left(28_920.0, is_short=True) == "8 h 02"


def test_ground_without_a_rate_in_the_map_is_no_fallback(frames):
    here = frames[-1].row._replace(target_source="fallback", lat_deg=34.0)
    frame = replace(frames[-1], row=here, ordered_source="map")
    assert is_off_map(frame) and name_source("fallback", True) == "no rate in the map here"
    assert not is_off_map(replace(frame, row=here._replace(lat_deg=None))), "the position is lost"
    assert not is_off_map(replace(frame, ordered_source="canopy"))


async def test_a_small_map_is_the_large_one_s_drawing(full, pilot):
    ring = ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
    drawn = draw_small_map(full.page, FieldPicture("", (ring,)), 8, 4)
    assert (
        len(drawn) == 4
        and {len(row) for row in drawn} == {8}
        and draw_small_map(full.page, None, 8, 4) == []
    )
    for row in (drawn[0], drawn[-1]):
        assert all(0x2800 < ord(text) < 0x2900 for text, _style in row), "a line all along"
    rates = np.array([[100.0, np.nan], [200.0, 300.0]], np.float32)
    planned = [
        cell
        for row in draw_small_map(
            full.page, FieldPicture("", planned=PlannedRates(0.0, 0.0, 10.0, rates)), 8, 4
        )
        for cell in row
    ]
    low, high = ("#{:02x}{:02x}{:02x}".format(*find_rate_colour(share)) for share in (0.0, 1.0))
    assert any(low in style for _text, style in planned) and any(
        high in style for _text, style in planned
    )


async def test_the_job_page_tells_what_is_left(full, shown, pilot):
    await opened(full, pilot)
    for worker in [one for one in full.workers if one.group == "field"]:
        await worker.wait()
    await settled(full, pilot)
    row = next(row for row in shown(full) if "to finish" in row)
    assert " kg" in row and " m" in row and " min" in row


async def test_no_letter_of_the_map_dialog_reaches_the_page(full, desk, pilot):
    await opened(full, pilot)
    await pilot.press("p")
    await settled(full, pilot)
    await pilot.press("1", "enter")
    await settled(full, pilot)
    await pilot.press("f", "j", "i")
    assert isinstance(full.screen, MapDialog) and not isinstance(full.screen, NumberDialog)
