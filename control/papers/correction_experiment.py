"""What results does the lag paper's correction experiment (section 2.3, tables 5 and 6) have with
the machine model?

The machine crosses a cell's boundary from zero rate at a constant ground and shaft speed. Without
the correction the command is given at the boundary; with the correction it is given where the
distance to the boundary equals L = v T_lag (eq 1 and 6). The miss is the position of the first
granules, positive beyond the boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from topdress.control.machine.fall import find_paper_lag_s
from topdress.control.machine.machine import Machine
from topdress.control.machine.model_elements import Array
from topdress.control.machine.start_lag import find_start_lag_s

from .published import DROP_S, LAG_M, LAG_SPEED_KMH

# Number of replicates of each shaft speed.
REPLICATE_COUNT = 3
SPEED_MPS = LAG_SPEED_KMH / 3.6
# Number of quadrature points between two positions.
PHASE_COUNT = 400
# Minimum density, 1/m, to avoid the logarithm of zero.
MIN_DENSITY = 1e-300


class Interpretation(NamedTuple):
    """Holds one interpretation of the field experiment. Every deviation is off by default, so
    that eq 6 is exact."""

    name: str
    # Source of the lag: `line` (eq 6), `model` (the machine model's own first granule), or `field`
    # (table 1).
    lag_from: str = "line"
    # Whether drop times scatter as in table 3.
    scatter: bool = False
    # Rate of the positions, and so of the decisions, Hz; None means no delay.
    update_hz: float | None = None
    # Whether the three replicates of a shaft speed cross the boundary at the same phase between two
    # positions.
    shared_phase: bool = False


IN_PHASE = "eq 6, scatter, position at 1 Hz, replicates in phase"
ONCE_A_SECOND = "eq 6, scatter, position at 1 Hz"
INTERPRETATIONS = (
    Interpretation("eq 6 exact"),
    Interpretation("machine model", "model"),
    Interpretation("machine model, scatter of table 3", "model", True),
    Interpretation("field lag of table 1", "field"),
    Interpretation("field lag, scatter of table 3", "field", True),
    *(
        Interpretation(f"eq 6, scatter, position at {hz:g} Hz", "line", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
    Interpretation(IN_PHASE, "line", True, 1.0, True),
    *(
        Interpretation(f"machine model, scatter, position at {hz:g} Hz", "model", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
    *(
        Interpretation(f"field lag, scatter, position at {hz:g} Hz", "field", True, hz)
        for hz in (1.0, 5.0, 10.0)
    ),
)


def simulate_misses(
    machine: Machine,
    shaft_rpm: int,
    reading: Interpretation,
    corrected: bool,
    trials: int,
    rng: np.random.Generator,
) -> Array:
    """Returns simulated misses (trials, REPLICATE_COUNT), m, at the paper's speed. KeyError for
    a shaft speed that the paper did not test."""
    lag = np.full((trials, REPLICATE_COUNT), _find_lag_s(machine, shaft_rpm, reading))
    if reading.scatter:
        drops = np.array(DROP_S[shaft_rpm])
        lag += rng.choice(drops - drops.mean(), lag.shape)
    if reading.update_hz is not None:
        lag += rng.uniform(
            0.0, 1.0 / reading.update_hz, (trials, 1 if reading.shared_phase else REPLICATE_COUNT)
        )
    ahead = SPEED_MPS * find_paper_lag_s(shaft_rpm) if corrected else 0.0
    return np.asarray(SPEED_MPS * lag - ahead, dtype=np.float64)


def _find_lag_s(machine: Machine, shaft_rpm: int, reading: Interpretation) -> float:
    if reading.lag_from == "field":
        return float(np.mean(LAG_M[shaft_rpm])) / SPEED_MPS
    return (
        find_start_lag_s(machine, shaft_rpm)
        if reading.lag_from == "model"
        else find_paper_lag_s(shaft_rpm)
    )


class InterpretationFit(NamedTuple):
    """Holds the fit of an interpretation to table 5."""

    reading: Interpretation
    # Mean of all misses, m.
    mean_m: float
    # R.m.s. difference of the mean miss by shaft speed, simulated minus published, m.
    between_m: float
    # Standard deviation between the replicates of a shaft speed, m.
    within_m: float
    # Standard deviation of the replicates' means between shaft speeds, m.
    means_m: float
    # Joint log likelihood of the paper's 21 values, natural logarithm, 1/m.
    log_likelihood: float
    # Mean miss by shaft speed, m.
    by_rpm: dict[int, float]


# Standard error of a tape measurement on the ground, m.
TAPE_SD_M = 0.05


def compare_interpretations(
    machine: Machine,
    published_m: dict[int, tuple[float, ...]],
    readings: tuple[Interpretation, ...] = INTERPRETATIONS,
    trials: int = 2000,
    seed: int = 1,
) -> list[InterpretationFit]:
    """Compares every interpretation with the published misses, and returns the fits, the most
    likely first (`calc_joint_log_likelihood`).

    trials, seed: number and seed of the simulated misses for means and spreads.
    """
    rng = np.random.default_rng(seed)
    fits = []
    for reading in readings:
        ours = {
            rpm: simulate_misses(machine, rpm, reading, True, trials, rng) for rpm in published_m
        }
        apart = [
            float(ours[rpm].mean()) - sum(values) / len(values)
            for rpm, values in published_m.items()
        ]
        fits.append(
            InterpretationFit(
                reading,
                float(np.mean([o.mean() for o in ours.values()])),
                float(np.sqrt(np.mean(np.square(apart)))),
                _calc_within_sd(list(ours.values())),
                float(np.std([o.mean(axis=1) for o in ours.values()], axis=0, ddof=1).mean()),
                calc_joint_log_likelihood(machine, reading, published_m),
                {rpm: float(o.mean()) for rpm, o in ours.items()},
            )
        )
    return sorted(fits, key=lambda fit: -fit.log_likelihood)


def _calc_within_sd(groups: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean([np.var(group, axis=-1, ddof=1).mean() for group in groups])))


def calc_published_spread(published_m: dict[int, tuple[float, ...]]) -> tuple[float, float, float]:
    """Returns the mean miss, the standard deviation between replicates, and that of their means
    between shaft speeds, m."""
    groups = [np.array(values) for values in published_m.values()]
    means = [float(group.mean()) for group in groups]
    return float(np.mean(means)), _calc_within_sd(groups), float(np.std(means, ddof=1))


def calc_joint_log_likelihood(
    machine: Machine, reading: Interpretation, published_m: dict[int, tuple[float, ...]]
) -> float:
    """Returns the joint log likelihood of all published misses, natural logarithm, 1/m.

    The quadrature is over the phase between two positions and the scatter of the drop times,
    smoothed by the tape's error. Replicates of a shaft speed with a common phase are likely
    together or not at all. A judgement value by value would rate a common phase as likely as an
    independent phase of each drive.
    """
    total = 0.0
    for rpm, values in published_m.items():
        by_phase = [_calc_densities(machine, rpm, reading, value) for value in values]
        if reading.shared_phase:
            total += _calc_log(float(np.mean(np.prod(by_phase, axis=0))))
        else:
            total += sum(_calc_log(float(one.mean())) for one in by_phase)
    return total


class FieldLagRival(NamedTuple):
    """Holds a rival without mechanism: the field's own lag with two fitted spreads."""

    mean_m: float
    # Standard deviation between shaft speeds, m.
    between_m: float
    # Standard deviation between replicates, m.
    within_m: float
    # Log likelihood of the 21 values, 1/m.
    log_likelihood: float
    # Log likelihood minus BIC's half of ln 21 for each parameter.
    penalised: float


def fit_field_rival(published_m: dict[int, tuple[float, ...]]) -> FieldLagRival:
    """Returns the rival of maximum likelihood in closed form.

    The mean by shaft speed is table 1's distance minus the corrected lag; the deviations are normal
    between shaft speeds and between replicates.
    """
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
    return FieldLagRival(
        float(np.mean(expected)),
        float(np.sqrt(max(0.0, of_means - within / replicates))),
        float(np.sqrt(within)),
        float(log),
        float(log - np.log(left.size)),
    )


def _calc_densities(
    machine: Machine, shaft_rpm: int, reading: Interpretation, value_m: float
) -> Array:
    """Returns the density of one miss at each phase (PHASE_COUNT,), 1/m."""
    lag_s = np.full((PHASE_COUNT, 1), _find_lag_s(machine, shaft_rpm, reading))
    if reading.update_hz is not None:
        lag_s += (np.arange(PHASE_COUNT)[:, None] + 0.5) / PHASE_COUNT / reading.update_hz
    if reading.scatter:
        drops = np.array(DROP_S[shaft_rpm])
        lag_s = lag_s + (drops - drops.mean())
    z = (value_m - SPEED_MPS * (lag_s - find_paper_lag_s(shaft_rpm))) / TAPE_SD_M
    return np.asarray(np.mean(np.exp(-0.5 * z * z), axis=1) / (TAPE_SD_M * np.sqrt(2.0 * np.pi)))


def _calc_log(density: float) -> float:
    return float(np.log(max(density, MIN_DENSITY)))


def calc_exceedance_share(
    machine: Machine,
    reading: Interpretation,
    published_m: dict[int, tuple[float, ...]],
    trials: int = 4000,
    seed: int = 1,
) -> float:
    """Returns the share of simulated tables in which shaft speeds differ, relative to replicates,
    at least as much as in the published table.

    The statistic is the ratio of the two standard deviations.
    """
    rng = np.random.default_rng(seed)
    drawn = np.stack(
        [simulate_misses(machine, rpm, reading, True, trials, rng) for rpm in published_m]
    )

    def ratio(misses: Array) -> Array:
        between, within = (
            misses.mean(axis=-1).std(axis=0, ddof=1),
            misses.var(axis=-1, ddof=1).mean(axis=0),
        )
        return np.asarray(between / np.sqrt(within))

    printed = ratio(np.array(list(published_m.values()))[:, None, :])
    return float(np.mean(ratio(drawn) >= printed))
