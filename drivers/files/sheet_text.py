"""A spreadsheet's one table as comma-separated text, so that what reads text tables reads it too."""
from __future__ import annotations

import csv
import datetime as dt
import io
from pathlib import Path
from typing import Any

from drivers.files.imports.trouble import TableError
from drivers.files.limits import DAMAGED_ZIP, BeyondLimits
from drivers.files.sheet_limits import cells_of, check_sheets

SUFFIXES = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")


def sheet_text(path: Path) -> bytes:
    """The sheet that holds a table, dates as ISO 8601. Raises TableError, OSError."""
    from python_calamine import CalamineError, CalamineWorkbook
    try:
        check_sheets(path)
        with CalamineWorkbook.from_path(str(path)) as book:
            tables = {name: cells_of(book.get_sheet_by_name(name), f"sheet {name}") for name in book.sheet_names}
    except (CalamineError, BeyondLimits, *DAMAGED_ZIP) as error:
        raise TableError(path, f"not readable as a workbook: {error}") from None
    filled = {name: rows for name, rows in tables.items() if any(cell != "" for row in rows for cell in row)}
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
