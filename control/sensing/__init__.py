"""Which speed and which place control uses, and how fast the machine will go over the next
seconds.

Files:

- `gnss_late`: How late a receiver's speed comes, measured against the wheel
- `position_gate`: Which GNSS places can be believed
- `sensing`: Which speed and which place control uses
- `speed_ahead`: How fast the machine will go over the next seconds
- `speed_check`: Which of three witnesses of one ground speed is not believed
- `walk_watch`: Does GNSS's place go where its own speed and course say?
"""

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
