"""Flicker walk F of the rate: the running sum of flicker noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["FlickerWalk"]


@dataclass(frozen=True)
class FlickerWalk(Component):
    """The running sum of flicker noise: flicker walk FM.

    One-sided density F^2 dt^3 / (4 sin^3(pi f dt)), which is 2 F^2 / (2 pi f)^3 at low frequency.
    AVAR and MVAR grow with the record and have no expectation; HVAR follows from the density.

    Parameters
    ----------
    F : float
        In unit/s.
    """

    F: float
    symbol: ClassVar[str] = "F"
    is_filtered: ClassVar[bool] = True
    is_steep: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("F", "{unit}/s"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return F^2 dt^3 / (4 sin^3(pi f dt))."""
        sine = np.sin(np.pi * np.asarray(f, np.float64) * dt)
        return np.asarray(self.F**2 * (dt / sine) ** 3 / 4)
