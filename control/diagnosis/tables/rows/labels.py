"""What a table's labels say: which rows belong together, and how a change of the rate began."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from control.calibration.bench_table import BenchTable
from control.diagnosis.tables.piece import Array, BoolArray

EMPTY = frozenset({"empty", "standstill", "start", "first", "stopped", "zero"})
RUNNING = frozenset({"running", "change", "full", "filled", "flowing"})
UP = frozenset({"up", "rise", "rising", "increase"})
DOWN = frozenset({"down", "fall", "falling", "decrease"})


class Roles(NamedTuple):
    """`start`: (n,) 1 where the tube was empty. `change`: (n,) +1 after a rise, -1 after a fall, 0 unknown.

    `running`: (n,) rows that carry the speed of a shaft that turned before the change.
    """

    start: Array
    change: Array
    running: BoolArray
    tell_start: bool
    tell_direction: bool

    @property
    def known(self) -> bool:
        return self.tell_start or self.tell_direction


def labels_of(table: BenchTable) -> npt.NDArray[np.str_]:
    """Label of each row, (n,); "" where the table has none."""
    return np.full(table.rows, "") if table.label is None else table.label


def column_of(table: BenchTable) -> str:
    """The column that the labels come from, as a sentence names it."""
    return table.label_column or "label"


def roles_of(table: BenchTable) -> Roles:
    """Reads the labels and the speeds before; a table tells start or direction only where both of its sides occur."""
    label, running = labels_of(table), table.running()
    words = np.array([str(text).strip().lower() for text in label], dtype=object)
    empty, running_said = np.isin(words, list(EMPTY)), np.isin(words, list(RUNNING))
    up, down = np.isin(words, list(UP)), np.isin(words, list(DOWN))
    if running.any():
        before, after = table.columns["before_rpm"], table.columns["shaft_rpm"]
        empty, up, down = ~running, running & (after > before), running & (after < before)
        starts = bool(empty.any())
        directions = bool(up.any() and down.any())
    else:
        starts = bool(empty.any() and running_said.any() and (empty | running_said).all())
        directions = bool(up.any() and down.any() and (up | down).all())
    return Roles(np.where(starts & empty, 1.0, 0.0), np.where(directions, up * 1.0 - down * 1.0, 0.0), running, starts,
                 directions)
