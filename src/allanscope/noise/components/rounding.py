"""Rounding of the rate to its least significant bit: a known part, without a free number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.white import White
from allanscope.noise.part import Array, Component

__all__ = ["Rounding"]


@dataclass(frozen=True)
class Rounding(Component):
    """White noise of variance lsb^2 / 12 a sample, after any filter of the sensor.

    True to 0.1 % as long as what is rounded has a standard deviation of at least half an LSB
    (Widrow and Kollar, Quantization Noise, 2008). Below that the error depends on where the mean
    lies between two codes: see `allanscope.noise.quantised`.

    Parameters
    ----------
    lsb : float
        Step of the samples in the unit of the axis.
    """

    lsb: float
    symbol: ClassVar[str] = "rounding"

    def white(self, dt: float) -> White:
        """Return the white noise that it amounts to: N = lsb sqrt(dt / 12)."""
        return White(abs(self.lsb) * float(np.sqrt(dt / 12)))

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return lsb^2 dt / 6 at every frequency."""
        return self.white(dt).density(f, dt)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m)."""
        return self.white(dt).avar(m, dt)

    def mvar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m) (m^2 + 1) / (2 m^2)."""
        return self.white(dt).mvar(m, dt)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return lsb^2 / (12 m)."""
        return self.white(dt).hvar(m, dt)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return lsb^2 / (12 stride)."""
        return self.white(dt).ordinates(k, n, dt, stride)
