"""How does a residual depend on a variable? Binned means with confidence bands show it, and the
variable along which an effect is most visible is chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.console.reports.variable_names import find_variable

Array = npt.NDArray[np.float64]

MEAN_BINS = 14
MIN_ROWS_IN_BIN = 3
# A rate needs longer bins than a mean.
RATE_BINS = 7
# Shortest bin in which a rate is estimated, s.
MIN_RATE_BIN_S = 20.0
# Multiple of the median interval above which a bin is omitted, because it would only stretch the
# scale.
MAX_INTERVAL_FACTOR = 3.0
TWO_SIDED_90_QUANTILE = 1.645
# Share of an effect by which a later axis must be more telling in order to be chosen.
MIN_AXIS_GAIN_SHARE = 0.03


class ResidualAxis(NamedTuple):
    """Names a variable by its id on which a residual (n,) may depend."""

    variable: str
    # Values (n,), NaN where the variable does not apply.
    values: Array
    # Signs (n,) by which the residual is multiplied, so that opposite changes do not cancel.
    sign: Array | None = None
    # Names of the values 0, 1, ... of a categorical variable.
    names: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Label of the axis, in the language in use."""
        turned = (
            " (residual turned so that up is the way of the change)"
            if self.sign is not None
            else ""
        )
        return find_variable(self.variable).label + turned


class BinnedMeans(NamedTuple):
    """Holds means (k,) over the bins of an axis, and half of their 90 % intervals."""

    at: Array
    mean: Array
    half: Array


def calc_binned_means(axis: ResidualAxis, values: Array, memory: float = 0.0) -> BinnedMeans:
    """Returns means of values (n,) over an axis, with half of their 90 % intervals.

    `memory` is the autocorrelation of neighbouring values, which makes the intervals wider.
    """
    index, count = assign_bins(axis)
    y = values if axis.sign is None else values * axis.sign
    keep = (index >= 0) & np.isfinite(y)
    index, y, x = index[keep], y[keep], axis.values[keep]
    number = np.bincount(index, minlength=count).astype(float)
    there = number >= MIN_ROWS_IN_BIN if len(y) > 4 * MIN_ROWS_IN_BIN else number > 0
    safe = np.maximum(number, 1.0)
    mean = np.bincount(index, y, minlength=count) / safe
    at = np.bincount(index, x, minlength=count) / safe
    spread = np.sqrt(
        np.bincount(index, (y - mean[index]) ** 2, minlength=count) / np.maximum(number - 1.0, 1.0)
    )
    memory = min(0.98, max(0.0, memory))
    own = np.maximum(1.0, number * (1.0 - memory) / (1.0 + memory))
    return BinnedMeans(
        at[there], mean[there], (TWO_SIDED_90_QUANTILE * spread / np.sqrt(own))[there]
    )


def calc_binned_rates(
    axis: ResidualAxis, level: Array, step_s: float, segments: npt.NDArray[np.int64], memory: float
) -> BinnedMeans:
    """Returns rates of change of a level (n,) by bins of an axis: least squares on the level
    itself, with first-order autoregressive noise.

    `segments` (n,) numbers continuous parts; between parts the level may jump. `memory` is the
    autocorrelation of the level's noise. Bins shorter than LEAST_RATE_S, or with far wider
    intervals than the others, are omitted.
    """
    index, count = assign_bins(axis, RATE_BINS, 0.0)
    inside = np.zeros((len(level), count + 1 + int(segments.max())))
    rows = np.arange(len(level))
    spent = np.zeros((len(level), count))
    known = index >= 0
    spent[rows[known], index[known]] = step_s
    inside[1:, :count] = np.cumsum(spent, axis=0)[:-1]
    inside[rows, count + segments] = 1.0
    together = segments[1:] == segments[:-1]
    memory = min(0.98, max(0.0, memory))
    white = (inside[1:] - memory * inside[:-1])[together]
    y = (level[1:] - memory * level[:-1])[together]
    inverse = np.linalg.pinv(white.T @ white)
    weights = inverse @ (white.T @ y)
    variance = float(np.sum((y - white @ weights) ** 2)) / max(1, len(y) - white.shape[1])
    lasts = np.bincount(index[known], minlength=count)
    there = lasts * step_s >= MIN_RATE_BIN_S
    at = np.bincount(index[known], axis.values[known], minlength=count) / np.maximum(lasts, 1)
    half = TWO_SIDED_90_QUANTILE * np.sqrt(variance * np.maximum(0.0, np.diag(inverse)[:count]))
    there &= half <= MAX_INTERVAL_FACTOR * np.median(half[there]) if there.any() else there
    return BinnedMeans(at[there], weights[:count][there], half[there])


def assign_bins(
    axis: ResidualAxis, bins: int = MEAN_BINS, even_share: float = 0.5
) -> tuple[npt.NDArray[np.int64], int]:
    """Returns the bin of each value (n,), -1 for none, and the number of bins.

    `even_share` is 1 for bins of equal width and 0 for bins of equal count.
    """
    x = axis.values
    known = np.isfinite(x) & (np.ones(len(x), bool) if axis.sign is None else axis.sign != 0.0)
    index = np.full(len(x), -1, np.int64)
    if not known.any():
        return index, 1
    kinds = np.unique(x[known])
    if axis.names or len(kinds) <= bins:
        index[known] = np.searchsorted(kinds, x[known])
        return index, len(kinds)
    low, high = np.percentile(x[known], (0.5, 99.5))
    by_rank = np.quantile(x[known], np.linspace(0.0, 1.0, bins + 1))
    even = np.linspace(low, high, bins + 1)
    edges = np.unique((1.0 - even_share) * by_rank + even_share * even)[1:-1]
    index[known] = np.searchsorted(edges, x[known])
    return index, len(edges) + 1


def calc_shown_share(axis: ResidualAxis, effect: Array) -> float:
    """Returns the share of an effect on the rows (n,) that its means over the axis show, 0 to 1."""
    total = float(np.sum(effect**2))
    if total <= 0.0:
        return 0.0
    index, count = assign_bins(axis)
    y = effect if axis.sign is None else effect * axis.sign
    keep = index >= 0
    sums = np.bincount(index[keep], y[keep], minlength=count)
    numbers = np.maximum(np.bincount(index[keep], minlength=count), 1)
    return float(np.sum(sums**2 / numbers)) / total


def find_telling_axis(axes: Sequence[ResidualAxis], effect: Array) -> ResidualAxis:
    """Returns the axis along which the effect is most visible; among nearly equal axes the
    first."""
    best, most = axes[0], calc_shown_share(axes[0], effect)
    for axis in axes[1:]:
        share = calc_shown_share(axis, effect)
        if share > most + MIN_AXIS_GAIN_SHARE:
            best, most = axis, share
    return best


def calc_correlation(values: Array) -> float:
    """Returns the correlation of neighbouring values."""
    centred = values - values.mean()
    total = float(np.sum(centred**2))
    return (
        float(np.sum(centred[1:] * centred[:-1])) / total
        if total > 0.0 and len(values) > 2
        else 0.0
    )
