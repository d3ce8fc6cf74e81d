"""Flicker phase noise P: flicker of the angle."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["FlickerPhase"]


class FlickerPhase(PowerLaw):
    """The difference of flicker angle noise.

    S(f) = 2 pi f P^2 for f << 1/t0 (two-sided);
    AVAR(tau) = 2 P^2 / (pi tau^2) (4 h_m - h_2m), h_m = 1 + 1/3 + ... + 1/(2m - 1), exact: as
    tau^-2 but for a logarithm. The modified Allan variance tells it from white phase.

    Parameters
    ----------
    P : float
        Flicker coefficient of the angle, unit s.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, P: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(1.0, 2.0 * math.pi * P**2, rate_hz, rng)
