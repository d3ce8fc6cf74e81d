"""Rounding of the rate to its least significant bit: a known part, without a free number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.white import White
from allanscope.noise.part import Array, Component

__all__ = ["Rounding"]

_FINE = 64
"""Frequencies for each correlation that is known, between which the density is interpolated."""


@dataclass(frozen=True)
class Rounding(Component):
    r"""Noise of variance lsb^2 / 12 a sample, after any filter of the sensor.

    True to 0.1 % as long as what is rounded has a standard deviation of at least half an LSB
    (Widrow and Kollar, Quantization Noise, 2008). Below that the error depends on where the mean
    lies between two codes: see `allanscope.noise.quantised`. It is white where the samples change
    by half an LSB from one to the next; of slower noise the errors follow each other, with the
    density

    .. math:: S(f) = \frac{q^2 \Delta t}{6}
              \Big(1 + 2 \sum_{k \ge 1} r_k \cos 2 \pi f k \Delta t\Big)

    Parameters
    ----------
    lsb : float
        Step of the samples in the unit of the axis.
    correlation : tuple of float
        :math:`r_1, r_2, ...`, of errors so many samples apart (`rounding_correlation`); empty where
        they are white.

    Examples
    --------
    >>> Rounding(0.1, (0.5,)).density([0.0, 25.0, 50.0], dt=0.01) / (0.1**2 * 0.01 / 6)
    array([2., 1., 0.])
    """

    lsb: float
    correlation: tuple[float, ...] = ()
    symbol: ClassVar[str] = "rounding"

    def white(self, dt: float) -> White:
        """Return the white noise that it amounts to: N = lsb sqrt(dt / 12)."""
        return White(abs(self.lsb) * float(np.sqrt(dt / 12)))

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return lsb^2 dt / 6 at every frequency, where the errors are white."""
        white = self.white(dt).density(f, dt)
        if not self.correlation:
            return white
        size = _FINE * _power_of_two(len(self.correlation) + 1)
        lags = np.zeros(size)
        lags[0] = 1.0
        lags[1 : len(self.correlation) + 1] = 2 * np.array(self.correlation)
        shape = np.maximum(np.fft.rfft(lags).real, 0.0)
        at = np.arange(len(shape)) / (size * dt)
        return np.asarray(white * np.interp(np.asarray(f, np.float64), at, shape))

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m)."""
        return super().avar(m, dt) if self.correlation else self.white(dt).avar(m, dt)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m) (m^2 + 1) / (2 m^2)."""
        return super().mvar(m, dt) if self.correlation else self.white(dt).mvar(m, dt)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m)."""
        return super().hvar(m, dt) if self.correlation else self.white(dt).hvar(m, dt)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return lsb^2 / (12 stride), where the errors are white."""
        if self.correlation:
            return super().ordinates(k, n, dt, stride)
        return self.white(dt).ordinates(k, n, dt, stride)


def _power_of_two(least: int) -> int:
    """Return the next power of two."""
    return 1 << (least - 1).bit_length()
