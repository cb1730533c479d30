"""Numerals, scales, lines, map frames, units, ages: the pure parts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.style import Style
from topdress.console.app import map_camera, panel_views
from topdress.console.app.actions import ACTIONS
from topdress.console.app.block_digits import ROWS_AT_SCALE, draw_digits, find_largest_scale
from topdress.console.app.braille import trace_values
from topdress.console.app.coverage_raster import GroundBox
from topdress.console.app.frame_history import LiveHistory
from topdress.console.app.pages.calibrate.curve_plot import CurvePlot, CurveView
from topdress.console.app.refresh_rates import RefreshTimer
from topdress.console.app.units import IMPERIAL, METRIC
from topdress.console.app.widgets.base_panel import align_text_right, fit_text_width, spread_parts
from topdress.console.app.widgets.value_tiles import draw_share_bar
from topdress.console.colour_scale import COLOUR_STEPS, find_rate_colour, round_calm_ends
from topdress.control.log_row import LogRow

from tests.app.harness import dots
from tests.app.made_up.run import run_frames


@pytest.mark.parametrize(("scale", "rows"), [(1, 3), (2, 5)])
def test_numerals_are_rectangles_and_all_differ(scale, rows):
    faces = {character: draw_digits(character, scale) for character in "0123456789"}
    assert len(set(faces.values())) == 10
    for face in faces.values():
        assert len(face) == rows and len({len(row) for row in face}) == 1


def test_a_numeral_at_both_scales():
    assert draw_digits("7") == ("▀▀█", "  █", "  ▀")
    assert draw_digits("1.", 2) == (
        "  ██      ",
        "████      ",
        "  ██      ",
        "  ██      ",
        "██████  ██",
    )


@settings(max_examples=100, deadline=None)
@given(st.text(alphabet="abc作业 °x", max_size=30), st.integers(0, 40))
def test_texts_are_fitted_by_cells(text, width):
    assert cell_len(fit_text_width(text, width)) == width
    if cell_len(text) <= width:
        assert fit_text_width(text, width).startswith(text)
        assert (
            align_text_right(text, width).endswith(text)
            and cell_len(align_text_right(text, width)) == width
        )


def test_a_row_keeps_its_end_when_the_left_is_too_long():
    row = spread_parts(["作业" * 10, "more"], ["END"], 20)
    assert row.plain.endswith("END") and cell_len(row.plain) == 20


def lightness(rgb):
    """CIE L* of an sRGB colour, computed apart from the scale's own space."""
    linear = [
        c / 255 / 12.92 if c / 255 <= 0.04045 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in rgb
    ]
    y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return 116 * y ** (1 / 3) - 16


def test_the_scale_s_lightness_rises_evenly():
    steps = [lightness(find_rate_colour(i / (COLOUR_STEPS - 1))) for i in range(COLOUR_STEPS)]
    rises = [b - a for a, b in pairwise(steps)]
    assert min(rises) > 0
    assert max(rises) < 2.2 * sum(rises) / len(rises)
    assert steps[-1] - steps[0] > 45


@pytest.mark.parametrize(
    "matrix",
    [
        # protanopia (Machado 2009)
        ((0.152, 1.053, -0.205), (0.115, 0.786, 0.099), (-0.004, -0.048, 1.052)),
        ((0.367, 0.861, -0.228), (0.280, 0.673, 0.047), (-0.012, 0.043, 0.969)),  # deuteranopia
    ],
)
def test_colour_blind_eyes_keep_the_ends_apart(matrix):
    def seen(rgb):
        return [
            sum(weight * channel for weight, channel in zip(row, rgb, strict=True))
            for row in matrix
        ]

    places = [seen(find_rate_colour(share / 4)) for share in range(5)]
    for a, b in pairwise(places):
        assert sqrt(sum((x - y) ** 2 for x, y in zip(a, b, strict=True))) > 30


def test_scale_ends_are_calm_and_hold_all_values():
    assert round_calm_ends([]) == (0.0, 100.0)
    assert round_calm_ends([3.0, 40.0]) == (0.0, 100.0)
    assert round_calm_ends([260.0, 390.0]) == (250.0, 400.0)
    assert round_calm_ends([301.0, 302.0]) == (300.0, 400.0)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0, 900), min_size=1, max_size=20))
def test_no_value_lies_outside_the_scale(values):
    low, high = round_calm_ends(values)
    assert low <= min(values) and max(values) <= high and high - low >= 100


def test_a_trace_is_a_step_where_the_value_steps():
    seen = dots(trace_values([(0.0, 0.0), (0.5, 1.0), (1.0, 1.0)], columns=4, rows=2))
    assert seen == {
        (0, 7),
        (1, 7),
        (2, 7),
        (3, 7),
        *((4, y) for y in range(8)),
        (5, 0),
        (6, 0),
        (7, 0),
    }


def test_an_unknown_value_breaks_the_trace():
    seen = dots(trace_values([(0.0, 0.5), (0.4, None), (1.0, 0.5)], columns=5, rows=1))
    assert {x for x, _y in seen} == {0, 9}


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-3000, 3000), st.floats(-3000, 3000)), min_size=1, max_size=10),
    st.integers(16, 60),
    st.integers(6, 60),
)
def test_every_place_lies_on_the_map(places, columns, rows):
    easts, norths = zip(*places, strict=True)
    pixels = map_camera.fit_box(
        GroundBox(min(easts), min(norths), max(easts), max(norths)), columns, rows
    ).make_grid(columns, rows)
    for place in places:
        x, y = pixels.find_pixel(*place)
        assert 0 <= x < columns and 0 <= y < rows


def test_the_map_has_north_up_and_east_right():
    pixels = map_camera.fit_box(GroundBox(0.0, 0.0, 50.0, 50.0), 40, 40).make_grid(40, 40)
    west, north = pixels.find_pixel(0.0, 50.0), pixels.find_pixel(0.0, 0.0)
    assert west[1] < north[1]
    assert pixels.find_pixel(50.0, 0.0)[0] > pixels.find_pixel(0.0, 0.0)[0]


def test_a_head_s_bar():
    assert draw_share_bar(0.5, 8) == ("▄▄▄▄", "▁▁▁▁")
    assert draw_share_bar(1.7, 4) == ("▄▄▄▄", "") and draw_share_bar(-1.0, 2) == ("", "▁▁")


@pytest.mark.parametrize(
    ("unit", "si", "text"),
    [
        (METRIC.speed, 1.25, "4.5"),
        (METRIC.rate, 336.7, "337"),
        (METRIC.speed, -0.004, "0.0"),
        (METRIC.rate, None, "--"),
        (IMPERIAL.speed, 4.4704, "10.0"),
        (IMPERIAL.rate, 112.085, "100"),
        (IMPERIAL.area, 4.0468564224, "10.00"),
        (IMPERIAL.mass, 45.359237, "100"),
        (IMPERIAL.distance, 30.48, "100"),
    ],
)
def test_units_at_the_edge(unit, si, text):
    assert unit.format_value(si) == text


@given(st.floats(0, 1e4))
def test_what_is_typed_comes_back_in_si(shown):
    for unit in (*METRIC[1:], *IMPERIAL[1:]):
        assert unit.convert_to_si(shown) * unit.per_si == pytest.approx(shown)


def test_the_rate_error_is_relative_to_50_kg_ha_at_least():
    assert panel_views.find_rate_error(300.0, 270.0) == pytest.approx(-0.10)
    assert panel_views.find_rate_error(10.0, 20.0) == pytest.approx(0.20)
    assert panel_views.find_rate_error(None, 20.0) is None


@pytest.mark.parametrize(
    ("applied", "level", "text"),
    [(300.0, "", "0 %"), (331.0, "amber", "+10 %"), (329.0, "", "+10 %"), (239.0, "red", "-20 %")],
)
def test_levels_of_the_rate_error(applied, level, text):
    frame = run_frames(seconds=1.0)[-1]
    row = frame.row._replace(target_rate_kg_ha=300.0, applied_rate_kg_ha=applied)
    rates = panel_views.make_run_view(replace(frame, row=row), 0.0, METRIC).rates
    assert (rates.level, rates.error.text) == (level, text)


def test_a_machine_that_is_held_owes_nothing():
    frame = run_frames(seconds=1.0)[-1]
    row = frame.row._replace(target_rate_kg_ha=300.0, applied_rate_kg_ha=0.0)
    assert (
        panel_views.make_run_view(replace(frame, row=row), 0.0, METRIC).rates.error.text == "-100 %"
    )
    held = panel_views.make_run_view(
        replace(frame, row=row._replace(state="held")), 0.0, METRIC
    ).rates
    assert (held.error.text, held.error_share, held.level) == ("--", None, "")


def test_times():
    assert (
        panel_views.format_duration(59.9) == "00:59"
        and panel_views.format_duration(3723) == "1:02:03"
    )
    assert panel_views.format_local_time("2026-03-18T23:59:58.000Z", 3600.0) == "00:59:58"
    assert panel_views.format_local_time("2026-03-18T06:00:00.000Z", 0.0, 61.0) == "05:58:59"
    assert (
        panel_views.format_local_time(None, 0.0) == ""
        and panel_views.format_local_time("yesterday", 0.0) == ""
    )


def test_an_empty_frame_row_shows_dashes_not_numbers():
    frame = replace(
        run_frames(seconds=1.0)[0],
        row=LogRow(0.0),
        metres_left_m=None,
        place_m=None,
        gnss_age_s=None,
        gnss_hz=None,
    )
    seen = panel_views.make_run_view(frame, 0.0, METRIC)
    assert seen.rates.target.text == seen.rates.applied.text == seen.rates.error.text == "--"
    assert {tile.value.text for tile in seen.tiles} == {"--"}
    assert seen.heads.valid == "0 of 6 heads"


def test_the_history_is_bounded_and_begins_anew_with_a_new_log():
    history = LiveHistory()
    frames = run_frames(seconds=30.0)
    for frame in frames:
        history.add_frame(frame)
        history.add_frame(frame)
    assert len(history.points) == len(frames)
    assert history.list_recent_points(10.0)[0].time_s == pytest.approx(frames[-1].row.time_s - 10.0)
    assert history.worked.box is not None and history.series.end_s == frames[-1].row.time_s
    history.add_frame(frames[0])
    assert len(history.points) == 1 and history.worked.box == GroundBox(0.0, 0.0, 0.0, 0.0)
    assert history.series.start_s == history.series.end_s == 0.0


def test_pace():
    pace = RefreshTimer(0.5)
    assert [t for t in (0.0, 0.2, 0.4, 0.5, 0.9, 1.0, 0.3) if pace.is_due(t)] == [
        0.0,
        0.5,
        1.0,
        0.3,
    ]
    pace.make_due()
    assert pace.is_due(0.31)


def test_hold_and_stop_come_first_and_are_never_locked():
    assert {action.id for action in ACTIONS if action.priority} == {"hold", "stop"}
    assert {"hold", "stop"} <= {action.id for action in ACTIONS if action.locked}


@pytest.mark.parametrize("slope", [1.0, -1.0])
def test_points_and_their_line_stand_where_their_axes_say(monkeypatch, slope):
    """What grows to the right goes up, from edge to edge; the line runs through the points, the
    band around it."""
    monkeypatch.setattr(CurvePlot, "find_style", lambda self, name: Style())
    monkeypatch.setattr(CurvePlot, "rich_style", Style())
    ends = ((10.0, 5.0 - 4.0 * slope), (50.0, 5.0), (90.0, 5.0 + 4.0 * slope))
    alone = CurveView("rpm", "kg", ends)
    fitted = CurveView("rpm", "kg", (), tuple((x, y, y - 0.5, y + 0.5) for x, y in ends))
    rows, lined = (
        [strip.text for strip in CurvePlot(one).draw_rows(one, 70, 20)] for one in (alone, fitted)
    )
    body = [row[8:] for row in rows[1:-1]]
    marks = sorted((row.index("o"), k) for k, row in enumerate(body) if "o" in row)
    assert len(marks) == 3 and marks[0][0] <= 6 and marks[2][0] >= 52, "from edge to edge"
    down = [k for _, k in marks]
    assert (
        down == sorted(down, reverse=slope > 0.0) and min(down) <= 4 and max(down) >= len(body) - 5
    )
    assert float(rows[1].split()[0]) > float(rows[-2].split()[0]), "the axis counts upwards"
    drawn = [
        [k for k, row in enumerate(lined[1:-1]) if "\u2800" < row[8 + column] <= "\u28ff"]
        for column, _ in marks
    ]
    assert all(min(seen) - 1 <= row <= max(seen) + 1 for seen, row in zip(drawn, down, strict=True))


@pytest.mark.parametrize("columns", range(8, 80))
@pytest.mark.parametrize("text", ["89", "7", "330", "12.5"])
def test_two_numbers_stand_farther_apart_than_the_numerals_of_one(columns, text):
    """At 60 x 20 the numerals of 89 and 89 were 4 columns apart and the numbers 2: read as 8 98
    9."""
    scale = find_largest_scale((text, text), columns, 20)
    numerals = {1: 1, 2: 2, 3: 4}[scale]
    free = columns - len(draw_digits(text, scale)[0])
    assert scale == 1 or free >= 2 * numerals
    assert (
        scale == 3 or len(draw_digits(text, scale + 1)[0]) + 2 * {2: 2, 3: 4}[scale + 1] > columns
    ), "as large as it can be"
    assert ROWS_AT_SCALE[scale] <= 20
