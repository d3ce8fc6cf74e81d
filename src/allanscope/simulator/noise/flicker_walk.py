"""Flicker walk F: the integral of flicker noise."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["FlickerWalk"]


class FlickerWalk(PowerLaw):
    """The sum of a flicker rate of change.

    S(f) = F^2 / (2 pi f)^3 (two-sided). The Allan variance has no limit as the record grows; the
    Hadamard variance rises as tau^2.

    Parameters
    ----------
    F : float
        Flicker coefficient of the rate of change, unit/s.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, F: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-3.0, F**2 / (2.0 * math.pi) ** 3, rate_hz, rng)
