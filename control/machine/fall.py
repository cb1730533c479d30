"""How long does material fall from the roller to the ground? Drop times of a start and of a running
shaft, their effects, and the papers' lag models.

A rig times a start: from 2 r/min to the first granule, with a standing shaft (lag paper, tables 3
and 4, eq 6). A running shaft's drop time is shorter. The difference depends on the motion in the
tube, which no start can show:

carried along   (`carried_share` 1) all falling material moves at the pace of the present shaft
                speed, and no granule overtakes; while the shaft accelerates that pace is slower
                than at the set-point.
falling singly  (0) each granule keeps the pace of its release. Material that a faster shaft
                releases later lands first.

`landing.falls_s` calculates any share. Each share gives the same line of starts with its own drop
time of a running shaft (`start.set_carried_share`).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from .effect import Effect

# After this time without flow the tube is empty, s.
EMPTY_TUBE_S = 2.0
# Minimum drop time, s.
MIN_DROP_S = 1e-6


class Fall(NamedTuple):
    """Parameters of the fall and of its effects."""

    # Line of drop times from lag paper eq 6, minus the response of 0.383 s.
    intercept_s: Annotated[float, Field(ge=0, le=20)] = 1.8288
    slope_s_per_rpm: Annotated[float, Field(ge=-0.1, le=0.1)] = -0.0083
    # Difference of start and running drop, as a share of |slope| n, per r/min.
    start_more_per_rpm: Annotated[float, Field(ge=0, le=0.1)] = 1.69e-3
    # Constant part of that difference, s.
    start_more_s: Annotated[float, Field(ge=-1, le=5)] = 0.0
    # Part of that difference proportional to the speed n, s per r/min.
    start_more_s_per_rpm: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    # Share of the pace that the stream in the tube determines.
    carried_share: Annotated[float, Field(ge=0, le=1)] = 1.0
    valid_from_rpm: Annotated[float, Field(ge=0, le=1e4)] = 10.0
    valid_to_rpm: Annotated[float, Field(ge=0, le=1e4)] = 70.0
    # Shaft speed at which the rebound is defined, r/min.
    full_rpm: Annotated[float, Field(ge=0.1, le=1e4)] = 100.0
    offset_s: Annotated[
        float,
        Field(ge=-2, le=3),
        Effect(
            "lag.offset",
            "s",
            "Constant extra lag",
            "A longer tube or a later detection adds the same time at every speed.",
            "lag paper, table 4: field against detected",
            ("lag",),
            "Enter the measured lag; shorten the tube.",
            "Lag test at several shaft speeds, with distances and times.",
            says=(
                "Granules land {size} s later than reckoned.",
                "Granules land {size} s sooner than reckoned.",
            ),
        ),
    ] = 0.0
    rebound_s: Annotated[
        float,
        Field(ge=-2, le=3),
        Effect(
            "lag.rebound",
            "s above the straight line at {fall.full_rpm:g} r/min",
            "Lag rises again at high shaft speed",
            "Granules thrown faster strike the tube more often on their way down.",
            "lag paper, figure 9 and section 2.4.3",
            ("lag",),
            "Work at 70 r/min or below.",
            "Lag test above 70 r/min.",
            says=(
                "At high shaft speed granules land {size} s later than reckoned.",
                "At high shaft speed granules land {size} s sooner than reckoned.",
            ),
        ),
    ] = 0.0
    first_fill_s: Annotated[
        float,
        Field(ge=-1, le=5),
        Effect(
            "lag.first_fill",
            "s",
            "Start from an empty tube takes longer than a change while running",
            "An empty tube and roller must fill before anything lands.",
            "the correction experiment starts from zero rate",
            ("lag",),
            "Start earlier at the beginning of a pass.",
            "Lag test from standstill and between two rates.",
            says=(
                "The first granules of a pass come {size} s later than later changes do.",
                "The first granules of a pass come {size} s sooner than later changes do.",
            ),
        ),
    ] = 0.0
    asymmetry_s: Annotated[
        float,
        Field(ge=-3, le=3),
        Effect(
            "lag.asymmetry",
            "s, down - up",
            "Falling changes lag more than rising ones",
            "A tube runs empty more slowly than it fills.",
            "transitions of rate changes, published 4-7 s",
            ("lag",),
            "Correct rising and falling changes separately.",
            "Lag test of equal steps up and down.",
            says=(
                "Less takes {size} s longer to arrive than more does.",
                "More takes {size} s longer to arrive than less does.",
            ),
        ),
    ] = 0.0
    clock_step_s: Annotated[
        float,
        Field(ge=0, le=2),
        Effect(
            "lag.coarse_clock",
            "s",
            "Measured times come in steps",
            "The detector's loop looks only every so often.",
            "polling detectors",
            ("lag",),
            "Use interrupts or a faster loop in the detector.",
            "Many repeats at one shaft speed.",
            probes=(0.05, 0.1, 0.2),
            says=("Times are measured in steps of {size} s only.",),
        ),
    ] = 0.0
    speed_scale_percent: Annotated[
        float,
        Field(ge=-50, le=50),
        Effect(
            "lag.speed_scale",
            "%, true over written speed - 1",
            "Distances and times disagree by a factor",
            "The test was driven at another speed than was written down.",
            "lag paper, tables 1 and 4",
            ("lag with distances and times",),
            "Measure the speed over the test length.",
            "The same lag test at two measured speeds.",
            says=(
                "The machine drove {size} % faster than was written down.",
                "The machine drove {size} % slower than was written down.",
            ),
        ),
    ] = 0.0
    lever_arm_m: Annotated[
        float,
        Field(ge=-20, le=20),
        Effect(
            "place.lever_arm",
            "m",
            "Lands short or long by a constant distance",
            "The antenna or the outlet is not where the machine file says.",
            "mounting measures",
            ("place at two speeds or more",),
            "Measure antenna to outlet with a tape.",
            "The same step at two ground speeds.",
            says=(
                "Granules land {size} m too far ahead.",
                "Granules land {size} m too far behind.",
            ),
        ),
    ] = 0.0
    latency_s: Annotated[
        float,
        Field(ge=-3, le=5),
        Effect(
            "place.latency",
            "s",
            "Lands late by a constant time",
            "Position, computing and bus take time that no model knows.",
            "GNSS and bus latency",
            ("place at two speeds or more",),
            "Enter the measured latency as lag.",
            "The same step at two ground speeds.",
            says=(
                "Changes of the rate land {size} s late.",
                "Changes of the rate land {size} s early.",
            ),
        ),
    ] = 0.0


class FallInput(NamedTuple):
    """Inputs of the fall."""

    # Shaft speed at the release, r/min.
    shaft_rpm: float
    flow_kg_s: float
    # +1 for material released after a rise of the rate, -1 after a fall, 0 otherwise.
    change: float = 0.0


class FallState(NamedTuple):
    """State of the tube."""

    time_s: float
    # Time since the last release, s.
    no_flow_s: float
    # Time since flow returned to an empty tube, s; a large value for a filled tube.
    filling_s: float


def make_fall_start(time_s: float = 0.0) -> FallState:
    return FallState(time_s, 2.0 * EMPTY_TUBE_S, 1e9)


def find_start_drop_s(p: Fall, shaft_rpm: float) -> float:
    """Returns the drop time of a start, s: from 2 r/min to the first granule, as a rig measures
    it (lag paper eq 6)."""
    start_s = p.intercept_s + p.slope_s_per_rpm * shaft_rpm + p.offset_s
    if shaft_rpm > p.valid_to_rpm:
        start_s += p.rebound_s * (
            (shaft_rpm - p.valid_to_rpm) / max(1.0, p.full_rpm - p.valid_to_rpm)
        )
    return start_s if start_s > 0.0 else 0.0


def calc_drop_s(p: Fall, shaft_rpm: float) -> float:
    """Returns the drop time of a running shaft, s, without the effects of previous changes.

    Where the drop time does not decrease with shaft speed, the result is the drop time of a start.
    """
    falls_s = -p.slope_s_per_rpm * shaft_rpm
    if falls_s < 0.0:
        falls_s = 0.0
    more = (
        p.start_more_s
        + p.start_more_s_per_rpm * shaft_rpm
        + p.start_more_per_rpm * shaft_rpm * falls_s
    )
    drop = find_start_drop_s(p, shaft_rpm) - more
    return drop if drop > 0.0 else 0.0


def step_fall(p: Fall, s: FallState, u: FallInput, dt_s: float) -> tuple[FallState, float]:
    """Returns the drop time of material released in this step, s, for a constant shaft speed;
    `landing.falls_s` is for changing speeds."""
    flowing = u.flow_kg_s > 0.0
    filling = s.filling_s + dt_s
    if flowing and s.no_flow_s >= EMPTY_TUBE_S:
        filling = 0.0
    quiet = 0.0 if flowing else s.no_flow_s + dt_s
    drop = calc_drop_s(p, u.shaft_rpm) + p.latency_s + 0.5 * p.asymmetry_s * -u.change
    drop += p.first_fill_s * max(0.0, 1.0 - filling / EMPTY_TUBE_S)
    return FallState(s.time_s + dt_s, quiet, filling), max(0.0, drop)


def find_paper_lag_s(shaft_rpm: float) -> float:
    """Returns the total lag from command to ground, s (lag paper eq 6; fitted on 10-70 r/min)."""
    return -8.3e-3 * shaft_rpm + 2.2118
