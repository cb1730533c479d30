"""Alarms on the console: when the bell rings, and what the list of the run's alarms says.

Delay and hysteresis of the alarms themselves are safety's (`control.safety.limits`): here is
only what is heard.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from topdress.console.app import words
from topdress.console.app.units import Units
from topdress.console.app.view import format_local_time
from topdress.console.locale import _
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.orders import Alarm, Severity

LEAST_GAP_S = 5.0  # between two bells
# a terminal has one bell: how often it strikes tells which
STROKES = {Severity.AMBER: 1, Severity.RED: 3}
# while a red alarm stands that nobody has acknowledged
REPEAT_AFTER_S = 30.0
# an alarm that was away for less is not new to the ear
SAME_ALARM_S = 10.0


class AlarmBell:
    """Decides when the terminal's bell rings: for each new alarm, and again while a red one is not
    acknowledged."""

    def __init__(self) -> None:
        self._gone_s: dict[str, float | None] = {}  # id -> when it went; None: it stands
        self._rang_s = float("-inf")
        self._owed = 0  # strokes

    def count_strokes_due(self, now_s: float, alarms: Iterable[Alarm]) -> int:
        """Take the alarms that stand, a few times a second; how often the bell has to strike now,
        for the worst new one; 0: not at all."""
        standing = {alarm.id: alarm for alarm in alarms}
        for name, alarm in standing.items():
            gone_s = self._gone_s.get(name, float("-inf"))
            if gone_s is not None and now_s - gone_s >= SAME_ALARM_S:
                self._owed = max(self._owed, STROKES[alarm.severity])
            self._gone_s[name] = None
        for name, gone_s in self._gone_s.items():
            if gone_s is None and name not in standing:
                self._gone_s[name] = now_s
        urgent = any(
            alarm.severity is Severity.RED and not alarm.acknowledged for alarm in standing.values()
        )
        waited_s = now_s - self._rang_s
        if urgent and waited_s >= REPEAT_AFTER_S:
            self._owed = STROKES[Severity.RED]
        if not standing:
            self._owed = 0
        if not self._owed or waited_s < LEAST_GAP_S:
            return 0
        strokes, self._owed, self._rang_s = self._owed, 0, now_s
        return strokes


class AlarmEntry(NamedTuple):
    """Holds one alarm of the list, in words."""

    severity: Severity
    symbol: str
    word: str
    text: str
    place: str
    todo: str
    stands: bool
    when: str  # first, last, how often, acknowledged
    gone: bool = False  # stands, though its cause is away


def make_alarm_entries(
    records: Iterable[AlarmRecord], units: Units, utc_offset_s: float
) -> tuple[AlarmEntry, ...]:
    """The list's lines, in the language in use; standing ones first."""
    return tuple(_make_alarm_entry(record, units, utc_offset_s) for record in records)


def _make_alarm_entry(record: AlarmRecord, units: Units, utc_offset_s: float) -> AlarmEntry:
    said = words.describe_alarm(
        Alarm(record.id, record.severity, record.first_s, record.acknowledged, record.details),
        units,
    )

    def format_clock(utc: str, time_s: float) -> str:
        return format_local_time(utc, utc_offset_s) or f"{time_s:.0f} s"

    when = [
        _("first {time}").format(time=format_clock(record.first_utc, record.first_s)),
        _("last {time}").format(time=format_clock(record.last_utc, record.last_s)),
        _("{count} times").format(count=record.times) if record.times != 1 else _("once"),
    ]
    gone = record.stands and bool(record.gone_utc)
    if gone:
        when.append(
            _("cause gone at {time}").format(time=format_clock(record.gone_utc, record.last_s))
        )
    if record.acknowledged_utc or record.acknowledged:
        when.append(
            _("acknowledged {time}").format(
                time=format_local_time(record.acknowledged_utc, utc_offset_s) or ""
            )
        )
    elif record.severity is Severity.RED:
        when.append(_("not acknowledged"))
    return AlarmEntry(
        record.severity,
        words.SEVERITY_SYMBOLS[record.severity],
        _(words.SEVERITY_NAMES[record.severity]),
        said.text,
        said.place,
        said.todo,
        record.stands,
        "  ".join(when).rstrip(),
        gone,
    )
