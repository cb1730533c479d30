"""Measures an N-rich strip or a farmer check between two key presses: mean NDVI, its standard
error, number of samples. Pure.
"""

from __future__ import annotations

from itertools import pairwise
from math import sqrt
from statistics import median
from typing import Literal, NamedTuple

from topdress.control.agronomy.reference_strips import StripMean
from topdress.control.log_row import HEAD_COLUMNS, NDRE_COLUMNS, LogRow

# Shortest strip with a usable mean, m.
MIN_STRIP_M = 20.0
# A longer step between frames is a gap, s, which contributes nothing.
MAX_FRAME_STEP_S = 2.0
# Limit of the correlation of neighbouring samples, which keeps the standard error finite.
MAX_SAMPLE_CORRELATION = 0.95


class NRichStrip(NamedTuple):
    """Describes a strip so far.

    Attributes
    ----------
    ndvi
        Mean NDVI; None before any reading.
    cv_percent
        Coefficient of variation of the fused NDVI along the way, %.
    se
        Standard error of the mean; None for fewer than three samples.
    """

    length_m: float
    ndvi: float | None
    cv_percent: float | None
    se: float | None = None
    samples: int = 0

    @property
    def is_long_enough(self) -> bool:
        """Whether the strip is long enough to be used."""
        return self.length_m >= MIN_STRIP_M and self.ndvi is not None


class FieldMean:
    """Averages NDVI on ground outside strips, for up to a day. Every metre with an NDVI has the
    same weight."""

    def __init__(self) -> None:
        self._before_s: float | None = None
        # Sums instead of samples keep the memory constant over a day.
        self._length_m = self._sum = self._sum2 = 0.0

    @property
    def ndvi(self) -> float | None:
        """Mean NDVI; None before `MIN_STRIP_M` with readings."""
        return self._sum / self._length_m if self._length_m >= MIN_STRIP_M else None

    def add_row(self, row: LogRow) -> None:
        """Add a row of the run; a row without NDVI or speed adds no length."""
        before_s, self._before_s = self._before_s, row.time_s
        ndvi = find_heads_index(row)
        if before_s is None or ndvi is None or row.speed_used_mps is None:
            return
        step_s = row.time_s - before_s
        if not 0.0 < step_s <= MAX_FRAME_STEP_S:
            return
        self._add_length(max(0.0, row.speed_used_mps) * step_s, ndvi)

    def _add_length(self, step_m: float, ndvi: float) -> None:
        """Add a step with its NDVI to the sums."""
        self._length_m += step_m
        self._sum += step_m * ndvi
        self._sum2 += step_m * ndvi * ndvi


class StripRun(FieldMean):
    """Averages NDVI on a strip while it is driven, with the standard error of its mean."""

    def __init__(self, which: Literal["nrich", "check"] = "nrich") -> None:
        super().__init__()
        self.which = which
        # One entry per decision: an unchanged value over several frames is one sample.
        self._samples: list[float] = []

    def _add_length(self, step_m: float, ndvi: float) -> None:
        """Add a step to the sums, and its NDVI to the samples where it has changed."""
        super()._add_length(step_m, ndvi)
        if step_m > 0.0 and (not self._samples or self._samples[-1] != ndvi):
            self._samples.append(ndvi)

    @property
    def strip(self) -> NRichStrip:
        """Strip so far."""
        if self._length_m <= 0.0:
            return NRichStrip(0.0, None, None)
        mean = self._sum / self._length_m
        variance = max(0.0, self._sum2 / self._length_m - mean * mean)
        return NRichStrip(
            self._length_m,
            mean,
            100.0 * sqrt(variance) / mean if mean > 0.0 else None,
            calc_standard_error(self._samples),
            len(self._samples),
        )

    @property
    def value(self) -> StripMean | None:
        """Value for an order; None before any NDVI."""
        strip = self.strip
        # The order accepts NDVI above 0 and up to 1 only.
        if strip.ndvi is None or not 0.0 < round(strip.ndvi, 4) <= 1.0:
            return None
        return StripMean(self.which, round(strip.ndvi, 4), strip.se, strip.samples)


def find_heads_index(row: LogRow) -> float | None:
    """Return the vegetation index of the heads: the decision's fused value, else the median of the
    heads where another target source leaves that value empty. None means that the heads are silent.
    """
    if row.ndvi is not None or row.ndre is not None:
        return row.ndvi if row.ndvi is not None else row.ndre
    known = [
        value
        for name in (*HEAD_COLUMNS, *NDRE_COLUMNS)
        if (value := getattr(row, name)) is not None
    ]
    return median(known) if known else None


def calc_standard_error(samples: list[float]) -> float | None:
    """Return the standard error of the mean of samples along a way, whose neighbours are
    correlated.

    n samples count as n (1 - r) / (1 + r) independent samples with r the lag-1 correlation (Bayley
    and Hammersley 1946, J. R. Stat. Soc. Suppl. 8:184-197, for a first-order process). None for
    fewer than three samples.
    """
    n = len(samples)
    if n < 3:
        return None
    mean = sum(samples) / n
    off = [sample - mean for sample in samples]
    square = sum(one * one for one in off)
    if square <= 0.0:
        return 0.0
    alike = sum(a * b for a, b in pairwise(off)) / square
    alike = min(MAX_SAMPLE_CORRELATION, max(0.0, alike))
    return sqrt(square / (n - 1) / n * (1.0 + alike) / (1.0 - alike))
