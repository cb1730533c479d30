"""Lowest, highest and mean over spans: the pyramid against the rows themselves, bounded for 8
hours, and of a log."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from topdress.console.app.pages.trends.channel_plots import round_axis_ends
from topdress.console.app.trend_channels import CHANNELS, RATE_ERROR_ID, find_value, list_values
from topdress.console.app.trend_series import (
    BUCKET_WIDTHS_S,
    BUCKETS_PER_LEVEL,
    LogSeries,
    SeriesPyramid,
    summarise_stretch,
)
from topdress.console.frame import Frame
from topdress.control.log_row import COLUMNS, NDRE_COLUMNS, TEXT_COLUMNS, LogRow

from tests.app.made_up.run import run_frames


def frame(time_s: float, ndvi: float | None) -> Frame:
    return Frame(seq=0, at_s=time_s, row=LogRow(time_s=time_s, ndvi=ndvi))


def test_every_number_of_a_log_row_can_be_plotted():
    assert {channel.id for channel in CHANNELS} - {RATE_ERROR_ID} == set(COLUMNS) - TEXT_COLUMNS - {
        "time_s",
        *NDRE_COLUMNS,
    }
    row = LogRow(
        1.0,
        ndvi=0.4,
        target_rate_kg_ha=300.0,
        applied_rate_kg_ha=330.0,
        state="working",
        satellites=9,
    )
    assert (find_value(row, "ndvi"), find_value(row, "satellites")) == (0.4, 9.0)
    assert find_value(row, RATE_ERROR_ID) == pytest.approx(10.0)
    assert isnan(find_value(row._replace(state="held"), RATE_ERROR_ID)) and isnan(
        find_value(row, "hopper_kg")
    )
    assert len(list_values(row)) == len(CHANNELS)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.one_of(st.none(), st.floats(-5, 5)), min_size=1, max_size=200),
    st.sampled_from([0.05, 0.2, 0.7]),
)
def test_sums_over_the_whole_run_are_those_of_its_rows(values, step_s):
    pyramid = SeriesPyramid()
    frames = [frame(k * step_s, value) for k, value in enumerate(values)]
    for one in frames:
        pyramid.add_frame(one)
    known = [value for value in values if value is not None]
    for series in (pyramid, LogSeries(frames)):
        for buckets in (1, 7, 400):
            found = summarise_stretch(
                series.find_stretch("ndvi", 0.0, len(values) * step_s, buckets)
            )
            if not known:
                assert isnan(found.mean)
            else:
                assert (found.low, found.high) == pytest.approx((min(known), max(known)))
                assert found.mean == pytest.approx(sum(known) / len(known), abs=1e-9)


def test_a_spike_of_one_row_is_seen_in_eight_hours():
    pyramid = SeriesPyramid()
    for k in range(4 * 3600):
        pyramid.add_frame(frame(2.0 * k, 99.0 if k == 2161 else 0.5))
    whole = pyramid.find_stretch("ndvi", 0.0, 8 * 3600.0, 200)
    assert len(whole.time_s) >= 200
    assert summarise_stretch(whole).high == 99.0
    at = whole.time_s[whole.high == 99.0]
    assert len(at) == 1 and at[0] <= 4322.0 < at[0] + 64
    assert whole.counts.sum() == 4 * 3600


def test_eight_hours_and_more_are_held_in_the_same_memory():
    pyramid = SeriesPyramid()
    before = pyramid.memory_bytes
    for k in range(12 * 1800):
        pyramid.add_frame(frame(2.0 * k, 0.5))
    assert pyramid.memory_bytes == before < 25e6
    assert pyramid.start_s == 0.0 and pyramid.end_s == pytest.approx(12 * 3600 - 2.0)
    for span_s, least in (
        (10.0, 10),
        (400.0, 300),
        (2_000.0, 300),
        (8_000.0, 300),
        (12 * 3600.0, 300),
    ):
        seen = pyramid.find_stretch("ndvi", pyramid.end_s - span_s, pyramid.end_s, 300)
        assert len(seen.time_s) >= min(least, span_s / 2.0 - 1)
        assert (
            seen.time_s[0] <= pyramid.end_s - span_s + 64.0
            and seen.time_s[-1] > pyramid.end_s - 64.0
        )
        assert len(seen.time_s) <= 2 * BUCKETS_PER_LEVEL


def test_a_short_span_shows_single_rows_and_a_long_one_wide_buckets():
    pyramid = SeriesPyramid()
    for k in range(8_000):
        pyramid.add_frame(frame(0.2 * k, 0.001 * (k % 10)))
    short = pyramid.find_stretch("ndvi", 1590.0, 1600.0, 100)
    assert np.array_equal(short.low, short.high) and len(short.time_s) == pytest.approx(50, abs=2)
    long = pyramid.find_stretch("ndvi", 0.0, 1600.0, 100)
    assert (
        np.diff(long.time_s).max() == pytest.approx(BUCKET_WIDTHS_S[3])
        and (long.high > long.low).all()
    )


def test_where_the_fine_buckets_were_dropped_coarser_ones_answer():
    pyramid = SeriesPyramid(widths_s=(0.2, 4.0), kept=50)
    for k in range(2_000):
        pyramid.add_frame(frame(0.2 * k, 0.5))
    early = pyramid.find_stretch("ndvi", 250.0, 260.0, 100)
    assert len(early.time_s) and np.diff(early.time_s) == pytest.approx(4.0)


def test_gaps_are_left_out():
    pyramid = SeriesPyramid()
    for k in [*range(10), *range(100, 110)]:
        pyramid.add_frame(frame(float(k), 0.5))
    assert pyramid.find_stretch("ndvi", 0.0, 120.0, 400).time_s.tolist() == [
        *range(10),
        *range(100, 110),
    ]


def test_a_log_is_read_at_its_own_rows():
    frames = run_frames(seconds=20.0)
    seen = LogSeries(frames).find_stretch("target_rate_kg_ha", 5.0, 6.0, 200)
    assert seen.time_s == pytest.approx([5.0, 5.2, 5.4, 5.6, 5.8, 6.0])
    assert seen.mean.tolist() == [one.row.target_rate_kg_ha for one in frames[25:31]]
    assert len(LogSeries(frames).find_stretch("ndvi", 500.0, 600.0, 10).time_s) == 0


def test_nothing_is_known_before_the_first_row():
    pyramid = SeriesPyramid()
    assert pyramid.start_s is pyramid.end_s is None
    assert len(pyramid.find_stretch("ndvi", 0.0, 10.0, 10).time_s) == 0
    assert isnan(summarise_stretch(pyramid.find_stretch("ndvi", 0.0, 10.0, 10)).low)


def test_time_that_runs_back_begins_anew():
    from topdress.console.app.frame_history import LiveHistory

    history = LiveHistory()
    for one in run_frames(seconds=10.0):
        history.add_frame(one)
    history.add_frame(replace(run_frames(seconds=1.0)[0]))
    assert history.series.start_s == history.series.end_s == 0.0


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e5, 1e5), st.floats(0, 1e5), st.integers(0, 3))
def test_axes_are_round_and_hold_the_values(low, span, decimals):
    begin, end = round_axis_ends(low, low + span, decimals)
    slack = 1e-6 * max(1.0, span, abs(low))
    assert begin <= low + slack and end >= low + span - slack
    assert end > begin and end - begin <= max(3.0 * span, 30.0 * 10.0**-decimals)


def test_axes_of_examples():
    assert round_axis_ends(268.0, 391.0, 0) == (250.0, 400.0)
    assert round_axis_ends(6.74, 6.95, 2) == pytest.approx((6.7, 7.0))
    assert round_axis_ends(0.5, 0.5, 3) == pytest.approx((0.498, 0.502))
    assert round_axis_ends(nan, nan, 0) == (0.0, 1.0)


def test_every_number_of_the_log_has_a_labelled_channel():
    """A new column of the log is plotted, and the console starts, before anybody labels it."""
    unlabelled = {channel.id for channel in CHANNELS if channel.label == channel.id}
    assert unlabelled <= {"satellites"}, "a label in console/app/trend_channels.py"
    numbers = set(COLUMNS) - TEXT_COLUMNS - {"time_s", *NDRE_COLUMNS}
    assert numbers <= {channel.id for channel in CHANNELS}
