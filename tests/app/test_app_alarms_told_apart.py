"""Latched, gone, acknowledged: told apart wherever an alarm is shown; a fault written out;
sizes for a seat's eyes."""

from __future__ import annotations

import json
from dataclasses import replace
from math import dist

import pytest
from topdress.console.app import themes
from topdress.console.app.alarms import make_alarm_entries
from topdress.console.app.panel_views import make_alarms_view
from topdress.console.app.units import METRIC
from topdress.console.app.widgets.alarm_bar import AlarmBar
from topdress.console.frame import format_frame_json, parse_frame
from topdress.console.worker.resume_alarms import AlarmHistory
from topdress.control.orders import Severity

from tests.app.harness import lab, later, linear, text_of, turned
from tests.app.made_up.run import sample_alarms


def frame_with(frame, *, acknowledged=False, gone=False, state="working", why=""):
    red, amber = sample_alarms(frame.at_s)
    red = red._replace(acknowledged=acknowledged, gone_s=frame.at_s - 10.0 if gone else None)
    return replace(
        frame,
        seq=frame.seq + 1,
        alarms=(red, amber),
        row=frame.row._replace(state=state),
        why_state=why,
    )


def first_rows(frame):
    bar = AlarmBar(make_alarms_view(frame, 0.0, METRIC))
    rows = bar.draw_rows(bar.view, 120, 3)
    return rows[0].plain, rows[1].plain, [str(span.style) for span in rows[0].spans]


def test_the_four_kinds_of_a_red_alarm_all_differ(frames):
    seen = {}
    for acknowledged in (False, True):
        for gone in (False, True):
            head, todo, styles = first_rows(
                frame_with(frames[-1], acknowledged=acknowledged, gone=gone)
            )
            assert ("cause gone at" in head) == gone
            assert ("A: acknowledge" in todo) is not acknowledged and (
                " acknowledged " in todo
            ) is acknowledged
            seen[acknowledged, gone] = styles
    assert "$alarm-red" in seen[False, False][1], "nobody has looked: the whole row"
    assert "$alarm-red" in seen[True, False][0] and "$alarm-red" not in seen[True, False][1], (
        "its cause still stands"
    )
    assert not any("$alarm-red" in style for gone in (True,) for style in seen[False, gone])


def test_a_frame_carries_when_the_cause_went(frames):
    frame = frame_with(frames[-1], gone=True)
    again = parse_frame(json.loads(format_frame_json(frame)))
    assert again.alarms == frame.alarms and again.alarms[0].gone_s is not None


def test_the_book_and_the_list_keep_it_and_forget_it(frames):
    book = AlarmHistory()
    red = sample_alarms(0.0)[0]
    book.add_row_alarms(1.0, "2026-03-18T06:00:01Z", [red])
    assert not make_alarm_entries(book.records, METRIC, 0.0)[0].gone
    book.add_row_alarms(2.0, "2026-03-18T06:00:02Z", [red._replace(gone_s=1.5)])
    book.add_row_alarms(3.0, "2026-03-18T06:00:03Z", [red._replace(gone_s=1.5)])
    entry = make_alarm_entries(book.records, METRIC, 0.0)[0]
    assert (
        entry.gone and "cause gone at 06:00:02" in entry.when and "not acknowledged" in entry.when
    )
    book.add_row_alarms(4.0, "2026-03-18T06:00:04Z", [red])
    assert not make_alarm_entries(book.records, METRIC, 0.0)[0].gone, "it came back"


@pytest.mark.parametrize("size", [(160, 50), (120, 40), (100, 30), (80, 24), (60, 20)])
async def test_a_fault_takes_half_the_screen_with_its_remedy(app, source, shown, size):
    source.current_frame = frame_with(source.current_frame, state="fault", why="shaft_silent")
    async with app.run_test(size=size) as pilot:
        await later(app, pilot)
        bar = app.page.query_one("#alarms", AlarmBar)
        assert abs(bar.size.height - size[1] / 2) <= 1
        text = " ".join(" ".join(shown(app)).split())
        for wanted in (
            "FAULT",
            "The metering shaft does not answer.",
            "Stop. Check power and cable",
            "A: acknowledge the alarm.",
            "R: make the machine ready",
            "The cause is still there.",
        ):
            assert wanted in text, wanted
        assert "STOP" in shown(app)[-1]


async def test_a_fault_leaves_the_device_that_is_at_fault_in_sight(app, source, shown, turned):
    """Twelve rows of the alarm at 80 x 24 left none for what the board says."""
    source.current_frame = frame_with(source.current_frame, state="fault", why="shaft_silent")
    async with app.run_test(size=(80, 24)) as pilot:
        await turned(app, pilot, "devices")
        rows = shown(app)
        assert any("The metering shaft does not answer." in row for row in rows)
        await pilot.press("down", "down")
        rows = shown(app)
        for said in ("sim://board", "port ", "raw file", "last lines"):
            assert any(said in row for row in rows), (said, "\n".join(rows))


@pytest.mark.parametrize("theme", themes.THEMES, ids=lambda theme: theme.name)
def test_no_two_of_work_caution_choice_stop_and_alarm_look_the_same(theme):
    v = theme.variables
    looks = {
        name: lab(linear(v[name]))
        for name in ("state-working", "alarm-amber", "select", "stop", "alarm-red")
    }
    near = {
        (a, b): round(dist(looks[a], looks[b]))
        for a in looks
        for b in looks
        if a < b and dist(looks[a], looks[b]) < 25.0
    }
    assert near == {}


@pytest.mark.parametrize(
    ("size", "rows"), [((160, 50), 10), ((120, 40), 5), ((80, 24), 5), ((60, 20), 5), ((40, 10), 3)]
)
async def test_the_rates_are_drawn_as_large_as_there_is_room(app, shown, size, rows, pilot):
    await later(app, pilot)
    heads = [row[:12].strip() for row in shown(app)[3 : max(8, size[1] * 2 // 3)]]
    drawn = [head for head in heads if head and set(head) <= set("█▀▄ ")]
    assert len(drawn) >= rows


@pytest.mark.parametrize("size", [(120, 40), (100, 30), (80, 24)])
async def test_the_map_page_tells_both_rates_in_numerals(app, size, pilot):
    await turned(app, pilot, "map")
    text = text_of(app)
    assert text.count("target kg/ha") == text.count("applied kg/ha") == 1


def test_an_amber_alarm_waits_for_nobody(frames):
    amber = sample_alarms(0.0)[1]
    assert amber.severity is Severity.AMBER
    bar = AlarmBar(make_alarms_view(replace(frames[-1], alarms=(amber,)), 0.0, METRIC))
    assert "acknowledge" not in bar.draw_rows(bar.view, 120, 3)[1].plain
