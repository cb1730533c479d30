"""The plant's sensors straight to the loop's measurements: what the drivers do, without the bytes."""
from __future__ import annotations

from control.readings import Measurements, Reading, ValvesSeen

from .plant import Sensed


class Measuring:
    """Keeps the newest of everything, as the drivers do."""

    def __init__(self, heads: int) -> None:
        self._now = Measurements(0.0, ndvi=(None,) * heads)

    def take(self, s: Sensed) -> Measurements:
        t = s.time_s
        ndvi = self._now.ndvi if s.ndvi is None else tuple(Reading(v, t) for v in s.ndvi)
        self._now = Measurements(
            t, s.gnss or self._now.gnss, Reading(s.wheel_mps, t), ndvi, Reading(s.shaft_rpm, t),
            Reading(s.opening_mm, t), Reading(s.hopper_kg, t), Reading(s.supply_v, t), Reading(s.pitch_deg, t),
            Reading(s.roll_deg, t), s.work_switch, plants=s.plants, speed_told=s.speed_told or self._now.speed_told,
            canopy_index=s.canopy_index, valves=None if s.valves_open is None else ValvesSeen(t, s.valves_open))
        return self._now
