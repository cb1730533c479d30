"""Compares applied with target rate in data that hold no more than rates: lag and gain, pass by
pass.

A pass is a stretch of work on one course. The applied rate y follows the target x with a lag L and
a gain g, y(t) = g x(t - L) + noise. L is searched for over an even grid on the rows that every lag
covers, g follows by least squares. Intervals are those of the profile likelihood [1]_, for the
number of independent rows by the residual's autocorrelation [2]_.

.. [1] Venzon and Moolgavkar, A method for computing profile-likelihood-based confidence intervals,
Applied Statistics
       37, 1988.
.. [2] Bayley and Hammersley, The "effective" number of independent observations in an
autocorrelated time series,
       J. R. Stat. Soc. Suppl. 8, 1946: n over 1 + 2 times the sum of the correlations.
.. [3] Kendall, Note on bias in the estimation of autocorrelation, Biometrika 41, 1954.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, chdtri, stdtrit
from topdress.control.diagnosis.judgement.evidence import TWO_SIDED_90_QUANTILE
from topdress.control.diagnosis.result import AppliedVersusTarget, Size
from topdress.control.geodesy import TangentPlane
from topdress.control.orders import State
from topdress.control.recordings.speed_unit import MOVING_MPS

Array = npt.NDArray[np.float64]

TARGET_COLUMN, APPLIED_COLUMN = "target_rate_kg_ha", "applied_rate_kg_ha"
# Column of an as-applied file whose rows are means over stretches of the path, with times at the
# stretches' middles.
STRETCH_COLUMN = "x_duration_s"
MAX_LAG_S, LAG_STEP_S = 6.0, 0.05
# Minimum length of a pass, s: every lag then covers a third or more.
MIN_PASS_S = 3 * MAX_LAG_S
# Minimum number of rows of a pass that every lag covers.
MIN_ROWS = 12
# A gap longer than this multiple of the median step ends a pass.
MAX_GAP_STEPS = 2.5
# Minimum length of a gap that ends a pass, s.
MIN_GAP_S = 3.0
# Change of course from the start of a pass that ends the pass, degrees.
MAX_COURSE_CHANGE_DEG = 60.0
# Minimum standard deviation over mean of a target that can show a lag.
MIN_CHANGE = 0.02
# Maximum autocorrelation of the residual from row to row.
MAX_AUTOCORRELATION = 0.95
# Significance level at which passes are reported to differ.
MAX_DIFFER_P_VALUE = 1e-3
# Drop of twice the log-likelihood at the ends of a 90 % interval (chi-squared, 1 degree of
# freedom).
DROP_90 = float(chdtri(1, 0.1))


class _RatePass(NamedTuple):
    """Fit of one pass at each trial lag."""

    begin_s: float
    end_s: float
    # Residual sum of squares by lag: (lags,).
    sums: Array
    # Gain by lag: (lags,).
    gains: Array
    # Sum of squares of the target by lag, for the gain's variance: (lags,).
    weight: Array
    rows: int
    # Sums of products of the residual at the best lag with itself, with the next row, and with the
    # row after.
    products: tuple[float, float, float]
    # Whether the target changes enough to show a lag.
    changes: bool
    speed_mps: float


def fit_rate_passes(
    columns: Mapping[str, npt.NDArray[Any]],
) -> tuple[tuple[AppliedVersusTarget, ...], str]:
    """Fit all passes together (first) and each pass, and return the fits with the reason for their
    absence ("" where there are fits).

    columns : of a run log, arrays (n,). time_s and both rates are required; course, position, state
    and speed are used where present.
    """
    missing = [
        name
        for name in (TARGET_COLUMN, APPLIED_COLUMN)
        if name not in columns or not np.isfinite(np.asarray(columns[name], np.float64)).any()
    ]
    if len(missing) == 2:
        return (), "no rates in it"
    if missing:
        return (), f"column {missing[0]} is missing or empty"
    time = np.asarray(columns["time_s"], np.float64)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    lags = np.arange(-MAX_LAG_S, MAX_LAG_S + 0.5 * LAG_STEP_S, LAG_STEP_S)
    found = [
        one
        for one in (
            _fit_one_pass(columns, time, rows, lags)
            for rows in _list_pass_rows(columns, time, step)
        )
        if one is not None
    ]
    if not found:
        return (), f"no pass of {MIN_PASS_S:g} s with both rates in {MIN_ROWS} rows and more"
    # The time of a value within its row is unknown.
    row_s = 0.0 if STRETCH_COLUMN in columns else step / np.sqrt(12.0)
    fits = tuple(_fit_common_lag(number, [one], lags, row_s) for number, one in enumerate(found, 1))
    return (
        (_fit_common_lag(None, found, lags, row_s), *fits)
        if len(fits) > 1
        else (_fit_common_lag(None, found, lags, row_s),)
    ), ""


def describe_rate_fit(fit: AppliedVersusTarget) -> str:
    """Describe a fit in a sentence."""
    where = f"over {fit.passes} passes" if fit.passes > 1 else "over one pass"
    return f"applied against target {where}: {describe_rate_value(fit)}"


def describe_rate_value(fit: AppliedVersusTarget) -> str:
    lag, gain = fit.lag, fit.gain
    late = (
        "lag not judged: the target changes too little"
        if lag.value is None
        else (f"lag {lag.value:.2f} s (90 %: {lag.low:.2f} to {lag.high:.2f})")
    )
    if lag.value is not None and fit.place_m is not None:
        late += f", {fit.place_m:.1f} m"
    differ = "; the passes differ by more than their noise" if fit.differ else ""
    return f"{late}; gain {gain.value:.3f} (90 %: {gain.low:.3f} to {gain.high:.3f}){differ}"


def _list_pass_rows(
    columns: Mapping[str, npt.NDArray[Any]], time: Array, step: float
) -> list[npt.NDArray[np.int64]]:
    """Return the rows of each pass."""
    course = _find_course_deg(columns, time)
    good = np.isfinite(np.asarray(columns[TARGET_COLUMN], np.float64)) & np.isfinite(
        np.asarray(columns[APPLIED_COLUMN], np.float64)
    )
    state = columns.get("state")
    if state is not None and (np.asarray(state) != "").any():
        good &= np.asarray(state) == State.WORKING
    speed = columns.get("speed_mps")
    if speed is not None:
        good &= ~(np.asarray(speed, np.float64) < MOVING_MPS)
    rows = np.flatnonzero(good)
    if not len(rows):
        return []
    longest = max(MAX_GAP_STEPS * step, MIN_GAP_S)
    found, begin = [], 0
    for k in range(1, len(rows) + 1):
        ends = (
            k == len(rows)
            or time[rows[k]] - time[rows[k - 1]] > longest
            or _has_turned(course, rows[begin], rows[k])
        )
        if ends:
            found.append(rows[begin:k])
            begin = k
    return [one for one in found if time[one[-1]] - time[one[0]] >= MIN_PASS_S]


def _has_turned(course: Array, began: int, now: int) -> bool:
    # NaN, an unknown course, compares as False.
    return bool(abs((course[now] - course[began] + 180.0) % 360.0 - 180.0) > MAX_COURSE_CHANGE_DEG)


def _find_course_deg(columns: Mapping[str, npt.NDArray[Any]], time: Array) -> Array:
    """Return the course in degrees from north, from the heading or the positions; NaN where neither
    is recorded."""
    heading = columns.get("heading_deg")
    if heading is not None and np.isfinite(np.asarray(heading, np.float64)).mean() > 0.5:
        return np.asarray(heading, np.float64)
    lat, lon = (columns.get(name) for name in ("lat_deg", "lon_deg"))
    if lat is None or lon is None or not np.isfinite(np.asarray(lat, np.float64)).any():
        return np.full(len(time), np.nan)
    lat, lon = np.asarray(lat, np.float64), np.asarray(lon, np.float64)
    first = int(np.flatnonzero(np.isfinite(lat))[0])
    way = np.gradient(
        TangentPlane(float(lat[first]), float(lon[first])).project_many_to_m(lat, lon), axis=0
    )
    return np.where(np.hypot(*way.T) > 0.0, np.degrees(np.arctan2(way[:, 0], way[:, 1])), np.nan)


def _fit_one_pass(
    columns: Mapping[str, npt.NDArray[Any]], time: Array, rows: npt.NDArray[np.int64], lags: Array
) -> _RatePass | None:
    at, target, applied = (
        np.asarray(columns[name], np.float64)[rows]
        for name in ("time_s", TARGET_COLUMN, APPLIED_COLUMN)
    )
    asked = (at >= at[0] + MAX_LAG_S) & (at <= at[-1] - MAX_LAG_S)
    if asked.sum() < MIN_ROWS or not (target > 0.0).any():
        return None
    y = applied[asked]
    sums, gains, weight = np.empty((3, len(lags)))
    for k, lag in enumerate(lags.tolist()):
        x = np.interp(at[asked] - lag, at, target)
        weight[k] = max(float(x @ x), 1e-12)
        gains[k] = float(x @ y) / weight[k]
        sums[k] = float(np.sum((y - gains[k] * x) ** 2))
    best = int(np.argmin(sums))
    left = y - gains[best] * np.interp(at[asked] - lags[best], at, target)
    speed = columns.get("speed_mps")
    mps = float("nan") if speed is None else float(np.nanmean(np.asarray(speed, np.float64)[rows]))
    mean = float(np.mean(target))
    products = (
        float(left @ left) + 1e-12,
        float(left[1:] @ left[:-1]),
        float(left[2:] @ left[:-2]),
    )
    return _RatePass(
        float(at[0]),
        float(at[-1]),
        np.maximum(sums, 1e-9 * float(y @ y) + 1e-12),
        gains,
        weight,
        len(y),
        products,
        float(np.std(target[asked])) > MIN_CHANGE * mean,
        mps,
    )


def _calc_independent_share(passes: list[_RatePass]) -> float:
    """Return the number of independent rows per row, from all passes together, because they share a
    machine.

    The residual is a first-order process plus white noise, as the steps of the target between rows
    also leave white noise: correlations c1, c1 r, c1 r^2 ... from row to row, each biased by (1 + 3
    c) / n in a series of n [3]_.
    """
    rows = sum(one.rows for one in passes)
    own, next_row, over_next = (sum(one.products[k] for one in passes) for k in range(3))
    c1, c2 = (c + (1.0 + 3.0 * c) * len(passes) / rows for c in (next_row / own, over_next / own))
    c1 = min(max(c1, 0.0), MAX_AUTOCORRELATION)
    r = min(max(c2 / c1, c1), MAX_AUTOCORRELATION) if c1 > 2.0 / np.sqrt(rows) else c1
    return max(3.0 / rows, 1.0 / (1.0 + 2.0 * c1 / (1.0 - r)))


def _fit_common_lag(
    number: int | None, passes: list[_RatePass], lags: Array, row_s: float
) -> AppliedVersusTarget:
    """Fit `passes` with a common lag and a gain for each; number None means all passes of the
    data."""
    independent = _calc_independent_share(passes)
    together = sum((one.sums for one in passes), np.zeros(len(lags)))
    drop = independent * sum(one.rows for one in passes) * np.log(together)
    best = int(np.argmin(drop))
    lag = (
        _estimate_lag(drop, best, lags, row_s)
        if any(one.changes for one in passes)
        else Size(None, None, None, "s")
    )
    at = best if lag.value is not None else int(np.argmin(np.abs(lags)))
    value, half, differ = _average_gain(passes, at, independent)
    mps = float(np.mean([one.speed_mps for one in passes]))
    place = None if lag.value is None or not np.isfinite(mps) else lag.value * mps
    return AppliedVersusTarget(
        number,
        len(passes),
        min(one.begin_s for one in passes),
        max(one.end_s for one in passes),
        sum(one.rows for one in passes),
        lag,
        Size(value, value - half, value + half, ""),
        place,
        differ,
    )


def _estimate_lag(drop: Array, best: int, lags: Array, row_s: float) -> Size:
    """Return the lag with its interval; unknown where the interval exceeds the trial lags."""
    inside = np.flatnonzero(drop - drop[best] <= DROP_90)
    first, last = int(inside[0]), int(inside[-1])
    if first == 0 or last == len(lags) - 1:
        return Size(None, None, None, "s")

    def crossing(a: int, b: int) -> float:
        share = (DROP_90 - (drop[a] - drop[best])) / (drop[b] - drop[a])
        return float(lags[a] + share * (lags[b] - lags[a]))

    low, high = crossing(first, first - 1), crossing(last, last + 1)
    bend = drop[best - 1] - 2.0 * drop[best] + drop[best + 1]
    value = (
        float(lags[best] + 0.5 * LAG_STEP_S * (drop[best - 1] - drop[best + 1]) / bend)
        if bend > 0.0
        else float(lags[best])
    )
    below, above = (
        float(np.hypot(side, TWO_SIDED_90_QUANTILE * row_s)) for side in (value - low, high - value)
    )
    return Size(value, value - below, value + above, "s")


def _average_gain(
    passes: list[_RatePass], at: int, independent: float
) -> tuple[float, float, bool]:
    """Return the weighted mean gain, half of its 90 % interval, and whether the passes differ.

    If the passes differ, the interval includes the difference (Birge, The calculation of errors by
    the method of least squares, Physical Review 40, 1932).
    """
    gains = np.array([one.gains[at] for one in passes])
    free_rows = max(1.0, independent * sum(one.rows for one in passes) - len(passes))
    # Residual variance for independent rows.
    noise = sum(one.sums[at] for one in passes) / free_rows
    share = np.array([one.weight[at] for one in passes]) / noise
    mean = float(share @ gains / share.sum())
    spread = float(share @ (gains - mean) ** 2)
    free = len(passes) - 1
    differ = free > 0 and float(chdtrc(free, spread)) < MAX_DIFFER_P_VALUE
    widened = max(1.0, spread / free) if differ else 1.0
    sides = float(stdtrit(free_rows, 0.95))
    return mean, sides * float(np.sqrt(widened / share.sum())), differ
