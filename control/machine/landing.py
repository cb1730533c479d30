"""Where does released material land? Mass is conserved: parcels are binned, and no signal is
shifted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .fall import MIN_DROP_S
from .model_elements import Array

# Number of bisection steps of the longest drop time: from 2 s to a nanosecond.
BISECTION_STEPS = 30


class LandedMass(NamedTuple):
    """Holds the mass on the ground along the track, in bins of `bin_m` from `origin_m` on."""

    origin_m: float
    bin_m: float
    mass_kg: Array

    def calc_centres_m(self) -> Array:
        return np.asarray(
            self.origin_m + self.bin_m * (np.arange(len(self.mass_kg)) + 0.5), dtype=np.float64
        )


def calc_carried_s(time_s: Array, settled_s: Array) -> Array:
    """Returns the drop time of material released at each time, (n,) s, where the stream in the tube
    determines its pace.

    time_s: (n,) increasing; settled_s: (n,) drop time at the shaft speed of that time, constant
    until the next. At every moment all falling material moves by dt / settled_s of its path. No
    granule overtakes. After the end the last pace continues.
    """
    pace = 1.0 / np.maximum(settled_s, MIN_DROP_S)
    way = np.concatenate([[0.0], np.cumsum(np.diff(time_s) * pace[:-1])])
    beyond = 1.0 / pace[-1]
    lands = np.interp(
        way + 1.0, np.append(way, way[-1] + 1.0), np.append(time_s, time_s[-1] + beyond)
    )
    return np.asarray(lands - time_s, dtype=np.float64)


def calc_fall_times_s(time_s: Array, settled_s: Array, carried_share: float = 1.0) -> Array:
    """Returns the drop time of material released at each time, (n,) s, where the stream determines
    a share of its pace.

    A granule has landed when the integral of share / settled_s(at the moment) + (1 - share) /
    settled_s(at its release) is 1. A share of 1 equals `calc_carried_s`; at 0 each granule falls
    independently, and those of a faster shaft overtake.
    """
    if carried_share >= 1.0:
        return calc_carried_s(time_s, settled_s)
    own = np.maximum(settled_s, MIN_DROP_S)
    if carried_share <= 0.0:
        return np.asarray(own, dtype=np.float64)
    way = np.concatenate([[0.0], np.cumsum(np.diff(time_s) / own[:-1])])
    # After the end the last pace continues.
    last = np.append(time_s, time_s[-1] + 1e3 * own[-1])
    ways = np.append(way, way[-1] + 1e3)
    low, high = np.zeros(len(own)), np.full(len(own), float(own.max()))
    for _ in range(BISECTION_STEPS):
        middle = 0.5 * (low + high)
        gone = (
            carried_share * (np.interp(time_s + middle, last, ways) - way)
            + (1.0 - carried_share) * middle / own
        )
        low, high = np.where(gone < 1.0, middle, low), np.where(gone < 1.0, high, middle)
    return np.asarray(0.5 * (low + high), dtype=np.float64)


def bin_landings(
    time_s: Array,
    track_m: Array,
    mass_kg: Array,
    drop_s: Array,
    bin_m: float,
    lever_arm_m: float = 0.0,
) -> tuple[LandedMass, Array]:
    """Bins parcels by the outlet's position when they land.

    Returns the ground and each parcel's position (n,), m along the track. A parcel is spread evenly
    between its own landing position and that of the next, so that bins finer than a tick's travel
    do not show a comb. Parcels may overtake one another. The landed mass equals the released mass.

    Parameters
    ----------
    time_s : (n,) release times, increasing, s. track_m : (n,) outlet's distance along the track at
    those times, m. mass_kg : (n,) mass released from time_s[k] to time_s[k+1], kg. drop_s : (n,)
    each parcel's own drop time, s.
    """
    place = np.interp(time_s + drop_s, time_s, track_m) + lever_arm_m
    beyond = time_s + drop_s > time_s[-1]
    if len(time_s) > 1 and np.any(beyond):
        speed = (track_m[-1] - track_m[-2]) / (time_s[-1] - time_s[-2])
        place[beyond] += (time_s[beyond] + drop_s[beyond] - time_s[-1]) * speed
    following = np.append(place[1:], 2.0 * place[-1] - place[-2] if len(place) > 1 else place[-1])
    origin = (np.floor(min(place.min(), following.min()) / bin_m) - 1.0) * bin_m
    count = int(np.ceil((max(place.max(), following.max()) - origin) / bin_m)) + 2
    return LandedMass(
        float(origin), bin_m, _spread_mass(place, following, mass_kg, float(origin), bin_m, count)
    ), place


def _spread_mass(
    a: Array, b: Array, mass_kg: Array, origin: float, bin_m: float, count: int
) -> Array:
    low, high = np.minimum(a, b), np.maximum(a, b)
    first = np.floor((low - origin) / bin_m).astype(np.int64)
    last = np.minimum(np.floor((high - origin) / bin_m).astype(np.int64), count - 1)
    total = np.zeros(count)
    width = high - low
    for step in range(int((last - first).max()) + 1):
        at = first + step
        inside = at <= last
        edge_low = origin + at * bin_m
        overlap = np.maximum(0.0, np.minimum(high, edge_low + bin_m) - np.maximum(low, edge_low))
        whole = first == last
        share = np.where(whole, 1.0, overlap / np.where(width > 0.0, width, 1.0))
        total += np.bincount(at[inside], weights=(share * mass_kg)[inside], minlength=count)
    return total
