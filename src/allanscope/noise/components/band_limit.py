"""White noise behind a low-pass: the filter of the part, or of whatever is in front of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from allanscope.noise.components.base import Quantity
from allanscope.noise.components.correlated import Correlated
from allanscope.noise.exponential import ExponentialCovariance

__all__ = ["BandLimitedWhite", "Filter"]

Filter = Literal["pole", "butterworth", "digital"]

_DAMPING = float(np.sqrt(0.5))
"""Damping ratio of a Butterworth filter of second order."""


@dataclass(frozen=True)
class BandLimitedWhite(Correlated):
    """White noise through a low-pass, as it is in the samples.

    Scaled so that N is what long averages show: AVAR tends to N^2 / tau. At short averaging times
    the curve lies below the white line, as if Q^2 were negative.

    Parameters
    ----------
    N : float
        In unit/sqrt(Hz), two-sided.
    cutoff : float
        -3 dB frequency in Hz. That of an analogue filter may lie above the Nyquist frequency; that
        of a digital one acts as 0.998 of it there.
    filter : {'pole', 'butterworth', 'digital'}
        One pole, y += (1 - p) (x - y) with p = exp(-2 pi fc dt), analogue or digital; an analogue
        Butterworth filter of second order with its aliases; or a digital one by the bilinear
        transform, |H|^2 = 1 / (1 + (tan(pi f dt) / tan(pi fc dt))^4).
    """

    N: float
    cutoff: float
    filter: Filter = "pole"
    symbol: ClassVar[str] = "band_limit"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("N", "{unit}/sqrt(Hz)"),
        Quantity("cutoff", "Hz", "shape", 1e-6, 1e7),
    )

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        corner = 2 * np.pi * self.cutoff * dt
        if self.filter == "digital":
            unit = _bilinear(min(corner, 0.998 * np.pi))
        elif self.filter == "butterworth":
            unit = ExponentialCovariance.second_order(corner, _DAMPING)
        else:
            unit = ExponentialCovariance((1.0,), (corner,))
        power = self.N**2 / dt / float(unit.spectrum(np.asarray(0.0)))
        return ExponentialCovariance(
            (unit.amplitudes[0] * power,), unit.rates, delta=unit.delta * power
        )

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the cutoff."""
        return (self.cutoff,) if self.cutoff < 0.5 / dt else ()


def _bilinear(corner: float) -> ExponentialCovariance:
    """Return the covariance for the spectrum 1 / (1 + (tan(w/2) / T)^4), T = tan(corner / 2).

    In c = cos w this is a rational function with two conjugate poles, and each pole c0 = cosh e is
    an exponential of rate e.
    """
    square = np.tan(corner / 2) ** 2
    pole = (1j - square) / (1j + square)
    rate = np.arccosh(pole)
    rate = rate if rate.real > 0 else -rate
    fourth = square**2
    residue = (1 + pole) ** 2 * fourth / ((fourth + 1) * (pole - np.conj(pole)))
    amplitude = complex(-2 * residue / np.sinh(rate))
    return ExponentialCovariance((amplitude,), (complex(rate),), delta=fourth / (fourth + 1))
