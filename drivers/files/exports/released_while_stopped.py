"""How much material did a machine release while it was commanded to stop? The log has an event for
each release, and rows in which the shaft turned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.orders import State
from topdress.drivers.files.read_log import RunLog

# Name of the event in the log, a contract with its readers.
RELEASE_EVENT = "released_stopped"
# Shaft speed above which the shaft turns, r/min: the lag paper's threshold.
MIN_TURNING_SHAFT_RPM = 2.0


class ReleaseWhileStopped(NamedTuple):
    """Holds one such event. The position is the antenna's; NaN where unknown."""

    time_s: float
    lat_deg: float
    lon_deg: float
    kg: float


def find_stopped_releases(log: RunLog) -> tuple[ReleaseWhileStopped, ...]:
    """Returns the log's events of this kind, in their order."""
    texts, time_s = log.texts("events").tolist(), log.time_s
    lat, lon = log.numbers("lat_deg"), log.numbers("lon_deg")
    return tuple(
        ReleaseWhileStopped(float(time_s[k]), float(lat[k]), float(lon[k]), _parse_event_kg(event))
        for k, text in enumerate(texts)
        if RELEASE_EVENT in text
        for event in text.split(";")
        if event.startswith(RELEASE_EVENT + " ")
    )


def find_stopped_rows(log: RunLog) -> npt.NDArray[np.bool_]:
    """Returns the rows (n,) out of work in which the shaft turned though commanded to stop.

    A log without such events has none. A calibration run has none, because its mass falls into a
    tray.
    """
    state = np.asarray(log.texts("state"))
    entered = any(RELEASE_EVENT in text for text in log.texts("events").tolist())
    out = (
        ~np.isin(state, (State.WORKING.value, State.CALIBRATING.value)) & log.has("state") & entered
    )
    stands = np.nan_to_num(log.numbers("shaft_rpm_cmd")) == 0.0
    return np.asarray(
        out & stands & (log.numbers("shaft_rpm") > MIN_TURNING_SHAFT_RPM), dtype=np.bool_
    )


def _parse_event_kg(event: str) -> float:
    """Returns the mass of an event, kg; 0 for an unreadable event."""
    try:
        kg = float(event.split(" ", 1)[1])
    except ValueError:
        return 0.0
    return kg if 0.0 < kg < float("inf") else 0.0
