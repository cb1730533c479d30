"""How are the columns of a recording repaired? In this order: times, sentinels, places, ranges,
units of speeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from topdress.control.log_row import COLUMNS, FILE_BEGINS, LOG_BEGINS, PLAUSIBLE, TEXT_COLUMNS
from topdress.control.recordings.finding import Finding
from topdress.control.recordings.places import in_place
from topdress.control.recordings.speeds import in_mps
from topdress.control.recordings.times import mended_times
from topdress.control.recordings.values import (
    ANYTHING,
    NDVI,
    SENTINELS,
    from_percent,
    known,
    within,
)

Columns = dict[str, NDArray[Any]]

# Range of each number of a log.
LIMITS = PLAUSIBLE | {
    name: ANYTHING for name in COLUMNS if name not in {*PLAUSIBLE, *TEXT_COLUMNS, "time_s"}
}


def mended(
    columns: Mapping[str, NDArray[Any]], utc_s: Callable[[], NDArray[np.float64]] | None = None
) -> tuple[Columns, list[Finding]]:
    """Repairs the columns of a run log; arrays that change are copied.

    Parameters
    ----------
    columns : arrays (n,) by column name; `time_s` in any unit, the others as published.
    utc_s : returns seconds since 1970 (n,), as for `mended_times`.

    Returns
    -------
    The repaired columns (m,), and the findings.

    Raises
    ------
    ValueError : in one line, where too few rows have usable times."""
    begins = np.array(
        [k for k, text in enumerate(columns.get("events", ())) if text and _begins(text)], np.intp
    )
    times = mended_times(np.asarray(columns["time_s"], np.float64), utc_s, begins)
    found = {
        name: values if isinstance(times.rows, slice) else values[times.rows]
        for name, values in columns.items()
    }
    findings = list(times.findings)
    return mend_values({**found, "time_s": times.time_s}, findings), findings


def _begins(events: object) -> bool:
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
    for name, limits in LIMITS.items():
        if name in columns:
            columns[name] = known(
                name, columns[name], limits, findings, nowhere if name == "lon_deg" else None
            )
    in_place(columns, findings)
    for name in NDVI:
        if name in columns:
            columns[name] = from_percent(name, columns[name], findings)
    for name, limits in PLAUSIBLE.items():
        if name in columns:
            columns[name] = within(name, columns[name], limits, findings)
    in_mps(columns, findings)
    return columns
