"""TTOTDEV: the time total deviation, MTOTDEV in terms of angle or velocity."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators.base import register
from allanscope.allan.estimators.mtotdev import Mtotdev

__all__ = ["Ttotdev"]


@register
class Ttotdev(Mtotdev):
    """Time total variance TTOT: ``tau^2 / 3`` times the modified total variance.

    NIST SP 1065 eq. 28 (DT0064 TTOTVAR); bias and degrees of freedom are those of `Mtotdev`.

    Examples
    --------
    >>> variance, windows = Ttotdev().exact(np.array([0.0, 1, 3, 7, 10, 11, 9]), 2)
    >>> round(variance, 6), windows
    (2.075532, 2)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Ttotdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, 0.743, 0.621, 0.667, 0.728]
    """

    name: ClassVar[str] = "ttotdev"
    variance_name: ClassVar[str] = "TTOTVAR"
    calibrated_as: ClassVar[str] = "mtotdev"
    derived_from: ClassVar[str] = "mtotdev"
    time: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return raw variance and number of windows."""
        variance, windows = super().exact(phase, m)
        return variance * m**2 / 3.0, windows

    def factor(self, m: ArrayLike) -> NDArray[np.float64]:
        """Return TTOT / MTOT."""
        return np.asarray(m, np.float64) ** 2 / 3.0
