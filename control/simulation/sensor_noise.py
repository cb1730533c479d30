"""How is seeded sensor noise drawn? In blocks, because single draws are slow."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, count
from math import exp, sqrt

import numpy as np

BLOCK_SIZE = 8192


class NormalNumbers:
    """Draws standard normal numbers, one with each call of `draw_number`."""

    def __init__(self, seed: int) -> None:
        draw = np.random.default_rng(seed).standard_normal
        self.draw_number: Callable[[], float] = chain.from_iterable(
            reversed(draw(BLOCK_SIZE).tolist()) for _ in count()
        ).__next__


class CorrelatedNoise:
    """Draws first-order correlated noise of a given standard deviation and correlation time."""

    def __init__(self, normals: NormalNumbers, sd: float, correlation_s: float) -> None:
        self._normals = normals
        self._sd = sd
        self._correlation_s = correlation_s
        self.value = sd * normals.draw_number()
        # Values of the last step, because steps usually have equal lengths.
        self._dt_s = self._keep = self._fresh_sd = 0.0

    def advance_noise(self, dt_s: float) -> float:
        if dt_s != self._dt_s:
            self._dt_s, self._keep = dt_s, exp(-dt_s / self._correlation_s)
            self._fresh_sd = self._sd * sqrt(1.0 - self._keep * self._keep)
        self.value = self._keep * self.value + self._fresh_sd * self._normals.draw_number()
        return self.value
