"""Flicker noise B: bias instability, accurate to its closed form."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["Flicker"]


class Flicker(PowerLaw):
    """1/f noise: ARFIMA(0, 1/2, 0).

    S(f) = B^2 / (2 pi f) for f << 1/t0 (two-sided), in discrete time B^2 t0 / (2 sin(pi f t0));
    AVAR(tau) = (2 ln 2 / pi) B^2 for tau >> t0. At m = tau / t0 = 1, 2, 4, 8 the discrete process
    has 1.443, 1.154, 1.050, 1.015 times that. The innovation has standard deviation B.

    Parameters
    ----------
    B : float
        Coefficient in the unit of the axis; the floor of ADEV is 0.664 B.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, B: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-1.0, B**2 / (2.0 * math.pi), rate_hz, rng)
