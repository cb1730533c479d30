"""The raster of the worked ground: where what lies, what a pixel says, bounded memory, and the
image made of it."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.console.app.coverage_raster import (
    CELL_KIND_COUNT,
    CELL_PLANE_COUNT,
    CELL_SIZES_M,
    GroundBox,
    OutletSpot,
    WorkedGround,
    make_spot,
)
from topdress.console.app.field_picture import FieldPicture, PlannedRates
from topdress.console.app.frame_history import LiveHistory, LogHistory
from topdress.console.app.map_camera import MapCamera, PixelGrid, fit_box
from topdress.console.app.map_image import (
    DONE_ENTRY,
    EMPTY_ENTRY,
    MAX_CELL_PIXEL_SHARE,
    PASSAGE_ENTRY,
    PLAN_ENTRY,
    TRAIL_ENTRY,
    GroundPixels,
    choose_two_colours,
    find_next_passes,
    make_image,
    mark_trail,
    rasterise_lines,
)
from topdress.console.app.map_layers import MapLayer, find_colour_scale
from topdress.console.app.units import IMPERIAL, METRIC
from topdress.console.colour_scale import COLOUR_STEPS

from tests.app.made_up.run import run_frames


def straight(
    length_m: float, step_m: float = 0.8, applied: float = 300.0, east_m: float = 0.5
) -> list[OutletSpot]:
    """A way due north from 0."""
    return [
        OutletSpot(east_m, north, 0.0, applied, 320.0, 0.5)
        for north in np.arange(0.0, length_m, step_m).tolist()
    ]


def test_a_swath_is_as_wide_as_the_outlets_and_nothing_beside_it():
    worked = WorkedGround(width_m=3.0)
    worked.add_spots(straight(20.0, east_m=5.5))
    seen = GroundPixels(worked, PixelGrid(12, 22, 1.0, 0.0, 21.0))
    done = ~np.isnan(seen.calc_means(MapLayer.APPLIED))
    assert done[5:20].sum(axis=1).tolist() == [3] * 15
    assert np.flatnonzero(done[10]).tolist() == [4, 5, 6]
    assert not done[0].any() and not done[21].any(), "nothing ahead of it, nothing behind"
    assert np.flatnonzero(seen.calc_means_and_passage(MapLayer.APPLIED)[1][10]).tolist() == [5]


def test_heading_east_the_swath_lies_north_and_south():
    worked = WorkedGround(width_m=3.0)
    worked.add_spots(
        [
            OutletSpot(east, 5.5, 90.0, 300.0, 320.0, 0.5)
            for east in np.arange(0.0, 10.0, 0.8).tolist()
        ]
    )
    seen = GroundPixels(worked, PixelGrid(10, 10, 1.0, 0.0, 10.0))
    assert np.flatnonzero(~np.isnan(seen.calc_means(MapLayer.APPLIED)[:, 4])).tolist() == [3, 4, 5]


def test_a_gap_between_frames_is_filled_but_a_jump_is_not():
    worked = WorkedGround(width_m=1.0)
    worked.add_spots(
        [
            OutletSpot(0.5, 0.5, 0.0, 300.0, 300.0, 0.5),
            OutletSpot(0.5, 8.5, 0.0, 300.0, 300.0, 0.5),
            OutletSpot(0.5, 40.5, 0.0, 300.0, 300.0, 0.5),
        ]
    )
    seen = GroundPixels(worked, PixelGrid(1, 45, 1.0, 0.0, 45.0)).calc_means(MapLayer.APPLIED)[
        ::-1, 0
    ]
    assert np.flatnonzero(~np.isnan(seen)).tolist() == [*range(9), 40]


def test_standing_still_weighs_nothing():
    worked = WorkedGround()
    worked.add_spots([OutletSpot(0.5, 0.5, 0.0, 300.0, 300.0, 0.5)])
    version = worked.version
    worked.add_spots([OutletSpot(0.5, 0.6, 0.0, 0.0, 300.0, 0.5)] * 1000)
    assert worked.version == version
    assert (
        GroundPixels(worked, PixelGrid(1, 1, 1.0, 0.0, 1.0)).calc_means(MapLayer.APPLIED)[0, 0]
        == 300.0
    )


def test_what_is_not_known_does_not_count_as_zero():
    worked = WorkedGround(width_m=1.0)
    worked.add_spots(
        [OutletSpot(0.5, 0.0, 0.0, nan, 300.0, nan), OutletSpot(0.5, 0.5, 0.0, 200.0, 300.0, nan)]
    )
    seen = GroundPixels(worked, PixelGrid(1, 1, 1.0, 0.0, 1.0))
    assert (seen.calc_means(MapLayer.APPLIED)[0, 0], seen.calc_means(MapLayer.TARGET)[0, 0]) == (
        200.0,
        300.0,
    )
    assert isnan(seen.calc_means(MapLayer.NDVI)[0, 0])


def test_a_held_machine_leaves_a_passage_only():
    frame = run_frames(seconds=1.0)[-1]
    held = replace(frame, row=frame.row._replace(state="held"))
    assert isnan(make_spot(held).applied_kg_ha) and isnan(make_spot(held).target_kg_ha)
    assert make_spot(frame).applied_kg_ha == frame.row.applied_rate_kg_ha
    assert make_spot(replace(frame, place_m=None)) is None


@pytest.mark.parametrize("metres", [0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 20.0, 100.0])
def test_at_every_scale_nothing_is_lost_and_the_mean_is_kept(metres):
    """The sums over all pixels are those over all finest cells, however coarse the pixels are."""
    worked = WorkedGround()
    rng = np.random.default_rng(5)
    spots = [
        OutletSpot(
            2.4 * (k // 80),
            float(k % 80),
            0.0 if k // 80 % 2 == 0 else 180.0,
            float(rng.uniform(200, 400)),
            300.0,
            0.5,
        )
        for k in range(800)
    ]
    worked.add_spots(spots)
    size = int(130 / metres) + 2
    pixels = PixelGrid(
        size, size, metres, -20.0 // metres * metres, 105.0 // metres * metres + metres
    )
    if metres < CELL_SIZES_M[0]:
        seen = GroundPixels(worked, pixels)
        assert set(
            np.unique(
                seen.calc_means(MapLayer.APPLIED)[~np.isnan(seen.calc_means(MapLayer.APPLIED))]
            )
        ) == {
            value
            for value in np.unique(
                GroundPixels(worked, PixelGrid(260, 260, 0.5, -20.0, 106.0)).calc_means(
                    MapLayer.APPLIED
                )
            )
            if value == value
        }
        return
    planes, finest = (
        GroundPixels(worked, pixels).sum_planes(*range(CELL_PLANE_COUNT)),
        worked.sum_window(0.5, -40, -48, 260, 260),
    )
    assert planes.sum(axis=(1, 2)) == pytest.approx(finest.sum(axis=(1, 2)), rel=1e-5)
    assert planes[CELL_KIND_COUNT].sum() > 0


@pytest.mark.parametrize("metres", [0.25, 1.0, 1.5, 2.0, 3.0, 7.5])
@pytest.mark.parametrize("north", [0.5, 1.5, 2.5, 4.5, 11.5])
def test_a_cell_is_seen_in_the_pixel_that_its_middle_lies_in(metres, north):
    """All cells of the size that a scale is drawn from; the middle of the one that holds 0.5 m
    east."""
    worked = WorkedGround(width_m=0.3)
    worked.add_spots([OutletSpot(0.5, north, 0.0, 300.0, 300.0, 0.5)])
    cell_m = worked.choose_cell_m(MAX_CELL_PIXEL_SHARE * metres)
    middle = tuple((place // cell_m + 0.5) * cell_m for place in (0.5, north))
    pixels = MapCamera(0.0, 6.0, metres).make_grid(20, 80)
    lit = np.argwhere(~np.isnan(GroundPixels(worked, pixels).calc_means(MapLayer.APPLIED)))
    # on an edge the north-eastern one
    column, row = pixels.find_pixel(middle[0] + 0.01, middle[1] + 0.01)
    assert [row, column] in lit.tolist()
    assert len(lit) == max(1.0, cell_m / metres) ** 2


def test_the_memory_is_bounded_however_far_is_driven():
    worked = WorkedGround(most_tiles=20)
    for k in range(400):
        worked.add_spots(
            [
                OutletSpot(40.0 * k, 0.0, 90.0, 300.0, 300.0, 0.5),
                OutletSpot(40.0 * k + 5.0, 0.0, 90.0, 300.0, 300.0, 0.5),
            ]
        )
    assert worked.cells_m[0] > 1.0, "the finest cells were given up"
    assert worked.tile_count <= 20 * len(worked.cells_m)
    assert (worked.box.west_m, worked.box.east_m) == (0.0, 40.0 * 399 + 5.0)
    far = GroundPixels(worked, PixelGrid(1, 1, 32.0, 8000.0, 32.0))
    assert far.calc_means(MapLayer.APPLIED)[0, 0] == pytest.approx(300.0), (
        "what was entered first is still there"
    )


def test_added_one_by_one_or_all_at_once_is_the_same():
    spots = straight(60.0)
    one, other = WorkedGround(), WorkedGround()
    other.add_spots(spots)
    for spot in spots:
        one.add_spots([spot])
    for cell in (1.0, 4.0, 16.0):
        assert one.sum_window(cell, -5, -5, 40, 90) == pytest.approx(
            other.sum_window(cell, -5, -5, 40, 90), abs=1e-2
        )


# --- the image
# --------------------------------------------------------------------------------------------------

PLANNED = PlannedRates(0.0, 0.0, 5.0, np.array([[100.0, 200.0], [300.0, np.nan]], dtype=np.float32))
PICTURE = FieldPicture(
    "f", (((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)),), 0.01, 1.0, PLANNED
)


def test_planned_rates_lie_under_the_work_and_the_outline_over_it():
    worked = WorkedGround(width_m=1.0)
    worked.add_spots([OutletSpot(2.5, north, 0.0, 300.0, 300.0, 0.5) for north in (1.5, 2.5, 3.5)])
    scale = find_colour_scale(MapLayer.APPLIED, worked, PICTURE, METRIC)
    assert (scale.low, scale.high) == (100.0, 300.0)
    seen = make_image(worked, PICTURE, scale, PixelGrid(14, 14, 1.0, -2.0, 12.0))
    assert seen[11 - 2, 2 + 2] == DONE_ENTRY + COLOUR_STEPS - 1
    assert seen[11 - 2, 1 + 2] == PLAN_ENTRY, "100 kg/ha, the lowest"
    assert seen[11 - 2, 7 + 2] == PLAN_ENTRY + round(0.5 * (COLOUR_STEPS - 1))
    assert seen[11 - 7, 7 + 2] == EMPTY_ENTRY, "the plan says nothing there"
    assert seen[11 - 2, 0 + 2] >= PLAN_ENTRY, "the line hides no ground"
    dots = rasterise_lines(
        ((*ring, ring[0]) for ring in PICTURE.rings_m), PixelGrid(14, 14, 1.0, -2.0, 12.0)
    )
    assert (
        dots.shape == (7, 14) and dots[6, 5 + 2] and dots[(11 - 5) // 2, 0 + 2] and not dots[3, 5]
    )
    assert all(int(bits).bit_count() <= 4 for bits in dots[2:5].ravel()), "a dot wide"
    assert (
        make_image(worked, PICTURE, scale, PixelGrid(14, 14, 1.0, -2.0, 12.0), plan=False)[9, 3]
        == EMPTY_ENTRY
    )
    error = make_image(
        worked,
        PICTURE,
        find_colour_scale(MapLayer.ERROR, worked, PICTURE, METRIC),
        PixelGrid(14, 14, 1.0, -2.0, 12.0),
    )
    assert (
        error[9, 4] == DONE_ENTRY + round(0.5 * (COLOUR_STEPS - 1)) and error[9, 3] == EMPTY_ENTRY
    )


def test_the_pass_behind_the_machine_glows_and_the_next_one_is_where_nothing_was_spread():
    worked = WorkedGround(width_m=2.0)
    worked.add_spots([OutletSpot(3.0, float(north), 0.0, 300.0, 300.0, 0.5) for north in range(40)])
    assert len(find_next_passes(worked, PixelGrid(20, 60, 1.0, -5.0, 50.0))) == 2, (
        "nothing lies on either side"
    )
    worked.add_spots([OutletSpot(500.0, 500.0, 0.0, nan, nan, nan)])
    worked.add_spots(
        [OutletSpot(1.0, float(north), 180.0, 300.0, 300.0, 0.5) for north in range(70, -1, -1)]
    )
    pixels = PixelGrid(20, 60, 1.0, -5.0, 50.0)
    (line,) = find_next_passes(worked, pixels)
    assert [east for east, _north in line] == pytest.approx([-1.0, -1.0])
    seen = make_image(
        worked, None, find_colour_scale(MapLayer.APPLIED, worked, None, METRIC), pixels
    )
    bare = seen.copy()
    mark_trail(seen, worked, pixels)
    assert (seen[49 - 5, 5:7] == bare[49 - 5, 5:7] + TRAIL_ENTRY - DONE_ENTRY).all() and (
        seen[:, 7:] == bare[:, 7:]
    ).all()
    near = pixels._replace(columns=40, rows=120, metres=0.5)
    seen = make_image(worked, None, find_colour_scale(MapLayer.APPLIED, worked, None, METRIC), near)
    mark_trail(seen, worked, near)
    assert (seen[2 * 30 : 2 * 49, 2 * 5 : 2 * 7] >= TRAIL_ENTRY).all(), (
        "without gaps between the frames"
    )
    worked.add_spots(
        [
            OutletSpot(1.0, 0.0, 90.0, 300.0, 300.0, 0.5),
            OutletSpot(2.0, 0.0, 90.0, 300.0, 300.0, 0.5),
        ]
    )
    assert find_next_passes(worked, pixels) == (), "a turn has none"


@pytest.mark.parametrize("heading_deg", [0.0, 20.0, 30.0, 45.0, 137.0, 270.0])
def test_no_hole_is_in_a_pass_whatever_its_heading(heading_deg):
    worked, (east, north) = (
        WorkedGround(2.4),
        (np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))),
    )
    worked.add_spots(
        [
            OutletSpot(way_m * east + 0.13, way_m * north + 0.29, heading_deg, 300.0, 300.0, nan)
            for way_m in np.arange(0.0, 33.0, 0.83).tolist()
        ]
    )
    pixels = PixelGrid(160, 160, 0.5, -40.0, 40.0)
    eastward, northward = np.meshgrid(*pixels.list_middles())
    along = (eastward - 0.13) * east + (northward - 0.29) * north
    off = (eastward - 0.13) * north - (northward - 0.29) * east
    under = (np.abs(off) <= 1.2) & (along > 1.0) & (along < 31.0)
    assert np.isfinite(GroundPixels(worked, pixels).calc_means(MapLayer.APPLIED)[under]).all()


def passes_of(
    *ways: list[OutletSpot], width_m: float = 2.4, all_at_once: bool = True
) -> WorkedGround:
    """Driven one after the other; far apart, where a list holds it, is no way."""
    worked, spots = WorkedGround(width_m=width_m), [spot for way in ways for spot in way]
    for some in [spots] if all_at_once else [[spot] for spot in spots]:
        worked.add_spots(some)
    return worked


FAR = [OutletSpot(500.0, 500.0, 0.0, nan, nan, nan)]


@pytest.mark.parametrize("all_at_once", [True, False])
@pytest.mark.parametrize(("apart_m", "twice"), [(2.4, 0.0), (1.4, 1.0 / 3.8), (3.4, 0.0)])
def test_ground_that_was_spread_on_twice_is_overlap_and_a_seam_is_none(apart_m, twice, all_at_once):
    """Two passes of 2.4 m, at 50 places across the raster; `twice`: of what they cover together."""
    shares = []
    for shift in np.arange(0.003, 0.5, 0.01).tolist():
        ways = (
            straight(20.0, east_m=10.0 + shift),
            FAR,
            straight(20.0, east_m=10.0 + shift + apart_m),
        )
        times = GroundPixels(
            passes_of(*ways, all_at_once=all_at_once), PixelGrid(60, 60, 0.5, 0.0, 35.0)
        ).calc_means(MapLayer.PASSES)
        known = times[np.isfinite(times)]
        assert set(known.tolist()) <= {1.0, 2.0}
        shares.append(float((known == 2.0).mean()))
    assert np.mean(shares) == pytest.approx(twice, abs=0.02 if twice else 0.0)


def test_a_tight_turn_and_a_machine_that_is_held_are_no_overlap():
    turn = [
        OutletSpot(
            10.0 + 1.5 * np.sin(t),
            10.0 + 1.5 * np.cos(t),
            float(np.degrees(t) + 90.0),
            300.0,
            300.0,
            nan,
        )
        for t in np.arange(0.0, np.pi, 0.3).tolist()
    ]
    held = [spot._replace(applied_kg_ha=nan) for spot in straight(30.0, east_m=20.5)]
    times = GroundPixels(
        passes_of(turn, FAR, straight(30.0, east_m=20.5), FAR, held),
        PixelGrid(40, 40, 1.0, 0.0, 40.0),
    ).calc_means(MapLayer.PASSES)
    assert np.nanmax(times) == 1.0


def test_overlap_stays_where_the_finest_cells_are_given_up():
    one = straight(60.0, east_m=10.5)
    worked = passes_of(one, FAR, one)
    worked.most_tiles = 4
    worked.add_spots([OutletSpot(3000.0, 0.0, 0.0, nan, nan, nan)])
    worked.add_spots(one)
    assert 0.5 < worked.cells_m[0] < worked.width_m
    times = GroundPixels(worked, PixelGrid(1, 1, 32.0, 0.0, 32.0)).calc_means(MapLayer.PASSES)
    assert times[0, 0] == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(
    ("quarters", "shown"),
    [
        ([[5, 5], [5, 5]], ("█", 5, 5)),
        ([[5, 9], [5, 5]], ("▝", 9, 5)),
        ([[9, 9], [5, 9]], ("▜", 9, 5)),
        ([[0, 7], [7, 0]], ("▞", 7, 0)),
        ([[3, 4], [40, 41]], ("▄", 41, 3)),
        ([[3, 4], [5, 60]], ("▗", 60, 4)),
        ([[0, 50], [52, 53]], ("▟", 52, 0)),
    ],
)
def test_a_cell_shows_its_quarters_in_the_two_colours_that_differ_most(quarters, shown):
    code = int(choose_two_colours(np.array(quarters, np.uint8)).codes[0, 0])
    assert (
        " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"[code >> 16] if code >> 16 else "█",
        code >> 8 & 255,
        code & 255,
    ) == shown


def test_error_goes_from_too_little_to_too_much_against_50_at_least():
    worked = WorkedGround(width_m=1.0)
    for north, applied, target in ((0.5, 210.0, 300.0), (10.5, 390.0, 300.0), (20.5, 20.0, 10.0)):
        worked.add_spots([OutletSpot(0.5, north, 0.0, applied, target, 0.5)])
        worked.add_spots([OutletSpot(500.0, 500.0, 0.0, nan, nan, nan)])
    seen = GroundPixels(worked, PixelGrid(1, 21, 1.0, 0.0, 21.0)).calc_means(MapLayer.ERROR)[
        ::-1, 0
    ]
    assert seen[[0, 10, 20]].tolist() == pytest.approx([-0.3, 0.3, 0.2])


def test_where_nothing_was_spread_only_the_passage_is_seen():
    worked = WorkedGround(width_m=1.0)
    worked.add_spots([OutletSpot(0.5, north, 0.0, 0.0, 0.0, 0.5) for north in (0.5, 1.5, 2.5)])
    scale = find_colour_scale(MapLayer.APPLIED, worked, None, METRIC)
    assert (
        make_image(worked, None, scale, PixelGrid(1, 3, 1.0, 0.0, 3.0)).ravel().tolist()
        == [PASSAGE_ENTRY] * 3
    )


def test_scales_are_round_in_the_shown_unit():
    worked = WorkedGround()
    worked.add_spots(
        [
            OutletSpot(0.0, 0.0, 0.0, 260.0, 390.0, 0.41),
            OutletSpot(0.0, 2.0, 0.0, 300.0, 300.0, 0.63),
        ]
    )
    metric, imperial = (
        find_colour_scale(MapLayer.TARGET, worked, None, units) for units in (METRIC, IMPERIAL)
    )
    assert (metric.format_value(metric.low), metric.format_value(metric.high)) == ("250", "400")
    assert (
        imperial.format_value(imperial.low),
        imperial.format_value(imperial.high),
        imperial.unit,
    ) == (
        "200",
        "350",
        "lb/ac",
    )
    ndvi = find_colour_scale(MapLayer.NDVI, worked, None, METRIC)
    assert (ndvi.format_value(ndvi.low), ndvi.format_value(ndvi.high)) == ("0.40", "0.65")


def test_the_plan_s_mass_and_the_rate_at_a_place():
    assert PLANNED.planned_mass_kg == pytest.approx(600.0 * 25.0 / 10_000.0)
    assert PLANNED.find_rate(6.0, 1.0) == 200.0 and PLANNED.find_rate(1.0, 6.0) == 300.0
    assert (
        PLANNED.find_rate(6.0, 6.0) is None
        and PLANNED.find_rate(-0.1, 1.0) is None
        and PLANNED.find_rate(10.1, 1.0) is None
    )


# --- cameras
# --------------------------------------------------------------------------------------------------


@settings(max_examples=80, deadline=None)
@given(
    st.floats(-2000, 2000),
    st.floats(-2000, 2000),
    st.integers(20, 240),
    st.integers(12, 120),
    st.integers(0, 16),
)
def test_a_place_and_its_pixel_are_inverse(east, north, columns, rows, scale):
    from topdress.console.app.map_camera import PIXEL_SIZES_M

    pixels = MapCamera(east, north, PIXEL_SIZES_M[scale]).make_grid(columns, rows)
    column, row = pixels.find_pixel(east, north)
    assert 0 <= column < columns and 0 <= row < rows
    assert pixels.find_pixel(*pixels.find_middle(column, row)) == (column, row)


def test_following_stands_while_the_machine_is_well_inside():
    camera = MapCamera(0.0, 0.0, 1.0)
    assert camera.follow_place((10.0, 5.0), 60, 40) is camera
    assert camera.follow_place((29.0, 5.0), 60, 40) == MapCamera(29.0, 5.0, 1.0)


def test_zoom_goes_along_round_scales_and_stops_at_the_ends():
    assert (
        MapCamera(0, 0, 1.0).zoom_steps(1).metres == 0.5
        and MapCamera(0, 0, 1.0).zoom_steps(-1).metres == 1.5
    )
    assert (
        MapCamera(0, 0, 0.25).zoom_steps(3).metres == 0.25
        and MapCamera(0, 0, 200.0).zoom_steps(-3).metres == 200.0
    )


def test_a_field_is_seen_whole():
    pixels = fit_box(GroundBox(0.0, 0.0, 400.0, 100.0), 100, 60).make_grid(100, 60)
    for corner in ((0.0, 0.0), (400.0, 100.0)):
        column, row = pixels.find_pixel(*corner)
        assert 0 <= column < 100 and 0 <= row < 60


# --- history
# --------------------------------------------------------------------------------------------------


def test_a_log_s_ground_grows_in_slices_and_goes_back():
    frames = run_frames(seconds=60.0)
    history, live = LogHistory(frames), LiveHistory()
    for frame in frames:
        live.add_frame(frame)
    looks = 1
    while not history.enter_up_to(len(frames) - 1, most=70):
        looks += 1
    assert looks == 5
    box = live.worked.box
    assert history.worked.box == box
    west, south = int(box.west_m) - 3, int(box.south_m) - 3
    assert history.worked.sum_window(2.0, west, south, 60, 60) == pytest.approx(
        live.worked.sum_window(2.0, west, south, 60, 60), abs=1e-2
    )
    assert history.enter_up_to(20) and history.worked.box.north_m == pytest.approx(
        frames[20].place_m[1], abs=0.4
    )


def test_ground_from_before_is_entered_without_a_way_to_it():
    """The machine drives on at 40 m north; what it did before lies at 30 m to 36 m."""
    history = LiveHistory()
    here = [
        replace(frame, place_m=(0.5, 40.0 + frame.row.time_s)) for frame in run_frames(seconds=5.0)
    ]
    for frame in here[:15]:
        history.add_frame(frame)
    history.add_earlier_ground(
        [(0.5, 30.0, 0.0, 250.0), (0.5, 33.0, 0.0, 250.0), (0.5, 36.0, 0.0, 250.0)]
    )
    for frame in here[15:]:
        history.add_frame(frame)
    seen = GroundPixels(history.worked, PixelGrid(1, 50, 1.0, 0.0, 50.0)).calc_means(
        MapLayer.APPLIED
    )[::-1, 0]
    assert np.flatnonzero(~np.isnan(seen)).tolist() == [*range(30, 37), *range(40, 45)]
    assert seen[30:37] == pytest.approx(250.0)
