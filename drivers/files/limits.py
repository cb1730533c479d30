"""How much of a file is read? A table lists the limits, and every file is checked before a reader
opens it.

docs/limits.md shows the table, and a test compares both. A file beyond a limit is refused in a line
with its name, its size and the limit, without unpacking.
"""

from __future__ import annotations

import json
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from topdress.drivers.plain_text import PlaceInFile, RefusedInput

# Number of bytes of a megabyte.
MEGABYTE = 1 << 20


class Limit(NamedTuple):
    """Holds a limit. `what` is the kind of file, for the page, and `most` the limit in `unit`."""

    what: str
    most: int
    unit: str


CONFIG_LIMIT = Limit("configuration, settings, weather (YAML, CSV)", 2_000_000, "bytes")
TEXT_LIMIT = Limit(
    "run log, table, bench table, plant list as text (CSV and its relatives)",
    1024 * MEGABYTE,
    "bytes",
)
COLUMNS_LIMIT = Limit("columns of a table", 2_000, "columns")
LINE_LIMIT = Limit("line of a text table", 128 << 10, "bytes")
JSON_LIMIT = Limit("GeoJSON", 256 * MEGABYTE, "bytes")
DIGITS_LIMIT = Limit("whole number in JSON", 300, "digits")
XML_LIMIT = Limit(
    "task file of ISO 11783 (TASKDATA.XML and all that it names); all those of a zip",
    64 * MEGABYTE,
    "bytes",
)
KML_LIMIT = Limit("KML, in a KMZ too", 64 * MEGABYTE, "bytes")
TAGS_LIMIT = Limit("XML of any kind", 2_000_000, "tags")
GEOPACKAGE_LIMIT = Limit("GeoPackage; what one of its layers gives", 256 * MEGABYTE, "bytes")
RASTER_LIMIT = Limit("GeoTIFF", 256 * MEGABYTE, "bytes")
RASTER_CELLS_LIMIT = Limit(
    "cells of a GeoTIFF in all its bands, those without a value included", 10_000_000, "cells"
)
CROSSINGS_LIMIT = Limit("places where outlines of a map cross themselves", 1_000, "crossings")
# The repair of an outline with 36 000 corners takes 1.5 s, with 200 000 corners 7 s.
TOUCHES_LIMIT = Limit("places where one outline of a map touches itself", 10_000, "places")
# Zones that were drawn or simplified separately cross only at corners of their borders.
SHARED_CROSSINGS_LIMIT = Limit(
    "places where outlines of different zones of a map cross, beyond two for each corner",
    20_000,
    "crossings",
)
NEAR_EDGES_LIMIT = Limit(
    "pairs of edges of a map's large outlines whose extents meet", 2_000_000, "pairs"
)
OVERLAPS_LIMIT = Limit("pairs of zones of a map that overlap", 5_000, "pairs")
PARQUET_CELLS_LIMIT = Limit("cells of a Parquet file", 50_000_000, "cells")
PARQUET_BYTES_LIMIT = Limit(
    "Parquet, unpacked; its texts as they are read", 1024 * MEGABYTE, "bytes"
)
# A log of a machine that stands all day needs some 30, because only its times change.
PARQUET_COMPRESSION_LIMIT = Limit(
    "cells of a Parquet file for each of its bytes, beyond the first million", 200, "cells"
)
YAML_NODES_LIMIT = Limit(
    "nodes of a YAML file, aliases each time that they are used", 100_000, "nodes"
)
REFERENCES_LIMIT = Limit("files that a task file names, each once", 1_000, "files")
SHAPEFILE_LIMIT = Limit("shapefile: each of .shp, .shx, .dbf", 512 * MEGABYTE, "bytes")
SIDE_FILE_LIMIT = Limit("side file of a shapefile (.prj, .cpg and the like)", 1 * MEGABYTE, "bytes")
ZIP_ENTRIES_LIMIT = Limit("entries of a zip", 5_000, "entries")
ZIP_UNPACKED_LIMIT = Limit("zip, unpacked altogether", 1024 * MEGABYTE, "bytes")
WORKBOOK_LIMIT = Limit("Excel workbook, unpacked altogether", 256 * MEGABYTE, "bytes")
SHEET_CELLS_LIMIT = Limit(
    "cells of a sheet, empty ones between others included", 16_777_216, "cells"
)
RESUME_LIMIT = Limit(
    "what is kept of a job next to its log (.resume.json)", 128 * MEGABYTE, "bytes"
)
OTHER_FILES_LIMIT = Limit(
    "any other file (Parquet, recordings of devices, ...)", 1024 * MEGABYTE, "bytes"
)

# The order is that of the page.
FILE_LIMITS = (
    CONFIG_LIMIT,
    TEXT_LIMIT,
    COLUMNS_LIMIT,
    LINE_LIMIT,
    JSON_LIMIT,
    DIGITS_LIMIT,
    XML_LIMIT,
    KML_LIMIT,
    TAGS_LIMIT,
    GEOPACKAGE_LIMIT,
    RASTER_LIMIT,
    RASTER_CELLS_LIMIT,
    CROSSINGS_LIMIT,
    TOUCHES_LIMIT,
    SHARED_CROSSINGS_LIMIT,
    NEAR_EDGES_LIMIT,
    OVERLAPS_LIMIT,
    PARQUET_CELLS_LIMIT,
    PARQUET_BYTES_LIMIT,
    PARQUET_COMPRESSION_LIMIT,
    YAML_NODES_LIMIT,
    REFERENCES_LIMIT,
    SHAPEFILE_LIMIT,
    SIDE_FILE_LIMIT,
    ZIP_ENTRIES_LIMIT,
    ZIP_UNPACKED_LIMIT,
    WORKBOOK_LIMIT,
    SHEET_CELLS_LIMIT,
    RESUME_LIMIT,
    OTHER_FILES_LIMIT,
)

# Limits of files that are no format of their own.
_LIMIT_OF_SUFFIX = {
    **dict.fromkeys((".yaml", ".yml"), CONFIG_LIMIT),
    **dict.fromkeys((".shx", ".dbf"), SHAPEFILE_LIMIT),
    **dict.fromkeys((".prj", ".cpg", ".qpj"), SIDE_FILE_LIMIT),
}
# Suffixes of the files that a reader of a shapefile opens too.
_SIDE_SUFFIXES = (".shx", ".dbf", ".prj", ".cpg")
# Suffixes of file formats that are zips.
_ZIP_SUFFIXES = (".zip", ".kmz", ".xlsx", ".xlsm", ".xlsb", ".ods")
# Compressions whose unpacked size can be measured before unpacking.
_ZIP_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
# Bit 0 of a zip entry's flags (APPNOTE.TXT, 4.4.4).
_ENCRYPTED_FLAG = 0x1
# In a quoted cell, separators do not separate columns.
_QUOTED_CELL = re.compile(rb'"[^"]*"')


# Errors that a damaged, unusual or encrypted zip raises (RuntimeError: a password, a version, a
# compression).
DAMAGED_ZIP = (zipfile.BadZipFile, zlib.error, struct.error, RuntimeError, EOFError)


class BeyondLimits(RefusedInput):
    """Reports a file that is larger, or has more content, than the limit, in one line."""


def check_limit(limit: Limit, found: int, label: PlaceInFile | Path | str) -> None:
    """Refuses an amount beyond a limit. Raises BeyondLimits."""
    if found > limit.most:
        raise BeyondLimits(
            label,
            "{found}: allowed up to {most}",
            found=_format_amount(found, limit.unit),
            most=_format_amount(limit.most, limit.unit),
        )


def check_file(path: Path) -> None:
    """Checks a file, a folder of a task or a zip against the table, with the companion files that a
    reader opens. A missing file is reported by its reader.

    Raises
    ------
    BeyondLimits : the file is too large.
    OSError : the file cannot be read.
    """
    if path.is_dir():
        for number, file in enumerate(_iter_task_files(path), start=1):
            check_limit(ZIP_ENTRIES_LIMIT, number, str(path))
            _check_size(file.suffix, file.stat().st_size, str(file))
        return
    if not path.is_file():
        if path.exists():
            # Reading a pipe may never end.
            raise BeyondLimits(path, "a pipe or a device: allowed is a file")
        return
    if path.suffix.lower() in _ZIP_SUFFIXES and zipfile.is_zipfile(path):
        _check_zip(path)
    else:
        _check_size(path.suffix, path.stat().st_size, str(path))
    if path.suffix.lower() == ".shp":
        for suffix in _SIDE_SUFFIXES:
            for side_file in {path.with_suffix(suffix), path.with_suffix(suffix.upper())}:
                if side_file.is_file():
                    _check_size(suffix, side_file.stat().st_size, str(side_file))


def check_text(data: bytes, label: str) -> None:
    """Checks the beginning of a text table for an endless line or header. Raises BeyondLimits."""
    check_limit(TEXT_LIMIT, len(data), label)
    lines = data[:MEGABYTE].replace(b"\r", b"\n").split(b"\n")
    check_limit(
        LINE_LIMIT, max(map(len, lines)), PlaceInFile(label).go_down("one of its first lines")
    )
    for line in [_QUOTED_CELL.sub(b"", one) for one in lines if one][:50]:
        for sign in (b",", b";", b"\t", b"|"):
            check_limit(COLUMNS_LIMIT, line.count(sign), label)


def read_json(path: Path) -> Any:
    """Returns the data of a JSON file with or without a byte order mark. Raises ValueError (without
    the path) also for deep nesting and endless integers; OSError."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ValueError("a pipe or a device: allowed is a file")
    size = path.stat().st_size
    if size > JSON_LIMIT.most:
        raise ValueError(
            f"{_format_amount(size, JSON_LIMIT.unit)}: allowed up to "
            f"{_format_amount(JSON_LIMIT.most, JSON_LIMIT.unit)}"
        )
    try:
        return json.loads(path.read_bytes().decode("utf-8-sig"), parse_int=_parse_limited_int)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _check_zip(path: Path) -> None:
    """Checks a zip by its own directory, because its readers unpack no more of an entry than the
    directory states."""
    whole = ZIP_UNPACKED_LIMIT if path.suffix.lower() in (".zip", ".kmz") else WORKBOOK_LIMIT
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (*DAMAGED_ZIP, ValueError):
        # Its reader reports the damage.
        # The reader reports that the file is no zip.
        return
    check_limit(ZIP_ENTRIES_LIMIT, len(entries), str(path))
    check_limit(
        whole, sum(entry.file_size for entry in entries), PlaceInFile(str(path)).go_down("unpacked")
    )
    check_limit(
        XML_LIMIT,
        sum(entry.file_size for entry in entries if entry.filename.lower().endswith(".xml"))
        if whole is ZIP_UNPACKED_LIMIT
        else 0,
        PlaceInFile(str(path)).go_down("task files"),
    )
    seen: set[str] = set()
    for entry in entries:
        label = f"{path}/{entry.filename}"
        if entry.filename in seen:
            raise BeyondLimits(label, "stands twice in the zip: allowed once")
        seen.add(entry.filename)
        if entry.flag_bits & _ENCRYPTED_FLAG:
            raise BeyondLimits(label, "encrypted: allowed is a zip without a password")
        if entry.compress_type not in _ZIP_METHODS:
            raise BeyondLimits(
                label,
                "compression {number}: allowed are stored and deflated",
                number=entry.compress_type,
            )
        if whole is ZIP_UNPACKED_LIMIT:
            _check_size(Path(entry.filename).suffix, entry.file_size, label)


def _check_size(suffix: str, size: int, label: str) -> None:
    # The formats name their limits, which are defined here.
    from topdress.drivers.files.formats.registry import list_formats

    suffix = suffix.lower()
    limits = {ending: one.limit for one in list_formats() for ending in one.endings}
    check_limit({**limits, **_LIMIT_OF_SUFFIX}.get(suffix, OTHER_FILES_LIMIT), size, label)


def _iter_task_files(folder: Path) -> Iterator[Path]:
    """Yields the files of a task's folder, and of TASKDATA in that folder."""
    for file in folder.iterdir():
        if file.is_file():
            yield file
        elif file.is_dir() and file.name.lower() == "taskdata":
            yield from (inner for inner in file.iterdir() if inner.is_file())


def _parse_limited_int(text: str) -> int:
    """Returns an integer of JSON. Raises ValueError for too many digits."""
    if len(text) > DIGITS_LIMIT.most:
        raise ValueError(f"a whole number of {len(text)} digits: allowed up to {DIGITS_LIMIT.most}")
    return int(text)


def _format_amount(number: int, unit: str) -> str:
    if unit == "bytes":
        return f"{number / MEGABYTE:.0f} MB" if number >= 10 * MEGABYTE else f"{number} bytes"
    return f"{number} {unit}"
