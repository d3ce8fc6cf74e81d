"""White noise N: angle or velocity random walk."""

from __future__ import annotations

from numpy.random import Generator

from allanscope.simulator.noise.power_law import PowerLaw

__all__ = ["White"]


class White(PowerLaw):
    """Samples that know nothing of one another.

    S(f) = N^2 (two-sided);  AVAR(tau) = N^2 / tau, exact;  standard deviation N / sqrt(t0).

    Parameters
    ----------
    N : float
        Coefficient, unit/sqrt(Hz) two-sided: ADEV at 1 s. A density read from a one-sided spectrum
        or a datasheet is sqrt(2) larger.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.
    """

    def __init__(self, N: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(0.0, N**2, rate_hz, rng)
