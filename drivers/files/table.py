"""How are tables of any origin read as columns by name? Logs and bench tables may be CSV and its
relatives, or the only sheet of a workbook.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.columns import Columns, is_text_column, make_texts_array
from topdress.drivers.files.header_names import RenamedHeader
from topdress.drivers.files.imports.cell_numbers import parse_number, parse_number_cells
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.imports.table_header import EMPTY_CELLS, is_unit_row, is_value_cell
from topdress.drivers.files.imports.text_table import (
    CellColumn,
    NumberCells,
    convert_to_utf8,
    drop_cut_row,
    read_cell_columns,
)
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.sheet_text import WORKBOOK_SUFFIXES, read_sheet_text

HeaderRenamer = Callable[[tuple[str, ...]], RenamedHeader]

# Characters that may separate columns.
_SEPARATORS = ",;\t|"
_SEPARATOR_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars"}
# Number of cells that are tested before a column of unknown type is converted to numbers as a
# whole.
_TYPE_SAMPLE_CELLS = 1000
# Number of bytes in which a header is searched.
HEADER_BYTES = 1 << 20


class NoHeaderError(TableError):
    """Reports that the first line holds only numbers, so that the meaning of the columns is an open
    question."""


@dataclass(frozen=True, slots=True)
class Table:
    """Holds a table. `names` are all columns of the file, `columns` the columns that were read;
    arrays of length n, float64 (unknown = NaN) or object (texts, unknown = "")."""

    path: Path
    names: tuple[str, ...]
    columns: Columns
    findings: tuple[Finding, ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()))) if self.columns else 0


class _TableLayout(NamedTuple):
    """Describes where names and rows of a text begin, and how its cells are separated."""

    names: tuple[str, ...]
    separator: str
    decimal_comma: bool
    # Number of lines up to the header.
    skip_lines: int
    # Position of the byte at which the rows begin.
    body: int


def read_table(
    path: Path,
    numbers: Collection[str] = (),
    texts: Collection[str] = (),
    *,
    rename: HeaderRenamer | None = None,
    choose: Callable[[tuple[str, ...]], Collection[str]] | None = None,
    own_header: tuple[str, ...] = (),
    data: bytes | None = None,
) -> Table:
    """Returns a table with a header row: text, or the only sheet of a workbook. Title rows above
    the header and a row of units below it are skipped, with findings.

    Parameters
    ----------
    path : the table.
    numbers : columns of numbers.
    texts : columns of texts; any other column is numeric if all its cells are.
    rename : returns new names for the header's columns.
    choose : returns the new names that are read (None: all).
    own_header : columns of a writer that ends every row with a line end, so that a last line
    without a line end was cut off; the last line of other writers is used if it has all its fields.
    data : a text that replaces the file's.

    Returns
    -------
    the columns with findings.

    Raises
    ------
    TableError : the table cannot be read.
    """
    data, findings = _read_text(path, data=data)
    layout = _find_layout(path, data, findings)
    # An incomplete last row is removed before the cells are split.
    data, cut = drop_cut_row(
        data, layout.body, layout.separator, len(layout.names), layout.names == own_header
    )
    findings += cut
    factors: Mapping[str, float] = {}
    if rename is not None:
        renamed = rename(layout.names)
        if renamed.trouble:
            raise TableError(path, renamed.trouble)
        layout, factors = layout._replace(names=renamed.names), renamed.factors
        findings += renamed.findings
    # Two columns with one name cannot be distinguished by any later step.
    _refuse_twins(path, layout.names)
    chosen = layout.names if choose is None else choose(layout.names)
    wanted = [name for name in layout.names if name in chosen]
    # A table without rows still has typed columns.
    if data.count(b"\n", layout.body) == 0:
        columns = {name: np.array([], object if name in texts else np.float64) for name in wanted}
    else:
        cells, odd = read_cell_columns(
            path,
            data,
            layout.body,
            layout.separator,
            layout.names,
            above=layout.skip_lines,
            wanted=wanted,
            numbers=numbers,
            decimal_comma=layout.decimal_comma,
        )
        # The text is no longer needed, and may be large.
        del data
        findings += odd
        columns = convert_cells(cells, numbers, texts, findings)
    # Factors convert units in the header to the units of the columns.
    for name, factor in factors.items():
        if name in columns and columns[name].dtype != object:
            columns[name] = columns[name] * factor
    return Table(path, layout.names, columns, tuple(findings))


def read_header(path: Path) -> tuple[str, ...]:
    """Returns the names in a table's header, unchanged; only the beginning of a text is read.
    Raises TableError."""
    data, findings = _read_text(path, HEADER_BYTES)
    return _find_layout(path, data, findings).names


def _read_text(
    path: Path, most: int = -1, data: bytes | None = None
) -> tuple[bytes, list[Finding]]:
    """Returns the text in UTF-8. `most` is the largest number of bytes, cut at a line's end (-1:
    all). Raises TableError, BeyondLimits."""
    try:
        data = _read_bytes(path, most) if data is None else data
    except FileNotFoundError:
        raise TableError(path, "no such file") from None
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror or error}") from None
    data, _, findings = convert_to_utf8(path, data, whole=most < 0)
    return data, findings


def _read_bytes(path: Path, most: int) -> bytes:
    # The size limit is checked before any byte is read.
    check_file(path)
    if path.suffix.lower() in WORKBOOK_SUFFIXES:
        return read_sheet_text(path)
    with path.open("rb") as file:
        data = file.read(most)
    # The sample ends at a line end, so that its last row is complete.
    return data[: data.rfind(b"\n") + 1] or data if len(data) == most else data


def _find_layout(path: Path, data: bytes, findings: list[Finding]) -> _TableLayout:
    line, separator, lines, start = _find_header_line(path, data)
    if lines > 1:
        findings.append(Finding("preamble", f"{many(lines - 1, 'line')} before the header skipped"))
    # A declared separator is preferred to the most frequent sign.
    separator = separator or max(_SEPARATORS, key=line.count)
    names = _parse_names(path, line, separator)
    if separator in _SEPARATOR_NAMES:
        findings.append(
            Finding(
                "separator", f"columns are separated by {_SEPARATOR_NAMES[separator]}, read as such"
            )
        )
    body = min(start, len(data))
    below = _skip_unit_row(data, body, separator)
    if below is not None:
        findings.append(
            Finding("unit_row", "a row of units below the header was passed over", rows=1)
        )
        body, lines = below, lines + 1
    # A comma cannot be both separator and decimal mark.
    comma = separator != "," and _has_decimal_comma(data[body : body + 20_000], separator)
    if comma:
        findings.append(
            Finding("decimal_comma", "numbers are written with a decimal comma, read as such")
        )
    if data.find(b"\r\n", 0, body + 1) >= 0:
        findings.append(Finding("crlf", "lines end as on Windows, read as such"))
    return _TableLayout(names, separator, comma, lines, body)


def _find_header_line(path: Path, data: bytes) -> tuple[str, str, int, int]:
    """Returns the header line, the separator that a line before it names ("" without such a line),
    its number, and the position after it."""
    start = lines = 0
    separator = ""
    while True:
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        line = data[start:end].decode(errors="replace").strip("\r")
        lines += 1
        before, start = start, end + 1
        # Excel writes this line to declare the separator.
        if line.lower().startswith("sep=") and len(line) == 5 and line[4] in _SEPARATORS:
            separator = line[4]
        elif (
            line.strip(" ,;\t|")
            and not line.startswith("#")
            and not _is_title_line(line, data, start)
        ):
            return line, separator, lines, start
        elif before >= len(data):
            raise TableError(path, "no header row: the file holds comments only")


def _is_title_line(line: str, data: bytes, start: int) -> bool:
    """Returns whether a line of words is a title above a header: a single cell above rows of
    several cells, or words above words above numbers."""
    # A line with a number or a date is data, never a title.
    if any(is_value_cell(cell) for cell in _split_cells(line)):
        return False
    # Eight lines are enough to see a header and rows below a title.
    below = [
        row
        for row in data[start : start + 8000].decode(errors="replace").splitlines()[:8]
        if row.strip(" ,;\t|")
    ]
    rows = [cells for row in below if not is_unit_row(cells := _split_cells(row))]
    if len(rows) < 2 or len(rows[0]) < 2 or any(is_value_cell(cell) for cell in rows[0]):
        return (
            len(_split_cells(line)) == 1
            and len(rows) > 2
            and _is_title_line(below[0], data, start + len(below[0]))
        )
    return any(is_value_cell(cell) for cell in rows[1])


def _split_cells(line: str) -> list[str]:
    """Returns the filled cells by the separator that splits the line into most cells."""
    sign = max(_SEPARATORS, key=line.count)
    return [cell.strip() for cell in line.split(sign) if cell.strip()]


def _skip_unit_row(data: bytes, body: int, separator: str) -> int | None:
    """Returns the position after a row of units at `body`; None without such a row."""
    end = data.find(b"\n", body)
    cells = data[body:end].decode(errors="replace").strip("\r").split(separator)
    # A single cell is a title or a note, not a row of units.
    return end + 1 if end > body and len(cells) > 1 and is_unit_row(cells) else None


def _parse_names(path: Path, line: str, separator: str) -> tuple[str, ...]:
    try:
        names = tuple(name.strip() for name in next(csv.reader([line], delimiter=separator)))
    except csv.Error as error:
        raise TableError(path, f"no header row: {error}") from None
    if all(is_value_cell(name) or name.lower() in EMPTY_CELLS for name in names):
        raise NoHeaderError(
            path,
            f"no header row: the first line is {line[:40].strip()}; the first line must name the "
            "columns",
        )
    # A separator at the end of the header makes an empty last name.
    while names and not names[-1]:
        names = names[:-1]
    return names


def _refuse_twins(path: Path, names: tuple[str, ...]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise TableError(
                path,
                f"column {name or '(no name)'} stands {names.count(name)} times in the header: "
                "allowed once",
            )


def _has_decimal_comma(sample: bytes, separator: str) -> bool:
    cells = sample.decode(errors="replace").replace("\n", separator).split(separator)[:-1]
    # One cell that is no number disproves the decimal comma.
    with_comma = [cell for cell in cells if "," in cell]
    return bool(with_comma) and all(map(is_value_cell, with_comma))


def convert_cells(
    cells: dict[str, CellColumn],
    numbers: Collection[str],
    texts: Collection[str],
    findings: list[Finding] | None = None,
) -> Columns:
    """Returns cells by column as a table's columns; `findings` grows by cells that are no numbers.
    Cells are removed as they are converted, so that they are not in memory twice."""
    columns: Columns = {}
    for name in list(cells):
        # Each column of texts is released after its conversion, which halves the peak memory.
        column = cells.pop(name)
        if not isinstance(column, NumberCells):
            column = _convert_column(name, column, numbers, texts)
        if not isinstance(column, NumberCells):
            columns[name] = column
            continue
        if column.bad and findings is not None:
            findings.append(
                Finding(
                    "not_a_number",
                    f"column {name}: {many(column.bad, 'cell')} such as "
                    f"{column.cell[:20]!r} emptied: not a number",
                    name,
                    column.bad,
                )
            )
        # Infinite values come from divisions by zero in other programs.
        columns[name] = np.where(np.isinf(column.values), np.nan, column.values)
    return columns


def _convert_column(
    name: str, column: NDArray[Any], numbers: Collection[str], texts: Collection[str]
) -> CellColumn:
    """Returns numbers where the column must have numbers, or where all its cells are numbers."""
    if not is_text_column(column):
        return NumberCells(column.astype(np.float64))
    cells = column.tolist()
    # A test of the first cells avoids the conversion of long text columns.
    if name not in texts and (
        name in numbers or None not in map(parse_number, cells[:_TYPE_SAMPLE_CELLS])
    ):
        found = parse_number_cells(cells)
        if name in numbers or not found.bad:
            return NumberCells(found.values, found.bad, found.cell)
    return make_texts_array(cells)
