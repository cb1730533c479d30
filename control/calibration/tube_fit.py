"""Does the air stream in the tube carry the granules, or do they fall singly? From lag tests
between two rates.

A start cannot decide this (docs/decisions/0005), a change can: from 40 to 80 r/min the plate's
reading is best split into its two levels 1.13 s after the shaft has changed where the stream
carries all, 0.96 s where granules fall singly and quick ones land on top of slow ones. Where the
stream carries, the reading also jumps by a third at once. Shares up to 0.5 are alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from topdress.control.machine.change_lag import SettledPair, calc_change_lag
from topdress.control.machine.machine import Machine
from topdress.control.machine.start_lag import calc_change_response_s, set_carried_share

from .bench_table import Array, BenchTable, select_usable_rows
from .calibration_record import make_record, make_title, merge_records
from .least_squares import FittedInterval

# Candidate shares of the pace that the stream sets.
CANDIDATE_STREAM_SHARES = np.linspace(0.0, 1.0, 11)
MIN_ROWS = 3
# Standard deviation of the line of starts, s: lag table 3, 70 rows of 0.06 s.
START_LINE_SD_S = 0.010
# Least scatter of a row, s, whatever the repeats show: the plate is read 20 times a second.
MIN_SCATTER_S = 0.005
# Beyond this distance from every share, standard deviations, the table belongs to another machine.
MAX_DISTANCE_SD = 4.0
# Least standard deviation of the share in the machine file.
MIN_STREAM_SHARE_SD = 0.02
# Probability inside the interval.
INTERVAL_PROBABILITY = 0.9


@dataclass(frozen=True, slots=True)
class TubeFit:
    """Holds the share of the pace in the tube that the stream sets, 0 to 1, with its standard
    deviation and 90 % interval; the rows used, their scatter, and the distance of their mean
    from the nearest share's drop, s."""

    carried_share: FittedInterval
    sd: float
    rows_used: int
    scatter_s: float
    off_s: float
    settles: bool


def settle_tube(table: BenchTable, machine: Machine, *, date: str = "") -> tuple[Machine, TubeFit]:
    """Returns the machine with the tube that rows of a running shaft show, and the fit.

    `drop_s` of such a row (or `lag_s` minus the machine's response) goes from the change of the
    shaft until the stream on the ground is half-way between its two rates. Every share is
    simulated and compared with the rows; all are equally likely beforehand.

    Raises
    ------
    ValueError : in one line, where there are fewer than three rows, or no share gives such
        times."""
    table = select_usable_rows(table)
    before, after, drops = _select_rows(table, machine)
    if len(drops) < MIN_ROWS:
        raise ValueError(
            f"{table.path}: {len(drops)} rows of a change between two rates (before_rpm "
            "above 0, drop_s "
            f"or lag_s): at least {MIN_ROWS} are needed to settle the tube"
        )
    by_share = [set_carried_share(machine, share) for share in CANDIDATE_STREAM_SHARES.tolist()]
    steps = sorted(set(zip(before.tolist(), after.tolist(), strict=True)))
    chi2, off = np.zeros(len(CANDIDATE_STREAM_SHARES)), np.full(len(CANDIDATE_STREAM_SHARES), 0.0)
    scatter = _calc_scatter_s(before, after, drops)
    for one in steps:
        rows = (before == one[0]) & (after == one[1])
        wanted = np.array([_calc_drop_s(m, *one) for m in by_share])
        sd = np.hypot(scatter / np.sqrt(rows.sum()), START_LINE_SD_S)
        miss = float(drops[rows].mean()) - wanted
        chi2 += (miss / sd) ** 2
        off = np.where(np.abs(miss) > np.abs(off), miss, off)
    best = int(np.argmin(chi2))
    if chi2[best] > len(steps) * MAX_DISTANCE_SD**2:
        raise ValueError(
            f"{table.path}: column drop_s: {off[best]:+.3f} s off the nearest that any tube gives: "
            "allowed are times from the shaft's change until the stream is half-way between "
            "its two rates"
        )
    weight = np.exp(-0.5 * (chi2 - chi2[best]))
    weight /= weight.sum()
    share = float(weight @ CANDIDATE_STREAM_SHARES)
    sd = max(MIN_STREAM_SHARE_SD, float(np.sqrt(weight @ (CANDIDATE_STREAM_SHARES - share) ** 2)))
    below, above = np.interp(
        [0.5 - 0.5 * INTERVAL_PROBABILITY, 0.5 + 0.5 * INTERVAL_PROBABILITY],
        np.cumsum(weight),
        CANDIDATE_STREAM_SHARES,
    ).tolist()
    interval = FittedInterval(round(share, 2), below, above)
    settled = set_carried_share(machine, interval.value)
    settled = settled.model_copy(
        update={
            "tolerance": machine.tolerance.model_copy(
                update={"carried_share": round(min(1.0, sd), 3)}
            ),
            "adopted": merge_records(
                machine,
                (
                    make_record(
                        "fall.carried_share",
                        interval,
                        "",
                        table.path,
                        date,
                        {"shaft_rpm": (float(before.min()), float(after.max()))},
                    ),
                ),
                (),
            ),
            "title": make_title(machine, "tube", table.path, date),
        }
    )
    return Machine.model_validate(dict(settled)), TubeFit(
        interval, sd, len(drops), scatter, float(off[best]), settled.is_tube_measured
    )


def _select_rows(table: BenchTable, machine: Machine) -> tuple[Array, Array, Array]:
    """Returns shaft speed before and after, r/min, and drop, s, of each row of a running shaft."""
    running = table.find_running_rows()
    if "drop_s" in table.columns:
        drops = table.columns["drop_s"]
    else:
        drops = table.columns.get("lag_s", np.full(table.rows, np.nan)) - calc_change_response_s(
            machine
        )
    running = running & np.isfinite(drops)
    if not running.any():
        return np.zeros(0), np.zeros(0), np.zeros(0)
    return table.columns["before_rpm"][running], table.columns["shaft_rpm"][running], drops[running]


def _calc_drop_s(machine: Machine, before_rpm: float, after_rpm: float) -> float:
    """Returns the time from the shaft's change until the landed step is half-way, s."""
    opening = machine.set_points.opening_mm
    lag = calc_change_lag(
        machine, SettledPair(before_rpm, opening), SettledPair(after_rpm, opening)
    )
    return lag.total_s - calc_change_response_s(machine)


def _calc_scatter_s(before: Array, after: Array, drops: Array) -> float:
    """Returns the standard deviation of a row about the mean of its step, s."""
    left, rows, steps = 0.0, 0, 0
    for one in set(zip(before.tolist(), after.tolist(), strict=True)):
        group = drops[(before == one[0]) & (after == one[1])]
        left += float(np.sum((group - group.mean()) ** 2))
        rows, steps = rows + len(group), steps + 1
    return max(MIN_SCATTER_S, float(np.sqrt(left / max(1, rows - steps))))
