"""Which speed and which place control uses."""
from __future__ import annotations

from control.sensing.sensing import Sensed, Sensing, speed_ahead_mps, travelled_ahead_m

__all__ = ["Sensed", "Sensing", "speed_ahead_mps", "travelled_ahead_m"]
