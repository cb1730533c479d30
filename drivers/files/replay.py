"""Which measurements did the control loop receive, and which commands did it give, according to its
log?

A log row holds values without the times at which they were sampled. These times are estimated:

- A value that differs from the row before was sampled at this row; for GNSS a new `utc` shows it,
  where the log has this column.
- A value that repeats counts as sampled again every period of its sensor. The period is the lower
  decile of the intervals between changes, and at most half the time for which the loop holds a
  value. A sensor that had fallen silent would have an empty cell.
- Where cells become empty, the loop had held the last value for the time for which control holds it
(`VALID_FOR`): the value was sampled that long before, or at its last change if that was later. From
then on it remains the newest known value and grows old.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import GNSS_VALID_FOR_S, HEAD_COLUMNS, NDRE_COLUMNS, VALID_FOR_S
from topdress.control.orders import TargetSource
from topdress.control.readings import (
    SENSED_COLUMNS,
    AnnouncedSpeeds,
    GnssFix,
    Measurements,
    Reading,
    parse_announcement,
)
from topdress.drivers.files.read_log import RunLog

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Columns of a fix besides its position.
_GNSS_COLUMNS = ("fix_quality", "satellites", "hdop", "speed_mps", "heading_deg")


class _NewestReadings(NamedTuple):
    """Holds for every row the newest reading: its row (-1: none yet) and its time, s."""

    row: NDArray[np.intp]
    time_s: Floats


def iter_measurements(log: RunLog) -> Iterator[Measurements]:
    """Yields the measurements that the loop received at each row. Values are the newest accepted
    values, however old (see their time). A log with ground speed but neither positions nor wheel
    speed supplies its speed as the wheel's."""
    if not len(log):
        return
    time_s = log.time_s.tolist()
    fixes = _find_fixes(log)
    # A log with NDRE comes from heads whose second index determines the rate.
    index = "ndre" if any(log.has(name) for name in (*NDRE_COLUMNS, "ndre")) else "ndvi"
    single = NDRE_COLUMNS if index == "ndre" else HEAD_COLUMNS
    heads = [_find_readings(log, name, name) for name in single if log.has(name)] or [
        _find_readings(log, index, "ndvi_1")
    ]
    # Logs of tractors often have only the ground speed.
    stands_for_wheel = (
        log.has("speed_mps") and not log.has("lat_deg") and not log.has("wheel_speed_mps")
    )
    wheel = "speed_mps" if stands_for_wheel else "wheel_speed_mps"
    sensors = [
        _find_readings(log, wheel if name == "wheel_speed_mps" else name, name)
        for name in SENSED_COLUMNS
    ]
    switch = [
        None if value != value else value != 0.0 for value in log.numbers("work_switch").tolist()
    ]
    announced: AnnouncedSpeeds | None = None
    # The log's target includes the operator's nudge, but the rate request of another display does
    # not.
    # The nudge is applied by the loop itself, so it is removed from the recorded target.
    nudged = 1.0 + np.nan_to_num(log.numbers("nudge_percent")) / 100.0
    targets = (log.numbers("target_rate_kg_ha") / nudged).tolist()
    for at_s, fix, ndvi, held, work, text, source, target in zip(
        time_s,
        fixes,
        zip(*heads, strict=True),
        zip(*sensors, strict=True),
        switch,
        log.texts("speed_told").tolist(),
        log.texts("target_source").tolist(),
        targets,
        strict=True,
    ):
        # An announcement stays valid until the next one.
        announced = (parse_announcement(text, at_s) if text else None) or announced
        # NaN is not equal to itself, so this also excludes rows without a target.
        asked = (
            Reading(target, at_s) if source == TargetSource.EXTERNAL and target == target else None
        )
        readings: dict[str, Any] = dict(zip(SENSED_COLUMNS, held, strict=True))
        yield Measurements(
            at_s,
            fix,
            ndvi=ndvi,
            work_switch=work,
            speed_told=announced,
            canopy_index=index,
            rate_asked=asked,
            **readings,
        )


def _find_readings(log: RunLog, column: str, sensor: str) -> list[Reading | None]:
    values = log.numbers(column)
    # Each sensor has its own time of validity in the loop.
    held = _find_newest_readings(
        log.time_s, np.isfinite(values), _find_changes(values), VALID_FOR_S[sensor]
    )
    readings: list[Reading | None] = []
    plain = values.tolist()
    for row, time_s in zip(held.row.tolist(), held.time_s.tolist(), strict=True):
        readings.append(Reading(plain[row], time_s) if row >= 0 else None)
    return readings


def _find_fixes(log: RunLog) -> list[GnssFix | None]:
    lat_deg, lon_deg = log.numbers("lat_deg"), log.numbers("lon_deg")
    known = np.isfinite(lat_deg) & np.isfinite(lon_deg)
    utc = log.texts("utc")
    # The receiver's own time shows new fixes even if the machine stands.
    if log.has("utc"):
        fresh = np.concatenate(([True], utc[1:] != utc[:-1]))
        held = _find_newest_readings(log.time_s, known, fresh, np.inf, repeats=False)
    else:
        fresh = (
            _find_changes(lat_deg)
            | _find_changes(lon_deg)
            | _find_changes(log.numbers("speed_mps"))
        )
        held = _find_newest_readings(log.time_s, known, fresh, GNSS_VALID_FOR_S)
    columns = [log.numbers(name).tolist() for name in _GNSS_COLUMNS]
    lats, lons, utcs = lat_deg.tolist(), lon_deg.tolist(), utc.tolist()
    fixes: list[GnssFix | None] = []
    for row, time_s in zip(held.row.tolist(), held.time_s.tolist(), strict=True):
        if row < 0:
            fixes.append(None)
            continue
        quality, satellites, hdop, speed_mps, heading_deg = [
            value if value == value else None for value in (column[row] for column in columns)
        ]
        fixes.append(
            GnssFix(
                time_s,
                lats[row],
                lons[row],
                1 if quality is None else int(quality),
                None if satellites is None else int(satellites),
                hdop,
                speed_mps,
                heading_deg,
                utcs[row] or None,
            )
        )
    return fixes


def _find_changes(values: Floats) -> Flags:
    """Returns which values differ from the row before. The first value differs; unknown after
    unknown does not."""
    # Two unknown values are equal for this purpose, although NaN differs from NaN.
    differs = (values[1:] != values[:-1]) & ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.concatenate((np.ones(min(1, values.size), bool), differs))


def _estimate_period_s(time_s: Floats, fresh: Flags) -> float:
    """Returns the sensor's period, s, from the shortest usual interval between fresh values; 0
    without an interval."""
    intervals_s = np.diff(time_s[fresh])
    # A low quantile ignores the long intervals of constant values.
    return float(np.quantile(intervals_s, 0.1)) if intervals_s.size else 0.0


def _find_newest_readings(
    time_s: Floats, known: Flags, fresh: Flags, hold_s: float, repeats: bool = True
) -> _NewestReadings:
    """Returns the newest reading at every row (module docstring); `repeats` tells whether a
    repeated value may have been sampled again."""
    rows = np.arange(time_s.size)
    # A value after a gap was sampled again, even if it is unchanged.
    after_gap = known & np.concatenate(([True], ~known[:-1]))
    new = known & (fresh | after_gap)
    row = np.maximum.accumulate(np.where(known, rows, -1))
    changed_s = time_s[np.maximum(np.maximum.accumulate(np.where(new, rows, -1)), 0)]
    sampled_s = changed_s
    if repeats:
        # The loop would have dropped a value that repeats less often.
        period_s = min(_estimate_period_s(time_s, new), hold_s / 2.0)
        since_s = time_s - changed_s
        again_s = (
            time_s
            if period_s <= 0.0
            # The small number prevents a loss of a whole period by rounding.
            else changed_s + np.floor(since_s / period_s + 1e-6) * period_s
        )
        latest_s = np.maximum(changed_s, _find_last_known_s(time_s, known) - hold_s)
        # A value is no newer than its row.
        sampled_s = np.minimum(np.minimum(again_s, latest_s), time_s)
    return _NewestReadings(row, np.where(row >= 0, sampled_s[np.maximum(row, 0)], np.nan))


def _find_last_known_s(time_s: Floats, known: Flags) -> Floats:
    """Returns for every row the time, s, of the last known row before the cells become empty;
    infinite where they do not."""
    ends = known & np.concatenate((~known[1:], [False]))
    gap_s = np.where(ends, time_s, np.inf)
    return np.minimum.accumulate(gap_s[::-1])[::-1]
