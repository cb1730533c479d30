"""Records every alarm of a run: first and last time, number of occurrences, acknowledgement.
Pure.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from topdress.control.orders import Alarm, Severity


class AlarmRecord(NamedTuple):
    """Holds one kind of alarm over a run. Times are the rows' UTC, ISO 8601; "" where unknown or
    not yet reached."""

    id: str
    severity: Severity
    # Run time of its first occurrence, s.
    first_s: float
    # Run time at which it was last present, s.
    last_s: float
    # Number of occurrences.
    times: int
    first_utc: str = ""
    last_utc: str = ""
    # UTC of the last acknowledgement.
    acknowledged_utc: str = ""
    # True if a red alarm was acknowledged since its last occurrence.
    acknowledged: bool = False
    stands: bool = False
    details: tuple[tuple[str, str | float], ...] = ()
    # UTC at which the cause ended, while the alarm itself is still present.
    gone_utc: str = ""


class AlarmHistory:
    """Records alarms row by row; an alarm that ended and returns counts once more."""

    def __init__(self, before: Iterable[AlarmRecord] = ()) -> None:
        self._records = {record.id: record._replace(stands=False) for record in before}
        # Number of changes, by which users of the history detect news.
        self.changes = 0

    @property
    def records(self) -> tuple[AlarmRecord, ...]:
        """Records: present alarms before ended ones, red before amber, newest first."""
        return tuple(
            sorted(
                self._records.values(),
                key=lambda record: (
                    not record.stands,
                    record.severity is not Severity.RED,
                    -record.last_s,
                ),
            )
        )

    def add_row_alarms(
        self, time_s: float, utc: str | None, alarms: Iterable[Alarm]
    ) -> tuple[AlarmRecord, ...]:
        """Take the alarms that are present at a time of the run, and return the records of those
        that are new.

        Parameters
        ----------
        time_s
            Run time, s.
        utc
            UTC of the row, or None.
        alarms
            Present alarms.
        """
        now, came = utc or "", []
        standing = {alarm.id: alarm for alarm in alarms}
        for record in self._records.values():
            if record.stands and record.id not in standing:
                self._records[record.id] = record._replace(stands=False)
                self.changes += 1
        for alarm in standing.values():
            before = self._records.get(alarm.id)
            if before is None or not before.stands:
                record = _update_record(before, alarm, time_s, now)
                came.append(record)
                self.changes += 1
            else:
                gone_utc = "" if alarm.gone_s is None else before.gone_utc or now
                record = before._replace(
                    last_s=time_s, last_utc=now, details=alarm.details, gone_utc=gone_utc
                )
            if alarm.acknowledged and not record.acknowledged:
                record = record._replace(acknowledged=True, acknowledged_utc=now)
                self.changes += 1
            self._records[alarm.id] = record
        return tuple(came)

    def add_earlier_records(self, records: Iterable[AlarmRecord]) -> None:
        """Add records from before the start of this history, which became known later."""
        for earlier in records:
            known = self._records.get(earlier.id)
            if known is None:
                self._records[earlier.id] = earlier._replace(stands=False)
            # The present record may already include the earlier occurrences.
            elif earlier.first_utc <= known.first_utc:
                self._records[earlier.id] = known._replace(
                    first_s=earlier.first_s,
                    first_utc=earlier.first_utc,
                    times=max(known.times, earlier.times),
                    acknowledged_utc=known.acknowledged_utc or earlier.acknowledged_utc,
                )
        self.changes += 1


def _update_record(
    before: AlarmRecord | None, alarm: Alarm, time_s: float, now: str
) -> AlarmRecord:
    """Return the record of an alarm that has just occurred."""
    if before is None:
        return AlarmRecord(
            alarm.id,
            alarm.severity,
            time_s,
            time_s,
            1,
            now,
            now,
            stands=True,
            details=alarm.details,
        )
    return before._replace(
        last_s=time_s,
        last_utc=now,
        times=before.times + 1,
        acknowledged=False,
        stands=True,
        details=alarm.details,
        gone_utc="",
    )
