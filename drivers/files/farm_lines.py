"""Which lines does a farm record contain, as `topdress record` writes it, and how much nitrogen did
a field get in a year?
"""

from __future__ import annotations

import csv
import datetime as dt
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from topdress.drivers.plain_text import OneLineError

# Columns of the farm record, a contract with its readers.
RECORD_COLUMNS = (
    "date",
    "begin_utc",
    "end_utc",
    "client",
    "farm",
    "field",
    "crop",
    "operator",
    "machine",
    "product",
    "worked_ha",
    "covered_ha",
    "applied_kg",
    "applied_kg_ha",
    "target_kg",
    "nitrogen_kg",
    "nitrogen_kg_ha",
    "worked_h",
    "price_per_kg",
    "cost",
    "currency",
    "simulated",
    "log",
)
# Beginning of the file, by which it is recognised.
RECORD_BEGIN = ",".join(RECORD_COLUMNS[:5]).encode()


class FarmRecordError(OneLineError):
    """Reports that a file is no farm record, or that a line lacks its nitrogen. The message names
    the line and the permitted values."""


class FieldYear(NamedTuple):
    """Holds the nitrogen from all passes of a year as a mean over the whole field."""

    n_kg_ha: float
    passes: int


def sum_year_nitrogen(
    path: Path,
    names: Mapping[str, str],
    begins: dt.date,
    area_ha: float,
    own_logs: Collection[str] = (),
) -> FieldYear:
    """Returns the nitrogen that a field got in a year.

    Simulated passes are not counted.

    Parameters
    ----------
    path : the farm record.
    names : client, farm and field of the job. A line belongs to the field unless both name another
    client or farm.
    begins : first day of the year; a line without a date is counted.
    area_ha : area of the field, ha.
    own_logs : names of logs that are not counted, because they belong to the job that is continued.

    Returns
    -------
    kg N/ha, and the number of passes.

    Raises
    ------
    FarmRecordError : the file is no farm record, or a line has no nitrogen.
    OSError : the file cannot be opened.
    """
    if not path.exists():
        raise FarmRecordError(
            f"{path}: is not there: allowed is a farm record (topdress record LOG --out "
            f"{path.name})"
        )
    kg, passes = 0.0, 0
    for number, cells in enumerate(read_record_rows(path), start=2):
        row = dict(zip(RECORD_COLUMNS, cells, strict=True))
        apart = any(
            (key == "field" or (row[key] and said)) and row[key].casefold() != said.casefold()
            for key, said in names.items()
        )
        early = bool(row["date"]) and row["date"] < begins.isoformat()
        if apart or early or row["simulated"] or row["log"] in own_logs:
            continue
        try:
            n_kg = float(row["nitrogen_kg"])
        except ValueError:
            n_kg = math.nan
        if not 0.0 <= n_kg < math.inf:
            raise FarmRecordError(
                f"{path}: line {number}: nitrogen_kg {row['nitrogen_kg']!r}: allowed is a number "
                "from 0"
            )
        kg, passes = kg + n_kg, passes + 1
    return FieldYear(kg / area_ha, passes)


def read_record_rows(path: Path) -> list[list[Any]]:
    """Returns the lines below the header with cells in the order of `RECORD_COLUMNS`; none for a
    missing file. Raises FarmRecordError, OSError."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.reader(file))
    if (
        not rows
        or tuple(rows[0]) != RECORD_COLUMNS
        or any(len(row) != len(RECORD_COLUMNS) for row in rows[1:])
    ):
        raise FarmRecordError(
            f"{path}: is no farm record of topdress: allowed is another name, or one that begins "
            f"{','.join(RECORD_COLUMNS[:4])},..."
        )
    return rows[1:]
