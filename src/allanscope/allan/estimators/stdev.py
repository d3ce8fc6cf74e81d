"""STDEV: the standard deviation of averages, without overlap."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import AverageEstimator, register

__all__ = ["Stdev"]


@register
class Stdev(AverageEstimator):
    """Standard variance STDVAR: the sample variance of the means of adjoining groups of m rates.

    ``STDVAR = 1/(M - 1) sum (w[k] - mean(w))^2`` (NIST SP 1065; DT0064 STDVAR). For white FM
    it equals AVAR; its excess over AVAR measures what lies below 1 / tau (Barnes' B1 ratio).

    Examples
    --------
    Rates 1 2 4 3: their means by two are 1.5 and 3.5.

    >>> import numpy as np
    >>> Stdev().exact(np.array([0.0, 1, 3, 7, 10]), 2)
    (2.0, 2)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Stdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, 2.0, 2.0, 1.083, 1.083, 1.062]
    """

    name: ClassVar[str] = "stdev"
    variance_name: ClassVar[str] = "STDVAR"
    overlap: ClassVar[bool] = False
