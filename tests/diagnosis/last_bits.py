"""Diagnoses of the same data by another kernel of matrix products, in a process of its own, or
of data moved by a hair.

`python last_bits.py CASES ANSWERS` reads cases that `saved` wrote and writes what is said of
each.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

# Kernels of OpenBLAS that sum a product in different orders; numpy's wheels hold all of them
# (OPENBLAS_CORETYPE).
KERNELS = ("Prescott", "Haswell", "SkylakeX", "Zen")
# of the noise of each column: no instrument shows as much
MOVED = 1e-9
SAME = 1e-3  # of its interval: two sizes that are the same
MEASURED = ("lag_s", "lag_m", "response_s", "drop_s", "mass_kg", "applied_kg", "ndvi", "miss_m")

# its name; the tables of one diagnosis, or the columns of a log
Case = tuple[str, Any]
Answer = dict[str, Any]


def answer(case: Case, machine: Any) -> Answer:
    """What is said of a case: verdict, names with their scopes and rivals, sizes with their
    intervals."""
    from topdress.control.diagnosis.runs.diagnose import diagnose_run
    from topdress.control.diagnosis.tables import diagnose_tables

    _, data = case
    found = (
        diagnose_run(data, machine) if isinstance(data, dict) else diagnose_tables(data, machine)
    )
    return {
        "verdict": found.verdict,
        "names": [[c.id, c.member, c.scope, [r.id for r in c.rivals]] for c in found.causes],
        "unexplained": [[u.channel, u.variable] for u in found.unexplained],
        "sizes": [[c.size.value, c.size.low, c.size.high] for c in found.causes],
    }


def by_kernel(kernel: str, cases: Sequence[Case], folder: Path) -> list[Answer] | None:
    """The answers under one kernel. None: this processor cannot run it."""
    given, said = folder / "cases.pickle", folder / f"{kernel}.json"
    given.write_bytes(pickle.dumps(list(cases)))
    done = subprocess.run(
        [sys.executable, __file__, given, said],
        env={**os.environ, "OPENBLAS_CORETYPE": kernel},
        capture_output=True,
        text=True,
    )
    if done.returncode == -signal.SIGILL:
        return None
    assert done.returncode == 0, done.stderr
    return list(json.loads(said.read_text()))


def moved(case: Case, machine: Any) -> Case:
    """The case with every measured column moved by a hair of its noise."""
    rng = np.random.default_rng(7)
    name, data = case
    if isinstance(data, dict):
        sd = {
            "shaft_rpm": machine.noise.shaft_rpm,
            "opening_mm": machine.noise.opening_mm,
            "hopper_kg": machine.noise.scale_kg,
            "wheel_speed_mps": machine.noise.wheel_mps,
            "speed_mps": machine.noise.gnss_mps,
        }
        sd |= {column: machine.noise.ndvi for column in data if column.startswith("ndvi_")}
        return name, {
            column: values + MOVED * sd[column] * rng.standard_normal(len(values))
            if column in sd
            else values
            for column, values in data.items()
        }
    out = []
    for table in data:
        columns = dict(table.columns)
        for column in MEASURED:
            if column in columns:
                # in these tables noise is a tenth of what varies
                sd_of = 0.1 * float(np.nanstd(columns[column]))
                columns[column] = columns[column] + MOVED * sd_of * rng.standard_normal(
                    len(columns[column])
                )
        out.append(replace(table, columns=columns))
    return name, out


def differences(cases: Sequence[Case], one: Sequence[Answer], other: Sequence[Answer]) -> list[str]:
    """Cases that are not answered alike: verdict, names, what is unexplained, sizes within SAME
    of their intervals."""
    out = []
    for (name, _), a, b in zip(cases, one, other, strict=True):
        words = ("verdict", "names", "unexplained")
        if any(a[word] != b[word] for word in words):
            out.append(
                f"{name}: "
                + ", ".join(f"{a[word]} or {b[word]}" for word in words if a[word] != b[word])
            )
            continue
        for (effect, *_), (size, low, high), (again, *_) in zip(
            a["names"], a["sizes"], b["sizes"], strict=True
        ):
            if size is not None and abs(size - again) > SAME * (high - low):
                out.append(f"{name}: {effect} {size} or {again}")
    return out


def main(given: str, said: str) -> None:
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    machine = load_config("huanghai", MACHINE_KIND).model
    cases = pickle.loads(Path(given).read_bytes())
    Path(said).write_text(json.dumps([answer(case, machine) for case in cases]))


if __name__ == "__main__":
    main(*sys.argv[1:])
