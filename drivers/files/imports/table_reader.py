"""How is a file of any kind read as a raw table? The kind of the file selects its reader."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from topdress.drivers.files.archives import has_time_log, open_archive
from topdress.drivers.files.columns import TIME_TYPE, is_text_column, make_text_column
from topdress.drivers.files.formats.registry import find_format, list_able
from topdress.drivers.files.imports.column_vocabulary import find_subject, fold_column_name
from topdress.drivers.files.imports.import_errors import LogImportError
from topdress.drivers.files.imports.mapping import Source, SourceKind
from topdress.drivers.files.imports.raw_table import RawTable, find_units_in
from topdress.drivers.files.imports.text_table import read_text_table
from topdress.drivers.files.limits import check_file
from topdress.drivers.files.optional_packages import require_extras
from topdress.drivers.files.parquet_limits import check_parquet, check_text_bytes
from topdress.drivers.files.prescriptions.column_words import (
    MAX_UNIT_TEXTS,
    find_unit_columns,
    parse_cell,
)
from topdress.drivers.files.stated_units import ANY_COLUMN, find_text_units, merge_units

if TYPE_CHECKING:
    import polars as pl

# Number of rows that are searched for the first text of a column.
SEARCHED_ROWS = 1000
# Largest number of letters of a unit; longer texts are remarks.
MAX_UNIT_LENGTH = 60


def read_raw_table(path: Path, said: Source | None = None, data: bytes | None = None) -> RawTable:
    """Returns a file of any kind as a raw table.

    Parameters
    ----------
    path : the file or folder.
    said : entries of the import file about reading.
    data : lines of the text at `path`, which replace the whole file.

    Raises
    ------
    LogImportError : the file is no table.
    RefusedInput : the file cannot be opened, in one line.
    OSError : the file cannot be read.
    """
    said = said or Source()
    if data is None:
        # The size is checked before the file is read, because a wrong file may be of any size.
        if not path.exists():
            raise LogImportError(path, "no such file")
        check_file(path)
    return _add_stated_units(
        _read_by_kind(path, said) if data is None else read_text_table(path, said, data)
    )


def _read_by_kind(path: Path, said: Source) -> RawTable:
    kind = said.kind or _find_source_kind(path)
    # A folder is a task set or a shapefile; all other formats are single files.
    if path.is_dir() and kind not in ("isoxml", "shapefile"):
        raise LogImportError(
            path, "a folder: allowed is a file, or the folder of a task (TASKDATA.XML)"
        )
    readers = {one.source_kind: one.read_table for one in list_able("read_table")}
    read = readers[kind]
    assert read is not None
    return read(path, said)


def _add_stated_units(raw: RawTable) -> RawTable:
    """Returns the table with units from a column of units, or from a line above the header."""
    texts: dict[str, list[str]] = {}
    for name, column in raw.columns.items():
        if not is_text_column(column):
            continue
        # A long text is a remark, so its beginning is enough to see that it is no unit.
        first = next(filter(None, column[:SEARCHED_ROWS].tolist()), "")[:MAX_UNIT_LENGTH]
        if first and parse_cell(first) is None:
            kinds = dict.fromkeys(text[:MAX_UNIT_LENGTH] for text in column.tolist() if text)
            # One text more than the limit shows that a column has too many.
            texts[name] = list(islice(kinds, MAX_UNIT_TEXTS + 1))
    stated = merge_units(
        find_text_units(ANY_COLUMN, raw.above, "the lines above the header"),
        find_unit_columns(texts),
    )
    # A unit without a column belongs to the rate, because only rates have ambiguous units.
    units = {
        name: stated.get(name.casefold(), stated.get(ANY_COLUMN))
        for name in raw.names
        if name not in raw.units
        and (subject := find_subject(fold_column_name(name), None)) is not None
        and subject.id == "rate"
    }
    return replace(
        raw,
        units={
            **raw.units,
            **{name: unit.text for name, unit in units.items() if unit is not None},
        },
    )


def _find_source_kind(path: Path) -> SourceKind:
    """Returns the kind of a file. In a folder or a zip a task with time logs comes before points,
    and points before a task without time logs."""
    if path.is_dir() or path.suffix.lower() == ".zip":
        files = open_archive(path)
        shapes = any(name.lower().endswith(".shp") for name in files.names)
        # A worked task has positions of its own, so shapefiles next to it are ignored.
        return "shapefile" if shapes and not has_time_log(files) else "isoxml"
    found = find_format(path, "read_table")
    return "text" if found is None or found.source_kind is None else found.source_kind


def read_parquet_table(path: Path, said: Source) -> RawTable:
    """Returns the table of a Parquet file (extra parquet). Raises LogImportError, MissingExtra."""
    require_extras("Parquet", "parquet")
    import polars as pl

    # The reader allocates memory by the file's own numbers, so they are checked first.
    check_parquet(path)
    try:
        frame = pl.read_parquet(path, use_pyarrow=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise LogImportError(
            path, f"not readable as Parquet: {str(error).splitlines()[0]}"
        ) from None
    if frame.height == 0:
        raise LogImportError(path, "no rows in it")
    # Repeated texts make a small file large in memory.
    check_text_bytes(frame, path)
    columns = {name: _convert_series(frame[name]) for name in frame.columns}
    utc = frozenset(
        name for name, kind in frame.schema.items() if getattr(kind, "time_zone", None) is not None
    )
    source = said.model_copy(update={"kind": "parquet"})
    return RawTable(path, columns, source, find_units_in(columns), 1, utc=utc)


def _convert_series(series: pl.Series) -> NDArray[Any]:
    """Returns a column as numbers, times or texts (n,)."""
    import polars as pl

    if series.dtype.is_numeric() or series.dtype == pl.Boolean:
        return np.array(series.cast(pl.Float64).fill_null(float("nan")).to_numpy(), np.float64)
    if series.dtype in (pl.Date, pl.Datetime):
        micro = series.cast(pl.Datetime("us", getattr(series.dtype, "time_zone", None)))
        # The time zone is dropped after the conversion to UTC, because numpy has none.
        return np.array(micro.dt.timestamp("us").cast(pl.Datetime("us")).to_numpy(), TIME_TYPE)
    return make_text_column(series.cast(pl.String, strict=False).fill_null("").to_list())
