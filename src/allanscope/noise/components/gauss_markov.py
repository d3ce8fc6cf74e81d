"""First-order Gauss-Markov process: noise that forgets exponentially."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from allanscope.noise.components.correlated import Correlated, ExponentialCovariance
from allanscope.noise.part import Quantity

__all__ = ["GaussMarkov"]


@dataclass(frozen=True)
class GaussMarkov(Correlated):
    """First-order Gauss-Markov process with autocovariance sigma^2 exp(-|t| / Tc), point-sampled.

    One-sided density 4 sigma^2 Tc / (1 + (2 pi f Tc)^2), folded at the Nyquist frequency. ADEV has
    a hump of 0.617 sigma at tau = 1.89 Tc. The form in IEEE 952 is that of an integrating sensor
    and differs by a factor 1.5 at m = 1, not at all for m > 10 and dt << Tc. A random telegraph
    signal has the same second moments.

    Parameters
    ----------
    sigma : float
        Stationary standard deviation in the unit of the axis.
    correlation_time : float
        Tc in s.
    """

    sigma: float
    correlation_time: float
    symbol: ClassVar[str] = "gauss_markov"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("sigma", "{unit}"),
        Quantity("correlation_time", "s", "shape", 1e-6, 1e9),
    )

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        return ExponentialCovariance((self.sigma**2,), (dt / self.correlation_time,))

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return 1 / (2 pi Tc)."""
        return tuple(f for f in (1 / (2 * np.pi * self.correlation_time),) if f < 0.5 / dt)
