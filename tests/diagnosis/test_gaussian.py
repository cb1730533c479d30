"""The algebra of evidence against the densities that it stands for, and how even a gain is
against sums by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from topdress.control.diagnosis.judgement.gaussian import ColumnProducts, calc_elementwise_gain
from topdress.control.diagnosis.runs import whitened

approx = pytest.approx
RNG = np.random.default_rng(1)
X, R = RNG.normal(size=(40, 4)), RNG.normal(0.3, 1.0, 40)
SD, MEAN = np.array([0.5, 2.0, 1e-3, 0.0]), np.array([0.2, 0.0, -0.1, 0.3])
OF_ROWS = ColumnProducts(X.T @ X, X.T @ R, R @ R)


def log_density(v: float, mean: Any = MEAN) -> float:
    """Of the data under noise of variance v, the sizes integrated."""
    return float(multivariate_normal(X @ mean, v * np.eye(40) + X * SD**2 @ X.T).logpdf(R))


def test_the_gain_is_what_the_columns_make_the_data_likelier() -> None:
    found = OF_ROWS.fit(SD, MEAN)
    assert found.gain == approx(log_density(1.0) - multivariate_normal(np.zeros(40)).logpdf(R))
    assert found.b[3] == MEAN[3] and found.cov[3, 3] == 0.0, "no prior s.d.: it stands"
    assert calc_elementwise_gain(OF_ROWS.A[0, 0], OF_ROWS.s[0], 0.5) == approx(
        OF_ROWS.select_columns(np.array([0])).fit(SD[:1]).gain
    )


def test_the_strength_of_the_noise_is_that_of_every_v() -> None:
    v, along = np.array([0.4, 1.0, 3.0]), OF_ROWS.find_independent_axes(SD)
    assert along.calc_log_evidence(v) == approx(
        [log_density(one, np.zeros(4)) + 20.0 * np.log(2.0 * np.pi * one) for one in v]
    )
    b, variance = along.calc_sizes(v)
    one = OF_ROWS.fit(SD)
    assert b[1] == approx(one.b) and along.axes * variance[1] @ along.axes.T == approx(
        one.cov, abs=1e-9
    )


def test_columns_beyond_others_are_as_if_all_were_fitted_and_a_free_one_costs_nothing() -> None:
    first, last = np.array([0, 1]), np.array([2, 3])
    sd = np.array([np.inf, 0.7, 0.5, 2.0])
    every, fitted = OF_ROWS.fit(sd), OF_ROWS.select_columns(first).fit(sd[first])
    beyond = (
        OF_ROWS.select_columns(last)
        .project_out(OF_ROWS.A[np.ix_(last, first)], fitted)
        .fit(sd[last])
    )
    assert beyond.b == approx(every.b[last]) and beyond.cov == approx(every.cov[np.ix_(last, last)])
    assert fitted.gain + beyond.gain == approx(every.gain)
    alone = OF_ROWS.select_columns(first[:1]).fit(sd[:1])
    assert (alone.log_occam, alone.gain) == (
        approx(0.0, abs=1e-9),
        approx(0.5 * OF_ROWS.s[0] ** 2 / OF_ROWS.A[0, 0]),
    )


def test_cases_side_by_side_are_fitted_as_one_by_one() -> None:
    both = ColumnProducts(np.stack([OF_ROWS.A, 2.0 * OF_ROWS.A]), np.stack([OF_ROWS.s, OF_ROWS.s]))
    sd = np.stack([SD, SD[::-1]])
    for k, one in enumerate(both.fit(sd).b):
        assert one == approx(ColumnProducts(both.A[k], both.s[k]).fit(sd[k]).b)


@pytest.mark.parametrize("pull", [0.0, 1.5, 6.0])
def test_a_tolerance_moves_in_the_place_of_a_column_or_stands_whichever_is_likelier(
    pull: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what a column does, half is what a tolerance can follow; the last row is that
    tolerance's prior."""
    channel = SimpleNamespace(copies=1, settled=True, grid=SimpleNamespace(step_s=1.0))
    model = SimpleNamespace(channels=[channel], calc_banded_residual=lambda parts: {})
    search: Any = SimpleNamespace(
        model=model, columns=SimpleNamespace(list_columns=lambda parts: [])
    )
    held, own, left = (
        np.append(np.ones(30), 0.0),
        np.append(RNG.normal(size=30), pull),
        RNG.normal(size=31),
    )
    left = left + own
    residual = SimpleNamespace(
        left=left,
        priors=slice(30, 31),
        split_column=lambda trace: (own, held),
        make_series=lambda one, rows: rows[:30],
    )
    monkeypatch.setattr(whitened, "WhitenedResidual", lambda *args: residual)
    size = own @ left / (own @ own)
    rest = (left - size * own)[:30]

    def log_t(e: Any) -> Any:
        return -0.5 * (whitened.BLOCK_DOF + 1.0) * np.log(whitened.BLOCK_DOF + e**2)

    def without_best(gains: Any) -> float:
        return float(gains.sum())

    moved = without_best(log_t(rest) - log_t(left[:30]))
    moved += 0.5 * (left[30] ** 2 - (left[30] - size * pull) ** 2)
    stands = without_best(log_t(rest) - log_t((left + size * held)[:30]))
    square = own[:30] ** 2
    uneven = max(1.0, float(np.sum(square * rest**2) / np.sum(square)))
    assert whitened.calc_block_gain(search, (), {}, None) == approx(min(moved, stands) / uneven)  # type: ignore[arg-type]
