"""White noise N: angle random walk of a gyro, velocity random walk of an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["White"]


@dataclass(frozen=True)
class White(Component):
    """White noise of the rate.

    One-sided density 2 N^2, AVAR = N^2 / tau, MVAR = N^2 / tau (m^2 + 1) / (2 m^2),
    HVAR = N^2 / tau, all exact for samples. N is two-sided (IEEE 952); a datasheet's density is
    one-sided and equals sqrt(2) N.

    Parameters
    ----------
    N : float
        In unit/sqrt(Hz); samples have standard deviation N / sqrt(dt).

    Examples
    --------
    >>> White(4e-3).avar(104, 1 / 104) ** 0.5
    np.float64(0.004)
    """

    N: float
    symbol: ClassVar[str] = "N"
    is_filtered: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("N", "{unit}/sqrt(Hz)"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 2 N^2 at every frequency."""
        del dt
        return np.full(np.shape(f), 2 * self.N**2)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return N^2 / tau."""
        return self.N**2 / (np.asarray(m, np.float64) * dt)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return N^2 / tau (m^2 + 1) / (2 m^2)."""
        factor = np.asarray(m, np.float64)
        return self.N**2 / (factor * dt) * (1 + factor**-2) / 2

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return N^2 / tau."""
        return self.avar(m, dt)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the variance of a row, N^2 / (stride dt); exact."""
        del n
        return np.full(np.shape(k), self.N**2 / (stride * dt))
