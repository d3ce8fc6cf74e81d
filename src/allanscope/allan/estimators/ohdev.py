"""OHDEV: the Hadamard deviation from every position."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import DifferenceEstimator, register
from allanscope.allan.noise_type import Family

__all__ = ["Ohdev"]


@register
class Ohdev(DifferenceEstimator):
    """Overlapping Hadamard variance OHVAR: HVAR averaged over all starting points.

    ``OHVAR = 1/(6 m^2) <(x[i + 3m] - 3 x[i + 2m] + 3 x[i + m] - x[i])^2>`` (NIST SP 1065 eq. 20;
    DT0064 OHVAR, with 1/2 for 1/6: see `Hdev`). Blind to linear drift, converges down to alpha -4.

    Examples
    --------
    A ramp leaves nothing:

    >>> import numpy as np
    >>> Ohdev().exact(np.arange(9.0) ** 2, 2)
    (0.0, 3)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Ohdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, nan, 2.042, 1.208, 1.306]
    """

    name: ClassVar[str] = "ohdev"
    variance_name: ClassVar[str] = "OHVAR"
    lowest_alpha: ClassVar[int] = -4
    hadamard: ClassVar[bool] = True
    family: ClassVar[Family] = "hvar"
    order: ClassVar[int] = 3
