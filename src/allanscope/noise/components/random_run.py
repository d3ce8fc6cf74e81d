"""Random run D of the rate: the running sum of a random walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["RandomRun"]


@dataclass(frozen=True)
class RandomRun(Component):
    """The running sum of a random walk: random run FM.

    One-sided density D^2 dt^4 / (8 sin^4(pi f dt)), which is 2 D^2 / (2 pi f)^4 at low frequency.
    AVAR and MVAR grow with the record and have no expectation; HVAR tends to 11/120 D^2 tau^3.

    Parameters
    ----------
    D : float
        In unit/s/sqrt(s).
    """

    D: float
    symbol: ClassVar[str] = "D"
    is_filtered: ClassVar[bool] = True
    is_steep: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("D", "{unit}/s/sqrt(s)"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return D^2 dt^4 / (8 sin^4(pi f dt))."""
        sine = np.sin(np.pi * np.asarray(f, np.float64) * dt)
        return np.asarray(self.D**2 * (dt / sine) ** 4 / 8)
