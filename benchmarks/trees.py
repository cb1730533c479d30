"""This tree and another one, measured by turns in the same run: what else the machine does meets both alike."""
from __future__ import annotations

import os
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]


def trees(against: Path | None) -> dict[str, Path]:
    """By name, the old one first."""
    return {"old": against.resolve(), "new": HERE} if against is not None else {"new": HERE}


def environment_of(tree: Path, before: Mapping[str, str] = os.environ) -> dict[str, str]:
    """A program started with it takes the code of the tree."""
    return dict(before) | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Median and range in words."""
    return (f"median {statistics.median(values):.{digits}f}, {min(values):.{digits}f} to {max(values):.{digits}f}, "
            f"{len(values)} times")


def ratio(what: str, found: Mapping[str, Sequence[float]]) -> str:
    """Old over new of the medians, in words; "" without an old one."""
    if "old" not in found:
        return ""
    old, new = (statistics.median(found[name]) for name in ("old", "new"))
    return f"{what}: old / new {old / new:.2f}" if new else ""
