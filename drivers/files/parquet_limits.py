"""How much does a Parquet file hold, by its footer and the headers of its pages, before its reader
allocates memory for it?

The reader (polars) asks for as much memory as the file says, and ends the whole program where there
is none. Both are in Thrift's compact protocol (parquet.thrift of parquet-format 2.10;
thrift-compact-protocol.md).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from topdress.drivers.files.limits import (
    MB,
    PARQUET_BYTES,
    PARQUET_CELLS,
    PARQUET_PACKED,
    BeyondLimits,
    held_to,
)
from topdress.drivers.plain_text import PlaceInFile

if TYPE_CHECKING:
    import polars as pl

# First and last bytes of a Parquet.
MAGIC = b"PAR1"
# Bytes of a footer, and of a page's header.
LONGEST_FOOTER, LONGEST_HEADER = 16 * MB, 64 << 10
# Structs within structs: a damaged footer may nest without end.
DEEPEST = 20
# Ids of fields of the file; `ROWS` of a row group too.
ROWS, ROW_GROUPS = 3, 4
# Ids of fields of a row group, a column chunk and its metadata.
COLUMNS, META, VALUES, PACKED, DATA_PAGE, DICTIONARY_PAGE = 1, 3, 5, 7, 9, 11
# So many cells of a single value cost next to nothing, however small the file.
FREE_CELLS = 1_000_000
# Ids of fields of a page's header; each kind of page has its values in field 1.
PAGE_UNPACKED, PAGE_PACKED, PAGE_KINDS = 2, 3, (5, 7, 8)


def check_parquet(path: Path) -> None:
    """Checks a Parquet file before it is read. A damaged file is refused too: its reader may end
    the program. Raises BeyondLimits, OSError."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - 8))
            tail = file.read(8)
            length = int.from_bytes(tail[:4], "little")
            if tail[4:] != MAGIC or not 0 < length <= min(size - 12, LONGEST_FOOTER):
                raise ValueError
            file.seek(size - 8 - length)
            chunks = _column_chunks(_Thrift(file.read(length)).struct(), size, path)
            values = unpacked = 0
            for chunk in chunks:
                at = min(chunk[DATA_PAGE], chunk.get(DICTIONARY_PAGE) or chunk[DATA_PAGE])
                end = at + chunk[PACKED]
                while at < end:
                    file.seek(at)
                    thrift = _Thrift(file.read(LONGEST_HEADER))
                    page = thrift.struct()
                    values += max(
                        (page[kind].get(1, 0) for kind in PAGE_KINDS if kind in page), default=0
                    )
                    unpacked += page[PAGE_UNPACKED]
                    held_to(PARQUET_CELLS, values, path)
                    held_to(PARQUET_BYTES, unpacked, path)
                    if min(page[PAGE_UNPACKED], page[PAGE_PACKED]) < 0:
                        raise ValueError
                    at += thrift.at + page[PAGE_PACKED]
    except (ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, BeyondLimits):
            raise
        raise BeyondLimits(path, "not readable as Parquet: its footer is damaged") from None


def check_texts(frame: pl.DataFrame, path: Path) -> None:
    """Checks the texts of a file as it was read: a text is in it once, however many rows have
    it. Raises BeyondLimits."""
    import polars as pl

    texts = [column for column in frame.iter_columns() if column.dtype == pl.String]
    size = sum(int(column.str.len_bytes().sum() or 0) for column in texts)
    held_to(PARQUET_BYTES, size, PlaceInFile(str(path)).go_down("its texts"))


def _column_chunks(footer: dict[int, Any], size: int, path: Path) -> list[dict[int, Any]]:
    """Returns the metadata of each column of each row group. Raises BeyondLimits where it
    announces more than is read, ValueError where it is impossible."""
    groups = footer.get(ROW_GROUPS, [])
    chunks = [chunk[META] for group in groups for chunk in group.get(COLUMNS, [])]
    counts = [footer[ROWS], *(group[ROWS] for group in groups)]
    values = [chunk[VALUES] for chunk in chunks]
    if min(*counts, *values, *(chunk[PACKED] for chunk in chunks), 0) < 0:
        raise ValueError
    cells = max(sum(values), *counts, sum(counts[1:]))
    held_to(PARQUET_CELLS, cells, path)
    if cells > FREE_CELLS:
        held_to(PARQUET_PACKED, cells // size, PlaceInFile(str(path)).go_down("a byte"))
    return chunks


class _Thrift:
    """Reads Thrift's compact protocol. `at`: the byte behind what was read."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """Returns fields by their ids. Raises ValueError, IndexError."""
        if depth > DEEPEST:
            raise ValueError("nested too deeply")
        found: dict[int, Any] = {}
        number = 0
        while head := self._byte():
            # The upper four bits hold the step from the last id; 0: the id follows.
            number = number + (head >> 4) if head >> 4 else self._whole()
            found[number] = self._value(head & 15, depth)
        return found

    def _value(self, kind: int, depth: int) -> Any:
        # Types of the protocol: true, false; byte; i16 to i64; double; binary; list, set; struct.
        if kind in (1, 2):
            return kind == 1
        if kind == 3:
            return self._byte()
        if kind in (4, 5, 6):
            return self._whole()
        if kind in (7, 8):
            return self._skip(8 if kind == 7 else self._varying())
        if kind in (9, 10):
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varying()
            return [
                self._byte() if head & 15 in (1, 2) else self._value(head & 15, depth)
                for _ in self._each(count)
            ]
        if kind == 12:
            return self.struct(depth + 1)
        raise ValueError(f"type {kind}")  # maps do not occur

    def _each(self, count: int) -> range:
        if count > len(self.data) - self.at:
            raise ValueError("longer than there are bytes")
        return range(count)

    def _byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1]

    def _skip(self, count: int) -> None:
        self._each(count)
        self.at += count

    def _varying(self) -> int:
        number = shift = 0
        while True:
            byte = self._byte()
            number |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return number
            if shift > 63:
                raise ValueError("a number without an end")

    def _whole(self) -> int:
        number = self._varying()
        # Zigzag: the lowest bit is the sign.
        return number >> 1 ^ -(number & 1)
