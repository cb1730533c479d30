"""Which columns must each kind of bench table have?"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from topdress.control.recordings.finding import Finding
from topdress.control.recordings.speed_unit import KMH_PER_MPS
from topdress.control.recordings.valid_values import blank_sentinels

Array = npt.NDArray[np.float64]

# The kinds are words of the command line and of the page.
KINDS = ("lag", "catch", "weigh", "heads", "place")
# A lag can be measured as a whole, in parts, or as a distance.
LAG_COLUMNS = ("lag_s", "drop_s", "response_s", "lag_m")
SPEED_COLUMNS = ("speed_mps", "speed_kmh")
# One column of each group is sufficient.
REQUIRED_COLUMNS: dict[str, tuple[tuple[str, ...], ...]] = {
    "lag": (("shaft_rpm",), LAG_COLUMNS),
    "catch": (("shaft_rpm",), ("opening_mm",), ("duration_s",), ("mass_kg",)),
    "weigh": (("target_kg",), ("applied_kg",), ("area_m2",)),
    "heads": (("head",), ("ndvi_reference",), ("ndvi",)),
    "place": (("shaft_rpm",), SPEED_COLUMNS, ("miss_m",)),
}
# Other columns are reported, because they may be misspelt.
KNOWN_COLUMNS = frozenset(
    {
        "shaft_rpm",
        *LAG_COLUMNS,
        *SPEED_COLUMNS,
        "replicate",
        "opening_mm",
        "duration_s",
        "mass_kg",
        "outlet",
        "area_m2",
        "target_kg",
        "applied_kg",
        "width_m",
        "revolutions",
        "head",
        "ndvi_reference",
        "ndvi",
        "warm_min",
        "height_m",
        "miss_m",
        "corrected_lag_s",
        "before_rpm",
    }
)
# The ranges exclude wrong units and sentinels, not unusual machines.
COLUMN_RANGES: dict[str, tuple[float, float]] = {
    "shaft_rpm": (0.0, 1000.0),
    "lag_s": (-5.0, 60.0),
    "drop_s": (-5.0, 60.0),
    "response_s": (-5.0, 60.0),
    "lag_m": (-50.0, 500.0),
    "speed_mps": (0.01, 20.0),
    "speed_kmh": (0.04, 72.0),
    "opening_mm": (0.0, 500.0),
    "duration_s": (1e-3, 36000.0),
    "mass_kg": (0.0, 20000.0),
    "outlet": (1.0, 100.0),
    "area_m2": (1e-3, 1e8),
    "target_kg": (1e-6, 1e6),
    "applied_kg": (0.0, 1e6),
    "width_m": (0.01, 100.0),
    "revolutions": (1e-6, 1e9),
    "head": (1.0, 100.0),
    "ndvi_reference": (-1.0, 1.0),
    "ndvi": (-1.5, 1.5),
    "warm_min": (0.0, 10000.0),
    "height_m": (0.01, 20.0),
    "miss_m": (-200.0, 200.0),
    "corrected_lag_s": (0.0, 60.0),
    "before_rpm": (0.0, 1000.0),
}


@dataclass(frozen=True, slots=True)
class BenchTable:
    """Holds one bench test.

    `columns`: numbers, float64 arrays of shape (n,), NaN where a cell was empty. `label`: texts
    of shape (n,) of the column `label_column` whose values are compared with each other, or
    None. `path`: where it was read from."""

    kind: str
    columns: Mapping[str, Array]
    label_column: str = ""
    path: str = ""
    label: npt.NDArray[np.str_] | None = None
    findings: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def find_running_rows(self) -> npt.NDArray[np.bool_]:
        """Returns which rows (n,) had a shaft that turned before its change; where it is
        unknown, it stood."""
        # A table without this column is one of starts.
        before = self.columns.get("before_rpm", np.zeros(self.rows))
        return np.asarray(np.nan_to_num(before) > 0.0)

    def find_speed_mps(self) -> Array | None:
        """Returns the written ground speed, (n,) m/s; None where the table has none."""
        if "speed_mps" in self.columns:
            return self.columns["speed_mps"]
        return self.columns["speed_kmh"] / KMH_PER_MPS if "speed_kmh" in self.columns else None


def find_missing_columns(kind: str, names: Collection[str]) -> tuple[str, ...] | None:
    """Returns the first group of columns of which a table of this kind must have one, and has
    none."""
    for group in REQUIRED_COLUMNS[kind]:
        if not any(name in names for name in group):
            return group
    if (
        kind == "lag"
        and not any(name in names for name in LAG_COLUMNS[:3])
        # A lag as a distance needs the ground speed to become a time.
        and not any(name in names for name in SPEED_COLUMNS)
    ):
        return SPEED_COLUMNS
    return None


def recognise_kind(names: Collection[str]) -> str | None:
    """Returns the kind of a table with these columns; None where none or several fit."""
    fitting = [kind for kind in KINDS if find_missing_columns(kind, names) is None]
    # Several kinds that fit leave the choice to the user.
    return fitting[0] if len(fitting) == 1 else None


def select_usable_rows(table: BenchTable) -> BenchTable:
    """Returns the table without rows that lack a needed number, with a finding about them.

    Raises
    ------
    ValueError : in one line, for an unknown kind, a missing column, a number out of range or no
        row left."""
    path = table.path or "table"
    if table.kind not in KINDS:
        raise ValueError(f"{path}: kind {table.kind!r}: allowed {', '.join(KINDS)}")
    group = find_missing_columns(table.kind, table.columns)
    if group is not None:
        raise ValueError(
            f"{path}: column {' or '.join(group)}: missing: a {table.kind} table needs it"
        )
    # Sentinels such as -999 become empty before the ranges are checked.
    table = _blank_unreadable(table)
    measured = [name for name in LAG_COLUMNS if name in table.columns]
    needed = [
        name
        for group in REQUIRED_COLUMNS[table.kind]
        for name in group
        if name in table.columns and name not in LAG_COLUMNS
        # Of the lag columns one is enough, so they are checked separately.
    ]
    keep = np.all([np.isfinite(table.columns[name]) for name in needed], axis=0)
    if table.kind == "lag":
        keep &= np.any([np.isfinite(table.columns[name]) for name in measured], axis=0)
    for name, (low, high) in COLUMN_RANGES.items():
        values = table.columns.get(name)
        if values is None:
            continue
        wrong = np.flatnonzero(np.isfinite(values) & ((values < low) | (values > high)))
        if len(wrong):
            raise ValueError(
                # Rows are counted from 1 below the header, as a spreadsheet user sees them.
                f"{path}: row {wrong[0] + 1}, column {name}: {values[wrong[0]]:g}: "
                f"allowed {low:g} to {high:g}"
            )
    if not keep.any():
        raise ValueError(f"{path}: no row has all of {', '.join(needed)}")
    if keep.all():
        # A table that is complete is returned unchanged.
        return table
    dropped = int((~keep).sum())
    return replace(
        select_rows(table, keep),
        findings=(*table.findings, f"{path}: {dropped} rows lack a needed number and are left out"),
    )


def _blank_unreadable(table: BenchTable) -> BenchTable:
    """Returns the table without unreadable numbers and sentinels, with findings about them."""
    findings: list[Finding] = []
    columns = {
        name: blank_sentinels(name, values, COLUMN_RANGES[name], findings)
        if name in COLUMN_RANGES
        else values
        for name, values in table.columns.items()
    }
    said = (f"{table.path or 'table'}: {finding}" for finding in findings)
    return replace(table, columns=columns, findings=(*table.findings, *said))


def select_rows(table: BenchTable, rows: npt.NDArray[np.bool_]) -> BenchTable:
    """Returns the table with these rows (n,) only."""
    return replace(
        table,
        columns={name: values[rows] for name, values in table.columns.items()},
        label=None if table.label is None else table.label[rows],
    )
