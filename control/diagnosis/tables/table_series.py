"""One measured column of a bench table, and what the machine model says about it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.machine import CATALOGUE, Machine

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

# Scores within this share of one another are equal: two names may stand for the same column of
# a table (a constant extra lag, and a dead time that one table alone has), and the last bits,
# which differ from one processor to another, would choose between them. Rounding leaves some
# 1e-12 of a sum over the rows; two causes that differ are not told apart by a millionth of
# their sum of squares.
TIED = 1e-6


class TableCandidate(NamedTuple):
    """An effect that may be hypothesised. `scope`: index (Problem.scopes) of the groups of rows
    that alone have it, None: all have it."""

    id: str
    member: int | None = None
    scope: int | None = None


class SizedEffect(NamedTuple):
    candidate: TableCandidate
    # in the unit of the catalogue, on top of what the machine has
    size: float


class TablePiece(NamedTuple):
    """Rows (n,) of one measured column. `predict` runs the machine model for every row, in
    `unit`."""

    name: str  # "lag_table1_distance.csv lag_m"
    channel: str
    unit: str
    observed: Array
    predict: Callable[[Machine], Array]
    # relative noise of the rows, to choose from; all 1 where they are alike
    spreads: tuple[Array, ...]
    group: npt.NDArray[np.str_]  # label of each row, "" where the table has none
    label_column: str  # column that the labels come from
    candidates: tuple[TableCandidate, ...]  # scope None
    # ids that may hold in one label or one table only
    scoped_ids: tuple[str, ...]
    variables: Mapping[str, Array]  # recorded settings
    nuisances: Mapping[str, Array]  # what one tolerance makes of each row
    # id -> (n, k): the same effect in other shapes of its own variable
    forms: Mapping[str, Array]
    # id -> (k,): size that a unit of each form is where it is defined
    at_definition: Mapping[str, Array] = {}
    # what the machine file says of the sensor, for spread 1
    noise_sd: float | None = None
    clocked: bool = False  # times of a detector: may come in steps
    on_ground: bool = False  # distances along the travel, of a drive
    # ids that these rows have only where a scope names them
    named_only: frozenset[str] = frozenset()

    @property
    def table(self) -> str:
        """Name of the table that the column is in."""
        return self.name.rsplit(" ", 1)[0]


SCOPE_AND = " and "


def describe_scope(groups: Iterable[tuple[str, str]]) -> str:
    """What people call the groups (table, label) that alone have an effect: the `scope` of its
    cause."""
    return SCOPE_AND.join(describe_group(table, label) for table, label in groups)


def is_within_scope(scope: str | None, piece: TablePiece, label: str, effect_id: str) -> bool:
    """Whether a cause with this scope holds in a piece's rows of one label."""
    if scope is None:
        return effect_id not in piece.named_only
    own = describe_group(piece.table, label)
    return own == scope or own in scope.split(SCOPE_AND)


def describe_group(table: str, label: str) -> str:
    """What people call the rows of one label (the `scope` of a cause): the table, by its file's
    name, and the label."""
    short = table.replace("\\", "/").rsplit("/", 1)[-1] or "the table"
    return f"{short} {label}".strip()


def add_effects(machine: Machine, effects: tuple[SizedEffect, ...]) -> Machine:
    """The machine with effects on top of those it has; bounds are not looked at."""
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
    """Those that are known in every row and take more than one value."""
    return {
        name: values
        for name, values in variables.items()
        if np.all(np.isfinite(values))
        and np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max()))
    }


def find_first_best(scores: Sequence[float] | Array) -> int:
    """Index of the highest score (n,), of equal ones the first: the order given decides, not
    rounding."""
    values = np.asarray(scores, np.float64)
    highest = float(values.max())
    least = highest - TIED * abs(highest) if np.isfinite(highest) else highest
    return int(np.flatnonzero(values >= least)[0])


def sort_best_first(scores: Sequence[float] | Array) -> list[int]:
    """Indices of the scores (n,) from the highest down, equal ones in the order given."""
    values = np.asarray(scores, np.float64)
    left = list(range(len(values)))
    out = []
    while left:
        out.append(left.pop(find_first_best(values[left])))
    return out
