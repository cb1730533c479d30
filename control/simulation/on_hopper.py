"""What else than its load the hopper's scale carries, and what is filled in: wind, people, road."""

from __future__ import annotations

import numpy as np
from topdress.control.field.job import Simulated

from .noise import Normals, Slow

# gusts: eddies of some 30 m at 4 m/s
GUST_S = 8.0
# of standing, until somebody steps up, for how long they stay, and how often they come
STEPS_UP_S, STAYS_S, COMES_EVERY_S = 6.0, 20.0, 40.0


class OnHopper:
    """`step` gives the kilograms on the scale that are no load, `lot` the next lot's flow.

    Draws numbers of its own: a machine with none of this is as it would be without.
    """

    def __init__(self, sim: Simulated, seed: int) -> None:
        self._sim = sim
        self._normal = Normals(seed)
        # what is named is what the strongest gusts reach: a peak factor of 3 s.d. is usual
        self._wind = Slow(self._normal, sim.wind_kg / 3.0, GUST_S)
        self._lots = np.random.default_rng(seed + 1)
        self._stands_s = 0.0

    def step(self, speed_mps: float, dt_s: float) -> float:
        """Kilograms that wind, people and shaking add to the scale's reading."""
        sim = self._sim
        self._stands_s = self._stands_s + dt_s if speed_mps == 0.0 else 0.0
        here_s = self._stands_s - STEPS_UP_S
        kg = sim.person_kg if here_s > 0.0 and here_s % COMES_EVERY_S < STAYS_S else 0.0
        if sim.wind_kg > 0.0:
            kg += self._wind.step(dt_s)
        if sim.shaking_kg_per_mps > 0.0:
            kg += sim.shaking_kg_per_mps * abs(speed_mps) * self._normal.next()
        return kg

    def lot(self) -> float:
        """How much more than the first lot the one flows that is filled in now, %."""
        most = self._sim.lot_percent
        return float(self._lots.uniform(-most, most)) if most > 0.0 else 0.0
