"""Removes measurements that a second table repeats, and restores the unit in which they were
measured.

Papers print the same drives as distances, as times calculated from the distances with one speed, as
means, and as the first half of a comparison. Counted as new evidence, such repetitions would make
intervals too narrow, and the speed of the calculation would be named besides the driven speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from topdress.control.calibration.bench_table import (
    LAG_COLUMNS,
    SPEED_COLUMNS,
    BenchTable,
    select_rows,
)
from topdress.control.machine.machine import Machine
from topdress.control.recordings.speed_unit import KMH_PER_MPS

from .cross_calibration import (
    MIN_SHARED_SPEEDS,
    LagSeries,
    TableReconciliation,
    describe_pair,
    list_lag_series,
)
from .table_noise import find_quantum
from .table_rows import list_labels
from .table_series import BoolArray

# Maximum last digit as a share of a value: coarser values agree by chance.
MAX_LAST_DIGIT_OF_VALUE = 0.005
# Columns that contain a complete measured lag.
MEASURED_COLUMNS = ("lag_m", "lag_s", "miss_m")


class DuplicateRows(NamedTuple):
    """A series and its repetition. `speed_mps`: speed with which times were calculated from
    distances."""

    kept: LagSeries
    again: LagSeries
    speed_mps: float | None

    @property
    def silent(self) -> str:
        """Name of the series that needs no sentence of its own, because the other represents
        both."""
        return (
            self.kept.name
            if self.speed_mps is not None and self.kept.unit == "s"
            else self.again.name
        )


class DeduplicatedTables(NamedTuple):
    """Tables in which every measurement appears once, in the given order, and the removed
    repetitions."""

    tables: tuple[BenchTable, ...]
    retellings: tuple[DuplicateRows, ...]


def remove_duplicates(tables: Sequence[BenchTable], machine: Machine) -> DeduplicatedTables:
    """Return the tables without repeated measurements.

    The series with most rows is kept, or the first of equally long series. Times calculated from
    distances of the same table become distances again, at the recorded speed.
    """
    of_table = [
        [one for one in list_lag_series(table, machine) if one.column in MEASURED_COLUMNS]
        if table.kind in ("lag", "place")
        else []
        for table in tables
    ]
    found = _find_duplicate_series(of_table)
    out = []
    for table, own in zip(tables, of_table, strict=True):
        kept = table
        for series in own:
            again = next((one for one in found if one.again is series), None)
            worked_out = next(
                (
                    one
                    for one in found
                    if one.speed_mps is not None
                    and series.unit == "s"
                    and series in (one.kept, one.again)
                ),
                None,
            )
            rows = _find_rows_of(table, series)
            twice = rows & np.isin(
                table.columns["shaft_rpm"], [] if again is None else again.kept.shaft_rpm
            )
            if worked_out is not None and bool((rows & ~twice).any()):
                out.append(_restore_distances(table, rows & ~twice, worked_out))
                twice = rows
            kept = _blank_column_rows(kept, series.column, twice)
        out.append(_drop_empty_rows(kept))
    return DeduplicatedTables(tuple(table for table in out if table.rows), tuple(found))


def _find_duplicate_series(of_table: Sequence[Sequence[LagSeries]]) -> list[DuplicateRows]:
    """Return every series that repeats a series of another table, with the kept series."""
    every = sorted(
        ((k, one) for k, own in enumerate(of_table) for one in own), key=lambda pair: -pair[1].rows
    )
    found: list[DuplicateRows] = []
    for (k, one), (other_k, other) in combinations(every, 2):
        done = [pair.again for pair in found]
        if k != other_k and not any(one is again or other is again for again in done):
            pair = match_duplicate_series(one, other)
            found += [] if pair is None else [pair]
    return found


def match_duplicate_series(kept: LagSeries, again: LagSeries) -> DuplicateRows | None:
    """Return the match of two series that agree to their last digits: the same unit, or distances
    and times at one speed; None where they differ."""
    distances, times = (again, kept) if kept.unit == "s" else (kept, again)
    rpm, at_distances, at_times = np.intersect1d(
        distances.shaft_rpm, times.shaft_rpm, return_indices=True
    )
    if len(rpm) < MIN_SHARED_SPEEDS:
        return None
    a, b = distances.value[at_distances], times.value[at_times]
    digits = [find_quantum(series.printed) for series in (distances, times)]
    if (
        max(digits[0] / float(np.mean(np.abs(a))), digits[1] / float(np.mean(np.abs(b))))
        > MAX_LAST_DIGIT_OF_VALUE
    ):
        return None
    alike = kept.unit == again.unit
    ratio = 1.0 if alike else float(np.mean(a) / np.mean(b))
    if ratio <= 0.0 or float(np.max(np.abs(a - ratio * b))) > digits[0] + ratio * digits[1] + 1e-12:
        return None
    return DuplicateRows(kept, again, None if alike else ratio)


def _find_rows_of(table: BenchTable, series: LagSeries) -> BoolArray:
    return np.asarray(
        (list_labels(table) == series.label)
        & np.isfinite(table.columns[series.column])
        & ~table.find_running_rows()
    )


def _blank_column_rows(table: BenchTable, column: str, rows: BoolArray) -> BenchTable:
    """Return the table with one column's rows set to NaN."""
    values = np.where(rows, np.nan, table.columns[column])
    return replace(table, columns={**table.columns, column: values})


def _drop_empty_rows(table: BenchTable) -> BenchTable:
    """Return the table without rows that contain no measurement."""
    measured = [table.columns[name] for name in (*LAG_COLUMNS, "miss_m") if name in table.columns]
    if table.kind not in ("lag", "place") or not measured:
        return table
    return select_rows(table, np.any([np.isfinite(values) for values in measured], axis=0))


def _restore_distances(table: BenchTable, rows: BoolArray, pair: DuplicateRows) -> BenchTable:
    """Convert times that were calculated with one speed back to distances, besides the recorded
    speed."""
    times, distances = (pair.kept, pair.again) if pair.kept.unit == "s" else (pair.again, pair.kept)
    assert pair.speed_mps is not None
    some = select_rows(table, rows)
    columns = {
        name: values
        for name, values in some.columns.items()
        if name not in (*LAG_COLUMNS, *SPEED_COLUMNS)
    }
    written = pair.speed_mps if distances.mps is None else distances.mps
    return replace(
        some,
        columns={
            **columns,
            "lag_m": some.columns[times.column] * pair.speed_mps,
            "speed_mps": np.full(some.rows, written),
        },
        findings=(),
    )


def describe_duplicates(
    pairs: Sequence[TableReconciliation], retellings: Sequence[DuplicateRows]
) -> tuple[str, ...]:
    """Return sentences on the relations between tables, each once, and on the removed
    repetitions."""
    sure = {frozenset((one.kept.name, one.again.name)) for one in retellings}
    silent = {one.silent for one in retellings}
    return (
        *(
            describe_pair(pair)
            for pair in pairs
            if frozenset((pair.first.name, pair.second.name)) in sure
            or not silent & {pair.first.name, pair.second.name}
        ),
        *(_describe_duplicate(one) for one in retellings),
    )


def _describe_duplicate(pair: DuplicateRows) -> str:
    said = f"{pair.again.name} tells {pair.kept.name} once more, to the last digit"
    if pair.speed_mps is not None:
        said += (
            ": the times were worked out of the distances with "
            f"{KMH_PER_MPS * pair.speed_mps:.2f} km/h"
        )
    return f"{said}; it counts once"
