"""MDEV: the modified Allan deviation, which distinguishes white from flicker phase noise."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import difference_edf
from allanscope.allan.estimators.base import Estimator, register
from allanscope.allan.noise_type import Family
from allanscope.compiled import Pointer, kernel

__all__ = ["Mdev"]


@register
class Mdev(Estimator):
    """Modified Allan variance MAVAR: OAVAR of a phase that is averaged over m samples first.

    ``MVAR = 1/(2 m^4) <(sum_{j < m} x[i+j+2m] - 2 x[i+j+m] + x[i+j])^2>`` (NIST SP 1065 eq. 14;
    DT0064 MAVAR). Averaging the phase makes white PM fall as tau^-3 but flicker PM as tau^-2, where
    AVAR falls as tau^-2 for both. In sensor words: quantisation falls faster than flicker of angle.

    Examples
    --------
    The same as OAVAR at m = 1:

    >>> x = np.array([0.0, 1, 3, 7, 10, 11])
    >>> Mdev().exact(x, 1), Mdev().exact(x, 2)
    ((1.25, 4), (0.125, 1))

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Mdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, 0.5, 0.391, 0.635, 0.477]
    """

    name: ClassVar[str] = "mdev"
    variance_name: ClassVar[str] = "MAVAR"
    family: ClassVar[Family] = "mvar"

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        if phase.size < 3 * m:
            return np.nan, 0
        terms = phase.size - 3 * m + 1
        total = _squares_of_sums(np.ascontiguousarray(phase, np.float64), m, terms)
        return total / terms / (2.0 * float(m) ** 4), terms

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the equivalent degrees of freedom after Greenhall and Riley."""
        return difference_edf(alpha, m, n, stride, order=2, modified=True)

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms."""
        return 3 * m + self.min_terms - 2


_squares_of_sums = kernel("squares_of_sums", Pointer(np.float64, 1), int, int, returns=float)
"""Sum of squares of the sums over m second differences at lag m."""
