"""How is a text file written? Encoding, separator, decimal mark and the beginning of the table are
detected.
"""

from __future__ import annotations

import codecs
import csv
import re
from typing import NamedTuple

from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import Delimiter, Source
from topdress.drivers.files.imports.table_header import (
    TableLayout,
    find_table_layout,
    is_value_cell,
)

# Number of lines at the beginning that are examined.
SAMPLE_LINES = 300
# Number of bytes at the beginning that are examined.
SAMPLE_BYTES = 400_000
# Separators by their names in the import file.
DELIMITERS: dict[Delimiter, str] = {";": ";", "tab": "\t", ",": ",", "|": "|", "blank": " "}
# Consecutive bytes above 127.
_HIGH_BYTES = re.compile(rb"[\x80-\xff]+")


class TextDialect(NamedTuple):
    """Describes how a text file is written."""

    encoding: str
    delimiter: Delimiter
    decimal_comma: bool
    layout: TableLayout
    # The cells of the examined lines.
    rows: list[list[str]]


def find_encoding(data: bytes) -> str:
    """Returns the encoding of a text, by byte order marks, zero bytes and the runs of bytes above
    127.

    GB 18030 (GBK) writes a Chinese letter as two such bytes, the first from 0xA1 on, so all runs
    have an even length. A Latin letter with an accent is a single such byte among ASCII bytes.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if data.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    even, odd = data[0:4000:2].count(0), data[1:4000:2].count(0)
    # UTF-16 has its zeros at even or at odd positions; a power loss leaves zeros at both.
    if max(even, odd) > 0.3 * len(data[:4000:2]) and min(even, odd) < 0.5 * max(even, odd):
        return "utf-16-le" if odd > even else "utf-16-be"
    if data.isascii() or _is_utf8(data):
        return "utf-8"
    first = _HIGH_BYTES.search(data)
    assert first is not None
    start = data[first.start() : first.start() + SAMPLE_BYTES]
    runs = _HIGH_BYTES.findall(start)
    chinese = sum(len(run) % 2 == 0 and all(byte >= 0xA1 for byte in run) for run in runs)
    if chinese > 0.5 * len(runs):
        return "gb18030"
    # Bytes that cp1252 does not define.
    undefined = set(start) & {0x81, 0x8D, 0x8F, 0x90, 0x9D}
    return "latin-1" if undefined else "cp1252"


def _is_utf8(data: bytes) -> bool:
    """Returns whether the bytes are valid UTF-8."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for begin in range(0, len(data), SAMPLE_BYTES):
            decoder.decode(
                data[begin : begin + SAMPLE_BYTES], final=begin + SAMPLE_BYTES >= len(data)
            )
    except UnicodeDecodeError:
        return False
    return True


def find_dialect(label: str, sample: str, encoding: str, said: Source) -> TextDialect:
    """Returns how the lines of `sample` are split; the entries of the import file are kept.

    Parameters
    ----------
    label : the file, for messages.
    sample : its first lines.
    encoding : the encoding in which it was read.
    said : entries of the import file about reading.

    Raises
    ------
    LogImportError : no row of numbers is found.
    """
    lines = sample.splitlines()[:SAMPLE_LINES]
    # Excel writes the separator as `sep=;` in the first line.
    stated = re.match(r"^\"?sep=(.)\"?$", lines[0], re.IGNORECASE) if lines else None
    wanted: list[Delimiter] = (
        [said.delimiter]
        if said.delimiter
        else (
            [name for name, sign in DELIMITERS.items() if stated and sign == stated[1]]
            or list(DELIMITERS)
        )
    )
    best: tuple[float, TextDialect] | None = None
    for delimiter in wanted:
        rows = split_lines(lines, delimiter)
        layout = _find_layout(rows, said)
        body = [row for row in rows[layout.body :] if row] if layout is not None else []
        if layout is None or not body:
            continue
        width = max((len(row) for row in body), key=[len(row) for row in body].count)
        even = sum(len(row) == width for row in body) / len(body)
        cells = [cell for row in body for cell in row if cell.strip()]
        values = sum(map(is_value_cell, cells)) / max(1, len(cells))
        comma = (
            said.decimal == ","
            if said.decimal
            else DELIMITERS[delimiter] != "," and _has_decimal_comma(body)
        )
        # The best separator gives rows of equal length, cells that are values, and a header.
        points = (
            even
            + values
            + 0.2 * min(width - 1, 5)
            + (layout.header >= 0)
            - (delimiter == "blank")
            - (width == 1)
        )
        if best is None or points > best[0]:
            best = points, TextDialect(encoding, delimiter, comma, layout, rows)
    if best is None:
        first = lines[0][:40].strip() if lines else ""
        raise LogImportError(
            label,
            f"no row of numbers among the first {len(lines)} lines (the first is {first!r}): "
            "allowed is a table with a header row and rows of numbers",
        )
    return best[1]


def split_lines(lines: list[str], delimiter: Delimiter) -> list[list[str]]:
    """Returns lines as cells without surrounding blanks; quotes are those of CSV (RFC 4180)."""
    if delimiter == "blank":
        return [line.split() for line in lines]
    return [
        [cell.strip() for cell in row]
        for row in csv.reader(
            (line.replace("\0", "") for line in lines), delimiter=DELIMITERS[delimiter]
        )
    ]


def _find_layout(rows: list[list[str]], said: Source) -> TableLayout | None:
    """Returns the rows of header, units and body; the entries of the import file are kept."""
    found = find_table_layout(rows)
    if said.title_rows is None:
        return found
    if said.names:
        return TableLayout(-1, None, said.title_rows)
    header = said.title_rows
    rest = find_table_layout(rows[header:])
    unit_row = said.unit_row if said.unit_row is not None else rest is not None and rest.units == 1
    return TableLayout(header, header + 1 if unit_row else None, header + (2 if unit_row else 1))


def _has_decimal_comma(body: list[list[str]]) -> bool:
    """Returns whether most cells with a comma are numbers, so that the comma is the
    decimal mark."""
    with_comma = [cell for row in body for cell in row if cell.rfind(",") > cell.rfind(".")]
    numbers = [cell for cell in with_comma if is_value_cell(cell)]
    return len(numbers) > 0.5 * len(with_comma) if with_comma else False
