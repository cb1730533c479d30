"""Entries of the examination, each one function: `diagnose(data, machine)`.

data : path of log.csv or bench.csv; kind.txt in its folder says run or which table. machine : path
of machine.yaml. The answer is a dictionary:

    causes    {effect id: probability that it is there}
    none      probability that nothing is wrong
    unknown   probability of a cause that is on no list
    size      {effect id: [5 %, 50 %, 95 %] of its size}
    machine   path of a machine file that predicts this machine, or None

Other packages enter by an entry point of the group `topdress.examination`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np

Answer = dict[str, Any]
Entry = Callable[[Path, Path], Answer]
GROUP = "topdress.examination"
# Shares of the cases of the timetable with seed 1, which no score uses: what a constant says.
CONSTANT = {"none": 0.36, "unknown": 0.17}
# Probability of a single id: 0.56 causes a case, shared by 56 ids.
CONSTANT_ID = 0.010


def diagnose_constant(data: Path, machine: Path) -> Answer:
    """Says the shares of the training seed, whatever the data."""
    from topdress.control.diagnosis.effects import EFFECT_ROWS

    return {"causes": dict.fromkeys(EFFECT_ROWS, CONSTANT_ID), **CONSTANT, "size": {}}


def diagnose_topdress(data: Path, machine: Path) -> Answer:
    """Says what the diagnosis of this project says, through its public functions only."""
    from topdress.control.diagnosis.effects import EFFECT_ROWS
    from topdress.control.diagnosis.result import UNKNOWN
    from topdress.drivers.files.bench_table import read_bench_table
    from topdress.drivers.files.config import load_config
    from topdress.drivers.files.config_kinds import MACHINE_KIND

    import topdress

    model = load_config(str(machine), MACHINE_KIND).model
    kind = (data.parent / "kind.txt").read_text(encoding="utf-8")
    if kind == "run":
        found = topdress.diagnose_run(topdress.read_log(data), model)
    else:
        found = topdress.diagnose_tables([read_bench_table(data, kind)], model)
    # The diagnosis gives no probability to what it does not say: these are assumed, not measured.
    causes = dict.fromkeys(EFFECT_ROWS, 0.002)
    unknown = 0.6 if found.unexplained else 0.02
    sizes = {}
    for cause in found.causes:
        causes[cause.id] = max(causes[cause.id], cause.probability)
        if cause.size.value is not None:
            sizes[cause.id] = [cause.size.low, cause.size.value, cause.size.high]
        for rival in cause.rivals:
            if rival.id == UNKNOWN:
                unknown = max(unknown, rival.probability)
            else:
                causes[rival.id] = max(causes.get(rival.id, 0.0), rival.probability)
    none = 0.02 if found.causes or found.unexplained else 0.9
    adopted = data.parent / "adopted.yaml"
    topdress.save(adopted, topdress.extend(model, found))
    return {
        "causes": causes,
        "none": none,
        "unknown": unknown,
        "size": sizes,
        "machine": str(adopted),
    }


def diagnose_least_squares(data: Path, machine: Path) -> Answer:
    """Fits the shaft's gain and the gate's offset to settled rows by least squares, and says by the
    information criterion of Schwarz (1978) whether each is wrong. Tables get no name."""
    from topdress.control.diagnosis.effects import EFFECT_ROWS

    causes = dict.fromkeys(EFFECT_ROWS, 0.005)
    sizes: dict[str, list[float]] = {}
    kind = (data.parent / "kind.txt").read_text(encoding="utf-8")
    if kind == "run":
        with data.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        log = {
            name: np.array([float(row[name] or "nan") for row in rows])
            for name in ("shaft_rpm_cmd", "shaft_rpm", "opening_mm_cmd", "opening_mm")
            if name in rows[0]
        }
        for command, reading, gain, offset in (
            ("shaft_rpm_cmd", "shaft_rpm", "shaft.gain", None),
            ("opening_mm_cmd", "opening_mm", None, "gate.offset"),
        ):
            if command not in log or reading not in log:
                continue
            _fit_drive(log[command], log[reading], gain, offset, causes, sizes)
    wrong = max(causes.values())
    return {
        "causes": causes,
        "none": float(np.clip(0.6 * (1.0 - wrong), 0.01, 0.6)),
        "unknown": 0.1,
        "size": sizes,
        "machine": None,
    }


def _fit_drive(
    command: np.ndarray,
    reading: np.ndarray,
    gain: str | None,
    offset: str | None,
    causes: dict[str, float],
    sizes: dict[str, list[float]],
) -> None:
    """Adds the probabilities and sizes of a drive's gain or offset, from its settled rows."""
    settled = np.convolve(np.abs(np.diff(command, prepend=command[0])), np.ones(30))[: len(command)]
    kept = (settled == 0.0) & np.isfinite(reading) & (command > 0.0)
    if kept.sum() < 100:
        return
    x, y = command[kept], reading[kept]
    left = y - x
    # Neighbouring rows have correlated noise: one row in ten counts.
    count = len(x) / 10.0
    column = x / 100.0 if gain else np.ones(len(x))
    size = float(column @ left / (column @ column))
    before, after = float(left @ left), float((left - size * column) @ (left - size * column))
    log_odds = 0.5 * count * np.log(before / max(after, 1e-12)) - 0.5 * np.log(count) - 3.0
    name = gain or offset or ""
    causes[name] = float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -6.0, 6.0))))
    sd = float(np.sqrt(after / len(x) / max(float(np.mean(column**2)), 1e-12) / count))
    sizes[name] = [size - 1.645 * sd, size, size + 1.645 * sd]


BUILT_IN: dict[str, Entry] = {
    "constant": diagnose_constant,
    "least_squares": diagnose_least_squares,
    "topdress": diagnose_topdress,
}


def find_entry(name: str) -> Entry:
    """Returns an entry by name: of this file, or of an installed package.

    Raises
    ------
    ValueError : there is none of that name; with those that there are.
    """
    others = {point.name: point for point in entry_points(group=GROUP)}
    if name in BUILT_IN:
        return BUILT_IN[name]
    if name in others:
        entry: Entry = others[name].load()
        return entry
    raise ValueError(f"entry {name!r}: allowed: {', '.join([*BUILT_IN, *others])}")
