"""Gauss-Markov noise: what a system of first or second order makes of white noise, exactly.

First order forgets at one rate; second order is a resonance that white noise keeps shaking. Both
are exact at the samples for any rate, and stationary from the first one on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.linalg import expm

from allanscope.simulator.noise.power_law import filter_bank

__all__ = ["GaussMarkov", "Narrowband"]

_WHOLE = np.ones(1)
"""Weight of the only pole."""


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
        self._pole = np.array([math.exp(-step)])
        self._drive = sigma * math.sqrt(-math.expm1(-2.0 * step))
        self._rng = rng
        self._before = self._pole[0] * sigma * rng.standard_normal()
        self._state = np.zeros(1)

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        if n == 0:
            return np.empty(0)
        samples = self._drive * self._rng.standard_normal(n)
        samples[0] += self._before
        self._before = 0.0
        filter_bank(self._pole, _WHOLE, 1, 0.0, self._state, samples, n)
        return samples


class Narrowband:
    """x'' + 2 zeta w0 x' + w0^2 x = white noise, sampled exactly.

    With w0 = 2 pi frequency and 2 zeta w0 = 2 pi bandwidth; for a small bandwidth that is the full
    width of the line at half its height. The autocovariance is, below critical damping,

        sigma^2 exp(-zeta w0 t) [cos(wd t) + zeta w0 / wd sin(wd t)],  wd = w0 sqrt(1 - zeta^2).

    The state (x, x'/w0) has the stationary covariance sigma^2 I, so with the transition
    Phi = exp(A t0) the noise of each step has covariance sigma^2 (I - Phi Phi^T).

    Parameters
    ----------
    frequency : float
        Undamped natural frequency in Hz.
    bandwidth : float
        Hz.
    sigma : float
        Stationary standard deviation in the unit of the axis.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(
        self, frequency: float, bandwidth: float, sigma: float, rate_hz: float, rng: Generator
    ) -> None:
        w0 = 2.0 * math.pi * frequency
        rate_matrix = np.array([[0.0, w0], [-w0, -2.0 * math.pi * bandwidth]])
        phi = expm(rate_matrix / rate_hz)
        self._numerators = [1.0, -phi[1, 1]], [0.0, phi[0, 1]]
        self._denominator = [1.0, -np.trace(phi), np.linalg.det(phi)]
        values, vectors = np.linalg.eigh(np.eye(2) - phi @ phi.T)
        self._step = sigma * (vectors * np.sqrt(np.clip(values, 0.0, None)))
        self._sigma = sigma
        self._rng = rng
        self._carry = [np.zeros(2), np.zeros(2)]
        self._started = False

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        if n == 0:  # lfilter forgets its state on an empty input
            return np.empty(0)
        from scipy.signal import lfilter  # half a second to load

        white = self._rng.standard_normal((n, 2))
        driven = white @ self._step.T
        if not self._started:  # a first step out of nothing is the stationary state itself
            driven[0] = self._sigma * white[0]
            self._started = True
        samples = np.zeros(n)
        for column, numerator in enumerate(self._numerators):
            part, self._carry[column] = lfilter(
                numerator, self._denominator, driven[:, column], zi=self._carry[column]
            )
            samples += part
        return samples
