"""How are the columns of a recording repaired? In this order: times, sentinels, places, ranges,
units of speeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import (
    COLUMNS,
    FILE_BEGINS,
    LOG_BEGINS,
    PLAUSIBLE_RANGES,
    TEXT_COLUMNS,
)
from topdress.control.recordings.finding import Finding
from topdress.control.recordings.place_check import mend_places
from topdress.control.recordings.row_times import mend_times
from topdress.control.recordings.speed_unit import mend_speeds
from topdress.control.recordings.valid_values import (
    NDVI_COLUMNS,
    SENTINELS,
    UNLIMITED,
    apply_limits,
    blank_sentinels,
    convert_percent,
)

Columns = dict[str, NDArray[Any]]

# Range of each number of a log.
COLUMN_LIMITS = PLAUSIBLE_RANGES | {
    name: UNLIMITED for name in COLUMNS if name not in {*PLAUSIBLE_RANGES, *TEXT_COLUMNS, "time_s"}
}


def mend_recording(
    columns: Mapping[str, NDArray[Any]], utc_s: Callable[[], NDArray[np.float64]] | None = None
) -> tuple[Columns, list[Finding]]:
    """Repairs the columns of a run log; arrays that change are copied.

    Parameters
    ----------
    columns : arrays (n,) by column name; `time_s` in any unit, the others as published.
    utc_s : returns seconds since 1970 (n,), as for `mend_times`.

    Returns
    -------
    The repaired columns (m,), and the findings.

    Raises
    ------
    ValueError : in one line, where too few rows have usable times."""
    begins = np.array(
        [k for k, text in enumerate(columns.get("events", ())) if text and _is_file_begin(text)],
        np.intp,
    )
    times = mend_times(np.asarray(columns["time_s"], np.float64), utc_s, begins)
    found = {
        name: values if isinstance(times.rows, slice) else values[times.rows]
        for name, values in columns.items()
    }
    findings = list(times.findings)
    return mend_values({**found, "time_s": times.time_s}, findings), findings


def _is_file_begin(events: object) -> bool:
    """Returns whether the events of a row mark the beginning of a joined file, as `import`
    writes them."""
    return isinstance(events, str) and any(
        one.startswith((FILE_BEGINS, LOG_BEGINS)) for one in events.split(";")
    )


def mend_values(columns: Columns, findings: list[Finding]) -> Columns:
    """Returns the columns without impossible values, and appends the findings."""
    columns = dict(columns)
    # A longitude of -99 degrees is a place in Mexico: it is a sentinel only where the latitude is
    # a sentinel too.
    nowhere = np.isin(columns.get("lat_deg", np.zeros_like(columns["time_s"])), SENTINELS)
    for name, limits in COLUMN_LIMITS.items():
        if name in columns:
            columns[name] = blank_sentinels(
                name, columns[name], limits, findings, nowhere if name == "lon_deg" else None
            )
    mend_places(columns, findings)
    for name in NDVI_COLUMNS:
        if name in columns:
            columns[name] = convert_percent(name, columns[name], findings)
    for name, limits in PLAUSIBLE_RANGES.items():
        if name in columns:
            columns[name] = apply_limits(name, columns[name], limits, findings)
    mend_speeds(columns, findings)
    return columns
