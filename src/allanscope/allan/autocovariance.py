"""Generalised autocovariance of power-law noise and of its differences, in closed form.

Power-law phase is not stationary, but a high enough difference of it is, and its covariance is the
same difference of a simple function of the lag alone (C. Greenhall and W. Riley, PTTI 2003,
equations 7 to 9). With the lag ``t`` in units of tau:

    s_w(t) = |t|^(3 - alpha), times log|t| for odd alpha      the noise, integrated
    s_x(t) = F^2 [2 s_w(t) - s_w(t - 1/F) - s_w(t + 1/F)]     the phase, averaged over tau / F
    s_z(t) = central difference of order 2 d of s_x           the term of the variance

F is m for a plain variance (the phase is averaged over one sample) and 1 for a modified one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["difference_autocovariance", "phase_autocovariance"]

Floats = NDArray[np.float64]

_BINOMIAL = {1: (2.0, -1.0), 2: (6.0, -4.0, 1.0), 3: (20.0, -15.0, 6.0, -1.0)}

_FAR = 1000.0
"""Lag in units of tau / F from which on s_x of flicker PM is its limit, to save digits."""


def difference_autocovariance(lag: Floats, width: float, alpha: int, order: int) -> Floats:
    """Return s_z, up to a factor that depends on alpha and tau only.

    Parameters
    ----------
    lag : ndarray
        Lag in units of tau.
    width : float
        F: m for a plain variance, 1 for a modified one, ``inf`` for the limit of large m (then
        ``alpha <= 0``, and the factor is another one).
    alpha : int
        Power law of the rate, 2 (white PM) to -4.
    order : {1, 2, 3}
        Order of the difference.

    Examples
    --------
    Neighbouring Allan terms that share one average of white FM are anticorrelated by one half:

    >>> s = difference_autocovariance(np.array([0.0, 1.0, 2.0]), np.inf, 0, 2)
    >>> (s / s[0]).tolist()
    [1.0, -0.5, 0.0]
    """
    middle, *sides = _BINOMIAL[order]
    total = middle * phase_autocovariance(lag, width, alpha)
    for k, weight in enumerate(sides, start=1):
        total += weight * (
            phase_autocovariance(lag - k, width, alpha)
            + phase_autocovariance(lag + k, width, alpha)
        )
    return total


def phase_autocovariance(lag: Floats, width: float, alpha: int) -> Floats:
    """Return s_x, with arguments as for `difference_autocovariance`."""
    if np.isinf(width):
        if alpha > 0:
            raise ValueError("phase noise needs a bandwidth: give a finite width")
        return _power(lag, alpha + 2)
    step = 1.0 / width
    exact = width**2 * (
        2.0 * _power(lag, alpha) - _power(lag - step, alpha) - _power(lag + step, alpha)
    )
    if alpha != 1 or width < _FAR:
        return exact
    # F^2 times a difference of nearly equal numbers loses every digit for large F: far from the
    # spike at 0 use the second derivative of t^2 log|t| instead.
    far = np.abs(lag) * width > _FAR
    return np.where(far, -(2.0 * np.log(np.where(far, np.abs(lag), 1.0)) + 3.0), exact)


def _power(lag: Floats, alpha: int) -> Floats:
    size = np.abs(lag)
    if alpha % 2 == 0:
        return -size if alpha == 2 else size ** (3 - alpha)
    return size ** (3 - alpha) * np.log(np.where(size > 0, size, 1.0))
