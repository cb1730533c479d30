"""What careless loggers, spreadsheets and sensors do to a recording: one function a kind, drawn with a seed.

`refusable`: a file that a program may refuse in one clear line (exit code 2), for it cannot be read as it stands.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .machines import Table

Rng = np.random.Generator


class Spoiler(NamedTuple):
    name: str
    apply: Callable[[Rng, Table], Table]
    refusable: bool = False


def _some(rng: Rng, table: Table) -> str:
    names = [name for name in table if name != "time_s" and table[name].dtype != object]
    return str(rng.choice(names))


def _cells(rng: Rng, n: int, share: float) -> np.ndarray:
    return rng.random(n) < share


def _rows(table: Table, kept: np.ndarray) -> Table:
    return {name: column[kept] for name, column in table.items()}


def _with(table: Table, **columns: np.ndarray) -> Table:
    return {**table, **columns}


def _set(rng: Rng, table: Table, value: float, share: float) -> Table:
    name = _some(rng, table)
    return _with(table, **{name: np.where(_cells(rng, len(table[name]), share), value, table[name])})


def constant_reading(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    return _with(table, **{name: np.full(len(table[name]), float(np.median(table[name])))})


def constant_commands(rng: Rng, table: Table) -> Table:
    return {name: np.full(len(column), column[len(column) // 2]) if name.endswith("_cmd") else column
            for name, column in table.items()}


def constant_everywhere(rng: Rng, table: Table) -> Table:
    return {name: column if name == "time_s" else np.full(len(column), column[0], column.dtype)
            for name, column in table.items()}


def all_zero(rng: Rng, table: Table) -> Table:
    return {name: np.zeros(len(column)) if name != "time_s" and column.dtype != object else column
            for name, column in table.items()}


def constant_but_one_row(rng: Rng, table: Table) -> Table:
    out = constant_everywhere(rng, table)
    name = _some(rng, out)
    out[name] = out[name].copy()
    out[name][len(out[name]) // 3] += 1.0
    return out


def infinite_cells(rng: Rng, table: Table) -> Table:
    return _set(rng, _set(rng, table, np.inf, 0.02), -np.inf, 0.01)


def infinite_column(rng: Rng, table: Table) -> Table:
    return _set(rng, table, np.inf, 1.1)


def infinite_times(rng: Rng, table: Table) -> Table:
    return _with(table, time_s=np.where(_cells(rng, len(table["time_s"]), 0.01), np.inf, table["time_s"]))


def not_a_number(rng: Rng, table: Table) -> Table:
    return _set(rng, _set(rng, table, np.nan, 0.3), np.nan, 0.05)


def empty_column(rng: Rng, table: Table) -> Table:
    return _set(rng, table, np.nan, 1.1)


def nearly_empty_column(rng: Rng, table: Table) -> Table:
    return _set(rng, table, np.nan, 0.985)


def empty_stretch(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    begin = int(rng.integers(0, n // 2))
    out = dict(table)
    for name in list(table)[1:]:
        if table[name].dtype != object:
            out[name] = table[name].copy()
            out[name][begin:begin + n // 3] = np.nan
    return out


def huge_cells(rng: Rng, table: Table) -> Table:
    return _set(rng, table, 1e300, 0.003)


def huge_column(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    return _with(table, **{name: table[name] * 1e200})


def tiny_column(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    return _with(table, **{name: table[name] * 1e-300})


def huge_times(rng: Rng, table: Table) -> Table:
    """A count of an unknown clock: the steps between rows drown in the digits that a float has."""
    return _with(table, time_s=table["time_s"] + 1e15)


def unix_times(rng: Rng, table: Table) -> Table:
    return _with(table, time_s=table["time_s"] + 1_782_000_000.0)


def long_times(rng: Rng, table: Table) -> Table:
    """Hours between two parts of it: the logger was switched on again after a week."""
    late = np.arange(len(table["time_s"])) > len(table["time_s"]) // 2
    return _with(table, time_s=table["time_s"] + np.where(late, 604_800.0, 0.0))


def spread_times(rng: Rng, table: Table) -> Table:
    return _with(table, time_s=table["time_s"] * 1e6)


def jumping_times(rng: Rng, table: Table) -> Table:
    return _with(table, time_s=table["time_s"] + rng.exponential(0.4, len(table["time_s"])).cumsum())


def backward_times(rng: Rng, table: Table) -> Table:
    time_s = table["time_s"].copy()
    time_s[len(time_s) // 2:] -= 0.3 * time_s[-1]
    return _with(table, time_s=time_s)


def repeated_times(rng: Rng, table: Table) -> Table:
    return _with(table, time_s=np.floor(table["time_s"]))


def doubled_rows(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    return _rows(table, np.sort(np.concatenate((np.arange(n), rng.integers(0, n, n // 3)))))


def shuffled_rows(rng: Rng, table: Table) -> Table:
    return _rows(table, rng.permutation(len(table["time_s"])))


def missing_rows(rng: Rng, table: Table) -> Table:
    return _rows(table, ~_cells(rng, len(table["time_s"]), 0.4))


def long_gaps(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    kept = np.ones(n, bool)
    for begin in rng.integers(0, n, 4):
        kept[begin:begin + n // 7] = False
    return _rows(table, kept)


def few_rows(rng: Rng, table: Table) -> Table:
    return _rows(table, np.arange(len(table["time_s"])) < int(rng.integers(38, 70)))


def wide(rng: Rng, table: Table) -> Table:
    """1,999 columns: a bus log with every signal of it, some noise, some slow, some copies."""
    n, extra = len(table["time_s"]), {}
    some = _some(rng, table)
    for k in range(1999 - len(table)):
        kind = k % 4
        extra[f"signal_{k}"] = (rng.integers(0, 100, n) / 10.0 if kind == 0 else np.round(table[some] * (1 + k), 3)
                                if kind == 1 else np.full(n, float(k)) if kind == 2
                                else np.round(np.sin(np.arange(n) / (40.0 + k)), 3))
    kept = np.arange(n) < 3000                      # a file of 30 MB is enough
    return _rows({**table, **extra}, kept)


def long_names(rng: Rng, table: Table) -> Table:
    n, some = len(table["time_s"]), _some(rng, table)
    load = np.sin(np.arange(n) / 300.0)
    name = "TractorFrontAxleHydraulicPressureSensorAfterSecondaryFilterStageInBarMeasuredAtTheLeftSide"
    bent = table[some] * (1.0 + 0.05 * load)        # something depends on it: a term would be named for the column
    return {**table, some: bent, name: 40.0 + 10.0 * load, name + "_ValueOfTheBackupSensor": rng.normal(0.0, 1.0, n)}


def odd_names(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    odd = ("Öl °C", "a/b\\c", "x;y", "  ", "=1+1", "пробка", "排肥", "__proto__", "time s", "-", "0", "id", "a.b#c@d")
    return {**table, **{name: 5.0 + np.sin(np.arange(n) / (50.0 + 9 * k)) for k, name in enumerate(odd)}}


def copies(rng: Rng, table: Table) -> Table:
    return {**table, **{f"{name}_again": column for name, column in list(table.items())[1:]}}


def same_header_twice(rng: Rng, table: Table) -> Table:
    some = _some(rng, table)
    return {**table, f"{some}\0": table[some]}       # `text_of` writes the name without the mark


def words_in_numbers(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    cells = np.array([f"{value:.3f}" for value in table[name]], object)
    cells[_cells(rng, len(cells), 0.05)] = "ERR"
    return _with(table, **{name: cells})


def coarse(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    step = max(1e-9, float(np.ptp(table[name])) / 3.0)
    return _with(table, **{name: np.round(table[name] / step) * step})


def upside_down(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    return _with(table, **{name: -table[name]})


def loud(rng: Rng, table: Table) -> Table:
    name = _some(rng, table)
    spread = 1.0 + float(np.ptp(table[name]))
    return _with(table, **{name: table[name] + spread * rng.standard_cauchy(len(table[name]))})


def marks(rng: Rng, table: Table) -> Table:
    return _set(rng, _set(rng, table, -9999.0, 0.1), 65535.0, 0.05)


def odd_events(rng: Rng, table: Table) -> Table:
    texts = np.full(len(table["time_s"]), "", object)
    for k, text in enumerate(("refill nan", "refill inf", "refill 1e308", "refill -50", "refill 100 100", "strategy")):
        texts[(k + 1) * len(texts) // 8] = text
    return _with(table, events=texts)


ALL = tuple(Spoiler(one.__name__, one) for one in (
    constant_reading, constant_commands, constant_everywhere, all_zero, constant_but_one_row, infinite_cells,
    infinite_column, infinite_times, not_a_number, empty_column, nearly_empty_column, empty_stretch, huge_cells,
    huge_column, tiny_column, unix_times, long_times, jumping_times, repeated_times, doubled_rows, missing_rows,
    long_gaps, wide, long_names, odd_names, copies, coarse, upside_down, loud, marks, odd_events))
REFUSABLE = tuple(Spoiler(one.__name__, one, True) for one in (
    huge_times, spread_times, backward_times, shuffled_rows, few_rows, same_header_twice, words_in_numbers))
