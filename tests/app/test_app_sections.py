"""Sections on the Run page and the map: the row, closing one by hand, strips of their own;
nothing without valves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from topdress.console.app.app import TopdressApp
from topdress.console.app.coverage_raster import (
    CELL_KIND_COUNT,
    OutletSpot,
    WorkedGround,
    make_spot,
)
from topdress.console.app.frame_words import SECTION_NAMES
from topdress.console.app.pages.run.keys import list_allow_choices
from topdress.console.app.pages.run.section_bar import list_section_choices, list_section_parts
from topdress.console.frame import Frame, format_frame_json, parse_frame
from topdress.console.locale import use_language
from topdress.control.log_row import LogRow
from topdress.control.orders import SECTION_CLOSED_REASONS, Do, Order, SectionState

from tests.app.gallery import StillSource

OPEN = SectionState(True)
STATES = (OPEN, OPEN, SectionState(False, "outside"), SectionState(False, "hand"))


def text_of(parts):
    return "".join(text for text, _style in parts)


def test_neighbours_that_are_alike_stand_together():
    assert text_of(list_section_parts(STATES)) == " sections   1-2 open   3 outside   4 BY HAND"
    assert set(SECTION_NAMES) == set(SECTION_CLOSED_REASONS)
    use_language("zh")
    assert text_of(list_section_parts(STATES)) == " 分段   1-2 打开   3 田外   4 手动关闭"


def test_sections_come_through_the_wire():
    frame = Frame(3, 1.5, LogRow(1.5, sections_cmd="1;1;0;0"), sections=STATES)
    import json

    assert parse_frame(json.loads(format_frame_json(frame))) == frame
    assert parse_frame(json.loads(format_frame_json(Frame(3, 1.5, LogRow(1.5))))).sections == ()


@pytest.mark.parametrize("size", [(80, 24), (100, 30), (120, 40)])
async def test_the_row_stands_on_the_run_page_of_a_machine_with_valves_alone(
    clock, frames, shown, size
):
    for sections in (STATES, ()):
        app = TopdressApp(
            StillSource(replace(frames[-1], sections=sections)), clock, live=False, utc_offset_s=0.0
        )
        async with app.run_test(size=size):
            rows = [row for row in shown(app) if "3 outside" in row]
            assert len(rows) == (1 if sections else 0)
            assert any("kg/ha" in row for row in shown(app))


async def test_a_section_is_closed_by_hand_and_taken_back(clock, frames):
    source = StillSource(replace(frames[-1], sections=STATES))
    app = TopdressApp(source, clock, live=False, utc_offset_s=0.0)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.click("#section-bar")
        # the last that may be allowed
        await pilot.press(str(len(list_allow_choices(source.current_frame))), "enter")
        await pilot.press("2", "enter")
        assert source.orders[-1] == Order(Do.SECTION, "2 off")


def test_only_machines_with_valves_are_asked(frames):
    assert "sections" not in [one.value for one in list_allow_choices(frames[-1])]
    frame = replace(frames[-1], sections=STATES)
    assert list_allow_choices(frame)[-1].value == "sections"
    assert [one.value for one in list_section_choices(frame)] == [
        "1 off",
        "2 off",
        "3 off",
        "4 auto",
        "all auto",
    ]


def test_the_map_keeps_strips_of_what_was_open(frames):
    worked = WorkedGround(3.0)
    worked.sections = (1.0 / 3.0, 2.0 / 3.0, 1.0)
    worked.add_spots(
        [
            OutletSpot(1.5, north, 0.0, 300.0, 300.0, 0.5, 0b101)
            for north in np.arange(0.5, 9.6, 0.5).tolist()
        ]
    )
    planes = worked.sum_window(1.0, 0, 0, 3, 10)
    assert planes[CELL_KIND_COUNT, 2:8].astype(bool).tolist() == [[True, False, True]] * 6
    row = frames[-1].row._replace(sections_cmd="1;0;1")
    assert make_spot(replace(frames[-1], row=row)).open_bits == 5.0
    assert make_spot(frames[-1]).open_bits == -1.0
