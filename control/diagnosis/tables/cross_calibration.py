"""Compares two tables, or two labels of a table, of the same quantity by different instruments, and
finds the factor, delay, speed or length that reconciles them.

A speed reconciles a lag measured as a distance with a lag measured as a time; a factor or a delay
reconciles two times; a factor or a length reconciles two distances. Of two possible quantities the
one with the smaller residual is shown first.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, stdtrit
from topdress.control.calibration.bench_table import BenchTable
from topdress.control.machine.fall import find_start_drop_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.start_lag import calc_response_s
from topdress.control.recordings.speed_unit import KMH_PER_MPS

from .table_rows import UNCORRECTED_LABEL, list_labels
from .table_series import Array, BoolArray, sort_best_first

# Minimum number of shaft speeds that both tables have.
MIN_SHARED_SPEEDS = 5
# Assumed standard error of a row without replicates, as a share of its value.
UNREPEATED_ROW_ERROR_SHARE = 0.01
# Rounding error of a table's digits, as a share of the value.
ROUNDING_ERROR_SHARE = 0.001
# A row agrees within this number of standard errors.
AGREEMENT_SE = 2.0
# A factor this close to 1, or a shift (s, m) this close to 0, counts as none.
NEGLIGIBLE_CHANGE = 0.002
# P value below which the other quantity is reported to fit less well (F test of the residuals).
MAX_WORSE_FIT_P_VALUE = 0.05


class LagSeries(NamedTuple):
    """Lag of starts by shaft speed. `unit`: s or m; `error`: (n,) standard errors; `mps`: recorded
    ground speed.

    `label` and `column`: position of its `rows` in the table; `printed`: (rows,) values as printed
    there.
    """

    name: str
    unit: str
    shaft_rpm: Array
    value: Array
    error: Array
    mps: float | None
    label: str
    column: str
    printed: Array

    @property
    def rows(self) -> int:
        return len(self.printed)


class TableReconciliation(NamedTuple):
    """The quantity that reconciles two series. `kind`: speed, factor, delay or length. `other`: the
    second-best quantity's kind. `holds`: number of agreeing rows of `rows`."""

    first: LagSeries
    second: LagSeries
    kind: str
    value: float
    low: float
    high: float
    holds: int
    rows: int
    other: str
    other_value: float
    other_worse: bool


def list_lag_series(table: BenchTable, machine: Machine) -> list[LagSeries]:
    """Return the complete lags of a table, label by label; the machine's response is added to a
    drop time."""
    labels = list_labels(table)
    speed = table.find_speed_mps()
    found = []
    for label in dict.fromkeys(labels.tolist()):
        rows = labels == label
        name = (
            f"{table.path.replace(chr(92), '/').rsplit('/', 1)[-1]}{f' {label}' if label else ''}"
        )
        for column, unit in (("lag_m", "m"), ("lag_s", "s"), ("drop_s", "s"), ("miss_m", "m")):
            if column not in table.columns:
                continue
            used = rows & np.isfinite(table.columns[column]) & ~table.find_running_rows()
            if not used.any():
                continue
            rpm = np.unique(table.columns["shaft_rpm"][used])
            groups = [table.columns[column][used & (table.columns["shaft_rpm"] == n)] for n in rpm]
            means = np.array([np.mean(group) for group in groups])
            if column == "drop_s":
                means = means + [calc_response_s(machine, n) for n in rpm.tolist()]
            if column == "miss_m":
                if label != UNCORRECTED_LABEL:
                    name += " with what was corrected for"
                means = means + _calc_corrected_distance(
                    table, used & (label != UNCORRECTED_LABEL), rpm, machine
                )
            found.append(
                LagSeries(
                    name,
                    unit,
                    rpm,
                    means,
                    _calc_standard_errors(groups, means),
                    None if speed is None else float(np.nanmean(speed[rows])),
                    label,
                    column,
                    table.columns[column][used],
                )
            )
    return found


def _calc_corrected_distance(
    table: BenchTable, rows: BoolArray, rpm: Array, machine: Machine
) -> Array:
    """Return the distance by which a correction was early, (n,) m: recorded speed times the
    corrected lag; 0 without a correction."""
    speed = table.find_speed_mps()
    if speed is None or not rows.any():
        return np.zeros(len(rpm))
    given = table.columns.get("corrected_lag_s", np.full(table.rows, np.nan))
    starts = np.array(
        [
            calc_response_s(machine, n) + find_start_drop_s(machine.fall, n)
            for n in table.columns["shaft_rpm"].tolist()
        ]
    )
    early = speed * np.where(np.isfinite(given), given, starts)
    return np.array([float(np.mean(early[rows & (table.columns["shaft_rpm"] == n)])) for n in rpm])


def _calc_standard_errors(groups: Sequence[Array], means: Array) -> Array:
    """Return standard errors of the means from the pooled variance; a share of the value where
    nothing was repeated."""
    spare = sum(len(group) - 1 for group in groups)
    if spare < 1:
        return UNREPEATED_ROW_ERROR_SHARE * np.abs(means)
    pooled = sum(float(np.sum((group - group.mean()) ** 2)) for group in groups) / spare
    errors = np.array([np.sqrt(pooled / len(group)) for group in groups])
    return np.asarray(np.maximum(errors, ROUNDING_ERROR_SHARE * np.abs(means)))


def compare_lag_series(
    tables: Sequence[BenchTable], machine: Machine
) -> tuple[TableReconciliation, ...]:
    """Return the comparison of every pair of lag series of `tables` with common shaft speeds, in
    the tables' order."""
    every = [
        series
        for table in tables
        if table.kind in ("lag", "place")
        for series in list_lag_series(table, machine)
    ]
    found = (reconcile_pair(one, two) for one, two in combinations(every, 2))
    return tuple(pair for pair in found if pair is not None)


def reconcile_pair(one: LagSeries, two: LagSeries) -> TableReconciliation | None:
    """Reconcile two series; None where they have too few common shaft speeds. The first is the
    distance, or else the first argument."""
    if one.unit == "s" and two.unit == "m":
        one, two = two, one
    rpm = np.intersect1d(one.shaft_rpm, two.shaft_rpm)
    if len(rpm) < MIN_SHARED_SPEEDS:
        return None
    a, ea = _interpolate_series(one, rpm)
    b, eb = _interpolate_series(two, rpm)
    mps = one.mps if one.unit != two.unit else None
    ratio = a / b
    shift = a / mps - b if mps is not None else a - b
    factor = "speed" if one.unit != two.unit else "factor"
    constant = "length" if one.unit == two.unit == "m" else "delay"
    left = {
        factor: a - float(np.mean(ratio)) * b,
        constant: (shift - float(np.mean(shift))) * (mps or 1.0),
    }
    if one.unit != two.unit and mps is None:
        left.pop(constant)
    order = [
        list(left)[k] for k in sort_best_first([-float(np.sum(rest**2)) for rest in left.values()])
    ]
    values = {factor: ratio, constant: shift}
    best = values[order[0]]
    middle = float(np.mean(best))
    half = float(stdtrit(len(rpm) - 1, 0.95) * np.std(best, ddof=1) / np.sqrt(len(rpm)))
    good = np.hypot(ea, float(np.mean(ratio)) * eb)
    holds = int(np.sum(np.abs(left[order[0]]) <= AGREEMENT_SE * good))
    sums = [float(np.sum(left[kind] ** 2)) for kind in order]
    worse = (
        len(order) > 1
        and float(fdtrc(len(rpm) - 1, len(rpm) - 1, sums[1] / max(sums[0], 1e-12)))
        < MAX_WORSE_FIT_P_VALUE
    )
    other = order[1] if len(order) > 1 else ""
    return TableReconciliation(
        one,
        two,
        order[0],
        middle,
        middle - half,
        middle + half,
        holds,
        len(rpm),
        other,
        float(np.mean(values[other])) if other else 0.0,
        worse,
    )


def _interpolate_series(series: LagSeries, rpm: Array) -> tuple[Array, Array]:
    rows = np.searchsorted(series.shaft_rpm, rpm)
    return series.value[rows], series.error[rows]


def describe_pair(pair: TableReconciliation) -> str:
    """Describe for the user which quantity converts one series to the other, its interval, and the
    number of agreeing rows."""
    if (
        pair.first.unit == pair.second.unit
        and 2 * pair.holds >= pair.rows
        and _is_same_quantity(pair)
    ):
        return (
            f"{pair.first.name} and {pair.second.name} say the same: {pair.kind} "
            f"{_describe_interval(pair, 1.0, '.3f')}, in "
            f"{pair.holds} of {pair.rows} rows"
        )
    if pair.kind == "speed":
        by_what = f"a speed of {_describe_interval(pair, KMH_PER_MPS, '.2f')} km/h"
        written = (
            ""
            if pair.first.mps is None
            else f"; {KMH_PER_MPS * pair.first.mps:.2f} km/h is written"
        )
    else:
        by_what, written = (
            {
                "factor": f"a factor of {_describe_interval(pair, 1.0, '.3f')}",
                "delay": f"a delay of {_describe_interval(pair, 1.0, '.3f')} s",
                "length": f"a length of {_describe_interval(pair, 1.0, '.3f')} m",
            }[pair.kind],
            "",
        )
    names = f"{pair.first.name} ({pair.first.unit}) and {pair.second.name} ({pair.second.unit})"
    if 2 * pair.holds < pair.rows:
        return (
            f"{names}: no one quantity reconciles them; {by_what} holds in {pair.holds} of "
            f"{pair.rows} rows{written}"
        )
    other = ""
    if pair.other:
        scale, unit = {
            "speed": (KMH_PER_MPS, " km/h"),
            "delay": (1.0, " s"),
            "length": (1.0, " m"),
            "factor": (1.0, ""),
        }[pair.other]
        other = (
            f"; a {pair.other} of {scale * pair.other_value:.3g}{unit} fits "
            f"{'less well' if pair.other_worse else 'nearly as well'}"
        )
    return (
        f"{names} are reconciled by {by_what}, which holds in {pair.holds} of {pair.rows} "
        f"rows{written}{other}"
    )


def _is_same_quantity(pair: TableReconciliation) -> bool:
    neutral = 1.0 if pair.kind == "factor" else 0.0
    return pair.low <= neutral <= pair.high or abs(pair.value - neutral) < NEGLIGIBLE_CHANGE


def _describe_interval(pair: TableReconciliation, scale: float, form: str) -> str:
    value, low, high = (
        format(scale * figure, form) for figure in (pair.value, pair.low, pair.high)
    )
    return f"{value} (90 %: {low} to {high})"
