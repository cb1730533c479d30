"""What a log's machine released while it was commanded to stop: its events, and the rows in
which it lies on a stretch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from topdress.control.orders import State
from topdress.drivers.files.read_log import RunLog

WORD = "released_stopped"
TURNING_RPM = 2.0  # the lag paper's threshold of a shaft that turns


class StoppedRelease(NamedTuple):
    """One entry of the log. The place is the antenna's; NaN: not known."""

    time_s: float
    lat_deg: float
    lon_deg: float
    kg: float


def released_stopped(log: RunLog) -> tuple[StoppedRelease, ...]:
    """The log's entries, in their order."""
    texts, time_s = log.texts("events").tolist(), log.time_s
    lat, lon = log.numbers("lat_deg"), log.numbers("lon_deg")
    return tuple(
        StoppedRelease(float(time_s[k]), float(lat[k]), float(lon[k]), _kg(event))
        for k, text in enumerate(texts)
        if WORD in text
        for event in text.split(";")
        if event.startswith(WORD + " ")
    )


def is_released_stopped(log: RunLog) -> npt.NDArray[np.bool_]:
    """Rows (n,) out of work in which the shaft turned though commanded to stop; none of a log
    that enters no such mass, and none of a calibrating run, whose mass lies in a tray."""
    state = np.asarray(log.texts("state"))
    entered = any(WORD in text for text in log.texts("events").tolist())
    out = (
        ~np.isin(state, (State.WORKING.value, State.CALIBRATING.value)) & log.has("state") & entered
    )
    stands = np.nan_to_num(log.numbers("shaft_rpm_cmd")) == 0.0
    return np.asarray(out & stands & (log.numbers("shaft_rpm") > TURNING_RPM), dtype=np.bool_)


def _kg(event: str) -> float:
    try:
        kg = float(event.split(" ", 1)[1])
    except ValueError:
        return 0.0
    return kg if 0.0 < kg < float("inf") else 0.0
