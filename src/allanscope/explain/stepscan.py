r"""Matched filters for steps and boxes at every instant at once.

In whitened ordinates the score of a unit step at sample t is a running sum of the inverse cosine
transform of d/lambda, and its information follows from one cosine sum,

.. math:: n I(t) = F(0) - F(2t), \qquad F(u) = \sum_k q_k \cos(\pi k u / n), \quad
          q_k = \frac{1}{4 \lambda_k \sin^2(\pi k / 2n)}

and a box from a to b is the difference of two steps,
:math:`n I(a, b) = 2F(0) - F(2a) - F(2b) - 2F(b - a) + 2F(a + b)`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from allanscope.explain.spectrum import Spectrum
from allanscope.noise.grid import Grid

__all__ = ["StepScan"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class StepScan:
    """Gains in nats of steps and boxes in a series of given ordinates under a noise spectrum."""

    def __init__(self, grid: Grid, ordinates: Array, spectrum: Spectrum) -> None:
        self.n, self.cells = grid.n, grid.low
        weight = spectrum.kept / spectrum.ordinates
        white = np.zeros(grid.n)
        np.multiply(ordinates, weight, out=white[1:])
        self.score = np.zeros(grid.n + 1)
        np.cumsum(idct(white, norm="ortho", overwrite_x=True), out=self.score[1:])
        k = np.arange(1, self.cells + 1)
        q = np.concatenate(
            [[0.0], weight[: self.cells] / (2 * np.sin(np.pi * k / (2 * grid.n))) ** 2]
        )
        self._sum = np.asarray(dct(np.append(q[:-1], 2 * q[-1]), type=1)) / 2

    def _cosine_sum(self, u: Ints) -> Array:
        """F at u samples, even with period 2 n; linear between the cells."""
        u = np.abs(u) % (2 * self.n)
        u = np.minimum(u, 2 * self.n - u)
        return np.asarray(
            np.interp(u * (self.cells / self.n), np.arange(self.cells + 1), self._sum)
        )

    def step(self, at: Ints) -> Array:
        """Gain of a step at samples `at`."""
        information = (self._sum[0] - self._cosine_sum(2 * at)) / self.n
        return np.asarray(self.score[at] ** 2 / (2 * np.maximum(information, 1e-300)))

    def box(self, first: Ints, last: Ints) -> Array:
        """Gain of a box from `first` to before `last`."""
        information = (
            2 * self._sum[0]
            - self._cosine_sum(2 * first)
            - self._cosine_sum(2 * last)
            - 2 * self._cosine_sum(last - first)
            + 2 * self._cosine_sum(first + last)
        ) / self.n
        score = self.score[first] - self.score[last]
        return np.asarray(score**2 / (2 * np.maximum(information, 1e-300)))
