"""The noise's fit: its own small solver against LAPACK's."""
from __future__ import annotations

import numpy as np
import pytest

from control.diagnosis.judgement.noise_fit import solved


@pytest.mark.parametrize("seed", range(20))
def test_the_step_is_that_of_lapack(seed: int) -> None:
    rng = np.random.default_rng(seed)
    square, right = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-3.0, 3.0, 4), rng.normal(size=4)
    for matrix in (square, square @ square.T):          # rows must change places; as Fisher's is
        expected = np.linalg.solve(matrix, right)
        off = matrix @ solved(matrix.copy(), right.copy()) - right
        assert np.abs(off).max() <= 1e-12 + 10.0 * np.abs(matrix @ expected - right).max()


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_what_has_no_step_is_refused(value: float) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solved(np.full((4, 4), value), np.ones(4))
