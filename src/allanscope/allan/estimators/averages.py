"""Estimators made of plain averages: the ordinary variance of means over m rates."""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.autocovariance import difference_autocovariance
from allanscope.allan.edf import difference_edf
from allanscope.allan.estimators.base import Estimator

__all__ = ["AverageEstimator"]

_MOST_POSITIONS = 256


class AverageEstimator(Estimator):
    """Sample variance of the means ``w`` of m rates: ``sum (w - mean(w))^2 / (terms - 1)``.

    Attributes
    ----------
    overlap : bool
        True when means start at every sample, False when only at every m-th.

    Notes
    -----
    For flicker and steeper noise it has no limit: it grows with the run, as its mean wanders.
    """

    overlap: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of means."""
        means = (phase[m:] - phase[:-m])[:: self.exact_stride(m)] / m
        if means.size < 2:
            return np.nan, means.size
        means = means - means.mean()
        return float(means @ means) / (means.size - 1), means.size

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom, less what the mean of the run takes."""
        alpha, m, n, stride = np.broadcast_arrays(alpha, m, n, stride)
        spans = n / m
        stationary = difference_edf(np.maximum(alpha, 0), m, n, stride, order=1)
        edf = np.array(stationary * (1.0 - 1.0 / np.maximum(spans, 1.0)))
        for i in np.argwhere((alpha < 0) & (spans >= 2)):
            index = tuple(i)
            quarters = round(4.0 * float(np.log2(spans[index])))
            edf[index] = _wandering_edf(int(alpha[index]), quarters)
        return edf

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` means."""
        return m + (self.min_terms - 1) * self.exact_stride(m)

    def exact_stride(self, m: int) -> int:
        """Return the step between means."""
        return 1 if self.overlap else m


@lru_cache(maxsize=1024)
def _wandering_edf(alpha: int, quarter_octaves: int) -> float:
    """Return ``tr(C)^2 / tr(C^2)``, C being the covariance of the means less their own mean.

    For such noise the slowest part of the run makes most of the variance, so a few hundred
    positions stand for all of them, and the number of degrees is small however long the run. It
    changes slowly with n / m, hence the steps of a quarter octave.
    """
    position = np.linspace(0.0, 2.0 ** (quarter_octaves / 4.0) - 1.0, _MOST_POSITIONS)
    lag = position[:, np.newaxis] - position
    covariance = difference_autocovariance(lag, np.inf, alpha, 1)
    rows = covariance.mean(axis=0)
    covariance = covariance - rows - rows[:, np.newaxis] + rows.mean()
    return float(np.trace(covariance) ** 2 / np.sum(covariance**2))
