"""The book of a run's alarms."""
from __future__ import annotations

import json

from console.worker.resume_alarms import AlarmBook, AlarmRecord
from control.orders import Alarm, Severity
from drivers.files.plain import plain, typed

RED = Alarm("shaft_silent", Severity.RED, 1.0)
AMBER = Alarm("hopper_low", Severity.AMBER, 2.0, False, (("hopper_kg", 18.0), ("metres_left", 640.0)))


def test_first_last_times_and_acknowledged():
    book = AlarmBook()
    assert [one.id for one in book.see(1.0, "t1", (RED,))] == ["shaft_silent"]
    assert book.see(2.0, "t2", (RED, AMBER))[0].id == "hopper_low"
    assert book.see(3.0, "t3", (RED._replace(acknowledged=True), AMBER)) == ()
    book.see(4.0, "t4", (AMBER,))
    assert [one.id for one in book.see(9.0, "t9", (RED, AMBER))] == ["shaft_silent"], "it came again"
    red, amber = book.records
    assert (red.id, red.first_utc, red.last_utc, red.times, red.stands) == ("shaft_silent", "t1", "t9", 2, True)
    assert red.acknowledged_utc == "t3" and not red.acknowledged, "what came anew is not acknowledged"
    assert (amber.first_s, amber.last_s, amber.times) == (2.0, 9.0, 1)


def test_standing_before_gone_and_red_before_amber():
    book = AlarmBook()
    book.see(1.0, None, (AMBER,))
    book.see(2.0, None, (RED,))
    assert [(one.id, one.stands) for one in book.records] == [("shaft_silent", True), ("hopper_low", False)]
    book.see(3.0, None, (AMBER,))
    assert [one.id for one in book.records] == ["hopper_low", "shaft_silent"]


def test_records_survive_a_file_and_the_time_before_is_added():
    first = AlarmBook()
    first.see(1.0, "2026-03-18T06:00:00Z", (RED, AMBER))
    kept = tuple(typed(AlarmRecord, one) for one in json.loads(json.dumps(plain(first.records))))
    assert kept == first.records
    later = AlarmBook()
    later.see(0.5, "2026-03-18T07:00:00Z", (RED,))
    later.add_before(kept)
    red, amber = later.records
    assert red.stands and red.first_utc == "2026-03-18T06:00:00Z" and red.last_utc == "2026-03-18T07:00:00Z"
    assert amber.id == "hopper_low" and not amber.stands
    assert AlarmBook(kept).see(5.0, "t", (RED,))[0].times == 2
