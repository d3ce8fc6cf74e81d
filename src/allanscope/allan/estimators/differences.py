"""Estimators whose term is a difference of the phase: their sums, degrees of freedom and needs."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import difference_edf
from allanscope.allan.estimators.base import Estimator
from allanscope.compiled import njit

__all__ = ["DifferenceEstimator", "mean_square_second", "mean_square_third"]


class DifferenceEstimator(Estimator):
    """Mean square of a difference of the phase at lag m, over ``2 m^2`` or ``6 m^2``.

    Attributes
    ----------
    order : {2, 3}
        2 for the Allan family, blind to an offset of the rate; 3 for Hadamard, blind to a drift.
    overlap : bool
        True when terms start at every sample, False when only at every m-th.
    """

    order: ClassVar[int] = 2
    overlap: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        stride = self.exact_stride(m)
        if self.order == 2:
            mean, terms = mean_square_second(phase, m, stride)
            return mean / (2.0 * m**2), terms
        mean, terms = mean_square_third(phase, m, stride)
        return mean / (6.0 * m**2), terms

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the equivalent degrees of freedom after Greenhall and Riley."""
        return difference_edf(alpha, m, n, stride, order=self.order)

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms."""
        return self.order * m + (self.min_terms - 1) * self.exact_stride(m)

    def exact_stride(self, m: int) -> int:
        """Return the step between terms."""
        return 1 if self.overlap else m


# Compiled, because an array expression would walk through memory four times for each tau.


@njit(cache=True, nogil=True)
def mean_square_second(x: NDArray[np.float64], m: int, stride: int) -> tuple[float, int]:
    """Return the mean of ``(x[i] - 2 x[i+m] + x[i+2m])^2``, i = 0, stride, ..., and its terms."""
    total, terms = 0.0, 0
    for i in range(0, x.size - 2 * m, stride):
        difference = (x[i] - x[i + m]) + (x[i + 2 * m] - x[i + m])
        total += difference * difference
        terms += 1
    return (total / terms if terms else np.nan), terms


@njit(cache=True, nogil=True)
def mean_square_third(x: NDArray[np.float64], m: int, stride: int) -> tuple[float, int]:
    """Return the mean of ``(x[i] - 3 x[i+m] + 3 x[i+2m] - x[i+3m])^2`` likewise."""
    total, terms = 0.0, 0
    for i in range(0, x.size - 3 * m, stride):
        difference = (x[i] - x[i + 3 * m]) + 3.0 * (x[i + 2 * m] - x[i + m])
        total += difference * difference
        terms += 1
    return (total / terms if terms else np.nan), terms
