"""In the cab: presets, a full hopper, a refill that was none, a boundary driven, an A-B line, a
map by its path."""

from __future__ import annotations

from dataclasses import replace

import pytest
from topdress.console.app.boundary_drive import BoundaryDrive
from topdress.console.app.coverage_raster import WorkedGround
from topdress.console.app.dialogs import ChoiceDialog, Confirm
from topdress.console.app.guide_line import GuideLine
from topdress.console.app.map_layers import MapLayer, find_colour_scale
from topdress.console.app.name_dialog import NameDialog
from topdress.console.app.number_dialog import NumberDialog
from topdress.console.app.pages.run.page import LIGHTS_PER_SIDE, LightBar, make_light_view
from topdress.console.app.units import IMPERIAL, METRIC
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import Do, Order

from tests.app.harness import feed, settled

SIZE = (120, 40)


async def field_known(app, pilot):
    app.fields.find_picture(app.source.current_frame)
    await settled(app, pilot)
    assert app.fields.find_picture(app.source.current_frame) is not None


# --- presets
# --------------------------------------------------------------------------------------------------


async def test_a_preset_is_two_keys_and_can_be_taken_back(full, source, pilot):
    before = source.current_frame.row.target_source
    await pilot.press("full_stop")
    assert (
        isinstance(full.screen, Confirm)
        and "150 kg/ha" in full.screen.heading
        and source.orders == []
    )
    await pilot.press("enter")
    assert source.orders == [Order(Do.MANUAL_RATE, 150.0), Order(Do.SOURCE, "manual")]
    await pilot.press("ctrl+z", "enter")
    assert source.orders[-1] == Order(Do.SOURCE, before)


async def test_a_preset_beyond_the_limits_is_refused_with_both(full, source, pilot):
    full.limits_kg_ha = 0.0, 120.0
    await pilot.press("slash")
    assert full.screen is full.page and source.orders == []
    assert "200 kg/ha" in full.notice_text and "120 kg/ha" in full.notice_text


# --- refills
# --------------------------------------------------------------------------------------------------


async def test_hopper_full_is_what_is_missing_and_a_refill_can_be_taken_back(full, source):
    full.hopper_kg = 300.0
    source.current_frame = replace(
        source.current_frame,
        row=source.current_frame.row._replace(hopper_kg=49.5, speed_used_mps=0.0),
    )
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("f", "f")
        assert isinstance(full.screen, NumberDialog) and full.screen.reading.value == 250.5
        await pilot.press("enter")
        assert source.orders == [Order(Do.REFILL, 250.5)]
        await pilot.press("ctrl+z")
        assert (
            isinstance(full.screen, Confirm)
            and "without the refill of 250.5 kg" in full.screen.text
        )
        await pilot.press("enter")
        assert source.orders[-1] == Order(Do.REFILL_BACK, 250.5)


def test_what_was_taken_back_is_no_refill_anywhere():
    from topdress.console.worker.resume import drop_last_refill

    noted = (("a", 250.0), ("b", 100.0), ("c", 250.0))
    assert drop_last_refill(noted, 250.0) == noted[:2]
    assert drop_last_refill(noted, 99.0) == noted


# --- limits, miles, colours ---


async def test_limits_are_the_same_in_settings_and_dialog(full, source, shown, turned):
    full.crop_limits_kg_ha = 0.0, 500.0
    full.limits_kg_ha = 0.0, 500.0
    async with full.run_test(size=SIZE) as pilot:
        await pilot.press("m")
        assert (full.screen.low, full.screen.high) == (0.0, 500.0)
        await pilot.press("escape")
        await turned(full, pilot, "settings")
        highest = next(
            row for row in full.page.list_rows() if row.path == ("manual_rate", "high_kg_ha")
        )
        assert highest.shown == "500 kg/ha" and highest.number[1] == 500.0


def test_far_is_told_in_miles_where_units_are_imperial():
    assert IMPERIAL.choose_way_unit(500.0).format_with_name(500.0) == "1640 ft"
    assert IMPERIAL.choose_way_unit(3218.688).format_with_name(3218.688) == "2.00 mi"
    assert METRIC.choose_way_unit(3218.7).format_with_name(3218.7) == "3219 m"
    assert METRIC.choose_way_unit(12000.0).format_with_name(12000.0) == "12.0 km"


def test_a_colour_means_one_rate_from_the_first_metre_to_the_last():
    ground, ends = WorkedGround(2.4), set()
    for low, high in ((180.0, 190.0), (100.0, 320.0), (20.0, 480.0)):
        ground._rate_ends = None
        scale = find_colour_scale(
            MapLayer.APPLIED, _of(ground, low, high), None, METRIC, most_kg_ha=500.0
        )
        ends.add((scale.low, scale.high))
    assert ends == {(0.0, 500.0)}
    assert find_colour_scale(
        MapLayer.APPLIED, _of(ground, 180.0, 190.0), None, METRIC
    ) != find_colour_scale(MapLayer.APPLIED, _of(ground, 20.0, 480.0), None, METRIC), (
        "a log's scale goes by the log"
    )


def _of(ground, low, high):
    class Ends:
        rate_ends, ndvi_ends = (low, high), None

    return Ends()


# --- the A-B line ---


def test_off_the_nearest_track_and_the_sides_change_with_the_way():
    guide = GuideLine()
    guide.set_begin((0.0, 0.0), 3.0)
    assert not guide.set_end((0.0, 5.0)) and guide.set_end((0.0, 100.0))
    assert guide.find_offset((0.4, 50.0), 0.0) == pytest.approx((0.4, 0))
    assert guide.find_offset((0.4, 50.0), 180.0) == pytest.approx((-0.4, 0)), (
        "driven back, it is to the left"
    )
    assert guide.find_offset((6.2, 10.0), 2.0) == pytest.approx((0.2, 2))
    assert guide.find_offset((-2.9, 10.0), 0.0) == pytest.approx((0.1, -1))


def test_lights_stand_on_the_side_of_the_machine(frames):
    guide = GuideLine()
    guide.set_begin((0.0, 0.0), 3.0)
    guide.set_end((0.0, 100.0))

    def seen(east_m):
        frame = replace(
            frames[-1], place_m=(east_m, 20.0), row=frames[-1].row._replace(heading_deg=0.0)
        )
        view = make_light_view(guide, frame, False, METRIC)
        return view, LightBar(view).draw_rows(view, 80, 1)[0].plain

    view, text = seen(0.31)
    assert (
        view.lights == 3
        and "0.31 m right of the line" in text
        and text.rindex("█") > text.index("┃")
    )
    view, text = seen(-1.2)
    assert (
        view.lights == -LIGHTS_PER_SIDE
        and "1.20 m left of the line" in text
        and text.index("█") < text.index("┃")
    )
    view, text = seen(0.02)
    assert view.lights == 0 and "◆" in text and "█" not in text


@pytest.mark.parametrize("size", [(120, 40), (100, 30), (80, 24)])
async def test_a_line_is_set_by_key_and_the_run_page_shows_how_far_off(
    full, source, shown, size, turned, pilot
):
    await field_known(full, pilot)
    await turned(full, pilot, "map")
    feed(full, [{"heading_deg": 0.0}], place_m=(10.0, 0.0))
    await pilot.press("n")
    feed(full, [{}], place_m=(10.0, 4.0))
    await pilot.press("n")
    assert full.guide.b is None and "too near" in full.notice_text
    feed(full, [{}], place_m=(10.0, 60.0))
    await pilot.press("n")
    assert full.guide.is_set
    feed(full, [{}], place_m=(10.25, 80.0))
    await turned(full, pilot, "run")
    assert any("0.25 m right of the line" in row for row in shown(full))
    await turned(full, pilot, "map")
    await pilot.press("delete")
    assert not full.guide.is_set


# --- a boundary by driving ---


def driven(right_m=1.5, side_m=100.0):
    """Clockwise round a square, the antenna `right_m` inside of its edge."""
    from topdress.control.log_row import LogRow

    plane, drive = TangentPlane(34.28, 119.88), BoundaryDrive(-right_m)
    inner, time_s = side_m, 0.0
    ways = ((0.0, 0.0, 90.0), (inner, 0.0, 0.0), (inner, inner, 270.0), (0.0, inner, 180.0))
    # anticlockwise: the edge is to the right; the sign says which
    for east, north, heading in ways:
        for step in range(int(inner)):
            at = {
                90.0: (east + step, north),
                0.0: (east, north + step),
                270.0: (east - step, north),
                180.0: (east, north - step),
            }[heading]
            lat, lon = plane.convert_to_deg(*at)
            time_s += 0.5
            drive.add_row(
                LogRow(time_s=time_s, lat_deg=lat, lon_deg=lon, heading_deg=heading, fix_quality=4)
            )
    return drive


def test_the_edge_lies_beside_the_way_and_keeps_its_area():
    from topdress.console.services.driven_field import make_driven_field
    from topdress.control.field.job import Ground

    for right_m, side in ((0.0, 100.0), (-1.5, 97.0), (1.5, 103.0)):
        drive = driven(-right_m)  # anticlockwise: to the right is outside
        assert drive.is_closable and drive.closing_gap_m < 3.0
        field, area_ha = make_driven_field(Ground(), drive.make_edge_ring_deg())
        assert area_ha == pytest.approx(side * side / 1e4, rel=0.01)
        assert 4 <= len(field.boundary_m) <= 16, "corners that say nothing are left out"


def test_a_way_that_encloses_nothing_is_refused():
    from topdress.console.services.driven_field import make_driven_field
    from topdress.control.field.job import Ground

    with pytest.raises(ValueError, match="allowed is"):
        make_driven_field(Ground(), ((34.28, 119.88), (34.281, 119.88)))


async def test_a_boundary_is_driven_and_kept_by_key(full, source, shown, turned, pilot):
    await field_known(full, pilot)
    await turned(full, pilot, "map")
    await pilot.press("b", "3", "enter")
    assert full.page.drive is not None
    await pilot.press("b")
    assert isinstance(full.screen, Confirm), "nothing is driven yet"
    await pilot.press("escape")
    for corner in driven(0.0).corners:
        feed(
            full,
            [corner._asdict() | {"fix_quality": 4}],
            place_m=TangentPlane(34.28, 119.88).project_to_m(corner.lat_deg, corner.lon_deg),
        )
    await pilot.pause()
    assert any("BOUNDARY" in row for row in shown(full))
    await pilot.press("b")
    assert (
        isinstance(full.screen, ChoiceDialog)
        and "stop the machine first" in full.screen.choices[0].why
    )
    await pilot.press("1", "enter", "escape")
    assert full.page.drive is not None, "what was driven waits for the machine to stop"
    feed(full, [{"state": "off"}])
    await pilot.press("b", "1", "enter")
    await settled(full, pilot)
    desk = full.services.job
    assert any(one[0] == "boundary" for one in desk.asked)
    assert isinstance(full.screen, Confirm) and full.page.where == "job"


# --- a map by its path ---


async def test_a_map_by_its_path_and_through_folders(full, source, turned):
    desk = full.services.job
    async with full.run_test(size=SIZE) as pilot:
        await turned(full, pilot, "job")
        await _settled(full, pilot, "p")
        assert isinstance(full.screen, ChoiceDialog)
        await pilot.press("up", "enter")  # the last line: a path
        assert isinstance(full.screen, NameDialog)
        await pilot.press(*"/maps/n.csv".replace("/", "~").replace(".", "^"))
        full.screen.query_one("#name-input").value = "/maps/n.csv"
        await _settled(full, pilot, "enter")
        assert ("preview", "/maps/n.csv", "", "") in desk.asked
        await pilot.press("escape")
        await _settled(full, pilot, "p")
        await pilot.press("up", "up")
        await _settled(full, pilot, "enter")  # look in folders
        assert isinstance(full.screen, ChoiceDialog) and full.screen.choices[0].label == "STICK/"
        await _settled(full, pilot, "enter")
        assert full.screen.choices[0].label == ".."


async def _settled(app, pilot, key):
    await pilot.press(key)
    await settled(app, pilot)
