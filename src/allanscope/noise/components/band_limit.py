"""White noise behind a low-pass: the filter of the part, or of whatever is in front of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.base import Array, Component, Quantity
from allanscope.noise.exponential import ExponentialCovariance

__all__ = ["BandLimitedWhite"]

_BUTTERWORTH = float(np.sqrt(0.5))


@dataclass(frozen=True)
class BandLimitedWhite(Component):
    """White noise through a Butterworth low-pass of first or second order, then sampled.

    Aliases included, and scaled so that N is what long averages show: AVAR tends to N^2 / tau. The
    first order is also what a digital filter y += (1 - p)(x - y) makes, with
    p = exp(-2 pi fc dt). At short averaging times the curve lies below the white line, as if Q^2
    were negative.

    Parameters
    ----------
    N : float
        In unit/sqrt(Hz), two-sided.
    cutoff : float
        -3 dB frequency in Hz of the analogue low-pass; it may lie above the Nyquist frequency.
    order : {1, 2}
        Of the filter.
    """

    N: float
    cutoff: float
    order: Literal[1, 2] = 1
    symbol: ClassVar[str] = "band_limit"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("N", "{unit}/sqrt(Hz)"),
        Quantity("cutoff", "Hz", "shape", 1e-6, 1e7),
    )

    def __post_init__(self) -> None:
        self._check_positive()

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        corner = 2 * np.pi * self.cutoff * dt
        if self.order == 1:
            unit = ExponentialCovariance((1.0,), (corner,))
        else:
            unit = ExponentialCovariance.second_order(corner, _BUTTERWORTH)
        power = self.N**2 / dt / float(unit.spectrum(np.asarray(0.0)))
        return ExponentialCovariance((unit.amplitudes[0] * power,), unit.rates)

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 2 N^2 at low frequency, less above the cutoff."""
        phase = 2 * np.pi * np.asarray(f, np.float64) * dt
        return 2 * dt * self.covariance(dt).spectrum(phase)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Allan variance, exact for samples."""
        return self.covariance(dt).avar(m)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Hadamard variance, exact for samples."""
        return self.covariance(dt).hvar(m)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the expected ordinates of the rows, exact."""
        return self.covariance(dt).averaged(stride).ordinates(k, n)

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the cutoff."""
        return (self.cutoff,) if self.cutoff < 0.5 / dt else ()
