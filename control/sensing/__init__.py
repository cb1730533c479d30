"""Determines the speed and position that control uses, and predicts the speed of the next seconds.

Files:

- `gnss_delay`: How late does a receiver's speed arrive?
- `place_drift`: Does GNSS's place follow its own speed and course?
- `position_gate`: Which GNSS places can be trusted?
- `sensing`: Which speed and which place does control use?
- `speed_check`: Which of three witnesses of ground speed is wrong
- `speed_forecast`: How fast will the machine go over the next seconds?
"""

from __future__ import annotations

from topdress.control.sensing.sensing import SensedMotion, Sensing, SensingLimits
from topdress.control.sensing.speed_forecast import (
    SpeedForecast,
    SpeedForecaster,
    predict_speed_ahead_mps,
    predict_way_ahead_m,
)

__all__ = [
    "SensedMotion",
    "Sensing",
    "SensingLimits",
    "SpeedForecast",
    "SpeedForecaster",
    "predict_speed_ahead_mps",
    "predict_way_ahead_m",
]
