"""How are text tables (CSV and its relatives) read? Bytes become UTF-8, rows become columns of
texts or numbers.

Rows are read in blocks, so that a million rows are in memory only as numbers and packed texts. Rows
that do not fit are omitted, with a finding. The beginning of header and rows is detected
(`dialect`) or given by the caller.
"""

from __future__ import annotations

import codecs
import csv
import io
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.recordings.finding import Finding, many
from topdress.drivers.files.columns import (
    MAX_BLOCK_ROWS,
    Columns,
    count_rows,
    make_text_column,
    select_rows,
)
from topdress.drivers.files.imports.cell_numbers import parse_number_cells
from topdress.drivers.files.imports.dialect import (
    DELIMITERS,
    SAMPLE_BYTES,
    TextDialect,
    find_dialect,
    find_encoding,
)
from topdress.drivers.files.imports.import_errors import LogImportError, TableError, format_list
from topdress.drivers.files.imports.mapping import Source
from topdress.drivers.files.imports.raw_table import RawTable, make_unique, split_header
from topdress.drivers.files.imports.table_header import find_tag_row
from topdress.drivers.files.limits import LINE_LIMIT, check_text

# Byte order marks of UTF-16.
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def drop_long_lines(data: bytes) -> tuple[bytes, list[Finding]]:
    """Returns the text without lines after the first that are longer than `LINE`, if other lines
    remain, and findings.

    Zero bytes, which a power loss leaves, are not counted; UTF-16 is unchanged.
    """
    # UTF-16 has a zero byte next to each letter, so its lines cannot be measured in bytes.
    long = [] if data.startswith(_UTF16_MARKS) else _find_long_lines(data)
    if not long:
        return data, []
    # The line number is that of an editor, counted from 1.
    starts_at = data.count(b"\n", 0, long[0][0]) + 1
    said = Finding(
        "long_row",
        f"{many(len(long))} left out, the first in line {starts_at} with "
        f"{long[0][1] - long[0][0]:,} bytes: allowed up to {LINE_LIMIT.most:,}",
        rows=len(long),
    )
    # The kept pieces run from the end of each long line to the start of the next.
    ends = [0, *(min(end + 1, len(data)) for _start, end in long)]
    kept = b"".join(
        [
            data[end:start]
            for end, start in zip(ends, [*(start for start, _end in long), len(data)], strict=True)
        ]
    )
    # If nothing but the header would remain, the text is kept, and a later check refuses it.
    return (kept, [said]) if kept.partition(b"\n")[2].strip() else (data, [])


def _find_long_lines(data: bytes) -> list[tuple[int, int]]:
    """Returns the first byte and line end of each long line. A long line has no line end in a half
    as long window, so only such windows are searched."""
    # Half of the limit is the largest step that cannot jump over a long line.
    half, place, found = LINE_LIMIT.most // 2, 0, list[tuple[int, int]]()
    while place + half <= len(data):
        if data.find(b"\n", place, place + half) >= 0:
            place += half
            continue
        # The window lies inside of a long line, so the line is measured in both directions.
        start, end = data.rfind(b"\n", 0, place) + 1, data.find(b"\n", place)
        end = len(data) if end < 0 else end
        # The header is never dropped, because without it no column has a name.
        if start > 0 and end - start - data.count(b"\0", start, end) > LINE_LIMIT.most:
            found.append((start, end))
        # The search continues after the line, in steps of the same length.
        place += half * max(1, (end - place) // half)
    return found


# Largest number of lines of a cell with line breaks, as headers of spreadsheets have. A quote that
# is open for longer would include the rows after it.
MAX_CELL_LINES = 5
# Bytes that may precede a cell.
_CELL_STARTS = b",;\t| "


def find_unclosed_quote(data: bytes) -> int | None:
    """Returns the line (from 1) of a quote that is not closed within a cell's few lines; None
    without such a quote.

    A last line without a line end is ignored, because it was cut.
    """
    # Most files have no quotes, and this test is the fastest.
    if b'"' not in data:
        return None
    opened = 0
    # The last line may be incomplete, so its quote is not evidence.
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        if opened and number - opened > MAX_CELL_LINES:
            return opened
        if b'"' not in line:
            continue
        # An odd number of quotes in a line closes a quote that an earlier line opened.
        if opened:
            opened = 0 if line.count(b'"') % 2 else opened
        elif line.count(b'"') % 2 and _is_opening_quote(line):
            opened = number
    return opened or None


def _is_opening_quote(line: bytes) -> bool:
    """Returns whether a quote is at the beginning of a cell; a quote after a number is the sign for
    inches."""
    return any(
        line[at : at + 1] == b'"' and (at == 0 or line[at - 1] in _CELL_STARTS)
        for at in range(len(line))
    )


# Id of the finding about a missing header.
NO_HEADER_ID = "no_header"
# Findings that an import does not report, because its import file states how the text is written.
UNREPORTED_IDS = frozenset(
    {"utf16", "byte_order_mark", "zero_bytes", "carriage_returns", "encoding", "no_last_line_end"}
)


class NumberCells(NamedTuple):
    """Holds a column's numbers. `values` is (n,), NaN for unknown. `bad` counts the cells that are
    no numbers; `cell` is the first of them."""

    values: NDArray[np.float64]
    bad: int = 0
    cell: str = ""


CellColumn = NumberCells | NDArray[Any]


def convert_to_utf8(
    path: Path, data: bytes, said: str | None = None, whole: bool = True
) -> tuple[bytes, str, list[Finding]]:
    """Returns a text in UTF-8 with line feeds, its encoding, and findings.

    Parameters
    ----------
    path : the file, for messages.
    data : its bytes.
    said : the encoding, where it is known.
    whole : False for the beginning of a file, which may end within a pair of quotes.

    Raises
    ------
    TableError : the text is empty, or a quote is not closed.
    BeyondLimits : the text is too large.
    """
    # The last line is ignored, because it may be cut inside a letter.
    encoding = said or find_encoding(data[: data.rfind(b"\n") + 1] or data)
    findings: list[Finding] = []
    if encoding.lower() not in ("utf-8", "utf8"):
        try:
            # An encoding named by the user must not lose bytes silently; a guessed encoding may.
            data = data.decode(encoding, errors="replace" if said else "ignore").encode()
        except LookupError:
            raise LogImportError(
                path,
                f"source.encoding {encoding}: not known; allowed e.g. utf-8, utf-16, latin-1, "
                "cp1252, gb18030",
            ) from None
        if encoding.startswith("utf-16"):
            findings.append(Finding("utf16", "the file is UTF-16 text, read as such"))
        elif encoding == "utf-8-sig":
            findings.append(
                Finding(
                    "byte_order_mark",
                    "a byte order mark before the first column's name was skipped",
                )
            )
        else:
            findings.append(Finding("encoding", f"the file is not UTF-8: read as {encoding}"))
    # The mark may remain after a conversion, and would become part of the first name.
    data = data.removeprefix(codecs.BOM_UTF8)
    # Long lines are dropped before the other checks, whose time grows with the length of a line.
    data, long = drop_long_lines(data)
    findings = [*long, *findings]
    if b"\0" in data:
        data = data.replace(b"\0", b"")
        findings.append(
            Finding("zero_bytes", "zero bytes, as a power loss leaves them, were skipped")
        )
    check_text(data, str(path))
    if not data.strip():
        raise TableError(path, "the file is empty")
    # Only old Macintosh programs end lines with carriage returns.
    if b"\n" not in data and b"\r" in data:
        data = data.replace(b"\r", b"\n")
        findings.append(
            Finding("carriage_returns", "lines end with carriage returns only, read as such")
        )
    line = find_unclosed_quote(data) if whole else None
    if line is not None:
        raise TableError(
            path, f"line {line}: a quote is opened and not closed: allowed are pairs of quotes"
        )
    return data, encoding, findings


def drop_cut_row(
    data: bytes, body: int, sign: str, width: int, own: bool = False
) -> tuple[bytes, list[Finding]]:
    """Returns the text without an incomplete last row, and findings. `body` is the position of the
    rows. `own` means that the writer ends every row with a line end."""
    end = data.rfind(b"\n") + 1
    # The body may begin after the last line end in a file with a header only.
    tail = data[max(end, body) :].strip(b"\r ")
    if not tail:
        return data, []
    # A writer of another program may omit the last line end, so a row with all fields is complete.
    if not own and tail.count(sign.encode()) >= width - 1:
        said = "the last line has no line end, but all its fields: it was used"
        return data + b"\n", [Finding("no_last_line_end", said, rows=1)]
    return data[:end], [Finding("cut_row", "the last row was cut off and left out", rows=1)]


def read_cell_columns(
    path: Path,
    data: bytes,
    body: int,
    sign: str,
    names: Sequence[str],
    *,
    above: int,
    wanted: Collection[str] | None = None,
    numbers: Collection[str] = (),
    decimal_comma: bool = False,
) -> tuple[dict[str, CellColumn], list[Finding]]:
    """Returns the rows from byte `body` on as columns, and findings about omitted rows: rows with
    another number of cells than the header, or unreadable rows.

    Parameters
    ----------
    path : the file, for messages.
    data : its bytes in UTF-8.
    body : position of the first row, bytes.
    sign : separator of cells.
    names : names of the columns.
    above : number of lines before the rows.
    wanted : the columns to be read; None: all.
    numbers : the columns that are read as numbers; all others are texts.
    decimal_comma : whether numbers have a decimal comma.

    Raises
    ------
    TableError : no row has as many cells as there are names.
    """
    wanted = [name for name in names if wanted is None or name in wanted]
    # Places of cells are computed once, because the loop below runs for every block.
    places = {name: place for place, name in enumerate(names)}
    rows = _EvenRows(data, body, sign, len(names), above)
    blocks: dict[str, list[CellColumn]] = {name: [] for name in wanted}
    for block in rows.iter_blocks():
        # The block is transposed, because columns are converted much faster than rows.
        columns = list(zip(*block, strict=True))
        for name, parts in blocks.items():
            cells = columns[places[name]]
            if name in numbers:
                found = parse_number_cells(cells, decimal_comma)
                parts.append(NumberCells(found.values, found.bad, found.cell))
            else:
                parts.append(make_text_column(cells))
    # A file in which no row fits has the wrong separator or decimal mark.
    if rows.wrong and not rows.count:
        line, what, fields = rows.wrong[0]
        comma = "; is the decimal sign a comma? write points, or separate by semicolons"
        raise TableError(
            path,
            f"line {line}: {what}{comma if sign == ',' and fields > len(names) else ''}",
        )
    return {
        name: _join_blocks(parts, name in numbers) for name, parts in blocks.items()
    }, rows.left_out_findings


class _EvenRows:
    """Reads rows with as many cells as the header. `wrong` holds line, fault and number of cells of
    the other rows."""

    def __init__(self, data: bytes, body: int, sign: str, width: int, above: int) -> None:
        self._reader = csv.reader(
            # A view of the bytes avoids a second copy of the whole file.
            io.TextIOWrapper(io.BytesIO(memoryview(data)[body:]), "utf-8", "replace", newline=""),
            delimiter=sign,
        )
        self._width, self._above = width, above
        self.count, self.wrong = 0, list[tuple[int, str, int]]()

    def iter_blocks(self) -> Iterator[list[list[str]]]:
        """Yields blocks of rows."""
        block: list[list[str]] = []
        for cells in self._iter_rows():
            if len(cells) != self._width and not self._trim_row(cells):
                continue
            block.append(cells)
            # Full blocks are yielded at once, so that memory holds one block of Python objects.
            if len(block) == MAX_BLOCK_ROWS:
                self.count += len(block)
                yield block
                block = []
        self.count += len(block)
        if block:
            yield block

    def _iter_rows(self) -> Iterator[list[str]]:
        """Yields all rows; continues after an error."""
        while True:
            try:
                yield from self._reader
                return
            # The reader continues with the line after the faulty line.
            except csv.Error as error:
                self.wrong.append((self._above + self._reader.line_num, str(error), 0))

    def _trim_row(self, cells: list[str]) -> bool:
        """Returns whether the row has the header's length, after removing empty cells after its
        last."""
        # Some programs end every row with a separator, which makes an empty last cell.
        if len(cells) > self._width and not any(cells[self._width :]):
            del cells[self._width :]
            return True
        # Blank rows are not reported, because many files separate parts by them.
        if any(cell.strip() for cell in cells):
            self.wrong.append(
                (
                    self._above + self._reader.line_num,
                    f"{len(cells)} fields where the header has {self._width}",
                    len(cells),
                )
            )
        return False

    @property
    def left_out_findings(self) -> list[Finding]:
        """Returns a finding about the omitted rows."""
        if not self.wrong:
            return []
        line, what, _ = self.wrong[0]
        return [
            Finding(
                "wrong_fields",
                f"{many(len(self.wrong))} left out, the first in line {line} with {what}",
                rows=len(self.wrong),
            )
        ]


def _join_blocks(parts: Sequence[CellColumn], is_numeric: bool) -> CellColumn:
    """Returns the blocks of a column as one column."""
    numeric = [part for part in parts if isinstance(part, NumberCells)]
    if is_numeric:
        # Empty lists cannot be concatenated, so a table without rows is a special case.
        return NumberCells(
            np.concatenate([part.values for part in numeric]) if numeric else np.empty(0),
            sum(part.bad for part in numeric),
            next((part.cell for part in numeric if part.bad), ""),
        )
    texts = [part for part in parts if not isinstance(part, NumberCells)]
    return np.concatenate(texts) if texts else make_text_column([])


def read_text_table(path: Path, said: Source, data: bytes | None = None) -> RawTable:
    """Returns a table of any dialect, or of the dialect that `said` describes.

    Parameters
    ----------
    path : the file.
    said : entries of the import file about reading.
    data : lines of the file, which replace the whole file.

    Raises
    ------
    TableError : the text is no table.
    BeyondLimits : the text is too large.
    OSError : the file cannot be read.
    """
    data, encoding, findings = convert_to_utf8(
        path, path.read_bytes() if data is None else data, said.encoding
    )
    # Only the beginning is examined, because the dialect does not change within a file.
    sample = data[:SAMPLE_BYTES].decode(errors="replace")
    # The sample must not end inside of a line, which would look like a row with missing cells.
    if len(data) > SAMPLE_BYTES:
        sample = sample[: sample.rfind("\n")]
    try:
        dialect = find_dialect(str(path), sample, encoding.removesuffix("-sig"), said)
    except csv.Error as error:
        raise LogImportError(path, f"not readable as a table: {error}") from None
    layout = dialect.layout
    # Columns get neutral names, and the question about their meaning stays open.
    if layout.header < 0 and not said.names:
        first = dialect.rows[layout.body]
        tags = find_tag_row(dialect.rows[: layout.body], len(first))
        plain = tuple(f"c{k + 1}" for k in range(len(first)))
        said = said.model_copy(update={"names": tags or plain})
        if tags is None:
            findings.append(
                Finding(
                    NO_HEADER_ID,
                    f"no header row: the first row is {format_list(first, 4)}: its columns are "
                    f"called {format_list(plain, 4)}: say in source.names what they are",
                )
            )
    names, units = _split_header_cells(dialect, said)
    columns, odd = _read_text_columns(path, data, dialect, names)
    # The dialect is recorded, so that the next reading needs no detection.
    found = said.model_copy(
        update={
            "kind": "text",
            "encoding": dialect.encoding,
            "delimiter": dialect.delimiter,
            "decimal": "," if dialect.decimal_comma else ".",
            "title_rows": max(layout.header, 0) if not said.names else layout.body,
            "unit_row": layout.units is not None,
        }
    )
    above = tuple(" ".join(cells) for cells in dialect.rows[: max(layout.header, 0)])
    return RawTable(
        path,
        columns,
        found,
        units,
        layout.body + 1,
        tuple(one for one in (*findings, *odd) if one.id not in UNREPORTED_IDS),
        above,
    )


def _split_header_cells(dialect: TextDialect, said: Source) -> tuple[list[str], dict[str, str]]:
    # Names from the import file replace the header.
    if said.names:
        return make_unique(list(said.names)), {}
    layout = dialect.layout
    return split_header(
        # Some programs write the header as a comment.
        [cell.lstrip("#").strip() for cell in dialect.rows[layout.header]],
        None if layout.units is None else dialect.rows[layout.units],
    )


def _read_text_columns(
    path: Path, data: bytes, dialect: TextDialect, names: list[str]
) -> tuple[Columns, list[Finding]]:
    """Returns columns of texts without surrounding blanks, and without empty rows."""
    start = _find_line_start(data, dialect.layout.body)
    # Several blanks between cells count as one separator.
    if dialect.delimiter == "blank":
        data, start = b"\n".join(b" ".join(line.split()) for line in data[start:].split(b"\n")), 0
    sign = DELIMITERS[dialect.delimiter]
    data, cut = drop_cut_row(data, start, sign, len(names))
    cells, odd = read_cell_columns(path, data, start, sign, names, above=dialect.layout.body)
    columns = {
        name: np.strings.strip(column)
        for name, column in cells.items()
        if not isinstance(column, NumberCells)
    }
    # Rows with only separators come from spreadsheets that saved empty rows.
    filled = np.zeros(count_rows(columns), np.bool_)
    for column in columns.values():
        filled |= column != ""
    if not filled.any():
        raise LogImportError(path, "no rows below the header")
    return columns if filled.all() else select_rows(columns, filled), [*cut, *odd]


def _find_line_start(data: bytes, line: int) -> int:
    """Returns the position of the first byte of a line, counted from 0."""
    place = 0
    for _ in range(line):
        end = data.find(b"\n", place)
        if end < 0:
            return len(data)
        place = end + 1
    return place
