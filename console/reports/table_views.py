"""How does a report show a bench table? Each measured column has its rows next to the nominal and
the extended machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.calibration.bench_table import BenchTable, select_usable_rows
from topdress.control.diagnosis.effects import LAG_COARSE_CLOCK
from topdress.control.diagnosis.result import Cause
from topdress.control.diagnosis.tables.duplicate_rows import remove_duplicates
from topdress.control.diagnosis.tables.table_rows import make_table_pieces
from topdress.control.diagnosis.tables.table_series import (
    MeasuredSeries,
    SizedEffect,
    TableCandidate,
    add_effects,
    is_within_scope,
)
from topdress.control.machine.machine import CATALOGUE, Machine

Array = npt.NDArray[np.float64]

# This effect shows in the clustering of times, not in the machine's behaviour.
COARSE_CLOCK = LAG_COARSE_CLOCK.id
# Variables that are used as the axis only if no other varies.
FALLBACK_AXIS_NAMES = ("replicate", "area_m2", "duration_s")


class ScopedCause(NamedTuple):
    """Holds a cause as the model takes it. `scope` is the set of rows in which it applies, as its
    cause names them; None for all."""

    effect: SizedEffect
    scope: str | None

    @property
    def id(self) -> str:
        """Id of the effect."""
        return self.effect.candidate.id


class RowGroup(NamedTuple):
    """Holds rows of one label (all rows, "", for a table without labels), and the effects that
    apply to them."""

    label: str
    rows: npt.NDArray[np.bool_]
    held: tuple[str, ...]
    not_held: tuple[str, ...]


class MeasuredColumn(NamedTuple):
    """Holds one measured column. Arrays are (n,) in `unit`."""

    # Path of the table.
    table: str
    # Name of the measured quantity.
    column: str
    channel: str
    unit: str
    observed: Array
    nominal: Array
    extended: Array
    variables: dict[str, Array]
    # The variable of the x axis, "" where none varies.
    main: str
    groups: tuple[RowGroup, ...]

    @property
    def name(self) -> str:
        """Table and column."""
        return f"{self.table} {self.column}".strip()

    @property
    def before(self) -> Array:
        """Measured minus nominal, (n,)."""
        return self.observed - self.nominal

    @property
    def after(self) -> Array:
        """Measured minus extended, (n,)."""
        return self.observed - self.extended


def make_table_views(
    tables: Sequence[BenchTable], machine: Machine, causes: Sequence[Cause]
) -> tuple[MeasuredColumn, ...]:
    """Returns views of every measured column, in the order of the tables.

    Raises ValueError with one line for tables that cannot be used.
    """
    parts = tuple(
        ScopedCause(
            SizedEffect(TableCandidate(cause.id, cause.member), cause.size.value), cause.scope
        )
        for cause in causes
        if cause.id in CATALOGUE and cause.id != COARSE_CLOCK and cause.size.value is not None
    )
    return tuple(
        _make_column_view(piece, machine, parts)
        for table in remove_duplicates(list(map(select_usable_rows, tables)), machine).tables
        for piece in make_table_pieces(table, machine)
    )


def _make_column_view(
    piece: MeasuredSeries, machine: Machine, parts: tuple[ScopedCause, ...]
) -> MeasuredColumn:
    nominal = piece.predict(machine)
    felt = dict.fromkeys(
        part.id
        for part in parts
        if np.any(piece.predict(add_effects(machine, (part.effect,))) != nominal)
    )
    extended = nominal.copy()
    groups = []
    for text in dict.fromkeys(piece.group.tolist()):
        rows = piece.group == text
        held = [part for part in parts if is_within_scope(part.scope, piece, text, part.id)]
        if held:
            extended[rows] = piece.predict(
                add_effects(machine, tuple(part.effect for part in held))
            )[rows]
        names = {part.id for part in held}
        groups.append(
            RowGroup(
                text,
                rows,
                tuple(n for n in felt if n in names),
                tuple(n for n in felt if n not in names),
            )
        )
    variables = dict(piece.variables)
    table, _, column = piece.name.rpartition(" ")
    return MeasuredColumn(
        table,
        column,
        piece.channel,
        piece.unit,
        piece.observed,
        nominal,
        extended,
        variables,
        _find_main_variable(variables, extended - nominal, nominal),
        tuple(groups),
    )


def _find_main_variable(variables: dict[str, Array], effect: Array, nominal: Array) -> str:
    """Returns the variable that the effects follow most, else the variable that the machine
    follows."""
    names = [name for name in variables if name not in FALLBACK_AXIS_NAMES] or list(variables)
    if not names:
        return ""
    series = effect if np.ptp(effect) > 1e-9 * (1.0 + float(np.abs(effect).max())) else nominal

    def calc_spread(name: str) -> float:
        kinds, index = np.unique(variables[name], return_inverse=True)
        if len(kinds) > 0.6 * len(series) and len(kinds) > 3:
            rank = np.argsort(np.argsort(variables[name]))
            index = rank * 6 // len(rank)
        counts = np.maximum(np.bincount(index), 1)
        means = np.bincount(index, series - series.mean()) / counts
        return round(float(np.sum(counts * means**2)), 12)

    return max(names, key=calc_spread)
