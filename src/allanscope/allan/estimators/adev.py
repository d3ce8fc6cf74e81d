"""ADEV: the Allan deviation without overlap."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import DifferenceEstimator, register

__all__ = ["Adev"]


@register
class Adev(DifferenceEstimator):
    """Allan variance AVAR: half the mean square difference of neighbouring means of m rates.

    ``AVAR = 1/2 <(w[k + 1] - w[k])^2>``, w being the means of adjoining groups of m rates (NIST
    SP 1065 eq. 7; DT0064 AVAR). A constant offset drops out, and so it converges for random walk,
    where the ordinary variance grows without end. `Oadev` uses the same data better.

    Examples
    --------
    Rates 1 2 4 3: their means by two are 1.5 and 3.5, half the squared difference is 2.

    >>> import numpy as np
    >>> x = np.array([0.0, 1, 3, 7, 10])
    >>> Adev().exact(x, 1), Adev().exact(x, 2)
    ((1.0, 3), (2.0, 1))

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Adev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, 2.0, 2.0, 1.562, 1.562, 1.417]
    """

    name: ClassVar[str] = "adev"
    variance_name: ClassVar[str] = "AVAR"
    overlap: ClassVar[bool] = False
