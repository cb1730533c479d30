"""How is an Excel workbook (.xlsx, .xlsm, .xls, .xlsb, .ods) read? The sheet, its title rows,
header and row of units are detected.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.columns import TIME_TYPE, make_text_column
from topdress.drivers.files.imports.dialect import SAMPLE_LINES
from topdress.drivers.files.imports.import_errors import LogImportError, format_list
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.raw_table import RawTable, split_header
from topdress.drivers.files.imports.table_header import TableLayout, find_table_layout
from topdress.drivers.files.sheet_text import format_cell, read_sheets

# Smallest number of rows of a log; a shorter table next to a longer table holds notes.
MIN_LOG_ROWS = 20


def read_excel(path: Path, said: Source) -> RawTable:
    """Returns the table of a workbook: of the sheet that `said` names, else of the only sheet with
    a table. Raises TableError, OSError."""
    tables = read_sheets(path, said.sheet)
    found = {
        name: (rows, layout)
        for name, rows in tables.items()
        if (layout := _find_layout(rows, said)) is not None
    }
    if not found:
        raise LogImportError(
            path,
            f"no sheet holds a table of numbers below a header (sheets: {format_list(tables)})",
        )
    long = [
        name for name, (rows, layout) in found.items() if len(rows) - layout.body >= MIN_LOG_ROWS
    ]
    left = long if len(long) == 1 else list(found)
    findings = tuple(
        Finding(
            "other_sheets",
            f"sheet {name} left out: {many(len(found[name][0]), 'row')} next to a log",
        )
        for name in found
        if name not in left
    )
    found = {name: found[name] for name in left}
    if len(found) > 1:
        raise LogImportError(
            path,
            f"{len(found)} sheets hold tables: say source.sheet in the import file; allowed "
            f"{format_list(found)}",
        )
    [(sheet, (rows, layout))] = found.items()
    return _build_table(path, said, sheet, rows, layout, findings)


def _find_layout(rows: list[list[Any]], said: Source) -> TableLayout | None:
    """Returns the rows of header, units and body of a sheet; the entries of the import file are
    kept."""
    if said.title_rows is not None:
        header = said.title_rows
        unit_row = said.unit_row is True
        below = header + (2 if unit_row else 1)
        return (
            TableLayout(header, header + 1 if unit_row else None, below)
            if below < len(rows)
            else None
        )
    return find_table_layout([[format_cell(cell) for cell in row] for row in rows[:SAMPLE_LINES]])


def _build_table(
    path: Path,
    said: Source,
    sheet: str,
    rows: list[list[Any]],
    layout: TableLayout,
    findings: tuple[Finding, ...],
) -> RawTable:
    """Returns a sheet's table. Raises LogImportError."""
    if layout.header < 0 and not said.names:
        raise LogImportError(
            path,
            f"sheet {sheet}: no header row: allowed is a row that names the columns, or "
            "source.names in the import file",
        )
    names, units = split_header(
        list(said.names) if said.names else [format_cell(cell) for cell in rows[layout.header]],
        None if layout.units is None else [format_cell(cell) for cell in rows[layout.units]],
    )
    body = [row for row in rows[layout.body :] if any(cell != "" for cell in row)]
    if not body:
        raise LogImportError(path, f"sheet {sheet}: no rows below the header")
    cells = list(zip(*body, strict=False))[: len(names)]
    columns = {name: _build_column(values) for name, values in zip(names, cells, strict=True)}
    source = said.model_copy(
        update={
            "kind": "excel",
            "sheet": sheet,
            "title_rows": max(layout.header, 0),
            "unit_row": layout.units is not None,
        }
    )
    above = tuple(
        " ".join(filter(None, map(format_cell, row))) for row in rows[: max(layout.header, 0)]
    )
    return RawTable(path, columns, source, units, layout.body + 1, findings, above)


def _build_column(values: tuple[Any, ...]) -> NDArray[Any]:
    """Returns a column as numbers, times or texts (n,), by its cells' types."""
    kinds = {type(value) for value in values if value != ""}
    if kinds <= {float, int, bool}:
        return np.array([np.nan if value == "" else float(value) for value in values], np.float64)
    if kinds <= {dt.datetime, dt.date}:
        return np.array([None if value == "" else value for value in values], TIME_TYPE)
    return make_text_column([format_cell(value) for value in values])
