"""Second-order Gauss-Markov process: noise in a band around a resonance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.base import Array, Quantity
from allanscope.noise.components.correlated import Correlated
from allanscope.noise.exponential import ExponentialCovariance

__all__ = ["Narrowband"]

_WIDEST = 1.98
"""Largest bandwidth in units of the frequency: just below critical damping."""


@dataclass(frozen=True)
class Narrowband(Correlated):
    """Position of a damped oscillator driven by white noise, point-sampled.

    Natural frequency f0, half-power bandwidth b = 2 z f0 with the damping ratio z < 1:
    gamma(t) = sigma^2 exp(-pi b |t|) (cos wd t + (z w0 / wd) sin wd |t|).

    Parameters
    ----------
    sigma : float
        Stationary standard deviation in the unit of the axis.
    frequency : float
        f0 in Hz.
    bandwidth : float
        b in Hz; values beyond 1.98 f0 act as 1.98 f0.
    """

    sigma: float
    frequency: float
    bandwidth: float
    symbol: ClassVar[str] = "narrowband"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("sigma", "{unit}"),
        Quantity("frequency", "Hz", "shape", 1e-9, 1e6),
        Quantity("bandwidth", "Hz", "shape", 1e-9, 1e6),
    )

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        damping = min(self.bandwidth / self.frequency, _WIDEST) / 2
        unit = ExponentialCovariance.second_order(2 * np.pi * self.frequency * dt, damping)
        return ExponentialCovariance((unit.amplitudes[0] * self.sigma**2,), unit.rates)

    def band_density(self, f: ArrayLike, width: ArrayLike, dt: float) -> Array:
        """Return the mean over each band, which may be wider than the resonance."""
        offsets = (np.arange(9) - 4)[:, np.newaxis] / 9
        nodes = np.asarray(f, np.float64) + offsets * np.asarray(width, np.float64)
        return np.asarray(self.density(nodes, dt).mean(axis=0))

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the resonance."""
        return (self.frequency,) if self.frequency < 0.5 / dt else ()
