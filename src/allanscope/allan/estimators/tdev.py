"""TDEV: the time deviation, MDEV in terms of angle or velocity."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators.base import register
from allanscope.allan.estimators.mdev import Mdev

__all__ = ["Tdev"]


@register
class Tdev(Mdev):
    """Time variance TVAR: ``tau^2 / 3`` times the modified Allan variance (NIST SP 1065 eq. 15).

    The scatter of the integrated rate (of an angle for a gyro, in deg) over tau, once offset and
    drift are gone. DT0064 TVAR.

    Examples
    --------
    >>> variance, terms = Tdev().exact(np.array([0.0, 1, 3, 7, 10, 11]), 2)
    >>> round(variance, 6), terms
    (0.166667, 1)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Tdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, 0.667, 0.521, 0.847, 0.635]
    """

    name: ClassVar[str] = "tdev"
    variance_name: ClassVar[str] = "TVAR"
    derived_from: ClassVar[str] = "mdev"
    time: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        variance, terms = super().exact(phase, m)
        return variance * m**2 / 3.0, terms

    def factor(self, m: ArrayLike) -> NDArray[np.float64]:
        """Return TVAR / MVAR."""
        return np.asarray(m, np.float64) ** 2 / 3.0
