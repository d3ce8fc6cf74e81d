"""PDEV: the parabolic deviation, from straight lines fitted to the phase."""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import LagSums, difference_edf, sampled_autocovariance, sum_lags
from allanscope.allan.estimators.base import Estimator, mean_square_second, register
from allanscope.allan.noise_type import Family
from allanscope.compiled import Pointer, kernel

__all__ = ["Pdev"]

_FINE = 32
"""Averaging factor from which on the weights of the window are as good as continuous."""


@register
class Pdev(Estimator):
    """Parabolic variance PVAR: half the mean square difference of neighbouring fitted rates.

    ``PVAR = 72/m^6 < (sum_{k < m} ((m - 1)/2 - k) (x[i + k] - x[i + k + m]))^2 >``, the sum being a
    least-squares slope of the phase over m values less that over the next m (F. Vernotte and
    others 2015, 2020). It averages white PM like MVAR within a window as short as AVAR's. At m = 1
    it is AVAR. Not in DT0064.

    The mean is over ``n + 1 - 2m`` windows, one fewer than there are, as in Vernotte (2020).

    Examples
    --------
    >>> Pdev().exact(np.array([0.0, 1, 3, 7, 10, 11]), 2)
    (1.40625, 2)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Pdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, 2.531, 1.406, 1.031, 1.055, 0.9]
    """

    name: ClassVar[str] = "pdev"
    variance_name: ClassVar[str] = "PVAR"
    family: ClassVar[Family] = "mvar"

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        terms = phase.size - 2 * m
        if terms < 1:
            return np.nan, 0
        if m == 1:
            return mean_square_second(phase, 1, 1)[0] / 2.0, terms
        mean = _squares_of_slopes(phase[:-m] - phase[m:], m, terms) / terms
        return 72.0 * mean / float(m) ** 6, terms

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom from the autocorrelation of the window's own weights."""
        alpha, m, n, stride = np.broadcast_arrays(alpha, m, n, stride)
        edf = difference_edf(alpha, m, n, stride, order=2)
        for i in np.argwhere(m > 1):
            index = tuple(i)
            coarse = max(float(m[index]) / _FINE, float(stride[index]), 1.0)
            points = min(int(m[index]), _FINE)
            lags = _lags(int(alpha[index]), points, float(m[index]) / coarse)
            edf[index] = lags.edf((n[index] + 1 - 2 * m[index]) / coarse)
        return edf

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms."""
        return 2 * m + self.min_terms - 1


_squares_of_slopes = kernel("squares_of_slopes", Pointer(np.float64, 1), int, int, returns=float)
"""Sum of ``(sum_k ((m - 1)/2 - k) u[i + k])^2`` over the first i; u has m values more."""


@lru_cache(maxsize=1024)
def _lags(alpha: int, points: int, span: float) -> LagSums:
    """Return the summed autocorrelations of a window of `points` phases a tau."""
    line = (points - 1) / 2 - np.arange(points)
    weights = np.concatenate([line, -line])
    pairs = np.correlate(weights, weights, "full")
    offset = np.arange(1 - weights.size, weights.size) / points

    def covariance(lag: NDArray[np.float64]) -> NDArray[np.float64]:
        phase = sampled_autocovariance(lag[:, np.newaxis] + offset, float(points), alpha)
        return phase @ pairs

    power = covariance(np.zeros(1))[0]
    return sum_lags(lambda lag: covariance(lag) / power, span, 3.0)
