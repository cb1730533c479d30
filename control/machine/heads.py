"""What does a canopy head read from the true NDVI below, before noise? The model has no memory."""

from __future__ import annotations

from math import exp
from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import Effect

# Time constant of warming up after power-on, s.
WARM_UP_S = 600.0


class Heads(NamedTuple):
    """Parameters of the heads' effects."""

    fouled_percent: Annotated[
        float,
        Field(ge=-90, le=90),
        Effect(
            "canopy.head_fouled",
            "%",
            "One head reads off",
            "Dust or a droplet on one lens dims one of its two wavelengths.",
            "2-10 % are usual",
            ("run", "heads"),
            "Clean that head's lens.",
            "Hold all heads over the same reference panel.",
            member_field="fouled_head",
            says=(
                "One canopy sensor reads {size} % too much.",
                "One canopy sensor reads {size} % too little.",
            ),
        ),
    ] = 0.0
    fouled_head: Annotated[float, Field(ge=0, le=100)] = 0.0
    warm_up_percent: Annotated[
        float,
        Field(ge=-60, le=60),
        Effect(
            "canopy.warm_up",
            "% at power-on",
            "All heads are off at power-on and settle",
            "The light sources change their output until they are warm.",
            "light-emitting diodes settle in about ten minutes",
            ("heads", "run with revisited ground"),
            "Switch the heads on a quarter of an hour before work.",
            "Drive the first pass again at the end.",
            says=(
                "Just switched on, the canopy sensors read {size} % too much.",
                "Just switched on, the canopy sensors read {size} % too little.",
            ),
        ),
    ] = 0.0
    saturation_percent: Annotated[
        float,
        Field(ge=0, le=60),
        Effect(
            "canopy.saturation",
            "% lost at NDVI 0.8",
            "Reading flattens in dense canopy",
            "Red reflectance is near zero in a closed canopy, and NDVI hardly rises with "
            "more leaf.",
            "NDVI saturates above leaf area index 3",
            ("heads",),
            "Use a red-edge index in dense crops.",
            "Panels or plots of known dense canopy.",
            says=("In a dense crop the canopy sensors read {size} % too little.",),
        ),
    ] = 0.0


class HeadInput(NamedTuple):
    """Inputs of a head."""

    ndvi: float
    # Number of the head, from 1.
    head: float
    # Time since power-on, s.
    on_s: float


def read_head(p: Heads, u: HeadInput) -> float:
    """Returns the reading of one head."""
    read = u.ndvi * (1.0 + p.warm_up_percent / 100.0 * exp(-u.on_s / WARM_UP_S))
    dense = u.ndvi / 0.8
    read *= 1.0 - p.saturation_percent / 100.0 * dense * dense * dense
    if u.head == p.fouled_head:
        read *= 1.0 + p.fouled_percent / 100.0
    return read
