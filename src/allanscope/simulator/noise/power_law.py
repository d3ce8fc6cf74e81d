"""Noise of any power law: white noise, integrated or differenced a fractional number of times."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.simulator.noise.fractional import FractionalIntegral

__all__ = ["PowerLaw"]

LONGEST_S = 1e7
"""Time constant of the slowest pole: four months, so that a day is far from where 1/f ends."""


class PowerLaw:
    """Rate noise with two-sided density ``h |f|^alpha``, exactly that of a power of a difference.

    ``y = sigma (1 - z^-1)^-d w`` with white w of unit variance, d = -alpha / 2, has the density

        S(f) = sigma^2 t0 |2 sin(pi f t0)|^alpha  ->  h |f|^alpha   for f << 1/t0,

    so that sigma^2 = h / ((2 pi)^alpha t0^(1 + alpha)).

    Parameters
    ----------
    alpha : float
        Exponent, from -4 (random run) to 2 (white phase).
    h : float
        Level: density at 1 Hz, unit^2 / Hz, two-sided.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.

    Raises
    ------
    ValueError
        If alpha is out of range or the level negative.

    Examples
    --------
    >>> white = PowerLaw(0.0, h=4.0, rate_hz=100.0, rng=np.random.default_rng(1))
    >>> white.sigma  # sqrt(h * rate)
    20.0
    """

    def __init__(self, alpha: float, h: float, rate_hz: float, rng: Generator) -> None:
        if not -4.0 <= alpha <= 2.0:
            raise ValueError(f"the exponent of a power law is from -4 to 2, got {alpha}")
        if not h >= 0.0:
            raise ValueError(f"the level of a noise is 0 or more, got {h}")
        self.sigma = math.sqrt(h * rate_hz) * (rate_hz / (2.0 * math.pi)) ** (alpha / 2.0)
        self._rng = rng
        whole = math.floor(-alpha / 2.0)
        fraction = -alpha / 2.0 - whole
        self._fractional = (
            FractionalIntegral(fraction, LONGEST_S * rate_hz, rng) if fraction else None
        )
        self._sums = [0.0] * max(whole, 0)
        self._last = self._next(1) if whole == -1 else None

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        samples = self._next(n)
        if self._last is not None:
            longer = np.concatenate((self._last, samples))
            self._last = longer[-1:]
            samples = np.diff(longer)
        if n:
            for order, total in enumerate(self._sums):
                samples[0] += total
                np.cumsum(samples, out=samples)
                self._sums[order] = float(samples[-1])
        return samples

    def _next(self, n: int) -> NDArray[np.float64]:
        """Return the next samples before they are summed or differenced."""
        samples = self._rng.standard_normal(n)
        if self._fractional is not None:
            self._fractional.apply(samples)
        samples *= self.sigma
        return samples
