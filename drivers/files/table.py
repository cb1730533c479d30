"""Tables as text (CSV and its relatives) of any origin: encoding, separator, decimal sign, line ends, a cut tail.

Well-formed tables take the quick way (polars, loaded only then); anything odd takes the careful way, row by row, where
everything refused is counted and said.
"""
from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control.recordings.finding import Finding, many
from drivers.files.header_names import Renamed
from drivers.files.imports.header import NOTHING, is_unit_row, is_value
from drivers.files.imports.trouble import TableError
from drivers.files.limits import check_file, check_text
from drivers.files.long_lines import without_long_lines
from drivers.files.quotes import unclosed_quote
from drivers.files.sheet_text import SUFFIXES, sheet_text

if TYPE_CHECKING:
    import polars as pl

Columns = dict[str, NDArray[Any]]
Rename = Callable[[tuple[str, ...]], Renamed]

_SEPARATORS = ",;\t|"
_SEPARATOR_NAMES = {";": "semicolons", "\t": "tabs", "|": "bars"}
_CHUNK_ROWS = 50_000
HEAD = 1 << 20              # bytes in which a header is looked for


class NoHeader(TableError):
    """Its first line holds numbers only: what the columns are is to be asked."""


@dataclass(frozen=True, slots=True)
class Table:
    """`names`: all columns of the file. `columns`: those read; arrays of length n, float64 (unknown = NaN) or object
    (texts, unknown = "")."""

    path: Path
    names: tuple[str, ...]
    columns: Columns
    findings: tuple[Finding, ...]

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0


class _Layout(NamedTuple):
    names: tuple[str, ...]
    separator: str
    decimal_comma: bool
    skip_lines: int              # header and what stands before it
    body: int                    # byte where the rows begin


def read_table(path: Path, numbers: Collection[str] = (), texts: Collection[str] = (), *,
               rename: Rename | None = None, choose: Callable[[tuple[str, ...]], Collection[str]] | None = None,
               own_header: tuple[str, ...] = ()) -> Table:
    """Reads a table with one header row: text, or the one sheet of a workbook. Title rows above the header and a row of
    units below it are passed over, and said.

    `numbers`, `texts`: columns whose type is known; any other is numeric if all its cells are. `rename`: the names by
    which the header's columns go from here on. `choose`: of these names those to be read (None: all). `own_header`: the
    columns of a writer that ends every row with a line end, so that a last line without one was cut off; from other
    writers such a line is used if it has all its fields. Raises TableError.
    """
    data, findings = _utf8(path)
    layout = _layout(path, data, findings)
    data = _without_cut_row(data, layout, layout.names == own_header, findings)
    factors: Mapping[str, float] = {}
    if rename is not None:
        renamed = rename(layout.names)
        if renamed.trouble:
            raise TableError(path, renamed.trouble)
        layout, factors = layout._replace(names=renamed.names), renamed.factors
        findings += renamed.findings
    _refuse_twins(path, layout.names)
    chosen = layout.names if choose is None else choose(layout.names)
    wanted = [name for name in layout.names if name in chosen]
    if data.count(b"\n", layout.body) == 0:
        columns = {name: np.array([], object if name in texts else np.float64) for name in wanted}
    elif (frame := _regular(data, layout, wanted, numbers)) is not None:
        del data
        columns = columns_of(frame, numbers, texts, layout.decimal_comma)
    else:
        columns = _carefully(path, data, layout, wanted, numbers, texts, findings)
    for name, factor in factors.items():
        if name in columns and columns[name].dtype != object:
            columns[name] = columns[name] * factor
    return Table(path, layout.names, columns, tuple(findings))


def header_of(path: Path) -> tuple[str, ...]:
    """The names in a table's header, as they stand; of a text only its beginning is read. Raises TableError."""
    data, findings = _utf8(path, HEAD)
    return _layout(path, data, findings).names


def _bytes(path: Path, most: int) -> tuple[bytes, list[Finding]]:
    """most : bytes of a text, cut at a line's end; -1: all. Raises TableError."""
    findings: list[Finding] = []
    try:
        check_file(path)
        if path.suffix.lower() in SUFFIXES:
            return sheet_text(path), findings
        with path.open("rb") as file:
            data = file.read(most)
        if len(data) == most:
            data = data[:data.rfind(b"\n") + 1] or data
        data, findings = without_long_lines(data)
        check_text(data.replace(b"\0", b""), str(path))
    except FileNotFoundError:
        raise TableError(path, "no such file") from None
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror or error}") from None
    return data, findings


def _utf8(path: Path, most: int = -1) -> tuple[bytes, list[Finding]]:
    data, findings = _bytes(path, most)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16", errors="ignore").encode()
        findings.append(Finding("utf16", "the file is UTF-16 text, read as such"))
    if data.startswith(b"\xef\xbb\xbf"):
        data = data[3:]
        findings.append(Finding("byte_order_mark", "a byte order mark before the first column's name was skipped"))
    if b"\0" in data:
        data = data.replace(b"\0", b"")
        findings.append(Finding("zero_bytes", "zero bytes, as a power loss leaves them, were skipped"))
    if not data.strip():
        raise TableError(path, "the file is empty")
    if b"\n" not in data and b"\r" in data:
        data = data.replace(b"\r", b"\n")
        findings.append(Finding("carriage_returns", "lines end with carriage returns only, read as such"))
    if not data.isascii():
        whole = data[:data.rfind(b"\n") + 1] or data     # the last line may be cut inside a letter
        if not _decodes(whole, "utf-8"):
            encoding = "gb18030" if _decodes(whole, "gb18030") else "latin-1"
            data = data.decode(encoding, errors="ignore").encode()
            findings.append(Finding("encoding", f"the file is not UTF-8: read as {encoding}"))
    line = unclosed_quote(data) if most < 0 else None       # a beginning may end within a pair
    if line is not None:
        raise TableError(path, f"line {line}: a quote is opened and not closed: allowed are pairs of quotes")
    return data, findings


def _decodes(data: bytes, encoding: str) -> bool:
    try:
        data.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _layout(path: Path, data: bytes, findings: list[Finding]) -> _Layout:
    line, separator, lines, start = _header_line(path, data)
    if lines > 1:
        findings.append(Finding("preamble", f"{many(lines - 1, 'line')} before the header skipped"))
    separator = separator or max(_SEPARATORS, key=line.count)
    names = _names(path, line, separator)
    if separator in _SEPARATOR_NAMES:
        findings.append(Finding("separator", f"columns are separated by {_SEPARATOR_NAMES[separator]}, read as such"))
    body = min(start, len(data))
    below = _below_units(data, body, separator)
    if below is not None:
        findings.append(Finding("unit_row", "a row of units below the header was passed over", rows=1))
        body, lines = below, lines + 1
    comma = separator != "," and _has_decimal_comma(data[body:body + 20_000], separator)
    if comma:
        findings.append(Finding("decimal_comma", "numbers are written with a decimal comma, read as such"))
    if data.find(b"\r\n", 0, body + 1) >= 0:
        findings.append(Finding("crlf", "lines end as on Windows, read as such"))
    return _Layout(names, separator, comma, lines, body)


def _header_line(path: Path, data: bytes) -> tuple[str, str, int, int]:
    """The header line, the separator that a line before it names ("": none does), its number, the byte behind it."""
    start = lines = 0
    separator = ""
    while True:
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        line = data[start:end].decode(errors="replace").strip("\r")
        lines += 1
        before, start = start, end + 1
        if line.lower().startswith("sep=") and len(line) == 5 and line[4] in _SEPARATORS:
            separator = line[4]
        elif line.strip(" ,;\t|") and not line.startswith("#") and not _is_title(line, data, start):
            return line, separator, lines, start
        elif before >= len(data):
            raise TableError(path, "no header row: the file holds comments only")


def _is_title(line: str, data: bytes, start: int) -> bool:
    """A line of words above a header: one cell above rows of several, or words above words above numbers."""
    if any(is_value(cell) for cell in _cells(line)):
        return False
    below = [row for row in data[start:start + 8000].decode(errors="replace").splitlines()[:8] if row.strip(" ,;\t|")]
    rows = [cells for row in below if not is_unit_row(cells := _cells(row))]
    if len(rows) < 2 or len(rows[0]) < 2 or any(is_value(cell) for cell in rows[0]):
        return len(_cells(line)) == 1 and len(rows) > 2 and _is_title(below[0], data, start + len(below[0]))
    return any(is_value(cell) for cell in rows[1])


def _cells(line: str) -> list[str]:
    """Filled cells by the sign that parts most."""
    sign = max(_SEPARATORS, key=line.count)
    return [cell.strip() for cell in line.split(sign) if cell.strip()]


def _below_units(data: bytes, body: int, separator: str) -> int | None:
    """The byte behind a row of units that stands at `body`; None: there is none."""
    end = data.find(b"\n", body)
    cells = data[body:end].decode(errors="replace").strip("\r").split(separator)
    return end + 1 if end > body and len(cells) > 1 and is_unit_row(cells) else None


def _names(path: Path, line: str, separator: str) -> tuple[str, ...]:
    try:
        names = tuple(name.strip() for name in next(csv.reader([line], delimiter=separator)))
    except csv.Error as error:
        raise TableError(path, f"no header row: {error}") from None
    if all(_number(name, False) is not None for name in names):
        raise NoHeader(path, f"no header row: the first line is {line[:40].strip()}; the first line must name the "
                       "columns")
    while names and not names[-1]:
        names = names[:-1]
    return names


def _refuse_twins(path: Path, names: tuple[str, ...]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise TableError(path, f"column {name or '(no name)'} stands {names.count(name)} times in the header: "
                             "allowed once")


def _has_decimal_comma(sample: bytes, separator: str) -> bool:
    cells = sample.decode(errors="replace").replace("\n", separator).split(separator)[:-1]
    with_comma = [cell for cell in cells if "," in cell]
    return bool(with_comma) and all(_number(cell, True) is not None for cell in with_comma)


def _without_cut_row(data: bytes, layout: _Layout, own: bool, findings: list[Finding]) -> bytes:
    end = data.rfind(b"\n") + 1
    tail = data[max(end, layout.body):].strip(b"\r ")
    if not tail:
        return data
    if not own and tail.count(layout.separator.encode()) == len(layout.names) - 1:
        findings.append(Finding("no_last_line_end", "the last line has no line end, but all its fields: it was used",
                                rows=1))
        return data + b"\n"
    findings.append(Finding("cut_row", "the last row was cut off and left out", rows=1))
    return data[:end]


def _regular(data: bytes, layout: _Layout, wanted: list[str], numbers: Collection[str]) -> pl.DataFrame | None:
    """The wanted columns, or None where the table is not so regular that nothing can be overlooked."""
    rows = data.count(b"\n", layout.body)
    quoted = b'"' in data
    if not quoted and data.count(layout.separator.encode(), layout.body) != rows * (len(layout.names) - 1):
        return None
    import polars as pl  # loaded here only: it starts slowly

    schema = {name: pl.Float64() if name in numbers else pl.String() for name in layout.names}
    try:
        frame = pl.read_csv(data, has_header=False, skip_rows=layout.skip_lines, schema=schema,
                            columns=[layout.names.index(name) for name in wanted], separator=layout.separator,
                            decimal_comma=layout.decimal_comma)
    except pl.exceptions.PolarsError:
        return None
    return frame if frame.height == rows or quoted else None


def columns_of(frame: pl.DataFrame, numbers: Collection[str], texts: Collection[str], decimal_comma: bool = False
               ) -> Columns:
    """A frame's columns as a table's. They are taken out of it one by one, so as not to be in memory twice."""
    import polars as pl

    columns: Columns = {}
    for name in frame.columns:
        series = frame.drop_in_place(name)
        if name not in numbers and name not in texts:
            comma = decimal_comma and series.dtype == pl.String
            plain = series.str.replace(",", ".", literal=True) if comma else series
            as_numbers = plain.cast(pl.Float64, strict=False)
            if as_numbers.null_count() == series.null_count():
                series = as_numbers
        columns[name] = _texts(series.to_list()) if series.dtype == pl.String else _finite(series.to_numpy())
    return columns


def _finite(values: NDArray[Any]) -> NDArray[np.float64]:
    """The numbers, infinities unknown."""
    infinite = np.isinf(values)
    return np.where(infinite, np.nan, values) if infinite.any() else values


def _texts(values: Sequence[str | None]) -> NDArray[Any]:
    """Texts without blanks around; equal ones share one object: a million states cost a million references only."""
    shared: dict[str, str] = {}
    array = np.empty(len(values), object)
    array[:] = [shared.setdefault(text, text) if (text := (value or "").strip()) else "" for value in values]
    return array


def _carefully(path: Path, data: bytes, layout: _Layout, wanted: list[str], numbers: Collection[str],
               texts: Collection[str], findings: list[Finding]) -> Columns:
    places = {name: layout.names.index(name) for name in wanted}
    parts: dict[str, list[Any]] = {name: [] for name in wanted}
    wrong = _WrongRows()
    bad: dict[str, _BadCells] = {name: _BadCells() for name in wanted}
    for chunk in _chunks(data, layout, wrong):
        by_place = list(zip(*chunk, strict=True))
        for name, place in places.items():
            cells = by_place[place]
            parts[name].append(_to_floats(cells, layout.decimal_comma, bad[name]) if name in numbers
                               else _texts(cells))
    wrong.tell(path, layout, wanted, parts, findings)
    columns: Columns = {}
    for name in wanted:
        array = np.concatenate(parts[name]) if parts[name] else np.array([], object if name in texts else np.float64)
        if name not in numbers and name not in texts:
            trial = _BadCells()
            as_floats = _to_floats(array.tolist(), layout.decimal_comma, trial)
            array = as_floats if trial.count == 0 else array
        columns[name] = array
        bad[name].tell(name, findings)
    return columns


def _chunks(data: bytes, layout: _Layout, wrong: _WrongRows) -> Iterator[list[list[str]]]:
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(memoryview(data)[layout.body:]), "utf-8", "replace", newline=""),
                        delimiter=layout.separator)
    fields = len(layout.names)
    chunk: list[list[str]] = []
    while (cells := _next_row(reader, layout, wrong)) is not None:
        if len(cells) > fields and not any(cells[fields:]):
            del cells[fields:]
        if len(cells) == fields:
            chunk.append(cells)
        elif any(cell.strip() for cell in cells):
            wrong.add(layout.skip_lines + reader.line_num, f"{len(cells)} fields where the header has {fields}",
                      len(cells))
        if len(chunk) == _CHUNK_ROWS:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _next_row(reader: Any, layout: _Layout, wrong: _WrongRows) -> list[str] | None:
    """The next one that can be taken apart; None: there is none."""
    while True:
        try:
            cells: list[str] | None = next(reader, None)
            return cells
        except csv.Error as error:
            wrong.add(layout.skip_lines + reader.line_num, str(error))


class _WrongRows:
    """Rows whose number of fields is not the header's, or that cannot be taken apart: counted, left out."""

    def __init__(self) -> None:
        self.count = 0
        self.first_line = 0
        self.first_what = ""
        self.first_fields = 0           # 0: it cannot be taken apart

    def add(self, line: int, what: str, fields: int = 0) -> None:
        if self.count == 0:
            self.first_line, self.first_what, self.first_fields = line, what, fields
        self.count += 1

    def tell(self, path: Path, layout: _Layout, wanted: list[str], parts: dict[str, list[Any]],
             findings: list[Finding]) -> None:
        if self.count == 0:
            return
        if wanted and not parts[wanted[0]]:
            comma = "; is the decimal sign a comma? write points, or separate by semicolons"
            more = self.first_fields > len(layout.names)
            raise TableError(path, f"line {self.first_line}: {self.first_what}"
                             f"{comma if layout.separator == ',' and more else ''}")
        findings.append(Finding("wrong_fields", f"{many(self.count)} left out, the first in line {self.first_line} "
                                f"with {self.first_what}", rows=self.count))


class _BadCells:
    """Cells of a numeric column that are no number: counted, emptied."""

    def __init__(self) -> None:
        self.count = 0
        self.example = ""

    def add(self, cell: str) -> None:
        self.example = self.example or cell
        self.count += 1

    def tell(self, name: str, findings: list[Finding]) -> None:
        if self.count:
            findings.append(Finding("not_a_number", f"column {name}: {many(self.count, 'cell')} such as "
                                    f"{self.example[:20]!r} emptied: not a number", name, self.count))


def _to_floats(cells: Collection[str], decimal_comma: bool, bad: _BadCells) -> NDArray[np.float64]:
    out = np.empty(len(cells))
    for index, cell in enumerate(cells):
        value = _number(cell, decimal_comma)
        if value is None:
            bad.add(cell)
        out[index] = np.nan if value is None else value
    return out


def _number(cell: str, decimal_comma: bool) -> float | None:
    """The number, NaN for nothing, None for what is no number."""
    text = cell.strip().strip('"')
    if text.lower() in NOTHING:
        return float("nan")
    if decimal_comma or "," in text:
        text = text.replace(",", ".", 1)
    try:
        return float(text)
    except ValueError:
        return None
