"""How are bench tables (CSV) read: lag, catch, weigh, heads, place? The columns determine the kind
of table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from topdress.control.calibration.bench_table import (
    KINDS,
    KNOWN_COLUMNS,
    BenchTable,
    find_missing_columns,
    recognise_kind,
    select_usable_rows,
)
from topdress.drivers.files.header_names import rename_header
from topdress.drivers.files.imports.import_errors import TableError
from topdress.drivers.files.table import read_table

__all__ = ["BenchTable", "read_bench_table"]

# Text columns that identify a row; rows are not compared by them.
_ID_COLUMNS = ("plot", "id", "name", "date", "remark", "note")
# A column with more different texts holds remarks instead of settings to compare.
_MAX_LABELS = 6
# Findings of the reader that change no number.
_HARMLESS_FINDINGS = ("crlf", "no_last_line_end", "separator", "decimal_comma")


def read_bench_table(path: Path | str, kind: str | None = None) -> BenchTable:
    """Returns a bench table.

    The label column is the first text column with at least two and at most six values.

    Parameters
    ----------
    path : the table.
    kind : one of lag, catch, weigh, heads, place; needed where the columns leave the kind open.

    Returns
    -------
    the table, checked for its kind.

    Raises
    ------
    TableError : a line with file, column or row, value, and the permitted values.
    """
    path = Path(path)
    if kind is not None and kind not in KINDS:
        raise TableError(path, f"kind {kind!r}: allowed {', '.join(KINDS)}")
    raw = read_table(
        path, numbers=KNOWN_COLUMNS, rename=lambda names: rename_header(names, KNOWN_COLUMNS, {})
    )
    if raw.rows == 0:
        raise TableError(path, "no rows below the header")
    kind = kind or _find_table_kind(path, raw.names)
    columns = {name: values for name, values in raw.columns.items() if values.dtype != object}
    label_column = _find_label_column(raw.columns)
    label = np.array([str(text) for text in raw.columns[label_column]]) if label_column else None
    for name, values in columns.items():
        if name in KNOWN_COLUMNS and not np.isfinite(values).any():
            raise TableError(path, f"column {name}: holds no number")
    said = tuple(
        f"{path}: {finding}" for finding in raw.findings if finding.id not in _HARMLESS_FINDINGS
    )
    table = BenchTable(kind, columns, label_column, str(path), label, said)
    try:
        return select_usable_rows(table)
    except ValueError as error:
        raise TableError("", str(error)) from None


def _find_table_kind(path: Path, names: tuple[str, ...]) -> str:
    """Returns the kind of table that the columns determine. Raises TableError where they determine
    none or several."""
    found = recognise_kind(names)
    if found is not None:
        return found
    nearest = max(KINDS, key=lambda k: find_missing_columns(k, names) is None)
    if find_missing_columns(nearest, names) is None:
        raise TableError(
            path, f"the columns fit several kinds of table: say which with --kind {'|'.join(KINDS)}"
        )
    lacks = "; ".join(
        f"{k} lacks {' or '.join(find_missing_columns(k, names) or ())}" for k in KINDS
    )
    raise TableError(
        path,
        f"no known kind of bench table: {lacks}; a log of another program is read by topdress "
        "import (--guess writes a first import file)",
    )


def _find_label_column(columns: dict[str, np.ndarray]) -> str:
    """Returns the column whose few texts label the rows; empty without such a column."""
    for name, values in columns.items():
        if values.dtype == object and name not in _ID_COLUMNS:
            kinds = {str(text) for text in values}
            if 2 <= len(kinds) <= _MAX_LABELS and len(kinds) < len(values):
                return name
    return ""
