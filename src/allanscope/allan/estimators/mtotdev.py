"""MTOTDEV: the modified Allan deviation of short windows that are reflected at both ends."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import difference_edf
from allanscope.allan.estimators.base import Estimator, register
from allanscope.allan.estimators.reflected import (
    reflected_edf,
    reflected_expectation,
    reflected_mean_square,
)
from allanscope.allan.noise_type import Family

__all__ = ["Mtotdev", "mtot_variance"]

_CORRECTION = {2: 0.94, 1: 0.83, 0: 0.73, -1: 0.70, -2: 0.69}


@register
class Mtotdev(Estimator):
    """Modified total variance MTOT: MVAR within windows of 3m phases, detrended and mirrored.

    NIST SP 1065 eq. 27 (D. Howe and F. Vernotte 1999; DT0064 MTOTVAR). Each window yields 6m second
    differences where MVAR takes one, a fifth to a half more degrees of freedom.

    Notes
    -----
    Detrending takes variance away. The raw value is divided by the published 0.94, 0.83, 0.73,
    0.70, 0.69 for white PM to random walk FM, as Stable32 does when asked to.
    The exact expectation at large m is 0.995, 0.851, 0.771, 0.717, 0.679; the published values are
    kept so that figures agree between programs, which leaves MTOTDEV of white FM 2.7 % high, and
    the limits span both. At m = 1 raw MTOT is one half of AVAR whatever the noise.

    Examples
    --------
    >>> variance, windows = Mtotdev().exact(np.array([0.0, 1, 3, 7, 10, 11, 9]), 2)
    >>> round(variance, 6), windows
    (1.556649, 2)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Mtotdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, 0.557, 0.466, 0.5, 0.546]
    """

    name: ClassVar[str] = "mtotdev"
    variance_name: ClassVar[str] = "MTOTVAR"
    family: ClassVar[Family] = "mvar"
    trust_fraction: ClassVar[float] = 0.3
    min_terms: ClassVar[int] = 1

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return raw variance and number of windows."""
        return mtot_variance(phase, m)

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom; `stride` has no part, up to m/4 it costs next to none."""
        plain = difference_edf(alpha, m, n, 1, order=2)
        return np.where(np.equal(m, 1), plain, reflected_edf(alpha, m, n))

    def needed(self, m: int) -> int:
        """Return how many rate samples make one window."""
        return 3 * m + self.min_terms - 2

    def correction(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return the published raw MTOT / MVAR."""
        alpha = np.broadcast_arrays(alpha, m, n)[0]
        return np.array([_CORRECTION[a] for a in alpha.flat]).reshape(alpha.shape)

    def expectation(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return the exact raw MTOT / MVAR."""
        return reflected_expectation(*np.broadcast_arrays(alpha, m, n)[:2])


def mtot_variance(phase: NDArray[np.float64], m: int, stride: int = 1) -> tuple[float, int]:
    """Return the raw modified total variance, for tau0 = 1, and its number of windows.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
        Phase; block means of a longer record's phase will do, with the result divided by the
        square of the block length (not picked values: MTOT needs the average).
    m : int
        Averaging factor.
    stride : int
        Step between windows: 1 for all; m/4 keeps all degrees of freedom but for white PM.
    """
    mean, windows = reflected_mean_square(phase, m, stride)
    return mean / (2.0 * m**2), windows
