"""Random walk K of the rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["RandomWalk"]


@dataclass(frozen=True)
class RandomWalk(Component):
    """The running sum of white noise, one step of standard deviation K sqrt(dt) a sample.

    One-sided density K^2 dt^2 / (2 sin^2(pi f dt)), AVAR = K^2 tau / 3 (1 + 1 / (2 m^2)),
    HVAR = K^2 tau / 6 (1 + 1 / m^2), MVAR = K^2 tau (11/40 + 1/(8 m^2) + 1/(10 m^4)); exact for
    samples. IEEE 952 gives the limits for large m.

    Parameters
    ----------
    K : float
        In unit/sqrt(s).
    """

    K: float
    symbol: ClassVar[str] = "K"
    is_filtered: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("K", "{unit}/sqrt(s)"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return K^2 dt^2 / (2 sin^2(pi f dt))."""
        sine = np.sin(np.pi * np.asarray(f, np.float64) * dt)
        return np.asarray((self.K * dt / sine) ** 2 / 2)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return K^2 tau / 3 (1 + 1 / (2 m^2))."""
        factor = np.asarray(m, np.float64)
        return self.K**2 * factor * dt / 3 * (1 + 0.5 / factor**2)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return K^2 tau (11 / 40 + 1 / (8 m^2) + 1 / (10 m^4))."""
        factor = np.asarray(m, np.float64)
        return self.K**2 * factor * dt * (11 / 40 + factor**-2 / 8 + factor**-4 / 10)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return K^2 tau / 6 (1 + 1 / m^2)."""
        factor = np.asarray(m, np.float64)
        return self.K**2 * factor * dt / 6 * (1 + factor**-2)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return K^2 dt / 4 (s / sin^2 x - 2/3 (s - 1/s)), x = pi k / 2n; exact.

        The cosines of the DCT-II are the eigenvectors of a random walk with an unknown start. The
        mean of s samples of it is a random walk less some white noise, which is the second term.
        """
        sine = np.sin(np.pi * np.asarray(k, np.float64) / (2 * n))
        rest = 2 / 3 * (stride - 1 / stride)
        return np.asarray(self.K**2 * dt / 4 * (stride / sine**2 - rest))
