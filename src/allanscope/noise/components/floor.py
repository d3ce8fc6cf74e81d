"""White noise behind a filter: what an amplifier or a converter adds after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from allanscope.noise.components.white import White
from allanscope.noise.part import Array, Component, Quantity

__all__ = ["Floor"]


@dataclass(frozen=True)
class Floor(Component):
    """White noise on which no filter of the sensor acts; in all else that of `White`.

    Parameters
    ----------
    floor : float
        In unit/sqrt(Hz), two-sided as N.
    """

    floor: float
    symbol: ClassVar[str] = "floor"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("floor", "{unit}/sqrt(Hz)"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 2 floor^2 at every frequency."""
        return White(self.floor).density(f, dt)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return floor^2 / tau."""
        return White(self.floor).avar(m, dt)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return floor^2 / tau (m^2 + 1) / (2 m^2)."""
        return White(self.floor).mvar(m, dt)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return floor^2 / tau."""
        return White(self.floor).hvar(m, dt)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the variance of a row, floor^2 / (stride dt)."""
        return White(self.floor).ordinates(k, n, dt, stride)
