"""HTOTDEV: the Hadamard deviation of short windows that are reflected at both ends."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import calibrated_edf, difference_edf
from allanscope.allan.estimators.base import Estimator, mean_square_third, register
from allanscope.allan.estimators.reflected import (
    reflected_edf,
    reflected_expectation,
    reflected_mean_square,
)
from allanscope.allan.noise_type import Family, NoiseTypes

__all__ = ["Htotdev", "htot_variance"]

_CORRECTION = {0: 0.995, -1: 0.851, -2: 0.771, -3: 0.717, -4: 0.679}

_FEW_WINDOWS = 32
"""Windows in the run up to which phase noise has more degrees of freedom than `reflected_edf`."""

_IN_PHASE_NOISE = 0.02
"""Part of the run up to which limits hold in phase noise beside a slower one."""

_PHASE_NOISES, _LITTLE = 2, 0.1
"""White and flicker PM come first among the shares of a variance; a part that does no harm."""


@register
class Htotdev(Estimator):
    """Hadamard total variance HTOT: HVAR within windows of 3m rates, detrended and mirrored.

    NIST SP 1065 eq. 29 (D. Howe and others 2000; DT0064 HTOTVAR). The windows are treated as those
    of `Mtotdev`, with rates for phases and 1/6 for 1/2. At m = 1 it is OHVAR, by convention.

    Notes
    -----
    The raw value is divided by the published 0.995, 0.851, 0.771, 0.717, 0.679 for white FM to
    random run FM, which are exact at large m. For phase noise nothing is
    published and nothing corrected: there it reads high, by 18 % for white PM, and only the
    limits allow for it.

    Examples
    --------
    >>> variance, windows = Htotdev().exact(np.array([0.0, 1, 3, 7, 10, 11, 9]), 2)
    >>> round(variance, 6), windows
    (3.008059, 1)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Htotdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, nan, nan, nan, nan, 1.181, 0.892, 1.226]
    """

    name: ClassVar[str] = "htotdev"
    variance_name: ClassVar[str] = "HTOTVAR"
    trust_fraction: ClassVar[float] = 0.1
    min_terms: ClassVar[int] = 1
    lowest_alpha: ClassVar[int] = -4
    hadamard: ClassVar[bool] = True
    family: ClassVar[Family] = "hvar"

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return raw variance and number of windows."""
        return htot_variance(phase, m)

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom; of few windows in phase noise those of simulation."""
        plain = difference_edf(alpha, m, n, 1, order=3)
        edf = np.where(np.equal(m, 1), plain, reflected_edf(np.asarray(alpha) + 2, m, n))
        few = np.asarray(n) <= _FEW_WINDOWS * np.asarray(m)
        return np.where(few, calibrated_edf(self.name, alpha, m, n, edf), edf)

    def trusts(self, noise: NoiseTypes, tau: ArrayLike, n: int) -> NDArray[np.bool_]:
        """Return whether the limits hold: beyond a fiftieth of the run not with phase noise.

        There a value has hundreds of degrees of freedom, and any slower noise that the record does
        not show yet takes them away: limits then held in 79 to 92 %, and in 90 % where a fifth of
        the variance was white PM. DT0064 trusts it to 30 % of
        the run; beyond 10 % they hold in 89 to 97 % where white FM meets a random walk or steeper.
        """
        times = np.asarray(tau, np.float64)
        phase_noise = noise.shares(self.family, times)[..., :_PHASE_NOISES].sum(axis=-1)
        slow = (noise.alpha <= 0) & (phase_noise <= _LITTLE)
        near = times <= _IN_PHASE_NOISE * n
        return np.asarray(super().trusts(noise, tau, n) & (near | slow))

    def needed(self, m: int) -> int:
        """Return how many rate samples make one window."""
        return 3 * m + self.min_terms - 1

    def correction(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return the published raw HTOT / HVAR; 1 at m = 1 and for phase noise."""
        alpha, m, n = np.broadcast_arrays(alpha, m, n)
        published = np.array([_CORRECTION.get(a, 1.0) for a in alpha.flat]).reshape(alpha.shape)
        return np.where(m == 1, 1.0, published)

    def expectation(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return the exact raw HTOT / HVAR."""
        alpha, m, n = np.broadcast_arrays(alpha, m, n)
        return np.where(m == 1, 1.0, reflected_expectation(alpha + 2, m))


def htot_variance(phase: NDArray[np.float64], m: int, stride: int = 1) -> tuple[float, int]:
    """Return the raw Hadamard total variance, for tau0 = 1, and its number of windows.

    Parameters
    ----------
    phase : ndarray of float64, shape (n + 1,)
        Phase; one picked from a longer record at every s-th sample will do, with the result
        divided by s^2.
    m : int
        Averaging factor.
    stride : int
        Step between windows: 1 for all; m/4 keeps all degrees of freedom for alpha <= 0.
    """
    if m == 1:
        mean, terms = mean_square_third(phase, 1, stride)
    else:
        mean, terms = reflected_mean_square(np.diff(phase), m, stride)
    return mean / 6.0, terms
