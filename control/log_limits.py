"""What the values of a log can be, and the numbers by which programs say "not known"."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from control.log_row import NDRE_COLUMNS

Floats = NDArray[np.float64]

SPEEDS = ("speed_mps", "wheel_speed_mps", "speed_used_mps")
HEADS = ("ndvi_1", "ndvi_2", "ndvi_3", "ndvi_4", "ndvi_5", "ndvi_6", "ndvi")
NDRE = (*NDRE_COLUMNS, "ndre")

# What the quantity can be on any machine of this kind; wide on purpose.
PLAUSIBLE = {
    "lat_deg": (-90.0, 90.0), "lon_deg": (-180.0, 180.0), "fix_quality": (0, 9), "satellites": (0, 100),
    "hdop": (0, 100), "heading_deg": (-180.0, 360.0), "pitch_deg": (-60.0, 60.0), "roll_deg": (-60.0, 60.0),
    **dict.fromkeys(SPEEDS, (-15.0, 30.0)), **dict.fromkeys((*HEADS, *NDRE), (-1.0, 1.0)),
    "target_rate_kg_ha": (0.0, 5000.0), "nudge_percent": (-100.0, 100.0), "shaft_rpm_cmd": (-1e5, 1e5),
    "shaft_rpm": (-1e5, 1e5), "opening_mm_cmd": (-50.0, 500.0), "opening_mm": (-50.0, 500.0),
    "hopper_kg": (-500.0, 50_000.0), "flow_trim": (0.0, 10.0), "supply_v": (0.0, 60.0),
    "applied_rate_kg_ha": (0.0, 20_000.0), "lag_s": (0.0, 60.0), "lag_m": (-100.0, 500.0),
}
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
