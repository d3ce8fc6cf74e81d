"""Flicker phase noise P: flicker of the angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import digamma

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["FlickerPhase"]


@dataclass(frozen=True)
class FlickerPhase(Component):
    """The difference of a flicker angle: what an amplifier or an interpolator adds to an angle.

    One-sided density 4 P^2 sin(pi f dt) / dt, which is 4 pi P^2 f at low frequency;
    AVAR = 2 P^2 / (pi tau^2) (4 h_m - h_2m) with h_m = 1 + 1/3 + ... + 1/(2m - 1), and
    HVAR = 2 P^2 / (3 pi tau^2) (15 h_m - 6 h_2m + h_3m); exact for samples.

    Parameters
    ----------
    P : float
        In unit*s.

    Examples
    --------
    >>> FlickerPhase(1.0).avar([1], dt=1.0).round(6)  # 2 / pi (4 - 4/3)
    array([1.697653])
    """

    P: float
    symbol: ClassVar[str] = "P"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("P", "{unit}*s"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 4 P^2 sin(pi f dt) / dt."""
        return np.asarray(4 * self.P**2 * np.sin(np.pi * np.asarray(f, np.float64) * dt) / dt)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return 2 P^2 / (pi tau^2) (4 h_m - h_2m)."""
        factor = np.asarray(m, np.float64)
        sums = 4 * _odd(factor) - _odd(2 * factor)
        return np.asarray(2 * self.P**2 / np.pi * sums / (factor * dt) ** 2)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return 2 P^2 / (3 pi tau^2) (15 h_m - 6 h_2m + h_3m)."""
        factor = np.asarray(m, np.float64)
        sums = 15 * _odd(factor) - 6 * _odd(2 * factor) + _odd(3 * factor)
        return np.asarray(2 * self.P**2 / (3 * np.pi) * sums / (factor * dt) ** 2)


def _odd(m: Array) -> Array:
    """1 + 1/3 + ... + 1/(2m - 1)."""
    return np.asarray(0.5 * (digamma(m + 0.5) - digamma(0.5)))
