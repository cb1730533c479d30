"""Reads flow and scale of a log in bins of a second: the metered flow, the scale reading, and the
refills.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.machine.effect import HOPPER_CAPACITY, SHAFT_RANGE
from topdress.control.machine.machine import Machine, scale_nominal

from .grid import MAX_BRIDGED_STEPS, Grid, hold_last_value, make_grid
from .inputs import STOPPED_RPM, LogRows

Array = npt.NDArray[np.float64]

# Bin length, s: the scale's noise is correlated over a second, so finer bins add no information.
HOPPER_STEP_S = 1.0
# Minimum number of bins with a scale reading: flow is estimated over ten seconds, and two windows
# give no noise.
MIN_BINS = 20
# Maximum number of bins of a scale, 16 hours; a longer log gets longer bins.
MAX_BINS = 60_000
# Standard deviation of a change between two rows, as a share of the change: its time is uniform
# within the row, 1 / sqrt(12).
CHANGE_SD_SHARE = 0.3
# Standard deviation of the rate itself, as a share: control may have changed the rate and changed
# it back between rows.
STEADY_SD_SHARE = 0.05
# Row distance, s, to which that share refers; it scales in proportion.
STEADY_SD_TIME_S = 2.0
# Length of a gap, s, after which the hopper level is unknown by as much as may have been metered.
LONG_GAP_S = 3.0
# Minimum mass of a refill, kg, on the nominal machine; scaled to another machine's hopper.
MIN_REFILL_KG = 3.0
# Minimum mass of a refill in standard deviations of the scale: a small hopper's share may be below
# the noise.
MIN_REFILL_SD = 8.0
# Number of bins in which a refill's rise must complete: a bag is tipped in.
RISE_BINS = 3
# Rises within this number of bins are one refill.
MERGE_BINS = 10
# Number of bins whose median is the level before and after a refill.
LEVEL_BINS = 6
# Maximum distance of a logged refill event from the rise that it describes, s.
MAX_EVENT_DISTANCE_S = 120.0
# Number of bins whose median is the level at the start.
START_BINS = 10


class Hopper(NamedTuple):
    """Flow and scale of a log, in bins of HOPPER_STEP_S or of the log's own step."""

    # Start of each bin, and end of the last, s: (m+1,).
    time_s: Array
    # Mean over the bin, r/min: (m+1,).
    shaft_rpm: Array
    # Mean over the bin, weighted with the shaft speed, mm: (m+1,).
    opening_mm: Array
    pitch_deg: Array
    # Mean over the bin, kg: (m,).
    reading_kg: Array
    # Mean time of those readings, as a share of the bin: (m,).
    read_at: Array
    # Refilled mass by bin, kg: (m+1,).
    refill_kg: Array
    start_kg: float
    # Bins from which a refill counts.
    jumps: tuple[int, ...]
    # Whether the operator noted the mass of each refill.
    written: tuple[bool, ...]
    # Time grid over the m bins.
    grid: Grid
    # Standard deviation of the unobserved metering in a bin, r/min x mm x s.
    unseen: float = 0.0
    # Bin at which each long gap ends, with the standard deviation of the metering in the gap, r/min
    # x mm x s.
    gaps: tuple[tuple[int, float], ...] = ()
    # Sums of the machine file's terms, averaged over the bin with the metered flow as weight.
    more_percent: Array | float = 0.0
    more_kg_s: Array | float = 0.0
    # Sum of the terms of the reading, kg: (m,).
    more_kg: Array | float = 0.0


def read_hopper(
    every: LogRows, reading: Array, written: list[tuple[float, float]], machine: Machine
) -> Hopper | None:
    """Read flow and scale; None where the scale has readings in too few bins."""
    time = every.time_s
    width = max(HOPPER_STEP_S, every.step_s, float(np.ceil((time[-1] - time[0]) / MAX_BINS)))
    count = int(np.floor((time[-1] - time[0]) / width))
    edges = time[0] + width * np.arange(count + 1)
    turned, wide, level = _average_inputs(
        every, edges, width, scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM
    )
    known = np.isfinite(reading) & (time < edges[-1])
    bins = np.minimum(count - 1, np.floor((time[known] - time[0]) / width).astype(int))
    seen = np.bincount(bins, minlength=count)
    sums = np.bincount(bins, weights=reading[known], minlength=count)
    kg = np.where(seen > 0, sums / np.maximum(1, seen), np.nan)
    within = np.bincount(bins, weights=(time[known] - edges[bins]) / width, minlength=count)
    read_at = np.where(seen > 0, within / np.maximum(1, seen), 0.5)
    rise_kg = max(
        scale_nominal(machine, HOPPER_CAPACITY) * MIN_REFILL_KG,
        MIN_REFILL_SD * machine.noise.scale_kg,
    )
    refill, jumps, hidden = _find_refills(kg, rise_kg)
    stated = []
    for jump in jumps:
        close = [amount for at, amount in written if abs(at - edges[jump]) < MAX_EVENT_DISTANCE_S]
        stated.append(bool(close))
        if close:
            refill[jump] = close[0]
    good = np.isfinite(kg) & ~hidden
    if good.sum() < MIN_BINS:
        return None
    start_kg = float(np.median(kg[good][:START_BINS]))
    return Hopper(
        edges,
        turned,
        wide,
        level,
        kg,
        read_at,
        np.append(refill, 0.0),
        start_kg,
        jumps,
        tuple(stated),
        make_grid(edges[:-1] + 0.5 * width, good, width),
        *_bound_unseen_flow(every, edges, scale_nominal(machine, SHAFT_RANGE) * STOPPED_RPM),
        *sum_term_flows(every, edges),
    )


def sum_term_flows(
    every: LogRows, edges: Array
) -> tuple[Array | float, Array | float, Array | float]:
    """Return the sums of the machine file's terms in each bin: per cent of the flow, kg/s (m+1,),
    and kg of the reading (m,)."""
    more, time = every.more, every.time_s
    percent: Array | float = 0.0
    kg_s: Array | float = 0.0
    kg: Array | float = 0.0
    if "flow_percent" in more:
        [percent] = average_metered(
            more["flow_percent"][None, :], every.shaft_rpm * every.opening_mm, time, edges
        )
    if "flow_kg_min" in more:
        kg_s = average_bins(
            np.where(every.shaft_rpm > 0.0, more["flow_kg_min"], 0.0) / 60.0, time, edges
        )
    if "scale_kg" in more:
        kg = kg + average_bins(more["scale_kg"], time, edges)[:-1]
    if "scale_kg_min" in more:
        run_away = np.concatenate(
            ([0.0], np.cumsum(more["scale_kg_min"][:-1] / 60.0 * np.diff(time)))
        )
        kg = kg + average_bins(run_away, time, edges)[:-1]
    return percent, kg_s, kg


def average_bins(series: Array, time: Array, edges: Array) -> Array:
    """Return the mean of a held series (rows,) over each bin, with the last value repeated:
    (m+1,)."""
    mean = _share_sums_over_bins(time, np.diff(time) * series[:-1], edges) / np.diff(edges)
    return np.append(mean, mean[-1])


def average_metered(series: Array, metered: Array, time: Array, edges: Array) -> Array:
    """Return the means of several series (k, rows) over each bin, weighted with the metered flow;
    unweighted where nothing was metered."""
    metered = np.maximum(metered, 0.0)
    weight = average_bins(metered, time, edges)
    flows = weight > 0.0
    found = np.array([average_bins(metered * one, time, edges) for one in series]) / np.where(
        flows, weight, 1.0
    )
    return (
        found
        if flows.all()
        else np.where(flows, found, [average_bins(one, time, edges) for one in series])
    )


def _bound_unseen_flow(
    every: LogRows, edges: Array, stopped_rpm: float
) -> tuple[float, tuple[tuple[int, float], ...]]:
    """Return standard deviations of the metering between rows, relative to linear interpolation
    (`Hopper.unseen`, `gaps`)."""
    if not every.lost.any():
        return 0.0, ()
    rate = np.where(every.shaft_rpm < stopped_rpm, 0.0, every.shaft_rpm) * every.opening_mm
    spans, usual = (
        np.diff(every.time_s),
        float(np.median(rate[rate > 0.0])) if (rate > 0.0).any() else 0.0,
    )
    steady = (
        STEADY_SD_SHARE * 0.5 * (rate[1:] + rate[:-1]) * np.minimum(1.0, spans / STEADY_SD_TIME_S)
    )
    off = np.where(every.lost[1:], (CHANGE_SD_SHARE * np.abs(np.diff(rate)) + steady) * spans, 0.0)
    long = (spans > LONG_GAP_S) & (spans > MAX_BRIDGED_STEPS * every.step_s) & (usual > 0.0)
    ends = np.clip(
        np.searchsorted(edges, every.time_s[1:][long], side="right") - 1, 0, len(edges) - 2
    )
    gaps = tuple(
        (int(end), float(span * usual)) for end, span in zip(ends, spans[long], strict=True)
    )
    return float(np.sqrt(np.sum(off[~long] ** 2) / max(1, len(edges) - 1))), gaps


def _average_inputs(
    every: LogRows, edges: Array, width: float, stopped_rpm: float
) -> tuple[Array, Array, Array]:
    """Return mean shaft speed, opening (weighted with the speed) and pitch in each bin, with the
    last value repeated: (m+1,) each."""
    time, spans, opening = every.time_s, np.diff(every.time_s), every.opening_mm
    rpm = np.where(every.shaft_rpm < stopped_rpm, 0.0, every.shaft_rpm)

    def mean(series: Array) -> Array:
        return _share_sums_over_bins(time, spans * 0.5 * (series[1:] + series[:-1]), edges) / width

    turned, metered, plain, level = (
        mean(rpm),
        mean(rpm * opening),
        mean(opening),
        mean(every.pitch_deg),
    )
    turned = np.where(turned < stopped_rpm, 0.0, turned)
    wide = np.where(turned > 0.0, metered / np.where(turned > 0.0, turned, 1.0), plain)
    extend = np.append(np.arange(len(turned)), len(turned) - 1)
    return turned[extend], wide[extend], level[extend]


def list_noted_refills(time: Array, events: npt.NDArray[Any]) -> list[tuple[float, float]]:
    """Return time, s, and mass, kg, of the refills that the operator noted."""
    found: list[tuple[float, float]] = []
    for row in np.flatnonzero(events != ""):
        for word in str(events[row]).split(";"):
            parts = word.split()
            if len(parts) == 2 and parts[0] == "refill":
                try:
                    found.append((float(time[row]), float(parts[1])))
                except ValueError:
                    continue
            # The event withdraws the refill before.
            elif parts[:1] == ["refill_back"] and found:
                found.pop()
    return found


def _share_sums_over_bins(time: Array, amounts: Array, edges: Array) -> Array:
    """Distribute amounts per row interval over bins and return the sums: (len(edges)-1,)."""
    total = np.concatenate(([0.0], np.cumsum(amounts)))
    return np.diff(np.interp(edges, time, total))


def _find_refills(
    kg: Array, rise_kg: float
) -> tuple[Array, tuple[int, ...], npt.NDArray[np.bool_]]:
    """Return the refilled mass by bin, kg, the bins from which each refill counts, and the bins in
    which the reading is between two levels."""
    refill = np.zeros(len(kg))
    hidden = np.zeros(len(kg), bool)
    filled = hold_last_value(kg)
    rises = np.flatnonzero(filled[RISE_BINS:] - filled[:-RISE_BINS] > rise_kg)
    jumps: list[int] = []
    if len(rises):
        groups = np.split(rises, np.flatnonzero(np.diff(rises) > MERGE_BINS) + 1)
        for group in groups:
            begin, end = int(group[0]), min(len(kg) - 1, int(group[-1]) + RISE_BINS + 1)
            before = filled[max(0, begin + 1 - LEVEL_BINS) : begin + 1]
            after = filled[end : end + LEVEL_BINS]
            at = min(len(kg) - 1, end)
            refill[at] = max(0.0, float(np.median(after)) - float(np.median(before)))
            hidden[begin : at + 1] = True
            jumps.append(at)
    return refill, tuple(jumps), hidden
