"""Events on their way into rows: bounded, in their order, none lost without a word."""
from __future__ import annotations

from control.loop.events import EVENT_CHARACTERS, MOST_WAITING, ROW_CHARACTERS, Events


def test_what_one_row_cannot_hold_waits_for_the_next():
    events = Events()
    given = [f"mark {k} " + "x" * 900 for k in range(232)]
    events.add(*given)
    rows = []
    while found := events.of_one_row():
        rows.append(found)
    assert [event for row in rows for event in row] == given
    assert max(len(";".join(row)) for row in rows) <= ROW_CHARACTERS
    assert len(rows) == 232


def test_one_event_is_no_longer_than_a_mark():
    events = Events()
    events.add("mark " + "x" * 50_000)
    (found,) = events.of_one_row()
    assert len(found) == EVENT_CHARACTERS and found.endswith("...")


def test_of_more_than_can_wait_the_number_is_kept():
    events = Events()
    events.add(*(["nudge 5"] * (MOST_WAITING + 17)))
    assert events.full
    found = []
    while row := events.of_one_row():
        found += row
    assert found == ["nudge 5"] * MOST_WAITING + ["events_left_out 17"]
    assert not events.full and events.of_one_row() == []
