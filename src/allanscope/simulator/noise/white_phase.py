"""White phase noise Q: quantisation of the angle."""

from __future__ import annotations

import math

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["WhitePhase"]


class WhitePhase(PowerLaw):
    """The difference of white angle noise: y = (q_k - q_(k-1)) / t0, q of standard deviation Q.

    S(f) = (2 pi f)^2 Q^2 t0 for f << 1/t0 (two-sided);  AVAR(tau) = 3 Q^2 / tau^2, exact.
    This is what a sensor of angle increments has. Rounding of a *rate* output makes white noise.

    Parameters
    ----------
    Q : float
        Coefficient, unit s (deg for a gyro, g s for an accelerometer).
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, Q: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(2.0, (2.0 * math.pi * Q) ** 2 / rate_hz, rate_hz, rng)
