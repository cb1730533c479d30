"""What careless loggers, spreadsheets and sensors do to a recording, by name; what is random in
it comes of a seed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .machines import Table

Rng = np.random.Generator
Array = np.ndarray
Change = Callable[[Rng, Table], Table]


class Spoiler(NamedTuple):
    """`refusable`: a program may refuse the file in one clear line (exit code 2): it cannot be
    read as it stands."""

    name: str
    apply: Change
    refusable: bool


def _some(rng: Rng, table: Table) -> str:
    names = [name for name in table if name != "time_s" and table[name].dtype != object]
    return str(rng.choice(names))


def _cells(rng: Rng, n: int, share: float) -> Array:
    return rng.random(n) < share


def _rows(table: Table, kept: Array) -> Table:
    return {name: column[kept] for name, column in table.items()}


def _column(change: Callable[[Rng, Array], Array]) -> Change:
    """One column of numbers is changed."""

    def apply(rng: Rng, table: Table) -> Table:
        name = _some(rng, table)
        return {**table, name: change(rng, table[name])}

    return apply


def _every(change: Callable[[str, Array], Array], texts: bool = False) -> Change:
    """Every column but the times is changed, those of texts too or not."""
    return lambda rng, table: {
        name: column
        if name == "time_s" or (column.dtype == object and not texts)
        else change(name, column)
        for name, column in table.items()
    }


def _times(change: Callable[[Rng, Array], Array]) -> Change:
    return lambda rng, table: {**table, "time_s": change(rng, table["time_s"])}


def _kept(rows: Callable[[Rng, int], Array]) -> Change:
    """Which rows stand in the file."""
    return lambda rng, table: _rows(table, rows(rng, len(table["time_s"])))


def _cells_are(*values_and_shares: tuple[float, float]) -> Change:
    """A share of the cells of some column is a value; then another one."""

    def apply(rng: Rng, table: Table) -> Table:
        for value, share in values_and_shares:
            table = _column(
                lambda rng, x, value=value, share=share: np.where(  # type: ignore[misc]
                    _cells(rng, len(x), share), value, x
                )
            )(rng, table)
        return table

    return apply


def _empty_stretch(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    begin, row = int(rng.integers(0, n // 2)), np.arange(n)
    return _every(lambda _, x: np.where((row >= begin) & (row < begin + n // 3), np.nan, x))(
        rng, table
    )


def _without_gaps(rng: Rng, n: int) -> Array:
    kept = np.ones(n, bool)
    for begin in rng.integers(0, n, 4):
        kept[begin : begin + n // 7] = False
    return kept


def _back(time_s: Array) -> Array:
    return np.where(np.arange(len(time_s)) < len(time_s) // 2, time_s, time_s - 0.3 * time_s[-1])


def _wide(rng: Rng, table: Table) -> Table:
    """1,999 columns: a bus log with every signal of it, some noise, some slow, some copies."""
    n, extra = len(table["time_s"]), {}
    some = _some(rng, table)
    for k in range(1999 - len(table)):
        kind = k % 4
        extra[f"signal_{k}"] = (
            rng.integers(0, 100, n) / 10.0
            if kind == 0
            else np.round(table[some] * (1 + k), 3)
            if kind == 1
            else np.full(n, float(k))
            if kind == 2
            else np.round(np.sin(np.arange(n) / (40.0 + k)), 3)
        )
    return _rows({**table, **extra}, np.arange(n) < 3000)  # a file of 30 MB is enough


def _long_names(rng: Rng, table: Table) -> Table:
    n, some = len(table["time_s"]), _some(rng, table)
    load = np.sin(np.arange(n) / 300.0)
    name = (
        "TractorFrontAxleHydraulicPressureSensorAfterSecondaryFilterStageInBarMeasuredAtTheLeftSide"
    )
    # something depends on it: a term would be named for the column
    bent = table[some] * (1.0 + 0.05 * load)
    return {
        **table,
        some: bent,
        name: 40.0 + 10.0 * load,
        name + "_ValueOfTheBackupSensor": rng.normal(0.0, 1.0, n),
    }


def _odd_names(rng: Rng, table: Table) -> Table:
    n = len(table["time_s"])
    odd = (
        "Öl °C",
        "a/b\\c",
        "x;y",
        "  ",
        "=1+1",
        "пробка",
        "排肥",
        "__proto__",
        "time s",
        "-",
        "0",
        "id",
        "a.b#c@d",
    )
    return {
        **table,
        **{name: 5.0 + np.sin(np.arange(n) / (50.0 + 9 * k)) for k, name in enumerate(odd)},
    }


def _twice(rng: Rng, table: Table) -> Table:
    some = _some(rng, table)
    return {**table, f"{some}\0": table[some]}  # `text_of` writes the name without the mark


def _in_thirds(rng: Rng, column: Array) -> Array:
    step = max(1e-9, float(np.ptp(column)) / 3.0)
    return np.round(column / step) * step


def _words(rng: Rng, column: Array) -> Array:
    cells = np.array([f"{value:.3f}" for value in column], object)
    cells[_cells(rng, len(cells), 0.05)] = "ERR"
    return cells


def _odd_events(rng: Rng, table: Table) -> Table:
    texts = np.full(len(table["time_s"]), "", object)
    for k, text in enumerate(
        ("refill nan", "refill inf", "refill 1e308", "refill -50", "refill 100 100", "strategy")
    ):
        texts[(k + 1) * len(texts) // 8] = text
    return {**table, "events": texts}


_constant = _every(lambda _, x: np.full(len(x), x[0], x.dtype), texts=True)
_READ: dict[str, Change] = {
    "constant_reading": _column(lambda rng, x: np.full(len(x), float(np.median(x)))),
    "constant_commands": _every(
        lambda name, x: np.full(len(x), x[len(x) // 2]) if name.endswith("_cmd") else x
    ),
    "constant_everywhere": _constant,
    "all_zero": _every(lambda _, x: np.zeros(len(x))),
    "constant_but_one_row": lambda rng, table: _column(
        lambda rng, x: x + (np.arange(len(x)) == len(x) // 3)
    )(rng, _constant(rng, table)),
    "infinite_cells": _cells_are((np.inf, 0.02), (-np.inf, 0.01)),
    "infinite_column": _cells_are((np.inf, 1.1)),
    "infinite_times": _times(lambda rng, t: np.where(_cells(rng, len(t), 0.01), np.inf, t)),
    "not_a_number": _cells_are((np.nan, 0.3), (np.nan, 0.05)),
    "empty_column": _cells_are((np.nan, 1.1)),
    "nearly_empty_column": _cells_are((np.nan, 0.985)),
    "empty_stretch": _empty_stretch,
    "huge_cells": _cells_are((1e300, 0.003)),
    "huge_column": _column(lambda rng, x: x * 1e200),
    "tiny_column": _column(lambda rng, x: x * 1e-300),
    "unix_times": _times(lambda rng, t: t + 1_782_000_000.0),
    # The logger was switched on again after a week.
    "long_times": _times(
        lambda rng, t: t + np.where(np.arange(len(t)) > len(t) // 2, 604_800.0, 0.0)
    ),
    "jumping_times": _times(lambda rng, t: t + rng.exponential(0.4, len(t)).cumsum()),
    "repeated_times": _times(lambda rng, t: np.floor(t)),
    "doubled_rows": _kept(
        lambda rng, n: np.sort(np.concatenate((np.arange(n), rng.integers(0, n, n // 3))))
    ),
    "missing_rows": _kept(lambda rng, n: ~_cells(rng, n, 0.4)),
    "long_gaps": _kept(_without_gaps),
    "wide": _wide,
    "long_names": _long_names,
    "odd_names": _odd_names,
    "copies": lambda rng, table: {
        **table,
        **{f"{name}_again": column for name, column in list(table.items())[1:]},
    },
    "coarse": _column(_in_thirds),
    "upside_down": _column(lambda rng, x: -x),
    "loud": _column(lambda rng, x: x + (1.0 + float(np.ptp(x))) * rng.standard_cauchy(len(x))),
    "marks": _cells_are((-9999.0, 0.1), (65535.0, 0.05)),
    "odd_events": _odd_events,
}
_REFUSABLE: dict[str, Change] = {
    # A count of an unknown clock: the steps between rows drown in the digits that a float has.
    "huge_times": _times(lambda rng, t: t + 1e15),
    "spread_times": _times(lambda rng, t: t * 1e6),
    "backward_times": _times(lambda rng, t: _back(t)),
    "shuffled_rows": _kept(lambda rng, n: rng.permutation(n)),
    "few_rows": _kept(lambda rng, n: np.arange(n) < int(rng.integers(38, 70))),
    "same_header_twice": _twice,
    "words_in_numbers": _column(_words),
}
SPOILERS = tuple(
    Spoiler(name, change, some is _REFUSABLE)
    for some in (_READ, _REFUSABLE)
    for name, change in some.items()
)
