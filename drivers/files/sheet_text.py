"""What content do a workbook's sheets have, and how does its only table become comma-separated
text?
"""

from __future__ import annotations

import copy
import re
import xml.parsers.expat as expat
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.drivers.files.limits import MEGABYTE, SHEET_CELLS_LIMIT, BeyondLimits, check_limit

if TYPE_CHECKING:
    from python_calamine import CalamineSheet

import csv
import datetime as dt
import io

from topdress.drivers.files.imports.import_errors import TableError, format_list
from topdress.drivers.files.limits import DAMAGED_ZIP

# Number of bytes that are unpacked at a time. A workbook is streamed for its check, because its
# reader (calamine) allocates all cells between the first and the last, empty ones included, and
# ends the whole program if memory is short.
CHUNK_BYTES = 4 * MEGABYTE
# Reference of a cell; `(?<=...)` follows the literal, so that the search runs at the speed of
# memory where no reference occurs.
_COLUMN_REFERENCE = re.compile(rb'r="(?<=\sr=")([A-Z]{1,9})\d')
# Number of a row.
_ROW_REFERENCE = re.compile(rb'row[^>]{0,200}?\sr="(\d{1,9})"')
# Cell with a row number of six digits or more.
_FAR_ROW_REFERENCE = re.compile(rb'r="(?<=\sr=")[A-Z]{1,9}(\d{6,12})"')


def check_sheets(path: Path) -> None:
    """Checks every sheet's cells against the limit, and every entry of the zip against the size
    that its directory states.

    A .xls is not checked, because it has at most 65 536 rows of 256 columns.

    Raises
    ------
    BeyondLimits : a sheet is too large.
    OSError : the file cannot be read. The errors of zipfile for a damaged zip pass through.
    """
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            label = f"{path}: {info.filename}"
            chunks = _iter_unpacked(archive, info, label)
            if path.suffix.lower() == ".ods":
                spans = _count_ods_cells(chunks) if info.filename == "content.xml" else iter(())
            elif path.suffix.lower() == ".xlsb" and info.filename.lower().endswith(".bin"):
                # In a .xlsx such a file holds a printer's settings.
                spans = _count_xlsb_cells(chunks)
            else:
                spans = _count_xlsx_cells(chunks)
            for cells in spans:
                check_limit(SHEET_CELLS_LIMIT, cells, label)
            for _ in chunks:
                # The entry is read to its end, so that the size in the directory is compared with
                # the real size.
                pass


def read_sheet_cells(sheet: CalamineSheet, label: str) -> list[list[Any]]:
    """Returns all cells from the first row and column on. Raises BeyondLimits for too many
    cells."""
    check_limit(SHEET_CELLS_LIMIT, sheet.total_height * sheet.total_width, label)
    return sheet.to_python(skip_empty_area=False)


def _iter_unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo, label: str) -> Iterator[bytes]:
    """Yields an entry's bytes. Raises BeyondLimits where the entry is longer than its directory
    states, because calamine reads all of it."""
    stated = info.file_size
    longer = copy.copy(info)
    longer.file_size += 1
    found = 0
    with archive.open(longer) as entry:
        for chunk in iter(lambda: entry.read(CHUNK_BYTES), b""):
            found += len(chunk)
            if found > stated:
                raise BeyondLimits(
                    label,
                    "unpacks to more than the {stated} bytes that its directory says",
                    stated=stated,
                )
            yield chunk


def _count_xlsx_cells(chunks: Iterator[bytes]) -> Iterator[int]:
    """Yields the number of cells so far of a sheet or string table of .xlsx, a little more than the
    real number: rows times columns by their references, or by the longest row without references.
    """
    columns: set[bytes] = set()
    last_row = rows = cells = strings = widest = in_row = 0
    rest = b""
    for chunk in chunks:
        text = rest + chunk
        references = _COLUMN_REFERENCE.findall(text)
        columns.update(references)
        stated = [*_ROW_REFERENCE.findall(text), *_FAR_ROW_REFERENCE.findall(text)]
        last_row = max(last_row, max(map(int, stated), default=0))
        here = _count_tags(text, b"c")
        # Some cells name no column.
        if here > len(references):
            first, *others = text.replace(b":row", b"<row").split(b"<row")
            in_row += _count_tags(first, b"c")
            for row in others:
                widest, in_row = max(widest, in_row), _count_tags(row, b"c")
            widest = max(widest, in_row)
        cells, rows, strings = (
            cells + here,
            rows + _count_tags(text, b"row"),
            strings + _count_tags(text, b"si"),
        )
        width = max(widest, max((_parse_column_letters(name) for name in columns), default=0))
        yield max(cells, strings, max(last_row, rows) * width)
        # A reference may be split between two chunks.
        rest = text[-300:]


def _count_tags(text: bytes, name: bytes) -> int:
    """Returns the number of elements whose name begins with `name`, with or without a prefix."""
    return text.count(b"<" + name) + text.count(b":" + name)


def _parse_column_letters(column: bytes) -> int:
    """Returns the number of a column's letters: A is 1, AA is 27."""
    number = 0
    for letter in column:
        number = number * 26 + letter - 64
    return number


def _count_ods_cells(chunks: Iterator[bytes]) -> Iterator[int]:
    """Yields the number of cells so far of .ods. A row or cell may be repeated by an attribute;
    empty ones at the end are not counted."""
    total = in_row = filled = repeated = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal in_row, filled, repeated
        kind = name.rpartition(":")[2]
        if kind == "table-row":
            in_row, filled, repeated = 0, 0, _read_repeats(attributes, "rows")
        elif kind in ("table-cell", "covered-table-cell"):
            in_row += _read_repeats(attributes, "columns")
            filled = (
                in_row if any("value" in key or "formula" in key for key in attributes) else filled
            )
        elif kind == "p":
            filled = in_row

    def end(name: str) -> None:
        nonlocal total
        if name.rpartition(":")[2] == "table-row":
            total += filled * repeated

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    for chunk in chunks:
        try:
            parser.Parse(chunk, False)
        except expat.ExpatError:
            # The reader reports that the file is no document.
            return
        yield total


def _read_repeats(attributes: dict[str, str], what: str) -> int:
    text = next(
        (value for key, value in attributes.items() if key.endswith(f"number-{what}-repeated")), "1"
    )
    return int(text) if text.isdecimal() and len(text) < 10 else 1


def _count_xlsb_cells(chunks: Iterator[bytes]) -> Iterator[int]:
    """Yields the number of cells so far of a sheet of .xlsb ([MS-XLSB] 2.1.4): record 0 begins a
    row with its number, records 1 to 11 are cells."""
    last_row = last_column = -1
    rest = b""
    for chunk in chunks:
        data, at = rest + chunk, 0
        while (record := _find_record(data, at)) is not None:
            kind, begin, at = record
            if kind == 0 and at - begin >= 4:
                last_row = max(last_row, int.from_bytes(data[begin : begin + 4], "little"))
            elif kind <= 11 and at - begin >= 4:
                last_column = max(last_column, int.from_bytes(data[begin : begin + 4], "little"))
        rest = data[at:]
        yield (last_row + 1) * (last_column + 1)


def _find_record(data: bytes, at: int) -> tuple[int, int, int] | None:
    """Returns kind, beginning and end of a record's content; None for an incomplete record."""
    kind, at = _read_varint(data, at, 2)
    size, begin = _read_varint(data, at, 4)
    return (kind, begin, begin + size) if 0 <= begin and begin + size <= len(data) else None


def _read_varint(data: bytes, at: int, most: int) -> tuple[int, int]:
    """Returns a number of seven bits per byte, and the position after it; -1 for an incomplete
    number."""
    number = 0
    for k in range(most):
        if not 0 <= at + k < len(data):
            return 0, -1
        number |= (data[at + k] & 0x7F) << 7 * k
        if data[at + k] < 0x80:
            return number, at + k + 1
    return number, at + most


# Suffixes of workbooks.
WORKBOOK_SUFFIXES = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")


def read_sheets(path: Path, only: str | None = None) -> dict[str, list[list[Any]]]:
    """Returns the rows of each sheet, or of the sheet with this name. Raises TableError,
    OSError."""
    from python_calamine import CalamineError, CalamineWorkbook

    try:
        check_sheets(path)
        with CalamineWorkbook.from_path(str(path)) as book:
            if only and only not in book.sheet_names:
                raise TableError(
                    path, f"source.sheet {only}: allowed {format_list(book.sheet_names)}"
                )
            return {
                name: read_sheet_cells(book.get_sheet_by_name(name), f"sheet {name}")
                for name in ([only] if only else book.sheet_names)
            }
    except (CalamineError, BeyondLimits, *DAMAGED_ZIP) as error:
        raise TableError(path, f"not readable as a workbook: {error}") from None


def read_sheet_text(path: Path) -> bytes:
    """Returns the only sheet with a table as CSV, dates as ISO 8601. Raises TableError, OSError."""
    filled = {
        name: rows
        for name, rows in read_sheets(path).items()
        if any(cell != "" for row in rows for cell in row)
    }
    if len(filled) != 1:
        names = ", ".join(filled) or "none"
        raise TableError(
            path,
            f"{len(filled)} sheets hold something ({names}): allowed is one; topdress import takes "
            "one of several",
        )
    [rows] = filled.values()
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(
        [format_cell(cell) for cell in row] for row in rows
    )
    return text.getvalue().encode()


def format_cell(value: Any) -> str:
    """Returns a cell as text, dates as ISO 8601."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        # Above 1e15 a double no longer represents every integer.
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, dt.datetime | dt.date):
        return value.isoformat()
    return str(value).replace("\n", " ").strip()
