"""How many counts has a turn of the metering shaft's encoder? From the counts between a mark and
the same mark after whole turns."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from scipy.special import stdtrit

from .least_squares import FittedInterval

# Accuracy with which a pencil line is set to a pointer by eye, degrees: 1 mm on a shaft of 40 mm.
MARK_SETTING_DEG = 3.0
# Standard deviation of the difference of two whole counts.
COUNT_DIFFERENCE_SD = 1.0 / sqrt(6.0)


def fit_counts(counts: Sequence[int], turns: int) -> FittedInterval:
    """Returns the counts a turn from those of each run of `turns` whole turns, with a 90 %
    interval: by the scatter of the runs, at least by whole counts; of a single run by the
    accuracy of the mark.

    Raises
    ------
    ValueError : in one line, for impossible runs: no count, backwards, a turn too many or too
        few."""
    for run, count in enumerate(counts, 1):
        if count == 0:
            raise ValueError(
                f"run {run}: not one count: the shaft did not turn, or the encoder is not wired"
            )
        if count < 0:
            raise ValueError(
                f"run {run}: {count} counts: the shaft turned backwards, or A and B are exchanged"
            )
    found = np.array(counts) / turns
    apart = float(np.ptp(found) * turns / np.mean(found))
    if apart > 0.5:
        said = ", ".join(map(str, counts))
        raise ValueError(
            f"runs of {said} counts are {apart:.1f} turns apart: one was miscounted: measure again"
        )
    mean, runs = float(np.mean(found)), len(counts)
    if runs == 1:
        half = mean * sqrt(2.0) * MARK_SETTING_DEG / 360.0 / turns
    else:
        sd = max(float(np.std(found, ddof=1)), COUNT_DIFFERENCE_SD / turns)
        half = float(stdtrit(runs - 1, 0.95)) * sd / sqrt(runs)
    return FittedInterval(mean, mean - half, mean + half)
