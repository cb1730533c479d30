"""Canopy heads: layouts, ranges, partial first lines, six heads on one line."""
from __future__ import annotations

import pytest

from drivers.devices.canopy_heads import PROTOCOLS, HeadDecoder, HeadFields


def test_greenseeker_takes_ndvi_from_the_third_field_and_the_second_index_from_the_fourth():
    sample, = HeadDecoder(PROTOCOLS["greenseeker"], head=4).feed(b"12.500,7,0.612,0.745,1\r\n", 3.5)
    assert sample == (3.5, 4, 0.612, 0.745)


def test_crop_circle_430_and_435_take_ndvi_from_the_second_field():
    sample, = HeadDecoder(PROTOCOLS["acs430"]).feed(b"0.210,0.655,18.1,27.7,5.8\r\n", 0.0)
    assert (sample.ndvi, sample.index_2) == (0.655, 0.21)
    sample, = HeadDecoder(PROTOCOLS["acs435"]).feed(b"0.210,0.655,18.1,27.7,5.8,0,0,0\r\n", 0.0)
    assert (sample.ndvi, sample.index_2) == (0.655, 0.21)
    assert (PROTOCOLS["acs430"].baud, PROTOCOLS["acs435"].fields) == (38400, 8)


@pytest.mark.parametrize(("line", "kind"), [
    (b"12.5,7,0.612,0.745", "wrong_field_count"), (b"12.5,7,0.612,0.745,1,9", "wrong_field_count"),
    (b"12.5,7,,0.745,1", "not_a_number"), (b"12.5,7,nan,0.745,1", "not_a_number"),
    (b"12.5,7,0.6.2,0.745,1", "not_a_number"), (b"12.5,7,1e-1,0.745,1", "not_a_number"),
    (b"12.5,7,612,0.745,1", "out_of_range"), (b"12.5,7,-1.01,0.745,1", "out_of_range"),
    (b"12.5,7,0.5,745,1", "out_of_range"),
])
def test_wrong_lines_are_named(line, kind):
    decoder = HeadDecoder(PROTOCOLS["greenseeker"])
    assert decoder.feed(b"1,1,0.5,0.5,1\r\n" + line + b"\r\n", 0.0)[1:] == []
    assert dict(decoder.counts.rejected) == {kind: 1}


def test_the_line_under_way_when_the_port_opens_is_no_error():
    decoder = HeadDecoder(PROTOCOLS["greenseeker"])
    assert len(decoder.feed(b".612,0.745,1\r\n1,1,0.5,0.5,1\r\n", 0.0)) == 1
    assert not decoder.counts.rejected
    assert decoder.counts.ignored == {"partial_first": 1}


def test_a_whole_first_line_counts():
    assert len(HeadDecoder(PROTOCOLS["greenseeker"]).feed(b"1,1,0.5,0.5,1\r\n", 0.0)) == 1


def test_multiplexed_lines_keep_their_heads_apart():
    decoder = HeadDecoder(PROTOCOLS["greenseeker"], head=None, heads=6)
    samples = decoder.feed(b"H1,1,1,0.5,0.5,1\nH6,1,1,0.6,0.5,1\nH7,1,1,0.7,0.5,1\n1,1,0.8,0.5,1\nH2,1,1,0.9\n", 0.0)
    assert [(sample.head, sample.ndvi) for sample in samples] == [(1, 0.5), (6, 0.6)]
    assert decoder.counts.rejected == {"unknown_head": 2, "wrong_field_count": 1}


def test_own_layout():
    sample, = HeadDecoder(HeadFields(fields=3, ndvi=3)).feed(b"a,b,0.5\n", 0.0)
    assert (sample.ndvi, sample.index_2) == (0.5, None)


@pytest.mark.parametrize("layout", [HeadFields(5, 6), HeadFields(5, 0), HeadFields(5, 3, 6)])
def test_a_layout_that_points_outside_the_line_is_refused(layout):
    with pytest.raises(ValueError, match=r"field map: .* allowed is"):
        HeadDecoder(layout)
