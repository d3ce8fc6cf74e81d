"""Random telegraph signal: two levels, with hops at random."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from allanscope.noise.components.correlated import Correlated, ExponentialCovariance
from allanscope.noise.part import Quantity

__all__ = ["RandomTelegraph"]


@dataclass(frozen=True)
class RandomTelegraph(Correlated):
    """Hops between two levels: autocovariance A^2 exp(-2 |t| / D), that of a Gauss-Markov process.

    Parameters
    ----------
    amplitude : float
        A: the levels are +A and -A, in the unit of the axis.
    dwell : float
        D, mean time between two hops in s.
    """

    amplitude: float
    dwell: float
    symbol: ClassVar[str] = "random_telegraph"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("amplitude", "{unit}"),
        Quantity("dwell", "s", "shape", 1e-6, 1e9),
    )

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        return ExponentialCovariance((self.amplitude**2,), (2 * dt / self.dwell,))

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return 1 / (pi D)."""
        return tuple(f for f in (1 / (np.pi * self.dwell),) if f < 0.5 / dt)
