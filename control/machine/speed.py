"""What do wheel and GNSS read from the true ground speed, before noise?"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import Effect
from .model_elements import DelayLine, average_line, make_line, put_in_line

# Relative increase of slip for each degree of upward pitch.
UPHILL_SHARE_PER_DEG = 0.15


class Speed(NamedTuple):
    """Parameters of the two speed sensors and of their effects."""

    wheel_circumference_m: Annotated[float, Field(ge=0.05, le=20)] = 2.50
    pulses_per_turn: Annotated[float, Field(ge=1, le=10000)] = 16.0
    slip_percent: Annotated[
        float,
        Field(ge=-5, le=40),
        Effect(
            "speed.wheel_slip",
            "%",
            "Wheel reads fast under load, more uphill",
            "A driven wheel under draught turns further than the tractor moves.",
            "6-9 % working against about 1 % on the road are published",
            ("run",),
            "Use GNSS speed, or a wheel that is not driven.",
            "Rows out of work, or out and back on a slope.",
            says=(
                "The wheel slips: it reads {size} % too fast under load.",
                "Under load the wheel reads {size} % too slow.",
            ),
        ),
    ] = 0.0
    radius_percent: Annotated[
        float,
        Field(ge=-20, le=20),
        Effect(
            "speed.wheel_radius",
            "%",
            "Wheel reads off by a constant factor, working or not",
            "Tyre pressure and wear change the distance that one turn covers.",
            "tyre pressure; usual 0.5-4 %",
            ("run",),
            "Calibrate the wheel's circumference over 100 m by GNSS.",
            "Drive out of work on a road.",
            says=(
                "The wheel sensor reads {size} % too fast.",
                "The wheel sensor reads {size} % too slow.",
            ),
        ),
    ] = 0.0
    missed_percent: Annotated[
        float,
        Field(ge=0, le=60),
        Effect(
            "speed.missed_pulses",
            "%",
            "Wheel pulses go missing",
            "A loose magnet or too wide a gap lets the Hall sensor miss some teeth.",
            "Hall sensor gap",
            ("run",),
            "Set the sensor's gap to 1-2 mm, look for a lost magnet.",
            "Count pulses over ten turns by hand.",
            says=("The wheel sensor misses {size} % of its pulses.",),
        ),
    ] = 0.0
    gnss_latency_s: Annotated[
        float,
        Field(ge=0, le=3),
        Effect(
            "speed.gnss_latency",
            "s",
            "GNSS speed comes late",
            "The receiver's filter and the link hold the speed back.",
            "0.1-1 s are published",
            ("run",),
            "Switch the receiver's smoothing off, raise its rate.",
            "Accelerate and brake sharply a few times.",
            probes=(0.05,),
            says=("The speed by GNSS comes {size} s late.",),
        ),
    ] = 0.0


class SpeedInput(NamedTuple):
    """Inputs of the speed sensors."""

    # True ground speed, m/s.
    speed_mps: float
    # 1 while the machine pulls under load, else 0.
    working: float = 0.0
    pitch_deg: float = 0.0
    # Sum of the machine file's terms, %.
    more_percent: float = 0.0


class SpeedState(NamedTuple):
    """State of the speed sensors."""

    time_s: float
    line: DelayLine


class SpeedOutput(NamedTuple):
    """Outputs of the speed sensors."""

    # Wheel reading, m/s.
    wheel_mps: float
    # GNSS reading, m/s.
    gnss_mps: float


def make_speed_start(speed_mps: float = 0.0, time_s: float = 0.0) -> SpeedState:
    return SpeedState(time_s, make_line(speed_mps))


def step_speed(
    p: Speed, s: SpeedState, u: SpeedInput, dt_s: float
) -> tuple[SpeedState, SpeedOutput]:
    """Advances the speed sensors by one step of `dt_s` with a constant true speed."""
    line = put_in_line(s.line, s.time_s, u.speed_mps)
    line, gnss = average_line(line, s.time_s - p.gnss_latency_s, s.time_s - p.gnss_latency_s + dt_s)
    slip = p.slip_percent * u.working * max(0.0, 1.0 + UPHILL_SHARE_PER_DEG * u.pitch_deg)
    wheel = (
        u.speed_mps
        * (1.0 + slip / 100.0)
        * (1.0 + p.radius_percent / 100.0)
        * (1.0 - p.missed_percent / 100.0)
    )
    wheel *= 1.0 + u.more_percent / 100.0
    return SpeedState(s.time_s + dt_s, line), SpeedOutput(wheel, gnss)
