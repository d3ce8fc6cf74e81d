"""OSTDEV: the standard deviation of averages from every position."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import AverageEstimator, register

__all__ = ["Ostdev"]


@register
class Ostdev(AverageEstimator):
    """Overlapping standard variance OSTDVAR: the sample variance of all means of m rates.

    As STDVAR, with ``w[i] = (x[i + m] - x[i]) / m`` from every sample i (DT0064 OSTDVAR). Unlike
    OAVAR it is biased low in a short run, for the overlapping means agree with their own mean.

    Examples
    --------
    Rates 1 2 4 3: their means by two are 1.5, 3 and 3.5.

    >>> import numpy as np
    >>> variance, terms = Ostdev().exact(np.array([0.0, 1, 3, 7, 10]), 2)
    >>> round(variance, 6), terms
    (1.083333, 3)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Ostdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, 1.125, 1.083, 0.75, 0.675, 0.742, 0.786]
    """

    name: ClassVar[str] = "ostdev"
    variance_name: ClassVar[str] = "OSTDVAR"
