"""Which speed and which place control uses, and how fast the machine will go over the next
seconds."""

from __future__ import annotations

from topdress.control.sensing.sensing import Sensed, Sensing, SensingLimits
from topdress.control.sensing.speed_ahead import (
    Forecaster,
    SpeedAhead,
    speed_ahead_mps,
    travelled_ahead_m,
)

__all__ = [
    "Forecaster",
    "Sensed",
    "Sensing",
    "SensingLimits",
    "SpeedAhead",
    "speed_ahead_mps",
    "travelled_ahead_m",
]
