"""What all stationary components have in common whose autocovariance is a sum of exponentials."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.base import Array, Component
from allanscope.noise.exponential import ExponentialCovariance

__all__ = ["Correlated"]


@dataclass(frozen=True)
class Correlated(Component):
    """A component that says its autocovariance; all else is exact and in closed form."""

    def __post_init__(self) -> None:
        self._check_positive()

    @abstractmethod
    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density of the samples, aliases included."""
        phase = 2 * np.pi * np.asarray(f, np.float64) * dt
        return 2 * dt * self.covariance(dt).spectrum(phase)

    def spectrum(self, f: ArrayLike, dt: float, stride: int = 1) -> Array:
        """Return the spectrum of the rows, in closed form."""
        phase = 2 * np.pi * np.asarray(f, np.float64) * stride * dt
        return self.covariance(dt).averaged(stride).spectrum(phase)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Allan variance, exact for samples."""
        return self.covariance(dt).avar(m)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Hadamard variance, exact for samples."""
        return self.covariance(dt).hvar(m)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the expected ordinates of the rows, exact."""
        return self.covariance(dt).averaged(stride).ordinates(k, n)
