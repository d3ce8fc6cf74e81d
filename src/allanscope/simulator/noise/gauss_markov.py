"""First-order Gauss-Markov noise: white noise that forgets at one rate."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

__all__ = ["GaussMarkov"]


class GaussMarkov:
    """x_k = phi x_(k-1) + sigma sqrt(1 - phi^2) w_k with phi = exp(-t0 / correlation_time).

    Exact at the samples, and stationary from the first one on. With m = tau / t0

        AVAR = (sigma/m)^2 [m (1+phi)/(1-phi) - phi (3 - 4 phi^m + phi^2m) / (1-phi)^2].

    Parameters
    ----------
    sigma : float
        Stationary standard deviation in the unit of the axis.
    correlation_time : float
        Time in s after which the autocorrelation has fallen to 1/e.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(
        self, sigma: float, correlation_time: float, rate_hz: float, rng: Generator
    ) -> None:
        step = 1.0 / (rate_hz * correlation_time)
        self._phi = math.exp(-step)
        self._drive = sigma * math.sqrt(-math.expm1(-2.0 * step))
        self._rng = rng
        self._carry = np.array([self._phi * sigma * rng.standard_normal()])

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        if n == 0:  # lfilter forgets its state on an empty input
            return np.empty(0)
        white = self._drive * self._rng.standard_normal(n)
        samples, self._carry = lfilter([1.0], [1.0, -self._phi], white, zi=self._carry)
        return np.asarray(samples)
