"""What does the hopper scale read from the true mass? The tare is set with a full hopper at the
start; noise and rounding follow.

A cell fixed to the frame bears only the perpendicular component: weight x cos(pitch). A hanging
cell, or one that an inclinometer corrects, has no such loss.
"""

from __future__ import annotations

from math import cos, radians
from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import HOPPER_CAPACITY, Effect


class Scale(NamedTuple):
    """Parameters of the scale and of its effects."""

    resolution_kg: Annotated[float, Field(ge=1e-4, le=10)] = 0.05
    gain_percent: Annotated[
        float,
        Field(ge=-30, le=30),
        Effect(
            "scale.gain",
            "%",
            "Scale reads off by a factor",
            "A wrong calibration weight or a cell under side load scales every reading.",
            "load cell calibration; usual 0.5-5 %",
            ("static weigh", "run with a known fill"),
            "Calibrate the scale with a known weight.",
            "A static weigh of a known fill.",
            says=(
                "The hopper scale reads {size} % too much.",
                "The hopper scale reads {size} % too little.",
            ),
        ),
    ] = 0.0
    drift_kg_h: Annotated[
        float,
        Field(ge=-1e4, le=1e4),
        Effect(
            "scale.drift",
            "kg/h",
            "Scale's zero drifts",
            "Warming cells and amplifiers move the zero through the day.",
            "load cell temperature drift",
            ("run",),
            "Let the scale warm up; tare at the refill.",
            "Stand still with the shaft stopped for ten minutes.",
            bounds=(-30.0, 30.0),
            scales_with=HOPPER_CAPACITY,
            says=(
                "The hopper scale's zero rises by {size} kg every hour.",
                "The hopper scale's zero falls by {size} kg every hour.",
            ),
        ),
    ] = 0.0
    tilt_percent_per_deg: Annotated[
        float,
        Field(ge=-5, le=5),
        Effect(
            "scale.tilt",
            "% more per degree nose up",
            "Reading changes with pitch",
            "On a slope part of the weight leaves the cells' axis.",
            "cosine and side load",
            ("run",),
            "Read the scale on level ground, or correct by pitch.",
            "Stand still nose up and nose down.",
            says=(
                "Each degree uphill makes the hopper scale read {size} % more.",
                "Each degree uphill makes the hopper scale read {size} % less.",
            ),
        ),
    ] = 0.0
    # Share of the cosine loss that the scale has: 1 for cells fixed to the frame, 0 for hanging or
    # corrected cells.
    cosine_share: Annotated[float, Field(ge=0, le=1)] = 0.0


class ScaleInput(NamedTuple):
    """Inputs of the scale."""

    hopper_kg: float
    time_s: float
    pitch_deg: float = 0.0
    # Sum of the machine file's terms, kg.
    more_kg: float = 0.0


def read_scale(p: Scale, u: ScaleInput) -> float:
    """Returns the reading before noise and rounding, kg."""
    read = (
        u.hopper_kg
        * (1.0 + p.gain_percent / 100.0)
        * (1.0 + p.tilt_percent_per_deg * u.pitch_deg / 100.0)
        * (1.0 - p.cosine_share * (1.0 - cos(radians(u.pitch_deg))))
    )
    return read + p.drift_kg_h * u.time_s / 3600.0 + u.more_kg
