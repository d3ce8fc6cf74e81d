"""TOTDEV: the Allan deviation of a record that is reflected at both ends."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.edf import calibrated_edf, difference_edf, small_factor_loss
from allanscope.allan.estimators.base import Estimator, mean_square_second, register

__all__ = ["Totdev"]

_EDF = {0: (1.50, 0.0), -1: (1.17, 0.22), -2: (0.93, 0.36)}
_BIAS = {2: -4.0 / 3.0, 1: np.nan, 0: 0.0, -1: 1.0 / (3.0 * np.log(2.0)), -2: 0.75}
_FLICKER_PM = [-0.98, -0.84, -0.812, -0.834, -0.870, -0.909, -0.946, -0.979, -1.008, -1.054, -1.090]
_AT_OCTAVE = [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13]
"""Slope of the bias of flicker PM at m = 2 ... 8192, from the exact covariance of its phase."""


@register
class Totdev(Estimator):
    """Total variance TOTVAR: OAVAR of the record and of its images at both ends.

    ``TOTVAR = 1/(2 m^2 (N - 2)) sum (x[i - m] - 2 x[i] + x[i + m])^2`` over all inner phases i of
    N, the phase being continued by odd reflection about its first and about its last value (NIST
    SP 1065 eq. 25; DT0064 TOTVAR). At half of the run it has 3 degrees of freedom for white FM
    where OAVAR has one. (SP 1065 also lists values of a variant with matched ends.)

    Notes
    -----
    The value is raw, as in all programs (but not between gaps, where each stretch is reflected and
    all are together as wrong as one). Its expectation is ``1 - a tau/T`` of AVAR, with a = 0,
    0.48, 0.75 for white, flicker and random-walk FM; the limits allow for that. Degrees of freedom
    are ``b T/tau - c`` (SP 1065 table 7). Nothing is published for phase noise: for white PM
    a = -4/3, for flicker PM -0.8 to -1.1, growing with m, and the degrees of freedom are those of
    simulation.

    Examples
    --------
    >>> Totdev().exact(np.array([0.0, 1, 3, 7, 10]), 1)
    (1.0, 3)
    >>> variance, terms = Totdev().exact(np.array([0.0, 1, 3, 7, 10]), 3)
    >>> round(variance, 6), terms
    (1.296296, 3)

    The variance at m = 2 after each of the rates 1 2 4 3 3 1 2 5:

    >>> x = np.cumsum([0.0, 1, 2, 4, 3, 3, 1, 2, 5])
    >>> [round(Totdev().exact(x[: n + 1], 2)[0], 3) for n in range(1, 9)]
    [nan, 0.5, 2.562, 1.333, 1.031, 1.425, 1.042, 1.929]
    """

    name: ClassVar[str] = "totdev"
    variance_name: ClassVar[str] = "TOTVAR"
    trust_fraction: ClassVar[float] = 0.5
    reflects: ClassVar[bool] = True

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms."""
        if phase.size < 3 or m >= phase.size:
            return np.nan, 0
        # Every inner phase is the middle of one term, so no image reaches further than m out.
        before = 2.0 * phase[0] - phase[1:m][::-1]
        after = 2.0 * phase[-1] - phase[-m:-1][::-1]
        mean, terms = mean_square_second(np.concatenate([before, phase, after]), m, 1)
        return mean / (2.0 * m**2), terms

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the published degrees of freedom, carried to small m; of every `stride`-th."""
        alpha, m, n = np.broadcast_arrays(alpha, m, n)
        slope, offset = np.moveaxis(np.array([_EDF.get(a, (0.0, 0.0)) for a in alpha.flat]), -1, 0)
        published = slope.reshape(alpha.shape) * n / m - offset.reshape(alpha.shape)
        loss = small_factor_loss(alpha, m, n, order=2)
        phase_noise = difference_edf(alpha, m, n, 1, order=2)
        edf: NDArray[np.float64] = np.where(alpha <= 0, published * loss, phase_noise)
        every = calibrated_edf(self.name, alpha, m, n, edf)
        return np.asarray(1.0 / (1.0 / every + _left_out(alpha, m, n, stride)))

    def needed(self, m: int) -> int:
        """Return how many rate samples give `min_terms` terms."""
        return max(m, self.min_terms + 1)

    def uncorrected_bias(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return the bias of the raw value."""
        return self.expectation(alpha, m, n)

    def expectation(self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike) -> NDArray[np.float64]:
        """Return ``1 - a tau/T``."""
        alpha, m, n = np.broadcast_arrays(alpha, m, n)
        slope = np.array([_BIAS[a] for a in alpha.flat]).reshape(alpha.shape)
        flicker_pm = np.interp(np.log2(np.maximum(m, 1)), _AT_OCTAVE, _FLICKER_PM)
        slope = np.where(alpha == 1, flicker_pm, slope)
        ratio: NDArray[np.float64] = 1.0 - slope * np.minimum(m / n, 1.0)
        return ratio


def _left_out(
    alpha: NDArray[np.int64], m: NDArray[np.int64], n: NDArray[np.int64], stride: ArrayLike
) -> NDArray[np.float64]:
    """Return what the inverse of the degrees of freedom grows by where terms are left out.

    By as much as that of OAVAR with as many terms as the images make: hardly for white FM and
    slower noise, but the terms of phase noise know little of each other.
    """
    whole = n + 2 * m
    some = difference_edf(alpha, m, whole, stride, order=2)
    every = difference_edf(alpha, m, whole, 1, order=2)
    return np.asarray(np.maximum(1.0 / some - 1.0 / every, 0.0))
