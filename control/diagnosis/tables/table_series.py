"""Defines one measured column of a bench table with the machine model's prediction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.machine import CATALOGUE, Machine

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Scores within this relative difference are equal. Two effects may have the same column in a table
# (a constant extra lag, and a dead time that one table alone has), and the last bits, which differ
# between processors, would choose between them. Rounding changes a sum over the rows by some 1e-12;
# different causes differ by more than a millionth of their sum of squares.
EQUAL_SCORE_TOLERANCE = 1e-6


class TableCandidate(NamedTuple):
    """A candidate effect. `scope`: index (Problem.scopes) of the groups of rows that alone have the
    effect; None for all."""

    id: str
    member: int | None = None
    scope: int | None = None


class SizedEffect(NamedTuple):
    """A candidate effect with its size."""

    candidate: TableCandidate
    # Size in the unit of the catalogue, on top of the machine's own effect.
    size: float


class MeasuredSeries(NamedTuple):
    """Rows (n,) of one measured column. `predict` runs the machine model for every row, in
    `unit`."""

    # Name of the piece, for example "lag_table1_distance.csv lag_m".
    name: str
    channel: str
    unit: str
    observed: Array
    predict: Callable[[Machine], Array]
    # Trial shapes of the rows' relative noise; all 1 where the noise is constant.
    spreads: tuple[Array, ...]
    # Label of each row, "" where the table has none.
    group: npt.NDArray[np.str_]
    # Column of the labels.
    label_column: str
    # Candidates for all rows (scope None).
    candidates: tuple[TableCandidate, ...]
    # Ids that may hold in one label or one table only.
    scoped_ids: tuple[str, ...]
    # Recorded settings by name.
    variables: Mapping[str, Array]
    # Change of each row by one tolerance.
    nuisances: Mapping[str, Array]
    # Alternative shapes of each effect over its own variable, by id: (n, k).
    forms: Mapping[str, Array]
    # Size where the effect is defined, for a unit of each shape, by id: (k,).
    at_definition: Mapping[str, Array] = {}
    # Noise of the sensor by the machine file, for spread 1.
    noise_sd: float | None = None
    # Whether the times come from a detector, which may quantise them.
    clocked: bool = False
    # Whether the rows are distances along the travel of a drive.
    on_ground: bool = False
    # Ids that apply to these rows only where a scope names the rows.
    named_only: frozenset[str] = frozenset()

    @property
    def table_name(self) -> str:
        """Name of the table with the column."""
        return self.name.rsplit(" ", 1)[0]


SCOPE_AND = " and "


def describe_scope(groups: Iterable[tuple[str, str]]) -> str:
    """Return the user's name for the groups (table, label) that alone have an effect: the `scope`
    of its cause."""
    return SCOPE_AND.join(describe_group(table, label) for table, label in groups)


def is_within_scope(scope: str | None, piece: MeasuredSeries, label: str, effect_id: str) -> bool:
    """Tell whether a cause with this scope holds in a piece's rows of one label."""
    if scope is None:
        return effect_id not in piece.named_only
    own = describe_group(piece.table_name, label)
    return own == scope or own in scope.split(SCOPE_AND)


def describe_group(table: str, label: str) -> str:
    """Return the user's name for the rows of one label (the `scope` of a cause): the table's file
    name, and the label."""
    short = table.replace("\\", "/").rsplit("/", 1)[-1] or "the table"
    return f"{short} {label}".strip()


def add_effects(machine: Machine, effects: tuple[SizedEffect, ...]) -> Machine:
    """Return the machine with effects added to its own; bounds are not checked."""
    stages: dict[str, Any] = {}
    for (effect_id, member, _), size in effects:
        entry = CATALOGUE[effect_id]
        stage = stages.get(entry.stage, getattr(machine, entry.stage))
        changes = {entry.field: getattr(stage, entry.field) + size}
        if entry.effect.member_field:
            changes[entry.effect.member_field] = float(member or 1)
        stages[entry.stage] = stage._replace(**changes)
    return machine.model_copy(update=stages)


def list_varying(variables: Mapping[str, Array]) -> dict[str, Array]:
    """Return the variables that have a value in every row and more than one distinct value."""
    return {
        name: values
        for name, values in variables.items()
        if np.all(np.isfinite(values))
        and np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max()))
    }


def find_first_best(scores: Sequence[float] | Array) -> int:
    """Return the index of the highest score (n,); the first of equal scores, so that rounding does
    not decide."""
    values = np.asarray(scores, np.float64)
    highest = float(values.max())
    least = highest - EQUAL_SCORE_TOLERANCE * abs(highest) if np.isfinite(highest) else highest
    return int(np.flatnonzero(values >= least)[0])


def sort_best_first(scores: Sequence[float] | Array) -> list[int]:
    """Return the indices of the scores (n,) in descending order; equal scores keep their order."""
    values = np.asarray(scores, np.float64)
    left = list(range(len(values)))
    out = []
    while left:
        out.append(left.pop(find_first_best(values[left])))
    return out
