"""The numbers by which programs say "not known" in a log."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ANYTHING = (-np.inf, np.inf)

SENTINELS = (-999.0, -9999.0, -99999.0, -999.9, -999.99, -99.0, 999.0, 9999.0, 99999.0, 999999.0, 999.9, 9999.9,
             32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0)
SENTINEL_APART = 3.0        # inside the plausible range: that many times larger than any other value


def stand_for_nothing(values: Floats, limits: tuple[float, float] = ANYTHING,
                      inside: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Which values (n,) are sentinels: out of the limits, or far larger than all others; or in the rows `inside` (n,),
    where those are given."""
    low, high = limits
    if not values.size or not _reaches_one(values, limits):
        return np.zeros(values.shape, bool)
    suspect = np.isin(values, SENTINELS)
    if inside is None:
        others = np.abs(values[~suspect & np.isfinite(values)])
        inside = np.abs(values) > SENTINEL_APART * (others.max() if others.size else np.inf)
    return np.asarray(suspect & ((values < low) | (values > high) | inside), bool)


def _reaches_one(values: Floats, limits: tuple[float, float]) -> bool:
    """A quick look: most columns stay far from any."""
    low, high = np.fmin.reduce(values), np.fmax.reduce(values)
    return bool(low <= -99.0 or high >= 999.0 or low < limits[0] or high > limits[1])
