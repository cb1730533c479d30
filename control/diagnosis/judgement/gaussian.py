"""Calculates posteriors, evidence and gains of columns under Gaussian noise, from their products
with each other and with the data.

The data are r = X b + e, with noise e ~ N(0, V) and sizes b_j ~ N(m_j, S_j^2). With

    A = X'V^-1 X,    s = X'V^-1 r,    c = r'V^-1 r   (1)

the log-likelihood of sizes b is b's - b'A b / 2 - c / 2, except for a constant. Hence their
posterior,

    P = A + S^-2,    b = m + P^-1 (s - A m),    cov b = P^-1,   (2)

and the log evidence of the columns over no column, with b integrated,

    gain = m's - m'A m / 2 + (s - A m)'P^-1 (s - A m) / 2 - log det(S P S) / 2.   (3)

The last term is the price of freedom [1]_: log det(S P S) is the sum of log(1 + S_j^2 A_jj), plus
log det R with R = P scaled to a diagonal of ones. A column without a prior, S = inf, has no price;
the others are then conditional on it.

After the fit of columns C, only the component of further columns J that C cannot follow remains
(Schur complement),

    A_J|C = A_JJ - A_JC P_C^-1 A_CJ,    s_J|C = s_J - A_JC b_C,   (4)

so a single further column, with a = A_j|C, z = s_j|C and m = 0, gains [2]_

    gain = z^2 / (a + S^-2) / 2 - log(1 + S^2 a) / 2.   (5)

Where rows are available, with Q an orthonormal basis of V^-1/2 X_C upon S^-1, A_J|C = J'J -
(Q'J)'(Q'J). A size that varies between cases is a further column of each case.

Under a noise of v V all of this follows for every v from l and U of S A S = U diag(l) U', with y =
U'S s, m = 0:

    b = S U [y / (l + v)],    cov b = S U diag(v / (l + v)) U'S,
    log E = -(c - sum y^2 / (l + v)) / 2 v - sum log(1 + l / v) / 2.   (6)

References
----------
.. [1] MacKay, Information Theory, Inference and Learning Algorithms, 2003, ch. 28. .. [2] Tipping
and Faul, Fast marginal likelihood maximisation for sparse Bayesian models,
    AISTATS 2003.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Addition to the diagonal of the scaled matrix R, of the order of the rounding error: R can then be
# inverted with identical columns too.
RIDGE_SHARE = 1e-10
# Minimum information of a free column, to avoid a division by zero.
MIN_INFORMATION = 1e-12
# Minimum share of the information: a form with less has no effect.
MIN_ENERGY_SHARE = 1e-6
# Ridge as a share of a form's information: two amplitudes that are harder to separate share their
# gain.
FORM_RIDGE_SHARE = 1e-4


class SizePosterior(NamedTuple):
    """Posterior of sizes, (2) and (3). log_occam : the last term of (3)."""

    # Posterior mean, (..., k).
    b: Array
    # Posterior covariance, (..., k, k).
    cov: Array
    # Log Occam factor, (...,).
    log_occam: Array
    # Log evidence over no column, (...,).
    gain: Array


class ColumnProducts(NamedTuple):
    """The products (1) of k columns; several cases have leading axes."""

    # Information matrix, (..., k, k).
    A: Array
    # Scores, (..., k).
    s: Array
    # Sum of squares of the data, (...,).
    c: Array | float = 0.0

    def select_columns(self, chosen: Indices) -> ColumnProducts:
        """Return the products of some of the columns (k,)."""
        return ColumnProducts(self.A[..., chosen[:, None], chosen], self.s[..., chosen], self.c)

    def fit(self, sd: Array, mean: Array | float = 0.0) -> SizePosterior:
        """Return the posterior of all sizes under priors with s.d. (..., k), each from 0 to inf,
        and mean."""
        a, free = np.maximum(np.diagonal(self.A, axis1=-2, axis2=-1), 0.0), np.isinf(sd)
        bound = np.where(free, 0.0, sd)
        cost = np.log1p(bound**2 * a)
        scale = np.where(
            free, 1.0 / np.sqrt(np.maximum(a, MIN_INFORMATION)), bound * np.exp(-0.5 * cost)
        )
        one = np.eye(a.shape[-1], dtype=bool)
        r = np.where(one, 1.0 + RIDGE_SHARE, self.A * scale[..., :, None] * scale[..., None, :])
        cov = np.linalg.inv(r) * scale[..., :, None] * scale[..., None, :]
        about = self.s - np.einsum("...ij,...j->...i", self.A, np.broadcast_to(mean, self.s.shape))
        moved = np.einsum("...ij,...j->...i", cov, about)
        log_det = np.linalg.slogdet(r)[1]
        if np.any(free):
            log_det = (
                log_det
                - np.linalg.slogdet(np.where(free[..., :, None] & free[..., None, :], r, one))[1]
            )
        log_occam = -0.5 * (log_det + np.sum(cost, axis=-1))
        gain = 0.5 * np.sum(mean * (self.s + about) + about * moved, axis=-1) + log_occam
        return SizePosterior(mean + moved, cov, log_occam, gain)

    def project_out(self, cross: Array, fitted: SizePosterior) -> ColumnProducts:
        """Return the products (4) of these columns after the fit of others. cross : A_JC, (..., k,
        fitted)."""
        return ColumnProducts(
            self.A - cross @ fitted.cov @ np.swapaxes(cross, -1, -2),
            self.s - np.einsum("...ij,...j->...i", cross, fitted.b),
        )

    def calc_single_gains(self, mixes: Array) -> Array:
        """Return the gain in twice the log-likelihood of the best size of each mixture of columns:
        mixes (k, n) -> (n,)."""
        a = np.einsum("kn,kn->n", mixes, self.A @ mixes)
        return np.where(
            a > MIN_ENERGY_SHARE, (self.s @ mixes) ** 2 / np.maximum(a, MIN_ENERGY_SHARE), 0.0
        )

    def calc_gain_of_mixes(self, mix: Array) -> float:
        """Return the joint gain in twice the log-likelihood of the best sizes of mixtures of
        columns: mix (k, p)."""
        part, side = mix.T @ self.A @ mix, mix.T @ self.s
        a = np.diag(part)
        if np.any(a <= MIN_ENERGY_SHARE):
            return 0.0
        scale = np.sqrt(a)
        stiff = part / scale[:, None] / scale + FORM_RIDGE_SHARE * np.eye(len(side))
        return float(np.linalg.solve(stiff, side / scale) @ (side / scale))

    def find_independent_axes(self, sd: Array) -> IndependentAxes:
        """Return the axes on which sizes are independent for noise of any strength, under priors
        with finite s.d. (k,) and mean 0."""
        length, turn = np.linalg.eigh(self.A * sd[:, None] * sd)
        return IndependentAxes(
            np.maximum(length, 0.0),
            np.einsum("...ij,...i->...j", turn, self.s * sd),
            turn * sd[:, None],
            np.asarray(self.c),
        )


class IndependentAxes(NamedTuple):
    """Sizes along axes on which they are independent whatever the strength of the noise, (6)."""

    # Eigenvalues l, (..., k).
    length: Array
    # Scores y, (..., k).
    score: Array
    # Axes S U, (..., k, k).
    axes: Array
    # Sum of squares of the data, (...,).
    c: Array

    def calc_log_evidence(self, v: Array) -> Array:
        """Return the log evidence under noises of variances v (n,) times V: (..., n)."""
        over = self.length[..., None, :] + v[:, None]
        left = np.maximum(
            self.c[..., None] - np.sum(self.score[..., None, :] ** 2 / over, axis=-1), 0.0
        )
        return np.asarray(
            -0.5 * left / v
            - 0.5 * np.sum(np.log1p(self.length[..., None, :] / v[:, None]), axis=-1)
        )

    def calc_sizes(self, v: Array) -> tuple[Array, Array]:
        """Return the sizes b of (6) and their variances along the axes, for n noises and k
        columns: (..., n, k) each."""
        over = self.length[..., None, :] + v[:, None]
        return (self.score[..., None, :] / over) @ np.swapaxes(self.axes, -1, -2), v[:, None] / over


def calc_elementwise_gain(a: Array, z: Array, sd: Array | float) -> Array:
    """Return the gain (5), element by element."""
    return np.asarray(0.5 * z**2 * sd**2 / (1.0 + a * sd**2) - 0.5 * np.log1p(a * sd**2))
