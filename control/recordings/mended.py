"""A recording's columns put right, each thing in its turn: times, sentinels, places, ranges,
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

# What each number of a log can be.
LIMITS = PLAUSIBLE | {
    name: ANYTHING for name in COLUMNS if name not in {*PLAUSIBLE, *TEXT_COLUMNS, "time_s"}
}


def mended(
    columns: Mapping[str, NDArray[Any]], utc_s: Callable[[], NDArray[np.float64]] | None = None
) -> tuple[Columns, list[Finding]]:
    """The columns (n,) of a run log put right, (m,), and what was found; `time_s` in any unit,
    the others as published.

    Arrays that change are copied. utc_s : as of `mended_times`. Raises ValueError, one line.
    """
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
    """Whether the events of a row say that one of several files begins there, as `import`
    writes them."""
    return isinstance(events, str) and any(
        one.startswith((FILE_BEGINS, LOG_BEGINS)) for one in events.split(";")
    )


def mend_values(columns: Columns, findings: list[Finding]) -> Columns:
    """The columns with values that can be what their names say; what was found is added."""
    columns = dict(columns)
    # -99 degrees next to a latitude is a place in Mexico: a longitude is a sentinel where the
    # latitude is one, too.
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
