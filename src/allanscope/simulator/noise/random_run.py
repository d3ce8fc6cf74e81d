"""Random run D: the integral of a random walk."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["RandomRun"]


class RandomRun(PowerLaw):
    """The double sum of white noise.

    S(f) = D^2 / (2 pi f)^4 (two-sided). The Allan variance has no limit as the record grows; the
    Hadamard variance rises as tau^3.

    Parameters
    ----------
    D : float
        Random walk coefficient of the rate of change, unit/s^(3/2).
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, D: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-4.0, D**2 / (2.0 * math.pi) ** 4, rate_hz, rng)
