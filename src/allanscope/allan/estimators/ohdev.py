"""OHDEV: the Hadamard deviation from every position."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import register
from allanscope.allan.estimators.differences import DifferenceEstimator

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
    """

    name: ClassVar[str] = "ohdev"
    variance_name: ClassVar[str] = "OHVAR"
    lowest_alpha: ClassVar[int] = -4
    hadamard: ClassVar[bool] = True
    order: ClassVar[int] = 3
