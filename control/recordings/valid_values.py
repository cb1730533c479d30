"""Which values of a recording are real readings? Unreadable numbers, sentinels, ranges, outliers
and repeated readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import HEAD_COLUMNS, NDRE_COLUMNS
from topdress.control.recordings.finding import Finding, many

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

UNLIMITED = (-np.inf, np.inf)
SENTINELS = (
    -999.0,
    -9999.0,
    -99999.0,
    -999.9,
    -999.99,
    -99.0,
    999.0,
    9999.0,
    99999.0,
    999999.0,
    999.9,
    9999.9,
    32767.0,
    -32768.0,
    65535.0,
    2147483647.0,
    -2147483648.0,
)
# A sentinel within the plausible range is this many times larger than any other value.
SENTINEL_RATIO = 3.0
# A larger number is no reading of a machine in any unit (as in machine files).
MAX_READABLE = 1e9
# A smaller number is 0: its square would be lost next to any other.
MIN_READABLE = 1e-9
# Decimals that logs print: three to six, eight for places, which are not rounded.
PRINTED_DIGITS = 8
# A cell is empty after so long without a reading, s: a longer run of equal values is no dropout.
MAX_HELD_S = 3.0
# Probability that equal readings in a row occur by chance anywhere in the log.
HELD_PROBABILITY = 0.01
# Window of the median, cells: a reading of one row or two does not move it.
OUTLIER_WINDOW = 5
# Window in which the usual distance of readings from that median is measured, cells.
OUTLIER_SPREAD_WINDOW = 15
# Limit in standard deviations: a normal distribution reaches 6 once in a thousand million.
OUTLIER_SD = 10.0
# Standard deviation of a normal distribution over its median absolute deviation, for the cells
# around.
MAD_SD = 1.4826
# Nine in ten normal values are within this many standard deviations: a column that jumps more often
# has no outliers.
TWO_SIDED_90_QUANTILE = 1.645
NDVI_COLUMNS = (*HEAD_COLUMNS, "ndvi")

# Vegetation indices and places are blanked outside their range, because their definition limits
# them.
BLANKED_OUTSIDE = frozenset({"lat_deg", "lon_deg", *NDVI_COLUMNS, *NDRE_COLUMNS, "ndre"})


def blank_sentinels(
    name: str,
    values: Floats,
    limits: tuple[float, float],
    findings: list[Finding],
    inside: Flags | None = None,
) -> Floats:
    """Returns values (n,) with NaN for unreadable numbers and sentinels; the same array where
    there are none. limits: range of the quantity. inside: as for `flag_sentinels`."""
    marked = flag_sentinels(values, limits, inside)
    if marked.any():
        kinds = ", ".join(f"{value:g}" for value in np.unique(values[marked])[:3])
        count = int(marked.sum())
        findings.append(
            Finding(
                "sentinel",
                f"column {name}: {many(count, 'value')} {kinds} emptied: not known",
                name,
                count,
            )
        )
        values = np.where(marked, np.nan, values)
    infinite, beyond = np.isinf(values), np.isfinite(values) & (np.abs(values) > MAX_READABLE)
    for marked, id_, what in (
        (infinite, "infinite", "infinite"),
        (beyond, "beyond", f"beyond {MAX_READABLE:.0e}"),
    ):
        if marked.any():
            count = int(marked.sum())
            findings.append(
                Finding(
                    id_,
                    f"column {name}: {many(count, 'cell')} {what}, which no machine reads: emptied",
                    name,
                    count,
                )
            )
            values = np.where(marked, np.nan, values)
    return values


def blank_unreadable(values: Floats) -> Floats:
    """Returns numbers (n,) that arithmetic can use: NaN for unreadable ones, 0 for those lost in
    any sum."""
    sane = np.where(np.isfinite(values) & ~(np.abs(values) > MAX_READABLE), values, np.nan)
    sane[np.abs(sane) < MIN_READABLE] = 0.0
    if np.array_equal(sane, values, equal_nan=True) and not np.signbit(values[values == 0.0]).any():
        # Nothing has changed: a million rows are not stored twice.
        return values
    return sane


def blank_outliers(name: str, values: Floats, findings: list[Finding]) -> Floats:
    """Blanks readings of one row or two that are far from those before and after (Hampel's
    identifier: Davies and Gather, JASA 88, 1993, 782): a few such cells would dominate any
    correlation with the column.

    The limit follows from the spread around each cell, from that of the whole column, and from
    the steps in which the column is written."""
    rows = np.flatnonzero(np.isfinite(values))
    if len(rows) < OUTLIER_SPREAD_WINDOW:
        return values
    seen = values[rows]
    # The import takes a third of a second, and most recordings do not need it.
    from scipy.ndimage import median_filter

    off = np.abs(seen - median_filter(seen, OUTLIER_WINDOW, mode="nearest"))
    steps = np.diff(np.unique(seen))
    scale = np.maximum(
        MAD_SD * median_filter(off, OUTLIER_SPREAD_WINDOW),
        np.percentile(off, 90.0) / TWO_SIDED_90_QUANTILE,
    )
    far = rows[
        off
        > OUTLIER_SD * np.maximum(scale, float(np.percentile(steps, 5.0)) if len(steps) else np.inf)
    ]
    if not len(far):
        return values
    findings.append(
        Finding(
            "lone",
            f"column {name}: {many(len(far), 'value')} such as {values[far[0]]:g} far off "
            "those before and after: not used",
            name,
            len(far),
        )
    )
    alone = values.copy()
    alone[far] = np.nan
    return alone


def flag_sentinels(
    values: Floats, limits: tuple[float, float] = UNLIMITED, inside: Flags | None = None
) -> Flags:
    """Returns which values (n,) are sentinels: out of the limits or far larger than all others;
    or in the rows `inside` (n,) where those are given."""
    low, high = limits
    if not values.size or not _may_have_sentinels(values, limits):
        return np.zeros(values.shape, bool)
    suspect = np.isin(values, SENTINELS)
    if inside is None:
        others = np.abs(values[~suspect & np.isfinite(values) & ~(np.abs(values) > MAX_READABLE)])
        inside = np.abs(values) > SENTINEL_RATIO * (others.max() if others.size else np.inf)
    return np.asarray(suspect & ((values < low) | (values > high) | inside), bool)


def _may_have_sentinels(values: Floats, limits: tuple[float, float]) -> bool:
    """Returns quickly whether a column may contain sentinels at all; most do not."""
    low, high = np.fmin.reduce(values), np.fmax.reduce(values)
    return bool(low <= -99.0 or high >= 999.0 or low < limits[0] or high > limits[1])


def apply_limits(
    name: str, values: Floats, limits: tuple[float, float], findings: list[Finding]
) -> Floats:
    """Reports values outside the limits, and blanks them where a definition excludes them."""
    outside = (values < limits[0]) | (values > limits[1])
    count = int(np.count_nonzero(outside))
    if count == 0:
        return values
    example = f"{values[outside][0]:g}"
    allowed = f"allowed {limits[0]:g} to {limits[1]:g}"
    if name in BLANKED_OUTSIDE:
        findings.append(
            Finding(
                "outside",
                f"column {name}: {many(count, 'value')} such as {example} emptied: {allowed}",
                name,
                count,
            )
        )
        return np.where(outside, np.nan, values)
    findings.append(
        Finding(
            "implausible",
            f"column {name}: {many(count, 'value')} such as {example}, {allowed}: left as read",
            name,
            count,
        )
    )
    return values


def convert_percent(name: str, values: Floats, findings: list[Finding]) -> Floats:
    """Converts an NDVI in percent to a share."""
    seen = values[np.isfinite(values)]
    if not seen.size or np.median(seen) <= 1.0 or seen.min() < 0.0 or seen.max() > 100.0:
        return values
    findings.append(
        Finding(
            "ndvi_percent", f"column {name} is in percent: divided by 100", name, int(seen.size)
        )
    )
    return values / 100.0


def round_as_printed(values: Floats) -> Floats:
    """Rounds readings to the last digit that a log prints: repeats and steps of a column are
    evidence, and must not depend on the last bits of a float."""
    with np.errstate(over="ignore"):
        # Adding 0 turns -0 into 0.
        rounded = np.round(values, PRINTED_DIGITS) + 0.0
    if np.array_equal(rounded, values, equal_nan=True):
        # The values are already rounded: a million rows are not stored twice.
        return values
    return np.where(np.isfinite(rounded), rounded, values)


def blank_held_readings(
    name: str, values: Floats, step_s: float, findings: list[Finding]
) -> Floats:
    """Blanks readings that were repeated through a dropout: of an improbably long run of equal
    readings only the first is kept."""
    same = np.concatenate(([False], (values[1:] == values[:-1]) & (values[1:] != 0.0)))
    share = same.sum() / max(1, np.isfinite(values).sum())
    # Where most readings repeat, the resolution is coarse and no dropout is proved.
    if share == 0.0 or share > 0.5:
        return values
    longest = max(
        3, int(np.ceil(np.log(HELD_PROBABILITY / len(values)) / np.log(min(0.9, share + 1e-4))))
    )
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, len(values)))
    held = np.zeros(len(values), bool)
    odd = (lengths > longest) & (lengths * step_s < MAX_HELD_S)
    for start, length in zip(starts[odd], lengths[odd], strict=True):
        held[start + 1 : start + length] = True
    if not held.any():
        return values
    count = int(held.sum())
    findings.append(
        Finding(
            "held",
            f"column {name}: {count} cells only repeat an older reading and are not used",
            name,
            count,
        )
    )
    return np.where(held, np.nan, values)
