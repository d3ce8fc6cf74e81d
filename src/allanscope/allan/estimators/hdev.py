"""HDEV: the Hadamard deviation without overlap."""

from __future__ import annotations

from typing import ClassVar

from allanscope.allan.estimators.base import DifferenceEstimator, register
from allanscope.allan.noise_type import Family

__all__ = ["Hdev"]


@register
class Hdev(DifferenceEstimator):
    """Hadamard variance HVAR: a sixth of the mean square second difference of means of m rates.

    ``HVAR = 1/6 <(w[k + 2] - 2 w[k + 1] + w[k])^2>`` (NIST SP 1065 eq. 17; DT0064 HVAR). A linear
    drift of the rate drops out as well, so it shows what lies under a warm-up ramp.

    Notes
    -----
    The 1/6 makes it equal AVAR for white FM. DT0064's listing has 1/2: its variances are three
    times, its deviations sqrt(3) times these; ``hadamard_factor="dt0064"`` gives them.

    Examples
    --------
    Rates 1 2 4 3 have the second differences 1 and -3: (1 + 9) / 2 / 6.

    >>> import numpy as np
    >>> variance, terms = Hdev().exact(np.array([0.0, 1, 3, 7, 10]), 1)
    >>> round(variance, 6), terms
    (0.833333, 2)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Hdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, nan, 2.042, 2.042, 1.771]
    """

    name: ClassVar[str] = "hdev"
    variance_name: ClassVar[str] = "HVAR"
    lowest_alpha: ClassVar[int] = -4
    hadamard: ClassVar[bool] = True
    family: ClassVar[Family] = "hvar"
    order: ClassVar[int] = 3
    overlap: ClassVar[bool] = False
