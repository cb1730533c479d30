"""How uniform is a canopy, and how often must it be sensed? Paper A, section 1.2, eq 1 and table
1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

# Sampling frequencies compared in paper A, table 1, Hz; the first is that of the raw data.
FREQUENCIES_HZ = (2.0, 1.0, 0.5, 0.25, 0.125)


class ReadingUniformity(NamedTuple):
    """Holds the uniformity of one stretch of readings, in percent; NaN where the mean is not
    above zero."""

    n: int
    mean: float
    # Sample standard deviation (n - 1) over mean, %.
    cv_percent: float
    # Christiansen's coefficient of uniformity, eq 1, %.
    cuc_percent: float


def calc_cv_percent(values: npt.ArrayLike) -> float:
    """Returns the coefficient of variation, %: sample standard deviation (divisor n - 1) over
    the mean.

    Parameters
    ----------
    values : (n,) readings; values that are not finite are left out.

    Returns
    -------
    NaN with fewer than two values or a mean not above zero."""
    w = _select_finite(values)
    # A mean of zero or less has no relative scatter.
    if w.size < 2 or w.mean() <= 0.0:
        return float("nan")
    return float(100.0 * w.std(ddof=1) / w.mean())


def calc_cuc_percent(values: npt.ArrayLike) -> float:
    """Returns Christiansen's coefficient of uniformity, %, (1 - sum|w - mean| / sum w) x 100
    (paper A, eq 1).

    Parameters
    ----------
    values : (n,) readings; values that are not finite are left out.

    Returns
    -------
    NaN without values or with a mean not above zero."""
    w = _select_finite(values)
    if w.size == 0 or w.mean() <= 0.0:
        return float("nan")
    # The coefficient uses absolute deviations and reacts less to single readings than the CV.
    return float(100.0 * (1.0 - np.abs(w - w.mean()).sum() / w.sum()))


def measure_evenness(values: npt.ArrayLike) -> ReadingUniformity:
    """Returns count, mean, CV and C_uc of readings (n,); values that are not finite are left
    out."""
    w = _select_finite(values)
    return ReadingUniformity(
        w.size, float(w.mean()) if w.size else float("nan"), calc_cv_percent(w), calc_cuc_percent(w)
    )


def subsample_readings(
    values: npt.ArrayLike, source_hz: float, target_hz: float
) -> npt.NDArray[np.float64]:
    """Returns every k-th reading, k = source_hz / target_hz: (n,) -> (ceil(n / k),).

    Raises
    ------
    ValueError : the source frequency is not a whole multiple of the target."""
    if not (source_hz > 0.0 and target_hz > 0.0):
        raise ValueError(f"frequencies {source_hz:g} and {target_hz:g} Hz: allowed is above 0")
    step = source_hz / target_hz
    # Only whole multiples keep every k-th reading without interpolation.
    if step < 1.0 or abs(step - round(step)) > 1e-9:
        raise ValueError(
            f"target {target_hz:g} Hz: allowed is {source_hz:g} Hz over a whole number"
        )
    return np.asarray(values, dtype=np.float64)[:: round(step)]


def tabulate_frequencies(
    values: npt.ArrayLike, source_hz: float = 2.0, frequencies_hz: Sequence[float] = FREQUENCIES_HZ
) -> dict[float, ReadingUniformity]:
    """Returns the uniformity at each sampling frequency of readings (n,) taken at `source_hz`: a
    column of paper A's table 1."""
    return {
        hz: measure_evenness(subsample_readings(values, source_hz, hz)) for hz in frequencies_hz
    }


class FrequencyChoice(NamedTuple):
    """Holds the chosen frequency. `departure` is, for each reduced frequency, the mean of |CV -
    raw| + |C_uc - raw| in percentage points."""

    frequency_hz: float
    departure: dict[float, float]


def choose_frequency(
    plots: Sequence[Mapping[float, ReadingUniformity]], raw_hz: float = 2.0
) -> FrequencyChoice:
    """Chooses the sampling frequency that changes the statistics of the canopy least (paper A,
    section 1.2).

    The criterion is the mean over all plots of |CV - CV_raw| + |C_uc - C_uc_raw|; the smallest
    wins, and on a tie the lower frequency (less data). On table 1 this is 1 Hz, the paper's
    choice, which halves the data. Frequencies that are missing or NaN in any plot are left out.

    Parameters
    ----------
    plots : for each plot a mapping from frequency, Hz, to its statistics.
    raw_hz : frequency of the raw data, Hz.

    Raises
    ------
    ValueError : no reduced frequency can be compared."""
    usable = [plot for plot in plots if raw_hz in plot]
    shared = set.intersection(*(set(plot) for plot in usable)) if usable else set()
    departure: dict[float, float] = {}
    for hz in sorted(f for f in shared if f < raw_hz):
        apart = [
            abs(plot[hz].cv_percent - plot[raw_hz].cv_percent)
            + abs(plot[hz].cuc_percent - plot[raw_hz].cuc_percent)
            for plot in usable
        ]
        finite = [value for value in apart if np.isfinite(value)]
        if finite:
            departure[hz] = sum(finite) / len(finite)
    if not departure:
        raise ValueError(f"no plot has statistics at {raw_hz:g} Hz and at a lower frequency")
    # On a tie the lower frequency wins, because it needs less data.
    return FrequencyChoice(min(departure, key=lambda hz: (departure[hz], hz)), departure)


def _select_finite(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    w = np.asarray(values, dtype=np.float64).ravel()
    return w[np.isfinite(w)]
