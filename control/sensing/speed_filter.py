"""The filters `speed_used` and `quick`: second order, critically damped."""
from __future__ import annotations

from math import exp
from typing import NamedTuple

FILTER_TAU_S = 0.25             # its step response is half-way after 0.2 s; a steady acceleration passes without delay
QUICK_TAU_S = 0.09              # filter `quick`, of the same samples, half-way after 0.07 s: for what is to come alone
LONGEST_GAP_S = 1.0             # after a longer one it begins anew
STANDS_MPS = 0.05               # a sample of 0 and less than this: standing


class Moving(NamedTuple):
    speed_mps: float = 0.0
    acceleration_mps2: float = 0.0

    def on(self, dt_s: float) -> Moving:
        """A time later, without a sample."""
        return Moving(max(0.0, self.speed_mps + self.acceleration_mps2 * dt_s), self.acceleration_mps2)

    def taking(self, sample_mps: float, gap_s: float, tau_s: float = FILTER_TAU_S) -> Moving:
        """With a sample taken in, `gap_s` after the one before."""
        if not 0.0 < gap_s < LONGEST_GAP_S:
            return Moving(sample_mps, 0.0)
        keep = exp(-gap_s / tau_s)
        error = sample_mps - self.speed_mps
        speed = max(0.0, self.speed_mps + (1.0 - keep * keep) * error)
        if sample_mps == 0.0 and speed < STANDS_MPS:
            return Moving()
        return Moving(speed, self.acceleration_mps2 + (1.0 - keep) * (1.0 - keep) / gap_s * error)
