"""Ramp R: a steady drift of the rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["Ramp"]


@dataclass(frozen=True)
class Ramp(Component):
    """A rate that grows by R a second.

    It is deterministic: AVAR = MVAR = R^2 tau^2 / 2, HVAR = 0, and it has no density. A fit
    estimates it as a regressor on the ordinates themselves (`allanscope.noise.drift`), so in their
    expected squares it counts as removed.

    Parameters
    ----------
    R : float
        Slope without its sign, in unit/s.
    """

    R: float
    symbol: ClassVar[str] = "R"
    is_noise: ClassVar[bool] = False
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("R", "{unit}/s"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return zeros."""
        del dt
        return np.zeros(np.shape(f))

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return R^2 tau^2 / 2."""
        return np.asarray((self.R * np.asarray(m, np.float64) * dt) ** 2 / 2)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return R^2 tau^2 / 2."""
        return self.avar(m, dt)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return zeros: third differences do not see a ramp."""
        del dt
        return np.zeros(np.shape(m))

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return zeros."""
        del n, dt, stride
        return np.zeros(np.shape(k))
