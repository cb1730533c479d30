"""What a guess holds: the import file, what of it is unsure, and why the rest is as it is."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.files.imports.mapping import ImportFile
from drivers.files.imports.units import ColumnUnit

Key = tuple[str, ...]

PAIRS = (("shaft_rpm_cmd", "shaft_rpm"), ("opening_mm_cmd", "opening_mm"), ("target_rate_kg_ha", "applied_rate_kg_ha"))


class Doubt(NamedTuple):
    """`key`: of the import file; `text`: why it is not sure."""

    key: Key
    text: str

    def __str__(self) -> str:
        return f"{'.'.join(self.key)}: {self.text}"


@dataclass
class Guess:
    """`reasons`: why each key is as it is. `open`: columns that need a number from outside the file, as YAML text.
    `full`: what a machine file says is the most of a column, in the log's unit."""

    mapping: ImportFile
    doubts: list[Doubt] = field(default_factory=list)
    reasons: dict[Key, str] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)
    full: Mapping[str, float] = field(default_factory=dict)
    width_m: float | None = None        # working width, where the file says one

    @property
    def sure(self) -> bool:
        return not self.doubts

    @property
    def questions(self) -> tuple[str, ...]:
        """What is unsure, a line each."""
        return tuple(map(str, self.doubts))

    @property
    def unsure(self) -> str:
        count = len(self.doubts)
        return "nothing is unsure" if count == 0 else f"{count} {'line is' if count == 1 else 'lines are'} unsure"


@dataclass
class ColumnCandidate:
    """A column of the file (`source`) that may be a column of the log (`target`). `values`: as the file has them."""

    source: str
    target: str
    unit: ColumnUnit | None
    implied: bool = False           # the unit is in the name
    role: str = ""                  # command, reading, or not given
    exact: bool = False
    values: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def weight(self) -> tuple[bool, bool, bool]:
        return self.exact, self.unit is not None or self.implied, self.role != ""
