"""OADEV: the Allan deviation from every position, the workhorse."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import DifferenceEstimator, register

__all__ = ["Oadev"]


@register
class Oadev(DifferenceEstimator):
    """Overlapping Allan variance OAVAR: AVAR averaged over all starting points.

    ``OAVAR = 1/(2 m^2) <(x[i + 2m] - 2 x[i + m] + x[i])^2>`` (NIST SP 1065 eq. 11; DT0064 OAVAR).
    It has the expectation of AVAR and up to three times its degrees of freedom.

    Examples
    --------
    Rates 1 2 4 3: means by two differ by 2 at the one position there is; by three there is none.

    >>> import numpy as np
    >>> x = np.array([0.0, 1, 3, 7, 10])
    >>> Oadev().exact(x, 1), Oadev().exact(x, 2), Oadev().exact(x, 3)
    ((1.0, 3), (2.0, 1), (nan, 0))

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Oadev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, 2.0, 1.0, 1.042, 1.062, 1.075]
    """

    name: ClassVar[str] = "oadev"
    variance_name: ClassVar[str] = "OAVAR"
