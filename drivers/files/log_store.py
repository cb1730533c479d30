"""How is a run log stored as Parquet? A single file holds columns, sidecar and the findings of the
text's reader.

The format serves seasons of logs: it needs fewer bytes than the text, and is read at once
(docs/format-run-log.md, "Parquet").
"""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import TEXT_COLUMNS
from topdress.control.recordings.finding import Finding
from topdress.drivers.files.atomic_files import find_sidecar, write_atomically
from topdress.drivers.files.columns import Columns, format_csv, is_text_column, make_texts_array
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.limits import BeyondLimits, check_file
from topdress.drivers.files.log_text import format_values
from topdress.drivers.files.optional_packages import require_extras
from topdress.drivers.files.parquet_limits import check_parquet, check_text_bytes
from topdress.drivers.files.run_meta import RunMeta, format_meta_yaml, parse_meta_yaml

if TYPE_CHECKING:
    import polars as pl

# Format of the metadata, a contract.
STORE_FORMAT = "topdress-log-store/1"
STORE_SUFFIXES = frozenset({".parquet", ".pq"})
# Key of topdress's metadata, and the first and last bytes of every Parquet file.
_METADATA_KEY, _PARQUET_MAGIC = "topdress", b"PAR1"
# Largest length of a footer, bytes.
_MAX_FOOTER_BYTES = 64 << 20


class StoredLog(NamedTuple):
    """Holds the contents of a store; columns, `meta` and findings are as in `RunLog`."""

    columns: Columns
    meta: RunMeta | None
    findings: tuple[Finding, ...]


def is_log_store(path: Path) -> bool:
    """Returns whether any version of topdress wrote this Parquet file."""
    # The suffix is tested first, because it is cheaper than reading the file.
    return path.suffix.lower() in STORE_SUFFIXES and _METADATA_KEY.encode() in _read_footer(path)


def write_log_store(
    path: Path, columns: Columns, meta: RunMeta | None, findings: Sequence[Finding] = ()
) -> None:
    """Writes a store, completely or not at all. `columns` are arrays of length n, float64 (NaN:
    unknown) or object (texts). Raises OSError."""
    require_extras("Parquet", "parquet")
    # Sidecar and findings are stored as text, so that any Parquet reader can show them.
    about = {
        "format": STORE_FORMAT,
        "meta": None if meta is None else format_meta_yaml(meta),
        "findings": [list(finding) for finding in findings],
    }
    # The store is built in memory, so that it is written completely or not at all.
    data = io.BytesIO()
    _build_frame(columns).write_parquet(
        data, metadata={_METADATA_KEY: json.dumps(about, ensure_ascii=False)}
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, data.getvalue())


def write_log_text(path: Path, columns: Columns, meta: RunMeta | None) -> None:
    """Writes the contents of a store as a run log of text with its sidecar, each completely or not
    at all. Every number reads back the same, and a log that topdress wrote is the same to the byte.
    Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if meta is not None:
        # The sidecar is written first, so that no log is without one.
        write_atomically(find_sidecar(path), format_meta_yaml(meta))
    write_atomically(path, format_csv(columns, _format_cells))


def _format_cells(name: str, column: NDArray[Any]) -> Sequence[str | None]:
    return list(column) if is_text_column(column) else format_values(name, column.tolist())


def read_log_store(path: Path, only: Collection[str] | None = None) -> StoredLog:
    """Returns a store's contents. `only` names the requested columns (None: all); `time_s` is
    always read. Raises TableError."""
    require_extras("Parquet", "parquet")
    import polars as pl

    try:
        check_file(path)
        # polars would allocate memory by the file's own numbers, so they are checked first.
        check_parquet(path)
        about = read_store_meta(path)
        names = [
            name
            for name in pl.read_parquet_schema(path)
            if only is None or name in only or name == "time_s"
        ]
        frame = pl.read_parquet(path, columns=names)
        check_text_bytes(frame, path)
    # A store is refused like every other table, without repeating its name.
    except BeyondLimits as error:
        raise TableError(path, str(error).removeprefix(f"{path}: ")) from None
    except (pl.exceptions.PolarsError, OSError) as error:
        raise TableError(path, f"not readable as Parquet: {_find_first_line(error)}") from None
    # Dropping each series after its conversion keeps only one copy in memory.
    columns = {name: _convert_series(frame.drop_in_place(name)) for name in names}
    # Readers of a store rely on increasing times and do not check again.
    if "time_s" not in columns or not bool(np.all(np.diff(columns["time_s"]) > 0.0)):
        raise TableError(path, "column time_s: missing, or not strictly increasing")
    return StoredLog(columns, *about)


def read_store_meta(path: Path) -> tuple[RunMeta | None, tuple[Finding, ...]]:
    """Returns sidecar and findings of a store, without reading its columns. Raises TableError,
    OSError."""
    require_extras("Parquet", "parquet")
    import polars as pl

    try:
        stated = json.loads(pl.read_parquet_metadata(path)[_METADATA_KEY])
        if stated["format"] != STORE_FORMAT:
            raise TableError(path, f"key format: value {stated['format']}: allowed {STORE_FORMAT}")
        meta = None if stated["meta"] is None else parse_meta_yaml(stated["meta"])
        return meta, tuple(Finding(*one) for one in stated["findings"])
    except pl.exceptions.PolarsError as error:
        raise TableError(path, f"not readable as Parquet: {_find_first_line(error)}") from None
    except TableError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise TableError(
            path, f"what it says of its log is not readable: {_find_first_line(error)}"
        ) from None


def _find_first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _read_footer(path: Path) -> bytes:
    """Returns the footer of a Parquet file; empty for another file. This check does not need
    polars."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        # The smallest Parquet file has 12 bytes.
        if size < 12:
            return b""
        file.seek(size - 8)
        # The last eight bytes are the length of the footer, and PAR1.
        length, magic = int.from_bytes(file.read(4), "little"), file.read(4)
        if magic == _PARQUET_MAGIC and length <= min(size - 8, _MAX_FOOTER_BYTES):
            file.seek(size - 8 - length)
            return file.read(length)
    return b""


def _build_frame(columns: Columns) -> pl.DataFrame:
    """Returns columns as a data frame. Unknown values become null, as all other readers of Parquet
    expect."""
    import polars as pl

    return pl.DataFrame(
        [
            pl.Series(name, [text or None for text in array.tolist()], pl.String)
            if array.dtype == object
            # Other readers of Parquet expect null, not NaN, for an unknown number.
            else pl.Series(name, array, pl.Float64).fill_nan(None)
            for name, array in columns.items()
        ]
    )


def _convert_series(series: pl.Series) -> NDArray[Any]:
    """Returns a column as texts or numbers (n,)."""
    import polars as pl

    if series.dtype == pl.String or series.name in TEXT_COLUMNS:
        return make_texts_array(series.cast(pl.String).to_list())
    return np.array(series.cast(pl.Float64).fill_null(float("nan")).to_numpy(), np.float64)
