"""How much content does a Parquet file have? Its footer and the headers of its pages state it,
before the reader allocates memory.

The reader (polars) allocates as much memory as the file states, and ends the whole program if the
memory is not available. Footer and headers use Thrift's compact protocol (parquet.thrift of
parquet-format 2.10; thrift-compact-protocol.md).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.drivers.files.limits import (
    MEGABYTE,
    PARQUET_BYTES_LIMIT,
    PARQUET_CELLS_LIMIT,
    PARQUET_COMPRESSION_LIMIT,
    BeyondLimits,
    check_limit,
)
from topdress.drivers.plain_text import PlaceInFile

if TYPE_CHECKING:
    import polars as pl

# First and last bytes of a Parquet file.
PARQUET_MAGIC = b"PAR1"
# Largest length of a footer, and of a page's header, bytes.
MAX_FOOTER_BYTES, MAX_HEADER_BYTES = 16 * MEGABYTE, 64 << 10
# Largest depth of structs within structs, because a damaged footer may nest without end.
MAX_STRUCT_DEPTH = 20
# Ids of fields of the file; a row group uses the id of `ROWS_FIELD` too.
ROWS_FIELD, ROW_GROUPS_FIELD = 3, 4
# Ids of fields of a row group, a column chunk and its metadata.
COLUMNS_FIELD, META_FIELD, VALUES_FIELD, PACKED_FIELD, DATA_PAGE_FIELD, DICTIONARY_PAGE_FIELD = (
    1,
    3,
    5,
    7,
    9,
    11,
)
# This number of cells is permitted however small the file is, because repeated values need hardly
# any bytes.
MAX_UNCHECKED_CELLS = 1_000_000
# Ids of fields of a page's header; each kind of page has its values in field 1.
PAGE_UNPACKED_FIELD, PAGE_PACKED_FIELD, PAGE_KIND_FIELDS = 2, 3, (5, 7, 8)


def check_parquet(path: Path) -> None:
    """Checks a Parquet file before it is read. A damaged file is refused too, because its reader
    may end the program. Raises BeyondLimits, OSError."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - 8))
            tail = file.read(8)
            length = int.from_bytes(tail[:4], "little")
            if tail[4:] != PARQUET_MAGIC or not 0 < length <= min(size - 12, MAX_FOOTER_BYTES):
                raise ValueError
            file.seek(size - 8 - length)
            chunks = _list_column_chunks(_ThriftReader(file.read(length)).read_struct(), size, path)
            values = unpacked = 0
            for chunk in chunks:
                at = min(
                    chunk[DATA_PAGE_FIELD],
                    chunk.get(DICTIONARY_PAGE_FIELD) or chunk[DATA_PAGE_FIELD],
                )
                end = at + chunk[PACKED_FIELD]
                while at < end:
                    file.seek(at)
                    thrift = _ThriftReader(file.read(MAX_HEADER_BYTES))
                    page = thrift.read_struct()
                    values += max(
                        (page[kind].get(1, 0) for kind in PAGE_KIND_FIELDS if kind in page),
                        default=0,
                    )
                    unpacked += page[PAGE_UNPACKED_FIELD]
                    check_limit(PARQUET_CELLS_LIMIT, values, path)
                    check_limit(PARQUET_BYTES_LIMIT, unpacked, path)
                    if min(page[PAGE_UNPACKED_FIELD], page[PAGE_PACKED_FIELD]) < 0:
                        raise ValueError
                    at += thrift.at + page[PAGE_PACKED_FIELD]
    except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, BeyondLimits):
            raise
        raise BeyondLimits(path, "not readable as Parquet: its footer is damaged") from None


def check_text_bytes(frame: pl.DataFrame, path: Path) -> None:
    """Checks the texts of a file after reading; a repeated text is counted once. Raises
    BeyondLimits."""
    import polars as pl

    texts = [column for column in frame.iter_columns() if column.dtype == pl.String]
    size = sum(int(column.str.len_bytes().sum() or 0) for column in texts)
    check_limit(PARQUET_BYTES_LIMIT, size, PlaceInFile(str(path)).go_down("its texts"))


def _list_column_chunks(footer: dict[int, Any], size: int, path: Path) -> list[dict[int, Any]]:
    """Returns the metadata of each column of each row group. Raises BeyondLimits where the metadata
    announce more than the limit, ValueError where they are impossible."""
    groups = footer.get(ROW_GROUPS_FIELD, [])
    chunks = [chunk[META_FIELD] for group in groups for chunk in group.get(COLUMNS_FIELD, [])]
    counts = [footer[ROWS_FIELD], *(group[ROWS_FIELD] for group in groups)]
    values = [chunk[VALUES_FIELD] for chunk in chunks]
    if min(*counts, *values, *(chunk[PACKED_FIELD] for chunk in chunks), 0) < 0:
        raise ValueError
    cells = max(sum(values), *counts, sum(counts[1:]))
    check_limit(PARQUET_CELLS_LIMIT, cells, path)
    if cells > MAX_UNCHECKED_CELLS:
        check_limit(
            PARQUET_COMPRESSION_LIMIT, cells // size, PlaceInFile(str(path)).go_down("a byte")
        )
    return chunks


class _ThriftReader:
    """Reads Thrift's compact protocol. `at` is the position of the next byte."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def read_struct(self, depth: int = 0) -> dict[int, Any]:
        """Returns fields by their ids. Raises ValueError, IndexError."""
        if depth > MAX_STRUCT_DEPTH:
            raise ValueError("nested too deeply")
        found: dict[int, Any] = {}
        number = 0
        while head := self._read_byte():
            # The upper four bits hold the difference to the last id; 0 means that the id follows.
            number = number + (head >> 4) if head >> 4 else self._read_zigzag()
            found[number] = self._read_value(head & 15, depth)
        return found

    def _read_value(self, kind: int, depth: int) -> Any:
        # Types of the protocol: 1 true, 2 false, 3 byte, 4 to 6 i16 to i64, 7 double, 8 binary, 9
        # list, 10 set, 12 struct.
        if kind in (1, 2):
            return kind == 1
        if kind == 3:
            return self._read_byte()
        if kind in (4, 5, 6):
            return self._read_zigzag()
        if kind in (7, 8):
            return self._skip_bytes(8 if kind == 7 else self._read_varint())
        if kind in (9, 10):
            head = self._read_byte()
            count = head >> 4 if head >> 4 < 15 else self._read_varint()
            return [
                self._read_byte() if head & 15 in (1, 2) else self._read_value(head & 15, depth)
                for _ in self._check_count(count)
            ]
        if kind == 12:
            return self.read_struct(depth + 1)
        # Parquet uses no maps.
        raise ValueError(f"type {kind}")

    def _check_count(self, count: int) -> range:
        if count > len(self.data) - self.at:
            raise ValueError("longer than there are bytes")
        return range(count)

    def _read_byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _skip_bytes(self, count: int) -> None:
        self._check_count(count)
        self.at += count

    def _read_varint(self) -> int:
        number = shift = 0
        while True:
            byte = self._read_byte()
            number |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return number
            if shift > 63:
                raise ValueError("a number without an end")

    def _read_zigzag(self) -> int:
        number = self._read_varint()
        # In zigzag encoding the lowest bit is the sign.
        return number >> 1 ^ -(number & 1)
