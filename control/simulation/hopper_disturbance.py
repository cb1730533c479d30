"""What does the hopper's scale carry besides its load, and what is filled in? Wind, people,
road; lots."""

from __future__ import annotations

import numpy as np
from topdress.control.field.job import Simulated

from .sensor_noise import CorrelatedNoise, NormalNumbers

# Time constant of gusts, s: eddies of some 30 m at 4 m/s.
GUST_TAU_S = 8.0
# Standing time until a person steps up, time of the stay, and interval of the visits, s.
STEP_UP_DELAY_S, STAY_S, STEP_UP_INTERVAL_S = 6.0, 20.0, 40.0


class HopperDisturbance:
    """Simulates the disturbance of the scale. `advance_disturbance` returns its mass,
    `draw_lot_percent` the flow of the next lot.

    It draws its own numbers: a machine without any disturbance is unchanged."""

    def __init__(self, sim: Simulated, seed: int) -> None:
        self._sim = sim
        self._normal = NormalNumbers(seed)
        # The job gives the strongest gusts: a peak factor of 3 standard deviations is usual.
        self._wind = CorrelatedNoise(self._normal, sim.wind_kg / 3.0, GUST_TAU_S)
        self._lots = np.random.default_rng(seed + 1)
        self._stands_s = 0.0

    def advance_disturbance(self, speed_mps: float, dt_s: float) -> float:
        """Returns the mass that wind, people and shaking add to the scale's reading, kg."""
        sim = self._sim
        self._stands_s = self._stands_s + dt_s if speed_mps == 0.0 else 0.0
        here_s = self._stands_s - STEP_UP_DELAY_S
        kg = sim.person_kg if here_s > 0.0 and here_s % STEP_UP_INTERVAL_S < STAY_S else 0.0
        if sim.wind_kg > 0.0:
            kg += self._wind.advance_noise(dt_s)
        if sim.shaking_kg_per_mps > 0.0:
            kg += sim.shaking_kg_per_mps * abs(speed_mps) * self._normal.draw_number()
        return kg

    def draw_lot_percent(self) -> float:
        """Returns how much more the new lot flows than the first one, %."""
        most = self._sim.lot_percent
        return float(self._lots.uniform(-most, most)) if most > 0.0 else 0.0
