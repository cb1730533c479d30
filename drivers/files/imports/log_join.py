"""How do files of a machine become a single log? They are joined by their clocks, or in
sequence.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from topdress.control.log_row import FILE_BEGINS
from topdress.control.recordings.finding import Finding
from topdress.drivers.files.columns import Columns, count_rows, make_text_column, stack_tables
from topdress.drivers.files.imports.convert import TIME_US_COLUMN, UTC_US_COLUMN, ConvertedFile
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import EVENTS_COLUMN, Join


class JoinedFiles(NamedTuple):
    """Holds the joined log. `columns` has `us` from 0 on, `utc_us` where known, and log columns.
    `begins_s` is the begin of each part, s, in the order of `parts`."""

    columns: Columns
    parts: tuple[ConvertedFile, ...]
    begins_s: tuple[float, ...]
    findings: tuple[Finding, ...]


def join_files(parts: Sequence[ConvertedFile], join: Join) -> JoinedFiles:
    """Returns files joined to one log.

    Parameters
    ----------
    parts : the converted files.
    join : the entry of the import file about joining.

    Returns
    -------
    columns from time 0 on, with findings.

    Raises
    ------
    LogImportError : files that must be joined by their clocks overlap.
    """
    by_clock = _is_joined_by_clock(parts, join)
    ordered = (
        sorted(parts, key=_find_first_us) if by_clock or _has_one_epoch(parts) else list(parts)
    )
    tables, begins = [], []
    # The joined log begins at 0.
    shift = -_find_first_us(ordered[0])
    end_us = 0
    for number, part in enumerate(ordered):
        if number and not by_clock:
            shift = end_us + round(join.gap_s * 1e6) - _find_first_us(part)
        columns = dict(part.columns)
        if part.kind == "utc":
            columns[UTC_US_COLUMN] = columns[TIME_US_COLUMN]
        columns[TIME_US_COLUMN] = columns[TIME_US_COLUMN] + shift
        if len(ordered) > 1:
            _mark_file_begin(columns, part.raw.path.name)
        begins.append(int(columns[TIME_US_COLUMN][0]) / 1e6)
        end_us = int(columns[TIME_US_COLUMN][-1])
        tables.append(columns)
    findings = []
    if len(ordered) > 1:
        how = "by their times" if by_clock else f"one after the other, {join.gap_s:g} s between"
        findings.append(Finding("joined", f"{len(ordered)} files joined {how}"))
    return JoinedFiles(stack_tables(tables), tuple(ordered), tuple(begins), tuple(findings))


def _is_joined_by_clock(parts: Sequence[ConvertedFile], join: Join) -> bool:
    """Returns whether files are joined by their clocks. Raises LogImportError where they
    overlap."""
    if len(parts) == 1 or join.order == "runs":
        return False
    ordered = sorted(parts, key=_find_first_us)
    overlap = next(
        (
            (a, b)
            for a, b in pairwise(ordered)
            if int(a.columns[TIME_US_COLUMN][-1]) >= _find_first_us(b)
        ),
        None,
    )
    if overlap is None:
        return join.order == "clock" or _has_one_epoch(parts)
    if join.order == "clock" or (_has_one_epoch(parts) and join.order is None):
        a, b = overlap
        raise LogImportError(
            b.raw.path,
            f"begins before {a.raw.path.name} ends: allowed are files that follow one "
            "another, or join.order: runs in the import file",
        )
    return False


def _has_one_epoch(parts: Sequence[ConvertedFile]) -> bool:
    return len({part.kind for part in parts}) == 1 and parts[0].kind != "relative"


def _find_first_us(part: ConvertedFile) -> int:
    """Returns a file's first time, microseconds."""
    return int(part.columns[TIME_US_COLUMN][0])


def _mark_file_begin(columns: Columns, name: str) -> None:
    """Marks the first row with an event that names the file."""
    # A semicolon separates events.
    mark = f"{FILE_BEGINS}{name.replace(';', ' ')}"
    events = (
        columns[EVENTS_COLUMN].tolist() if EVENTS_COLUMN in columns else [""] * count_rows(columns)
    )
    events[0] = f"{events[0]};{mark}" if events[0] else mark
    columns[EVENTS_COLUMN] = make_text_column(events)
