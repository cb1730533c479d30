"""What does the lag paper's correction experiment (section 2.3, tables 5 and 6) give on the
machine model?

From zero rate over a cell's boundary at a constant ground and shaft speed. Without the
correction the command is given at the boundary, with it where the distance to the boundary
equals L = v T_lag (eq 1 and 6). The miss is the place of the first granules, positive past the
boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.machine.elements import Array
from topdress.control.machine.fall import find_paper_lag_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.start import find_start_lag_s

from .published import DROP_S, LAG_M, LAG_SPEED_KMH

REPLICATES = 3
SPEED_MPS = LAG_SPEED_KMH / 3.6
# Points of the quadrature between two positions.
PHASES = 400
# Least density, 1/m; below it there is no logarithm.
LEAST_DENSITY = 1e-300


class FieldReading(NamedTuple):
    """Holds one interpretation of the field experiment. Every part is off by default: eq 6 holds
    exactly."""

    name: str
    # line: eq 6; model: the machine model's own first granule; field: table 1
    lag_from: str = "line"
    scatter: bool = False  # drop times scatter as in table 3
    # the position, and with it the decision, comes this often; None: at once
    update_hz: float | None = None
    # the three replicates of a shaft speed meet the boundary alike between updates
    shared_phase: bool = False


IN_PHASE = "eq 6, scatter, position at 1 Hz, replicates in phase"
ONCE_A_SECOND = "eq 6, scatter, position at 1 Hz"
READINGS = (
    FieldReading("eq 6 exact"),
    FieldReading("machine model", "model"),
    FieldReading("machine model, scatter of table 3", "model", True),
    FieldReading("field lag of table 1", "field"),
    FieldReading("field lag, scatter of table 3", "field", True),
    *(
        FieldReading(f"eq 6, scatter, position at {hz:g} Hz", "line", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
    FieldReading(IN_PHASE, "line", True, 1.0, True),
    *(
        FieldReading(f"machine model, scatter, position at {hz:g} Hz", "model", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
    *(
        FieldReading(f"field lag, scatter, position at {hz:g} Hz", "field", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
)


def misses_m(
    machine: Machine,
    shaft_rpm: int,
    reading: FieldReading,
    corrected: bool,
    trials: int,
    rng: np.random.Generator,
) -> Array:
    """Returns misses (trials, REPLICATES), m, at the paper's speed. KeyError for a shaft speed
    that the paper did not test."""
    lag = np.full((trials, REPLICATES), _lag_s(machine, shaft_rpm, reading))
    if reading.scatter:
        drops = np.array(DROP_S[shaft_rpm])
        lag += rng.choice(drops - drops.mean(), lag.shape)
    if reading.update_hz is not None:
        lag += rng.uniform(
            0.0, 1.0 / reading.update_hz, (trials, 1 if reading.shared_phase else REPLICATES)
        )
    ahead = SPEED_MPS * find_paper_lag_s(shaft_rpm) if corrected else 0.0
    return np.asarray(SPEED_MPS * lag - ahead, dtype=np.float64)


def _lag_s(machine: Machine, shaft_rpm: int, reading: FieldReading) -> float:
    if reading.lag_from == "field":
        return float(np.mean(LAG_M[shaft_rpm])) / SPEED_MPS
    return (
        find_start_lag_s(machine, shaft_rpm)
        if reading.lag_from == "model"
        else find_paper_lag_s(shaft_rpm)
    )


class ReadingFit(NamedTuple):
    """Holds how well an interpretation explains table 5."""

    reading: FieldReading
    mean_m: float  # of all its misses
    # r.m.s. of mean miss by shaft speed, ours minus the paper's
    between_m: float
    # standard deviation between the replicates of a shaft speed
    within_m: float
    # standard deviation of the replicates' means between shaft speeds
    means_m: float
    # of the paper's 21 values together, natural logarithm, 1/m
    log_likelihood: float
    by_rpm: dict[int, float]  # mean miss


# Error of a tape on the ground, m.
MEASURED_TO_M = 0.05


def explain(
    machine: Machine,
    published_m: dict[int, tuple[float, ...]],
    readings: tuple[FieldReading, ...] = READINGS,
    trials: int = 2000,
    seed: int = 1,
) -> list[ReadingFit]:
    """Compares every interpretation with the published misses; the likeliest first
    (`joint_log_likelihood`).

    trials, seed: of the misses drawn for the means and spreads next to it."""
    rng = np.random.default_rng(seed)
    fits = []
    for reading in readings:
        ours = {rpm: misses_m(machine, rpm, reading, True, trials, rng) for rpm in published_m}
        apart = [
            float(ours[rpm].mean()) - sum(values) / len(values)
            for rpm, values in published_m.items()
        ]
        fits.append(
            ReadingFit(
                reading,
                float(np.mean([o.mean() for o in ours.values()])),
                float(np.sqrt(np.mean(np.square(apart)))),
                _within(list(ours.values())),
                float(np.std([o.mean(axis=1) for o in ours.values()], axis=0, ddof=1).mean()),
                joint_log_likelihood(machine, reading, published_m),
                {rpm: float(o.mean()) for rpm, o in ours.items()},
            )
        )
    return sorted(fits, key=lambda fit: -fit.log_likelihood)


def _within(groups: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean([np.var(group, axis=-1, ddof=1).mean() for group in groups])))


def published_spread(published_m: dict[int, tuple[float, ...]]) -> tuple[float, float, float]:
    """Returns the mean miss, the standard deviation between replicates, and that of their means
    between shaft speeds, m."""
    groups = [np.array(values) for values in published_m.values()]
    means = [float(group.mean()) for group in groups]
    return float(np.mean(means)), _within(groups), float(np.std(means, ddof=1))


def joint_log_likelihood(
    machine: Machine, reading: FieldReading, published_m: dict[int, tuple[float, ...]]
) -> float:
    """Returns the joint likelihood of all published misses, natural logarithm, 1/m: by
    quadrature over the moment between two positions and the scatter of the drop times, smoothed
    by the tape's error.

    What the replicates of a shaft speed share, they share here: where that is the phase, the
    three are likely together or not at all. Judged value by value, a shared phase looked as
    likely as one of each drive's own."""
    total = 0.0
    for rpm, values in published_m.items():
        by_phase = [_densities(machine, rpm, reading, value) for value in values]
        if reading.shared_phase:
            total += _log(float(np.mean(np.prod(by_phase, axis=0))))
        else:
            total += sum(_log(float(one.mean())) for one in by_phase)
    return total


class Rival(NamedTuple):
    """Holds the field's own lag with both spreads fitted to table 5: two parameters, no
    mechanism."""

    mean_m: float
    between_m: float  # s.d. of shaft speeds about it
    within_m: float  # s.d. of replicates
    log_likelihood: float  # of the 21, 1/m
    # the same less BIC's half of ln 21 for each parameter
    penalised: float


def fitted_rival(published_m: dict[int, tuple[float, ...]]) -> Rival:
    """Returns the rival of greatest likelihood in closed form: the mean by shaft speed is table
    1's distance minus the corrected lag; the rest spreads normally between shaft speeds and
    between replicates."""
    expected = [
        float(np.mean(LAG_M[rpm])) - SPEED_MPS * find_paper_lag_s(rpm) for rpm in published_m
    ]
    left = np.array(list(published_m.values())) - np.array(expected)[:, None]
    speeds, replicates = left.shape
    within = float(np.sum((left - left.mean(axis=1, keepdims=True)) ** 2)) / (
        speeds * (replicates - 1)
    )
    of_means = float(np.mean(left.mean(axis=1) ** 2))
    log = -0.5 * (
        speeds * (replicates - 1) * (np.log(2.0 * np.pi * within) + 1.0)
        + speeds * (np.log(2.0 * np.pi * replicates * of_means) + 1.0)
    )
    return Rival(
        float(np.mean(expected)),
        float(np.sqrt(max(0.0, of_means - within / replicates))),
        float(np.sqrt(within)),
        float(log),
        float(log - np.log(left.size)),
    )


def _densities(machine: Machine, shaft_rpm: int, reading: FieldReading, value_m: float) -> Array:
    """Returns the density of one miss at each phase (PHASES,), 1/m."""
    lag_s = np.full((PHASES, 1), _lag_s(machine, shaft_rpm, reading))
    if reading.update_hz is not None:
        lag_s += (np.arange(PHASES)[:, None] + 0.5) / PHASES / reading.update_hz
    if reading.scatter:
        drops = np.array(DROP_S[shaft_rpm])
        lag_s = lag_s + (drops - drops.mean())
    z = (value_m - SPEED_MPS * (lag_s - find_paper_lag_s(shaft_rpm))) / MEASURED_TO_M
    return np.asarray(
        np.mean(np.exp(-0.5 * z * z), axis=1) / (MEASURED_TO_M * np.sqrt(2.0 * np.pi))
    )


def _log(density: float) -> float:
    return float(np.log(max(density, LEAST_DENSITY)))


def wider_apart(
    machine: Machine,
    reading: FieldReading,
    published_m: dict[int, tuple[float, ...]],
    trials: int = 4000,
    seed: int = 1,
) -> float:
    """Returns the share of tables drawn by an interpretation in which shaft speeds differ from
    one another, relative to replicates, by at least as much as in the published one (ratio of
    the two standard deviations)."""
    rng = np.random.default_rng(seed)
    drawn = np.stack([misses_m(machine, rpm, reading, True, trials, rng) for rpm in published_m])

    def ratio(misses: Array) -> Array:
        between, within = (
            misses.mean(axis=-1).std(axis=0, ddof=1),
            misses.var(axis=-1, ddof=1).mean(axis=0),
        )
        return np.asarray(between / np.sqrt(within))

    printed = ratio(np.array(list(published_m.values()))[:, None, :])
    return float(np.mean(ratio(drawn) >= printed))
