"""Noise in a band: a resonance, a line that wanders, white noise behind a band-pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.components.correlated import Correlated, ExponentialCovariance
from allanscope.noise.part import Array, Component, Quantity

__all__ = [
    "FORMS",
    "BandPassed",
    "IrregularCycles",
    "MovingLine",
    "Narrowband",
    "PeakFiltered",
    "WanderingLine",
]

_WIDEST = 1.98
"""Largest bandwidth in units of the frequency: just below critical damping."""


@dataclass(frozen=True)
class _InBand(Component):
    """Noise that has a size, a frequency and a bandwidth, and passes the filters of the sensor.

    Parameters
    ----------
    sigma : float
        Standard deviation before them, in the unit of the axis.
    frequency, bandwidth : float
        Centre and half-power bandwidth in Hz.
    """

    sigma: float
    frequency: float
    bandwidth: float
    is_filtered: ClassVar[bool] = True
    symbol: ClassVar[str] = "narrowband"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("sigma", "{unit}"),
        Quantity("frequency", "Hz", "shape", 1e-9, 1e6),
        Quantity("bandwidth", "Hz", "shape", 1e-9, 1e6),
    )

    def __post_init__(self) -> None:
        self._check_positive()

    @property
    def band(self) -> tuple[float, float]:
        """Frequency and bandwidth."""
        return self.frequency, self.bandwidth

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the centre of the band."""
        return (self.frequency,) if self.frequency < 0.5 / dt else ()


@dataclass(frozen=True)
class Narrowband(Correlated, _InBand):
    """Position of a damped oscillator driven by white noise, point-sampled.

    Natural frequency f0, half-power bandwidth b = 2 z f0 with the damping ratio z < 1:
    gamma(t) = sigma^2 exp(-pi b |t|) (cos wd t + (z w0 / wd) sin wd |t|).

    Values of b beyond 1.98 f0 act as 1.98 f0.
    """

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        damping = min(self.bandwidth / self.frequency, _WIDEST) / 2
        natural = 2 * np.pi * self.frequency * dt
        return ExponentialCovariance.second_order(natural, damping, self.sigma**2)

    def band_density(self, f: ArrayLike, width: ArrayLike, dt: float) -> Array:
        """Return the mean over each band, which may be wider than the resonance."""
        offsets = (np.arange(9) - 4)[:, np.newaxis] / 9
        nodes = np.asarray(f, np.float64) + offsets * np.asarray(width, np.float64)
        return np.asarray(self.density(nodes, dt).mean(axis=0))


@dataclass(frozen=True)
class IrregularCycles(Narrowband):
    """What cycles of the level leave of which each differs a little from the others."""

    symbol: ClassVar[str] = "cycle"


@dataclass(frozen=True)
class WanderingLine(Narrowband):
    """A line whose amplitude and phase wander: gamma(t) = sigma^2 exp(-pi b |t|) cos(2 pi f0 t)."""

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        rate = complex(np.pi * self.bandwidth * dt, -2 * np.pi * self.frequency * dt)
        return ExponentialCovariance((complex(self.sigma**2),), (rate,))


@dataclass(frozen=True)
class MovingLine(WanderingLine):
    """A line that wanders around a centre which moves: a mixture of such lines, alike but for it.

    Parameters
    ----------
    offsets : tuple of float
        Of the centres from `frequency` in Hz, equally long each.
    """

    offsets: tuple[float, ...] = (0.0,)

    @property
    def band(self) -> tuple[float, float]:
        """Mean centre, and the range that all bandwidths cover."""
        return self.frequency, self.bandwidth + max(self.offsets) - min(self.offsets)

    @property
    def peaks(self) -> tuple[tuple[float, float], ...]:
        """Each centre, with the bandwidth."""
        return tuple((self.frequency + offset, self.bandwidth) for offset in self.offsets)

    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""
        centres = 2 * np.pi * dt * (self.frequency + np.array(self.offsets))
        rates = tuple(complex(np.pi * self.bandwidth * dt, -w) for w in centres)
        return ExponentialCovariance((complex(self.sigma**2 / len(rates)),) * len(rates), rates)


@dataclass(frozen=True)
class BandPassed(_InBand):
    """White noise behind a Butterworth band-pass: density 1 / (1 + x^2p), x = 2 (f - f0) / b.

    Parameters
    ----------
    order : int
        p, the poles of each side.
    """

    order: int = 2

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density, aliases left out."""
        del dt
        steepness = 2 * self.order
        x = 2 * (np.asarray(f, np.float64) - self.frequency) / self.bandwidth
        area = np.pi / steepness / np.sin(np.pi / steepness) * self.bandwidth
        square = steep = x * x
        for _ in range(self.order - 1):  # `**` takes ten times as long
            steep = steep * square
        return np.asarray(self.sigma**2 / area / (1 + steep))


@dataclass(frozen=True)
class PeakFiltered(_InBand):
    """White noise behind a digital peak filter: one pole a side, nothing at the ends of the band.

    Power response 1 / (1 + x^2), x = (g / g0 - g0 / g) g0 / w, g = tan(pi f dt), of which the mean
    over the band is w / (1 + w): w = tan(pi b dt).
    """

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density of the samples."""
        g = np.tan(np.pi * np.clip(np.asarray(f, np.float64) * dt, 1e-9, 0.499999))
        w = np.tan(np.pi * min(self.bandwidth * dt, 0.49))
        g0 = np.tan(np.pi * min(self.frequency * dt, 0.499999))
        x = (g * g - g0 * g0) / (w * (1 + g0 * g0) * g)
        return np.asarray(2 * dt * self.sigma**2 * (1 + w) / w / (1 + x * x))


FORMS: tuple[Callable[[float, float], Component], ...] = (
    partial(Narrowband, 1.0),
    partial(WanderingLine, 1.0),
    partial(PeakFiltered, 1.0),
    partial(BandPassed, 1.0, order=2),
    partial(BandPassed, 1.0, order=4),
)
"""What noise in a band may be, by its centre and width: they differ in what lies far from it."""
