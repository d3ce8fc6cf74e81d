"""Random walk K: rate random walk."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["RandomWalk"]


class RandomWalk(PowerLaw):
    """Sum of white increments K sqrt(t0) w, starting from zero.

    S(f) = (K / 2 pi f)^2 (two-sided);  AVAR(tau) = K^2 tau / 3 (1 + 1 / (2 m^2)), exact.

    Parameters
    ----------
    K : float
        Coefficient, unit/sqrt(s): standard deviation of the change in 1 s.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, K: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-2.0, (K / (2.0 * math.pi)) ** 2, rate_hz, rng)
