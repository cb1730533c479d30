"""Decides when the terminal's bell rings and words the list of the run's alarms.

`control.safety.limits` has delay and hysteresis of the alarms themselves; this module handles their
sound only.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from topdress.console.app import frame_words
from topdress.console.app.panel_views import format_local_time
from topdress.console.app.units import Units
from topdress.console.locale import _
from topdress.console.worker.resume_alarms import AlarmRecord
from topdress.control.orders import Alarm, Severity

# Shortest time between two bell signals, s: closer signals blend into one, and their strokes cannot
# be counted.
MIN_BELL_GAP_S = 5.0
# A terminal has one sound for its bell, so the number of strokes carries the severity.
STROKES_BY_SEVERITY = {Severity.AMBER: 1, Severity.RED: 3}
# A red alarm that nobody acknowledges rings again after this time, s.
RED_REPEAT_S = 30.0
# An alarm that returns within this time, s, does not ring again: a value near its limit would ring
# at every crossing.
RECURRENCE_SILENCE_S = 10.0


class AlarmBell:
    """Decides when the terminal's bell rings: for each new alarm, and again while a red one is not
    acknowledged."""

    def __init__(self) -> None:
        # Maps an alarm's id to the time at which it ended, s. None means that the alarm stands.
        self._gone_s: dict[str, float | None] = {}
        # Minus infinity lets the first alarm ring at once.
        self._rang_s = float("-inf")
        # Strokes that are due as soon as `MIN_BELL_GAP_S` has passed.
        self._owed = 0

    def count_strokes_due(self, now_s: float, alarms: Iterable[Alarm]) -> int:
        """Return how many times the bell must strike now; 0 means silence.

        Parameters
        ----------
        now_s
            Time on a monotonic clock, s. Call this function a few times a second.
        alarms
            Alarms that stand now; the worst new alarm decides.
        """
        standing = {alarm.id: alarm for alarm in alarms}
        for name, alarm in standing.items():
            gone_s = self._gone_s.get(name, float("-inf"))
            if gone_s is not None and now_s - gone_s >= RECURRENCE_SILENCE_S:
                self._owed = max(self._owed, STROKES_BY_SEVERITY[alarm.severity])
            self._gone_s[name] = None
        for name, gone_s in self._gone_s.items():
            if gone_s is None and name not in standing:
                self._gone_s[name] = now_s
        urgent = any(
            alarm.severity is Severity.RED and not alarm.acknowledged for alarm in standing.values()
        )
        waited_s = now_s - self._rang_s
        if urgent and waited_s >= RED_REPEAT_S:
            self._owed = STROKES_BY_SEVERITY[Severity.RED]
        # Strokes that were due for an alarm that has ended would announce nothing.
        if not standing:
            self._owed = 0
        if not self._owed or waited_s < MIN_BELL_GAP_S:
            return 0
        strokes, self._owed, self._rang_s = self._owed, 0, now_s
        return strokes


class AlarmEntry(NamedTuple):
    """Holds one alarm of the list in words."""

    severity: Severity
    symbol: str
    word: str
    text: str
    place: str
    todo: str
    stands: bool
    # Times of the first and last occurrence, number of occurrences, acknowledgement.
    when: str
    # True for an alarm that stands although its cause has ended: it waits for acknowledgement.
    gone: bool = False


def make_alarm_entries(
    records: Iterable[AlarmRecord], units: Units, utc_offset_s: float
) -> tuple[AlarmEntry, ...]:
    """Word the run's alarms in the language in use; standing alarms come first.

    Parameters
    ----------
    records
        History of the run's alarms.
    units
        Units of the numbers in the texts.
    utc_offset_s
        Local time minus UTC, s.
    """
    return tuple(_make_alarm_entry(record, units, utc_offset_s) for record in records)


def _make_alarm_entry(record: AlarmRecord, units: Units, utc_offset_s: float) -> AlarmEntry:
    said = frame_words.describe_alarm(
        Alarm(record.id, record.severity, record.first_s, record.acknowledged, record.details),
        units,
    )

    def format_clock(utc: str, time_s: float) -> str:
        # A machine without a receiver has no UTC; the time since the start of the log replaces the
        # clock.
        return format_local_time(utc, utc_offset_s) or f"{time_s:.0f} s"

    when = [
        _("first {time}").format(time=format_clock(record.first_utc, record.first_s)),
        _("last {time}").format(time=format_clock(record.last_utc, record.last_s)),
        _("{count} times").format(count=record.times) if record.times != 1 else _("once"),
    ]
    # A record stores the end of the cause only while the alarm itself stands.
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
        frame_words.SEVERITY_SYMBOLS[record.severity],
        _(frame_words.SEVERITY_NAMES[record.severity]),
        said.text,
        said.place,
        said.todo,
        record.stands,
        "  ".join(when).rstrip(),
        gone,
    )
