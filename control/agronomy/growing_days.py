"""How many days since sowing were warm enough to grow? D of paper A, eq 4."""

from __future__ import annotations

import datetime as dt

import numpy as np
import numpy.typing as npt


def count_days_above_base(
    dates: npt.NDArray[np.datetime64],
    mean_temp_c: npt.NDArray[np.float64],
    sown: dt.date,
    sensed: dt.date,
    base_temp_c: float,
) -> int:
    """Counts the days from sowing to sensing whose mean air temperature is above the base (paper
    A, eq 4).

    The day of sowing counts. The day of sensing does not: its mean is not known while the canopy
    is sensed.

    Parameters
    ----------
    dates : (n,) days in any order, each once.
    mean_temp_c : (n,) mean temperature of each day, degC.
    sown, sensed : dates of sowing and sensing.
    base_temp_c : base temperature of the crop, degC.

    Raises
    ------
    ValueError : sensing is not after sowing, a day of the span is missing or has no finite
        temperature, a date stands twice, or no day is warm enough."""
    days = np.asarray(dates, dtype="datetime64[D]")
    temps = np.asarray(mean_temp_c, dtype=np.float64)
    if days.shape != temps.shape or days.ndim != 1:
        raise ValueError(
            f"{days.size} dates but {temps.size} temperatures: one temperature for each "
            "date is needed"
        )
    if sensed <= sown:
        raise ValueError(f"sensed {sensed} is not after sown {sown}")
    start, end = np.datetime64(sown, "D"), np.datetime64(sensed, "D")
    inside = (days >= start) & (days < end)
    found, count = np.unique(days[inside], return_counts=True)
    if (count > 1).any():
        raise ValueError(f"{found[count > 1][0]} stands twice among the dates")
    usable = days[inside & np.isfinite(temps)]
    missing = np.setdiff1d(np.arange(start, end), usable)
    if missing.size:
        raise ValueError(
            f"no mean temperature for {missing.size} of the "
            f"{int((end - start).astype(int))} days from "
            f"{sown} to {sensed}, the first is {missing[0]}"
        )
    warm = int(np.count_nonzero(temps[inside] > base_temp_c))
    if warm == 0:
        raise ValueError(
            f"no day from {sown} to {sensed} has a mean temperature above {base_temp_c:g} degC"
        )
    return warm
