"""Workbooks: the cells of their sheets, and the one table of one as comma-separated text for what reads texts."""
from __future__ import annotations

import csv
import datetime as dt
import io
from pathlib import Path
from typing import Any

from drivers.files.imports.trouble import TableError, listed
from drivers.files.limits import DAMAGED_ZIP, BeyondLimits
from drivers.files.sheet_limits import cells_of, check_sheets

SUFFIXES = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")


def sheets_of(path: Path, only: str | None = None) -> dict[str, list[list[Any]]]:
    """The rows of each sheet, or of the one of this name. Raises TableError, OSError."""
    from python_calamine import CalamineError, CalamineWorkbook
    try:
        check_sheets(path)
        with CalamineWorkbook.from_path(str(path)) as book:
            if only and only not in book.sheet_names:
                raise TableError(path, f"source.sheet {only}: allowed {listed(book.sheet_names)}")
            return {name: cells_of(book.get_sheet_by_name(name), f"sheet {name}")
                    for name in ([only] if only else book.sheet_names)}
    except (CalamineError, BeyondLimits, *DAMAGED_ZIP) as error:
        raise TableError(path, f"not readable as a workbook: {error}") from None


def sheet_text(path: Path) -> bytes:
    """The sheet that holds a table, dates as ISO 8601. Raises TableError, OSError."""
    filled = {name: rows for name, rows in sheets_of(path).items() if any(cell != "" for row in rows for cell in row)}
    if len(filled) != 1:
        names = ", ".join(filled) or "none"
        raise TableError(path, f"{len(filled)} sheets hold something ({names}): allowed is one; topdress import takes "
                         "one of several")
    [rows] = filled.values()
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([cell_text(cell) for cell in row] for row in rows)
    return text.getvalue().encode()


def cell_text(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, dt.datetime | dt.date):
        return value.isoformat()
    return str(value).replace("\n", " ").strip()
