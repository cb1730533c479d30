"""Columns under a noise: whatever is asked of their sizes, from their products with each other and
with the data.

The data are r = X b + e, with noise e ~ N(0, V) and sizes b_j ~ N(m_j, S_j^2). With

    A = X'V^-1 X,    s = X'V^-1 r,    c = r'V^-1 r   (1)

the log-likelihood of sizes b is b's - b'A b / 2 - c / 2, but for what no size changes. Hence
their posterior,

    P = A + S^-2,    b = m + P^-1 (s - A m),    cov b = P^-1,   (2)

and by how much, b integrated, the columns together make the data likelier than none of them
(log evidence),

    gain = m's - m'A m / 2 + (s - A m)'P^-1 (s - A m) / 2 - log det(S P S) / 2.   (3)

The last term is what freedom costs [1]_: log det(S P S) is the sum of log(1 + S_j^2 A_jj), plus
log det R with R = P scaled to a diagonal of ones. A column without a prior, S = inf, costs
nothing; the others are then as it leaves them.

Once the columns C are fitted, further columns J do only what these cannot follow (Schur
complement),

    A_J|C = A_JJ - A_JC P_C^-1 A_CJ,    s_J|C = s_J - A_JC b_C,   (4)

so that one more, with a = A_j|C, z = s_j|C and m = 0, gains [2]_

    gain = z^2 / (a + S^-2) / 2 - log(1 + S^2 a) / 2.   (5)

Where rows are at hand, with Q an orthonormal basis of V^-1/2 X_C upon S^-1, A_J|C = J'J -
(Q'J)'(Q'J). A size that scatters from case to case is a further column of each case.

Under a noise of v V all of that is had for every v at once from l and U of S A S = U diag(l)
U', with y = U'S s, m = 0:

    b = S U [y / (l + v)],    cov b = S U diag(v / (l + v)) U'S,
    log E = -(c - sum y^2 / (l + v)) / 2 v - sum log(1 + l / v) / 2.   (6)

References
----------
.. [1] MacKay, Information Theory, Inference and Learning Algorithms, 2003, ch. 28.
.. [2] Tipping and Faul, Fast marginal likelihood maximisation for sparse Bayesian models,
    AISTATS 2003.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# of R: what rounding leaves of columns that are one, times the square root of their number
RIDGE = 1e-10
LEAST = 1e-12  # of a free column's information, to divide by
LEAST_ENERGY = 1e-6  # of an information: a form of less does nothing
# of a form's own information: two amplitudes that are told apart worse share what they gain
STIFF = 1e-4


class Sizes(NamedTuple):
    """Posterior of sizes, (2) and (3). log_occam : the last term of (3), by itself."""

    b: Array  # (..., k)
    cov: Array  # (..., k, k)
    log_occam: Array  # (...,)
    gain: Array  # (...,)


class Gaussian(NamedTuple):
    """The products (1) of k columns; cases that are looked at together have leading axes."""

    A: Array  # (..., k, k)
    s: Array  # (..., k)
    c: Array | float = 0.0  # (...,)

    def of(self, chosen: Indices) -> Gaussian:
        """The same of some columns (k,)."""
        return Gaussian(self.A[..., chosen[:, None], chosen], self.s[..., chosen], self.c)

    def fit(self, sd: Array, mean: Array | float = 0.0) -> Sizes:
        """Posterior of all sizes under priors of s.d. (..., k), each from 0 to inf, and mean."""
        a, free = np.maximum(np.diagonal(self.A, axis1=-2, axis2=-1), 0.0), np.isinf(sd)
        bound = np.where(free, 0.0, sd)
        cost = np.log1p(bound**2 * a)
        scale = np.where(free, 1.0 / np.sqrt(np.maximum(a, LEAST)), bound * np.exp(-0.5 * cost))
        one = np.eye(a.shape[-1], dtype=bool)
        r = np.where(one, 1.0 + RIDGE, self.A * scale[..., :, None] * scale[..., None, :])
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
        return Sizes(mean + moved, cov, log_occam, gain)

    def beyond(self, cross: Array, fitted: Sizes) -> Gaussian:
        """(4): what is left of these columns by others, once they are fitted. cross : A_JC,
        (..., k, fitted)."""
        return Gaussian(
            self.A - cross @ fitted.cov @ np.swapaxes(cross, -1, -2),
            self.s - np.einsum("...ij,...j->...i", cross, fitted.b),
        )

    def gains_of_single(self, mixes: Array) -> Array:
        """Twice the log-likelihood that the best size of each mix of columns gains: mixes (k,
        n) -> (n,)."""
        a = np.einsum("kn,kn->n", mixes, self.A @ mixes)
        return np.where(a > LEAST_ENERGY, (self.s @ mixes) ** 2 / np.maximum(a, LEAST_ENERGY), 0.0)

    def calc_gain_of_mixes(self, mix: Array) -> float:
        """Twice the log-likelihood that the best sizes of mixes of columns gain together: mix
        (k, p)."""
        part, side = mix.T @ self.A @ mix, mix.T @ self.s
        a = np.diag(part)
        if np.any(a <= LEAST_ENERGY):
            return 0.0
        scale = np.sqrt(a)
        stiff = part / scale[:, None] / scale + STIFF * np.eye(len(side))
        return float(np.linalg.solve(stiff, side / scale) @ (side / scale))

    def find_independent_axes(self, sd: Array) -> Axes:
        """Under priors of s.d. (k,), none inf, and mean 0, for noises of any strength."""
        length, turn = np.linalg.eigh(self.A * sd[:, None] * sd)
        return Axes(
            np.maximum(length, 0.0),
            np.einsum("...ij,...i->...j", turn, self.s * sd),
            turn * sd[:, None],
            np.asarray(self.c),
        )


class Axes(NamedTuple):
    """(6): sizes along axes on which they are independent whatever the strength of the noise."""

    length: Array  # l (..., k)
    score: Array  # y (..., k)
    axes: Array  # S U (..., k, k)
    c: Array  # (...,)

    def log_evidence(self, v: Array) -> Array:
        """Under noises of variances v (n,) times V: (..., n)."""
        over = self.length[..., None, :] + v[:, None]
        left = np.maximum(
            self.c[..., None] - np.sum(self.score[..., None, :] ** 2 / over, axis=-1), 0.0
        )
        return np.asarray(
            -0.5 * left / v
            - 0.5 * np.sum(np.log1p(self.length[..., None, :] / v[:, None]), axis=-1)
        )

    def sizes(self, v: Array) -> tuple[Array, Array]:
        """b, and their variances along the axes: (..., n, k) each."""
        over = self.length[..., None, :] + v[:, None]
        return (self.score[..., None, :] / over) @ np.swapaxes(self.axes, -1, -2), v[:, None] / over


def calc_elementwise_gain(a: Array, z: Array, sd: Array | float) -> Array:
    """(5), element by element."""
    return np.asarray(0.5 * z**2 * sd**2 / (1.0 + a * sd**2) - 0.5 * np.log1p(a * sd**2))
