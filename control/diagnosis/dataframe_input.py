"""Converts data frames, dictionaries, records and arrays from a notebook to the columns of a run
log.

The module imports neither pandas nor polars: an object with named columns is a table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from topdress.control.diagnosis.result import load_notebook_module
from topdress.control.log_row import COLUMNS, TEXT_COLUMNS
from topdress.control.machine.machine import Machine

Columns = dict[str, npt.NDArray[Any]]


class DataFrame(Protocol):
    """A data frame of pandas, polars or another library with columns by name."""

    @property
    def columns(self) -> Any: ...

    def __getitem__(self, name: Any, /) -> Any: ...


# Log in a notebook: a data frame, columns by name, rows by name, or an array with fields.
LogTable = DataFrame | Mapping[str, Any] | Sequence[Mapping[str, Any]] | npt.NDArray[Any]
# Similarity of two names above which one is a misspelling: one wrong letter of ten, or two
# exchanged, leave 0.9 of the letters (difflib's ratio).
MIN_NAME_SIMILARITY = 0.85

TIME_COLUMN = "time_s"
COUNT_COLUMNS_S = {
    "time_ms": 1e-3,
    "time_us": 1e-6,
    "time_ns": 1e-9,
    "time_min": 60.0,
    "t_s": 1.0,
    "t_ms": 1e-3,
    # Names of counted times in other programs, with their unit in seconds.
    "t": 1.0,
    "time": 1.0,
    "seconds": 1.0,
    "milliseconds": 1e-3,
}
DATE_COLUMNS = ("time", "timestamp", "datetime", "date", "utc", "index")
ALLOWED_TEXT = (
    "allowed: a pandas or polars DataFrame, a dict of equally long columns, a list of "
    "dicts, or an array with "
    "named fields"
)


def load_machine(machine: Machine | str) -> Machine:
    """Return a machine, or load the machine file of a path or a shipped name. Raises ValueError."""
    if isinstance(machine, Machine):
        return machine
    found: Machine = load_notebook_module().load_named_machine(machine)
    return found


def name_frame_library(data: LogTable) -> str:
    """Return the library of the log's data frame, "pandas" or "polars"; else ""."""
    library = type(data).__module__.partition(".")[0]
    return library if library in ("pandas", "polars") else ""


def find_misspelt_columns(columns: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each column whose name is nearly that of a missing column of the run
    log."""
    missing = [name for name in COLUMNS if name not in columns]
    found = []
    for name in columns:
        nearest = (
            [] if name in COLUMNS else get_close_matches(name, missing, 1, MIN_NAME_SIMILARITY)
        )
        found += [
            f"column {name} is no column of a run log and is taken as a further variable: "
            f"did you mean {nearest[0]}?"
            for _ in nearest
        ]
    return found


def read_columns(data: LogTable) -> Columns:
    """Return columns (n,) by name: float64 with NaN for missing values, texts as objects; `time_s`
    in seconds.

    data : a table with named columns. A column `time_ms` (`time_us`, `time_min`, ...) and dates in
    `time_s`, `time`, `timestamp`, `utc` or the index of a data frame become `time_s`, relative to
    the first row. Empty columns are left out. Valid arrays are not copied, so that a log of a
    million rows is in memory only once.

    Raises ValueError, one line that names the column, the row and the allowed values.
    """
    named = _name_columns(data)
    if not named:
        raise ValueError(f"no columns in the data: {ALLOWED_TEXT}")
    lengths = {name: len(values) for name, values in named.items()}
    _check_lengths(lengths)
    if not next(iter(lengths.values())):
        raise ValueError(f"column {next(iter(lengths))}: no rows: allowed is one row a reading")
    found = {
        name: values
        for name, raw in named.items()
        if (values := _convert_values(name, raw)) is not None
    }
    return _add_time_column(found)


def _name_columns(data: Any) -> dict[str, Any]:
    """Return columns by name, unconverted."""
    if isinstance(data, Mapping):
        return {str(name): _read_column(str(name), values) for name, values in data.items()}
    # A log that was read from a file has its columns in a mapping.
    if isinstance(getattr(data, "columns", None), Mapping):
        return _name_columns(data.columns)
    fields = getattr(getattr(data, "dtype", None), "names", None)
    if fields:
        return {name: np.ravel(data[name]) for name in fields}
    if (
        hasattr(data, "columns")
        and hasattr(data, "__getitem__")
        and not isinstance(data, np.ndarray)
    ):
        return _read_data_frame(data)
    if (
        isinstance(data, Sequence)
        and not isinstance(data, str | bytes)
        and data
        and all(isinstance(row, Mapping) for row in data)
    ):
        names = dict.fromkeys(str(name) for row in data for name in row)
        return {name: np.array([row.get(name) for row in data], object) for name in names}
    shape = getattr(data, "shape", None)
    what = f"an array of shape {shape}" if shape is not None else f"a {type(data).__name__}"
    raise ValueError(f"{what} has no names for its columns: {ALLOWED_TEXT}")


def _read_data_frame(data: Any) -> dict[str, Any]:
    """Read a data frame of any library; an index of dates becomes a column of times."""
    names = [str(name) for name in data.columns]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"column {twice[0]}: stands twice in the data frame: allowed once")
    found = {str(name): data[name].to_numpy() for name in data.columns}
    index = getattr(data, "index", None)
    if (
        index is not None
        and not {TIME_COLUMN, *COUNT_COLUMNS_S, *DATE_COLUMNS} & set(found)
        and np.issubdtype(getattr(index, "dtype", np.dtype(object)), np.datetime64)
    ):
        found["index"] = index.to_numpy()
    return found


def _read_column(name: str, values: Any) -> Any:
    """Return a column of a dictionary as an array of one dimension."""
    if hasattr(values, "to_numpy"):
        values = values.to_numpy()
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    if isinstance(values, str | bytes) or not hasattr(values, "__len__"):
        raise ValueError(
            f"column {name}: value {str(values)[:40]}: allowed is a column with a value for "
            "each row"
        )
    array = (
        values
        if isinstance(values, np.ndarray)
        else np.array(
            list(values),
            object if any(isinstance(one, str) or one is None for one in values) else None,
        )
    )
    if array.ndim != 1:
        raise ValueError(
            f"column {name}: shape {array.shape}: allowed is one value for each row, shape (n,)"
        )
    return array


def _check_lengths(lengths: Mapping[str, int]) -> None:
    counts = list(lengths.values())
    usual = lengths.get(TIME_COLUMN, max(set(counts), key=counts.count))
    for name, count in lengths.items():
        if count != usual:
            other = (
                TIME_COLUMN
                if TIME_COLUMN in lengths
                else next(one for one, n in lengths.items() if n == usual)
            )
            raise ValueError(
                f"column {name}: {count} rows where {other} has {usual}: allowed is one "
                "length for all"
            )


def _convert_values(name: str, raw: Any) -> npt.NDArray[Any] | None:
    """Return numbers as float64, dates as datetime64, texts as objects; None for a column without a
    value."""
    array = np.asarray(raw)
    if np.issubdtype(array.dtype, np.datetime64):
        return array.astype("datetime64[ns]")
    if np.issubdtype(array.dtype, np.timedelta64):
        return np.asarray(array / np.timedelta64(1, "s"), np.float64)
    if array.dtype.kind in "biuf":
        return array.astype(np.float64, copy=False)
    if array.dtype.kind in "OUS" and name not in TEXT_COLUMNS:
        return _convert_objects(name, array.astype(object, copy=False))
    return array.astype(object, copy=False)


def _convert_objects(name: str, array: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
    """Convert a column of objects: numbers where all values are numbers, dates in a time column."""
    there = [(row, value) for row, value in enumerate(array) if not _is_missing(value)]
    if not there:
        return None
    if name in (TIME_COLUMN, *DATE_COLUMNS) and not _is_number(there[0][1]):
        return _convert_dates(name, array)
    numbers = np.full(len(array), np.nan)
    for row, value in there:
        if not _is_number(value):
            if name in COLUMNS:
                raise ValueError(
                    f"column {name}: row {row}: value {str(value)[:40]!r}: allowed is a number"
                )
            # A text column of the user's own is returned unchanged.
            return array
        numbers[row] = float(value)
    return numbers


def _is_missing(value: Any) -> bool:
    return (
        value is None
        or value == ""
        or (isinstance(value, float) and value != value)
        or type(value).__name__ in ("NAType", "NaTType")
    )


def _is_number(value: Any) -> bool:
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return True


def _convert_dates(name: str, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return dates from datetime objects or ISO 8601 texts."""
    found = np.full(len(array), np.datetime64("NaT", "ns"))
    for row, value in enumerate(array):
        if not _is_missing(value):
            text = value.isoformat() if hasattr(value, "isoformat") else str(value).strip()
            try:
                found[row] = np.datetime64(text.removesuffix("Z").split("+")[0], "ns")
            except ValueError:
                raise ValueError(
                    f"column {name}: row {row}: value {text[:40]!r}: allowed are seconds, "
                    "or ISO 8601 as "
                    "2026-03-20T08:00:00"
                ) from None
    return found


def _add_time_column(columns: Columns) -> Columns:
    """Return the columns with `time_s` in seconds. Raises ValueError where no column gives the
    time."""
    if TIME_COLUMN in columns:
        return columns | {TIME_COLUMN: _convert_to_seconds(columns[TIME_COLUMN])}
    if "utc" in columns and columns["utc"].dtype == object:
        columns = columns | {"utc": _convert_dates("utc", columns["utc"])}
    dated = [
        name
        for name in DATE_COLUMNS
        if name in columns and np.issubdtype(columns[name].dtype, np.datetime64)
    ]
    counted = [
        name for name in COUNT_COLUMNS_S if name in columns and columns[name].dtype == np.float64
    ]
    if dated:
        rest = {key: values for key, values in columns.items() if key != dated[0]}
        return {TIME_COLUMN: _convert_to_seconds(columns[dated[0]]), **rest}
    if counted:
        name = counted[0]
        rest = {key: values for key, values in columns.items() if key != name}
        return {TIME_COLUMN: COUNT_COLUMNS_S[name] * columns[name], **rest}
    raise ValueError(
        f"column {TIME_COLUMN}: missing: a run log needs it; allowed in its place: "
        f"{', '.join(COUNT_COLUMNS_S)}, or "
        f"dates in {', '.join(DATE_COLUMNS[:-1])} or the index"
    )


def _convert_to_seconds(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return seconds unchanged, and dates as seconds since the first."""
    if not np.issubdtype(values.dtype, np.datetime64):
        return values
    known = values[~np.isnat(values)]
    return np.asarray(
        (values - (known[0] if len(known) else values[0])) / np.timedelta64(1, "s"), np.float64
    )
