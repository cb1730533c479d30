"""Work that no model of ours made, for several files of tests."""
from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

Columns = dict[str, np.ndarray]
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def hidden() -> Iterator[SimpleNamespace]:
    """The modules of the generator of hidden machines by attribute: hidden.cases, hidden.plant ..."""
    sys.path.insert(0, str(HERE))
    try:
        yield SimpleNamespace(**{path.stem: importlib.import_module(f"hidden.{path.stem}")
                                 for path in sorted((HERE / "hidden").glob("[a-z]*.py"))})
    finally:
        sys.path.remove(str(HERE))


@pytest.fixture(scope="session")
def work() -> Columns:
    """Ten minutes of both drives on stairs of their own and a scale, 20 rows a second, without a model of ours."""
    rng, time_s = np.random.default_rng(5), np.arange(0.0, 600.0, 0.05)
    stairs = {}
    for name, low, high, every_s in (("shaft_rpm", 30.0, 95.0, 7.0), ("opening_mm", 12.0, 45.0, 9.0)):
        levels = rng.uniform(low, high, 200)
        stairs[name] = np.round(levels[(time_s / every_s).astype(int)], 1)
    shaft, opening = np.empty(len(time_s)), np.empty(len(time_s))
    turn, wide = stairs["shaft_rpm"][0], stairs["opening_mm"][0]
    for k in range(len(time_s)):
        shaft[k], opening[k] = turn, wide
        told_rpm, told_mm = stairs["shaft_rpm"][max(0, k - 7)], stairs["opening_mm"][max(0, k - 2)]
        turn += np.clip((told_rpm - turn) * (1.0 - np.exp(-0.05 / 0.05)), -10.0, 10.0)
        wide += np.clip(told_mm - wide, -1.0, 1.0)
    left_kg = 290.0 - np.cumsum(5.5e-3 * shaft * opening / 60.0) * 0.05
    return {"time_s": time_s, "shaft_rpm_cmd": stairs["shaft_rpm"], "opening_mm_cmd": stairs["opening_mm"],
            "shaft_rpm": shaft + rng.normal(0.0, 0.3, len(time_s)),
            "opening_mm": opening + rng.normal(0.0, 0.1, len(time_s)),
            "hopper_kg": np.round((left_kg + rng.normal(0.0, 0.15, len(time_s))) / 0.05) * 0.05}
