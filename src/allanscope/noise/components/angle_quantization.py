"""Quantization Q of the angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["AngleQuantization"]


@dataclass(frozen=True)
class AngleQuantization(Component):
    """The difference of a white angle error, (q_i - q_(i-1)) / dt with standard deviation Q of q.

    One-sided density 8 Q^2 sin^2(pi f dt) / dt, AVAR = 3 Q^2 / tau^2, HVAR = 10/3 Q^2 / tau^2,
    MVAR = 3 Q^2 / (tau^2 m); exact for samples. It belongs to sensors that put out increments of
    angle. Rounding a *rate* to its LSB makes white noise instead (`Rounding`), so a Q found on a
    rate sensor is nearly always vibration, aliasing or a filter.

    Parameters
    ----------
    Q : float
        In unit*s.
    """

    Q: float
    symbol: ClassVar[str] = "Q"
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("Q", "{unit}*s"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 8 Q^2 sin^2(pi f dt) / dt."""
        sine = np.sin(np.pi * np.asarray(f, np.float64) * dt)
        return np.asarray(8 * (self.Q * sine) ** 2 / dt)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return 3 Q^2 / tau^2."""
        return np.asarray(3 * (self.Q / (np.asarray(m, np.float64) * dt)) ** 2)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return 3 Q^2 / (tau^2 m)."""
        return self.avar(m, dt) / np.asarray(m, np.float64)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return 10/3 Q^2 / tau^2."""
        return self.avar(m, dt) * (10 / 9)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return 4 Q^2 / (s dt)^2 (sin^2 x + cos^2 x / n), x = pi k / 2n; exact.

        The mean of s differences is the difference over s. The second term is what the two ends of
        the record leave at the lowest ordinates.
        """
        half = np.pi * np.asarray(k, np.float64) / (2 * n)
        shape = np.sin(half) ** 2 + np.cos(half) ** 2 / n
        return np.asarray(4 * (self.Q / (stride * dt)) ** 2 * shape)
