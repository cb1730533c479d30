"""Cases as files: ordinary logs and tables in `data/`, and the truth in `truth/`, which a
diagnosis never opens."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .cases import Case

_SIDECAR = """format: topdress-run-log/1
software: hidden-effect generator
started_utc: null
seed: null
sha256: {}
machine: null
crop: null
job: null
"""


def write_cells(values: Any) -> list[str]:
    """Returns a column as cells of a CSV file: an empty cell for NaN."""
    if values.dtype == object:
        return [str(v) for v in values]
    whole = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 1e9)
    return [
        "" if v != v else str(int(v)) if w else repr(v)
        for v, w in zip(values.tolist(), whole.tolist(), strict=True)
    ]


def write_case(case: Case, folder: Path) -> Path:
    """Writes one case below `folder`; returns the data file. Raises OSError where that is
    impossible."""
    data, truth = folder / "data", folder / "truth"
    data.mkdir(parents=True, exist_ok=True)
    truth.mkdir(parents=True, exist_ok=True)
    path = data / f"{case.name}.csv"
    lines = [
        ",".join(case.columns),
        *map(",".join, zip(*[write_cells(c) for c in case.columns.values()], strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    if case.kind == "run":
        path.with_suffix(".yaml").write_text(_SIDECAR, encoding="utf-8", newline="\n")
    (truth / f"{case.name}.json").write_text(
        json.dumps(case.truth, indent=1), encoding="utf-8", newline="\n"
    )
    return path


def write_all(made: Iterable[Case], folder: Path) -> int:
    """Writes all cases; returns how many."""
    return sum(1 for case in made if write_case(case, folder))
