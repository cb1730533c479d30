"""Every alarm of a run: when it first and last stood, how often it came, when it was
acknowledged. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from topdress.control.orders import Alarm, Severity


class AlarmRecord(NamedTuple):
    """One kind of alarm over a run. Moments are UTC as the rows tell it, ISO 8601; empty: not
    known, or not yet."""

    id: str
    severity: Severity
    first_s: float  # run time
    last_s: float  # it stood then the last time
    times: int  # it came
    first_utc: str = ""
    last_utc: str = ""
    acknowledged_utc: str = ""  # the last time that somebody did
    acknowledged: bool = False  # red ones: since it came last
    stands: bool = False
    details: tuple[tuple[str, str | float], ...] = ()
    # its cause is away since about then, while the alarm stands still
    gone_utc: str = ""


class AlarmHistory:
    """Records alarms row by row; an alarm that ended and comes again counts once more."""

    def __init__(self, before: Iterable[AlarmRecord] = ()) -> None:
        self._records = {record.id: record._replace(stands=False) for record in before}
        # counts what is new: for whoever shows or keeps it
        self.changes = 0

    @property
    def records(self) -> tuple[AlarmRecord, ...]:
        """Standing alarms before those gone, red before amber, the newest before older ones."""
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
        """Take the alarms that stand at this moment of the run; returns the records of those that
        came just now."""
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
        """Add records of the time before this history was started, learned later."""
        for earlier in records:
            known = self._records.get(earlier.id)
            if known is None:
                self._records[earlier.id] = earlier._replace(stands=False)
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
