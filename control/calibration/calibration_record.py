"""What does a calibrated machine file record about its calibration?"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from topdress.control.machine.machine import Adopted, Machine

from .least_squares import FittedInterval


def make_record(
    id_: str,
    size: FittedInterval,
    unit: str,
    data: str,
    date: str,
    valid: Mapping[str, tuple[float, float]],
    member: int | None = None,
) -> Adopted:
    """Returns the record of a calibrated parameter: its data (`data`: path of the table or log)
    and its range of validity."""
    return Adopted(
        id=id_,
        size=size.value,
        low=size.low,
        high=size.high,
        unit=unit,
        data=data,
        date=date,
        valid=dict(valid),
        member=member,
    )


def merge_records(
    machine: Machine, records: tuple[Adopted, ...], replaced: Collection[str]
) -> tuple[Adopted, ...]:
    """Returns the earlier records without those that a new one replaces, then the new ones."""
    gone = {*replaced, *(r.id for r in records)}
    return (*(r for r in machine.adopted if r.id not in gone), *records)


def make_title(machine: Machine, what: str, data: str, date: str) -> str:
    """Returns the machine's title with its calibration."""
    source = data.replace("\\", "/").rsplit("/", 1)[-1] or "a bench table"
    note = f"{what} from {source}" + (f", {date}" if date else "")
    return f"{machine.title}; {note}" if machine.title else note
