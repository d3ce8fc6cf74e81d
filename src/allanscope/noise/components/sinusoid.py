"""A sinusoid: the one component whose density is a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.part import Array, Component, Quantity

__all__ = ["Sinusoid"]


@dataclass(frozen=True)
class Sinusoid(Component):
    """A sinusoid with a random phase.

    AVAR = A^2 sin^4(pi f tau) / (m^2 sin^2(pi f dt)) and so on, exact for samples on average over
    the phase: a first hump of 0.525 A^2 at tau = 0.371 / f and zeros at whole periods. Frequencies
    above Nyquist act through their aliases.

    Parameters
    ----------
    amplitude : float
        A, the peak, in the unit of the axis.
    frequency : float
        In Hz.
    """

    amplitude: float
    frequency: float
    symbol: ClassVar[str] = "sinusoid"
    is_line = True
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("amplitude", "{unit}"),
        Quantity("frequency", "Hz", "shape", 1e-9, 1e6),
    )

    def __post_init__(self) -> None:
        self._check_positive()

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """The frequency with A^2 / 2."""
        return ((self.frequency, self.amplitude**2 / 2),)

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return zeros: the power is in `lines` and in `band_density`."""
        del dt
        return np.zeros(np.shape(f))

    def band_density(self, f: ArrayLike, width: ArrayLike, dt: float) -> Array:
        """Return A^2 / (2 width) in the band that holds the line, zero elsewhere."""
        turn = (self.frequency * dt) % 1.0
        alias = min(turn, 1 - turn) / dt
        inside = np.abs(np.asarray(f, np.float64) - alias) <= 0.5 * np.asarray(width, np.float64)
        return np.where(inside, self.amplitude**2 / 2 / np.asarray(width, np.float64), 0.0)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return A^2 sin^4(pi f tau) / (m^2 sin^2(pi f dt))."""
        return self._passed(m, dt, 4, 1.0)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return A^2 sin^6(pi f tau) / (m^4 sin^4(pi f dt))."""
        factor = np.asarray(m, np.float64)
        x = np.pi * self.frequency * dt
        return np.asarray(self._passed(m, dt, 6, 1.0) / (factor * np.sin(x)) ** 2)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return 4/3 A^2 sin^6(pi f tau) / (m^2 sin^2(pi f dt))."""
        return self._passed(m, dt, 6, 4 / 3)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return A^2 / 2 times the squared projection of the line on every cosine."""
        angle = np.pi * np.asarray(k, np.float64) / n
        turn = 2 * np.pi * self.frequency * dt
        seen = _dirichlet(np.asarray(turn), stride) / stride
        row = turn * stride
        plus = np.exp(0.5j * angle) * _shifted_dirichlet(row + angle, n)
        minus = np.exp(-0.5j * angle) * _shifted_dirichlet(row - angle, n)
        power = np.abs(plus + minus) ** 2 / (2 * n)
        return np.asarray(self.amplitude**2 / 2 * seen**2 * power)

    def _passed(self, m: ArrayLike, dt: float, power: int, scale: float) -> Array:
        factor = np.asarray(m, np.float64)
        x = np.pi * self.frequency * dt
        top = np.sin(factor * x) ** power
        return np.asarray(scale * self.amplitude**2 * top / (factor * np.sin(x)) ** 2)


def _dirichlet(x: Array, n: int) -> Array:
    """sin(n x / 2) / sin(x / 2)."""
    half = np.sin(x / 2)
    return np.where(np.abs(half) < 1e-12, n, np.sin(n * x / 2) / np.where(half == 0, 1, half))


def _shifted_dirichlet(x: Array, n: int) -> NDArray[np.complex128]:
    """Sum over i < n of exp(i x)."""
    wrapped = np.mod(x + np.pi, 2 * np.pi) - np.pi
    return np.asarray(np.exp(0.5j * (n - 1) * wrapped) * _dirichlet(wrapped, n))
