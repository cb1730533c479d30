"""Text tables (CSV and its relatives) of any dialect, in one quick pass."""
from __future__ import annotations

import codecs
import csv
import re
from pathlib import Path

import polars as pl

from control.recordings.finding import Finding, many
from drivers.files.imports.dialect import DELIMITERS, SAMPLE_BYTES, Dialect, dialect_of, encoding_of
from drivers.files.imports.header import named
from drivers.files.imports.mapping import Source
from drivers.files.imports.raw import RawTable, unique
from drivers.files.imports.trouble import ImportTrouble, listed
from drivers.files.limits import check_text
from drivers.files.long_lines import without_long_lines
from drivers.files.quotes import unclosed_quote

NO_HEADER = "no_header"         # of a finding
_QUOTED = re.compile(rb'"[^"]*"')


def read_text(path: Path, said: Source) -> RawTable:
    """Raises ImportTrouble, OSError."""
    data = path.read_bytes()
    if not data.strip(b"\0 \r\n\t"):
        raise ImportTrouble(path, "the file is empty")
    encoding = said.encoding or encoding_of(data)
    data, findings = without_long_lines(_utf8(path, data, encoding))
    check_text(data, str(path))
    line = unclosed_quote(data)
    if line is not None:
        raise ImportTrouble(path, f"line {line}: a quote is opened and not closed: allowed are pairs of quotes")
    sample = data[:SAMPLE_BYTES].decode(errors="replace")
    if len(data) > SAMPLE_BYTES:
        sample = sample[:sample.rfind("\n")]
    try:
        dialect = dialect_of(str(path), sample, encoding.removesuffix("-sig"), said)
    except csv.Error as error:
        raise ImportTrouble(path, f"not readable as a table: {error}") from None
    if dialect.layout.header < 0 and not said.names:
        first = dialect.rows[dialect.layout.body]
        said = said.model_copy(update={"names": tuple(f"c{k + 1}" for k in range(len(first)))})
        findings.append(Finding(NO_HEADER, f"no header row: the first row is {listed(first, 4)}: its columns are "
                                f"called {listed(said.names or (), 4)}: say in source.names what they are"))
    names, units = _header(dialect, said)
    frame = _frame(path, data, dialect, names, findings)
    found = said.model_copy(update={
        "kind": "text", "encoding": dialect.encoding, "delimiter": dialect.delimiter,
        "decimal": "," if dialect.decimal_comma else ".", "title_rows": max(dialect.layout.header, 0) if not said.names
        else dialect.layout.body, "unit_row": dialect.layout.units is not None})
    above = tuple(" ".join(cells) for cells in dialect.rows[:max(dialect.layout.header, 0)])
    return RawTable(path, frame, found, units, dialect.layout.body + 1, tuple(findings), above)


def _utf8(path: Path, data: bytes, encoding: str) -> bytes:
    """The text in UTF-8, lines ended by line feeds."""
    if encoding.lower() not in ("utf-8", "utf8"):
        try:
            data = data.decode(encoding, errors="replace").encode()
        except LookupError:
            raise ImportTrouble(path, f"source.encoding {encoding}: not known; allowed e.g. utf-8, utf-16, latin-1, "
                                "cp1252, gb18030") from None
    data = data.removeprefix(codecs.BOM_UTF8).replace(b"\0", b"")
    if b"\r" in data and b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    return data


def _header(dialect: Dialect, said: Source) -> tuple[list[str], dict[str, str]]:
    if said.names:
        return unique(list(said.names)), {}
    cells = dialect.rows[dialect.layout.header]
    while cells and not cells[-1]:
        cells = cells[:-1]
    cells = [cell.lstrip("#").strip() for cell in cells]
    names = unique(cells)
    units = {name: unit for name, cell in zip(names, cells, strict=True) if (unit := named(cell)[1]) is not None}
    if dialect.layout.units is not None:
        row = dialect.rows[dialect.layout.units]
        units |= {name: cell.strip("()[] ") for name, cell in zip(names, row, strict=False) if cell.strip("()[]- ")}
    return names, units


def _frame(path: Path, data: bytes, dialect: Dialect, names: list[str], findings: list[Finding]) -> pl.DataFrame:
    """Columns of texts. Rows of another number of cells than the header are left out and said."""
    start = _line_start(data, dialect.layout.body)
    if dialect.delimiter == "blank":
        data, start = b"\n".join(b" ".join(line.split()) for line in data[start:].split(b"\n")), 0
    sign = DELIMITERS[dialect.delimiter]
    body = data[start:]
    tail = body[body.rfind(b"\n") + 1:]
    if b"\n" in body and tail.strip() and tail.count(sign.encode()) < len(names) - 1:
        findings.append(Finding("cut_row", "the last row was cut off and left out", rows=1))
        body = body[:len(body) - len(tail)]
    try:
        frame = _read(body, sign, len(names), ragged=False)
    except pl.exceptions.PolarsError:
        body, left_out = _without_odd_rows(body, sign, len(names), dialect.layout.body)
        if not body:
            raise ImportTrouble(path, f"no row has the header's {len(names)} cells: allowed is one cell for each "
                                f"column (is the decimal sign a comma, as the delimiter {sign!r} is?)") from None
        findings += left_out
        try:
            frame = _read(body, sign, len(names), ragged=True)
        except pl.exceptions.PolarsError as error:
            raise ImportTrouble(path, f"not readable as a table: {str(error).splitlines()[0]}") from None
    frame = frame.rename(dict(zip(frame.columns, names, strict=True)))
    texts = frame.select(pl.all().str.strip_chars())
    kept = texts.filter(~pl.all_horizontal(pl.all().is_null() | (pl.all() == "")))
    if kept.height == 0:
        raise ImportTrouble(path, "no rows below the header")
    return kept


def _read(body: bytes, sign: str, width: int, ragged: bool) -> pl.DataFrame:
    schema: dict[str, pl.DataType] = {f"c{k}": pl.String() for k in range(width)}
    first = body[:body.find(b"\n")] if b"\n" in body else body
    bare = _QUOTED.sub(b"", first).rstrip(b"\r ")
    if bare.endswith(sign.encode()) and bare.count(sign.encode()) == width:
        schema["past"] = pl.String()                # a delimiter after the last column
    frame = pl.read_csv(body, has_header=False, separator=sign, schema=schema, infer_schema=False,
                        truncate_ragged_lines=ragged, quote_char='"')
    return frame.drop("past", strict=False)


def _without_odd_rows(body: bytes, sign: str, width: int, above: int) -> tuple[bytes, list[Finding]]:
    """Lines of the header's number of cells; quoted line breaks are not known here."""
    delimiter = sign.encode()
    lines = body.split(b"\n")
    fits = (width - 1, width)
    good = [line for line in lines if line.strip() and line.count(delimiter) in fits]
    odd = [(k, line) for k, line in enumerate(lines) if line.strip() and line.count(delimiter) not in fits]
    findings = []
    if odd:
        at, line = odd[0]
        findings.append(Finding("wrong_fields", f"{many(len(odd))} left out, the first in line {above + at + 1} with "
                                f"{line.count(delimiter) + 1} cells where the header has {width}", rows=len(odd)))
    return b"\n".join(good), findings


def _line_start(data: bytes, line: int) -> int:
    place = 0
    for _ in range(line):
        end = data.find(b"\n", place)
        if end < 0:
            return len(data)
        place = end + 1
    return place
