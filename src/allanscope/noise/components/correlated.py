"""Noise whose autocovariance is a sum of exponentials: everything about it in closed form.

    gamma(h) = delta [h = 0] + neighbour [|h| = 1] + Re sum_i a_i p_i^|h|        |p_i| < 1

covers the first-order (one real pole) and the second-order (a pair of complex poles) Gauss-Markov
process, low-passed white noise, and samples held over. The class is closed under averaging in
blocks: the means of s samples have the poles p^s.

A `Correlated` component says such an autocovariance, and has nothing else to say.
"""

from __future__ import annotations

import cmath
import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.compiled import Pointer, kernel
from allanscope.noise.part import Array, Component

__all__ = ["Correlated", "ExponentialCovariance"]

Complex = NDArray[np.complexfloating[Any, Any]]

_AT_ONCE = 50.0
"""exp(-this) is nothing in double precision."""
_FORGOTTEN = 15.0
"""exp(-this) is a correlation that a mean over so many samples may forget beyond its neighbour."""


@dataclass(frozen=True)
class ExponentialCovariance:
    """Autocovariance of a sampled stationary process.

    Attributes
    ----------
    amplitudes : tuple of complex
        a; a pair of conjugate poles is given once with twice its amplitude.
    rates : tuple of complex
        -ln p per sample, so that poles close to 1 keep their precision.
    delta : float
        White part.
    neighbour : float
        Covariance of direct neighbours that no exponential describes.
    """

    amplitudes: tuple[complex, ...]
    rates: tuple[complex, ...]
    delta: float = 0.0
    neighbour: float = 0.0

    def __post_init__(self) -> None:
        # What is forgotten within one sample is white, however soon; its sinh would overflow.
        rates = tuple(complex(min(rate.real, _AT_ONCE), rate.imag) for rate in self.rates)
        object.__setattr__(self, "rates", rates)

    @classmethod
    def second_order(
        cls, natural: float, damping: float, variance: float = 1.0
    ) -> ExponentialCovariance:
        """Return the second-order process of a variance sampled at unit intervals.

        gamma(t) = exp(-z w0 t) (cos wd t + (z w0 / wd) sin wd t), wd = w0 sqrt(1 - z^2): position
        of a damped oscillator that white force drives.

        Parameters
        ----------
        natural : float
            w0 in rad per sample.
        damping : float
            z, between 0 and 1, excluded.
        """
        damped = natural * math.sqrt(1 - damping**2)
        amplitude = (1 - 1j * damping * natural / damped) * variance
        return cls((amplitude,), (complex(damping * natural, -damped),))

    def autocovariance(self, h: ArrayLike) -> Array:
        """Return gamma at lags in samples."""
        lag = np.abs(np.asarray(h, np.float64))
        total = np.select([lag == 0, lag == 1], [self.delta, self.neighbour], 0.0)
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            total = total + (a * np.exp(-e * lag)).real
        return total

    def spectrum(self, w: Array) -> Array:
        """Return the two-sided spectrum per sample at phases in rad per sample."""
        square = np.ravel(2 * np.sin(w / 2) ** 2)
        total = np.full(len(square), self.delta)
        if self.neighbour:
            total += 2 * self.neighbour * (1 - square)
        for pole in self._poles():
            _add_spectrum(square, len(square), *pole, total)
        return total.reshape(np.shape(w))

    def _poles(self) -> list[tuple[float, float, float, float]]:
        """Re(a sinh e / (cosh e - cos w)) with the difference written without cancellation."""
        poles = []
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            half = cmath.sinh(e / 2)  # of one number, in a fraction of the time of numpy's
            above, gap = a * cmath.sinh(e), 2 * half * half
            poles.append((above.real, above.imag, gap.real, gap.imag))
        return poles

    def misfit(self, variance: float, square: Array, power: Array, beside: Array) -> float:
        r"""Return what Whittle's likelihood of such noise beside other is, times -2 a bin.

        Parameters
        ----------
        variance : float
            What this covariance is multiplied by.
        square : ndarray, shape (b,)
            2 sin^2 of half the phases.
        power, beside : ndarray, shape (b,)
            Powers measured, and expected of the other noise.

        Returns
        -------
        float
            :math:`\sum_b \ln \lambda_b + p_b / \lambda_b`.
        """
        poles = np.array([number for pole in self._poles() for number in (variance, *pole)])
        white, tilt = variance * self.delta, 2 * variance * self.neighbour
        count = len(self.rates)
        return float(_misfit(square, power, beside, len(square), white, tilt, poles, count))

    def averaged(self, stride: int) -> ExponentialCovariance:
        """Return the covariance of means over `stride` samples."""
        if stride == 1:
            return self
        if self.neighbour:
            raise ValueError("average the samples themselves, not their means")
        amplitudes, rates = [], []
        delta, neighbour = self.delta / stride, 0.0
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            block = e * stride
            variance = a * _block_variance(e, stride) / stride**2
            first = a * np.expm1(-block) ** 2 / (4 * np.sinh(e / 2) ** 2) / stride**2
            if block.real > _FORGOTTEN:
                delta += variance.real
                neighbour += first.real
                continue
            amplitude = first * np.exp(block)
            delta += (variance - amplitude).real
            amplitudes.append(complex(amplitude))
            rates.append(complex(block))
        return ExponentialCovariance(tuple(amplitudes), tuple(rates), delta, neighbour)

    def ordinates(self, k: ArrayLike, n: int) -> Array:
        r"""Return E[d_k^2] of the orthonormal DCT-II of n samples, exact.

        The covariance of cosine k with itself at lag h is
        ((n - h) cos(t h) - sin(t h) / sin t) / n with t = pi k / n, so the expectation is a sum of
        geometric series: with u = cosh e - cos t and the pole exp(-e)

        .. math:: \frac{1}{u} \left(\sinh e - \frac{(1 - (-1)^k e^{-e n})
                  (\cosh e - 1)(1 + \cos t)}{n u}\right)

        The first term is the spectrum. What the ends of the record take from it is largest for a
        correlation time of 1 / t, the share 1 / (pi k) then.
        """
        number = np.ravel(np.asarray(k, np.float64))
        angle = np.pi * number / n
        sign = 1 - 2 * (np.rint(number) % 2)
        square = 2 * np.sin(angle / 2) ** 2
        total = np.full(len(number), self.delta)
        if self.neighbour:
            total += 2 * self.neighbour * (((n - 1) * np.cos(angle) - 1) / n)
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            numbers = (a, np.sinh(e), 2 * np.sinh(e / 2) ** 2, np.exp(-e * n))
            parts = [part for z in map(complex, numbers) for part in (z.real, z.imag)]
            _add_ordinates(square, sign, len(number), n, *parts, total)
        return total.reshape(np.shape(k))

    def avar(self, m: ArrayLike) -> Array:
        """Return the Allan variance at averaging factors `m`, exact."""
        factor = np.asarray(m, np.float64)
        total = self.delta / factor
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            top = _allan_rest(factor * e) / 2 + factor * _sinh_rest(e)
            total = total + (a * top / np.sinh(e / 2) ** 2).real / (2 * factor**2)
        return total

    def hvar(self, m: ArrayLike) -> Array:
        """Return the Hadamard variance at averaging factors `m`, exact."""
        factor = np.asarray(m, np.float64)
        total = self.delta / factor
        for a, e in zip(self.amplitudes, self.rates, strict=True):
            top = _hadamard_rest(factor * e) / 2 + 3 * factor * _sinh_rest(e)
            total = total + (a * top / np.sinh(e / 2) ** 2).real / (6 * factor**2)
        return total


_add_spectrum = kernel(
    "pole_spectrum",
    Pointer(np.float64, 1),
    int,
    *(float,) * 4,
    Pointer(np.float64, 1, written=True),
)
_misfit = kernel(
    "pole_misfit", *(Pointer(np.float64, 1),) * 3, int, float, float, Pointer(np.float64, 1), int,
    returns=float,
)  # fmt: skip
_add_ordinates = kernel(
    "pole_ordinates",
    *(Pointer(np.float64, 1), Pointer(np.float64, 1), int, *(float,) * 9),
    Pointer(np.float64, 1, written=True),
)


def _block_variance(e: complex, m: int) -> complex:
    """Variance of the sum of m samples for gamma = exp(-e h)."""
    return complex(m / np.tanh(e / 2) + np.expm1(-m * e) / (2 * np.sinh(e / 2) ** 2))


def _sinh_rest(e: complex) -> complex:
    """sinh(e) - e."""
    if abs(e) < 0.1:
        square = e * e
        return complex(e * square / 6 * (1 + square / 20 * (1 + square / 42)))
    return complex(np.sinh(e) - e)


def _allan_rest(x: Complex) -> Complex:
    """2x - (3 - 4 exp(-x) + exp(-2x)) = 2 x^3 / 3 - x^4 / 2 + ..."""
    series = x**3 * (2 / 3 + x * (-1 / 2 + x * (7 / 30 + x * (-1 / 12 + x * 31 / 1260))))
    return np.where(np.abs(x) < 0.03, series, 2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))


def _hadamard_rest(x: Complex) -> Complex:
    """6x - (10 - 15 exp(-x) + 6 exp(-2x) - exp(-3x)) = x^3 - 3 x^5 / 4 + ..."""
    series = x**3 * (1 + x * (0.0 + x * (-11 / 20 + x * (1 / 2 + x * (-239 / 840)))))
    exact = 6 * x - 10 + 15 * np.exp(-x) - 6 * np.exp(-2 * x) + np.exp(-3 * x)
    return np.asarray(np.where(np.abs(x) < 0.03, series, exact))


@dataclass(frozen=True)
class Correlated(Component):
    """A component that says its autocovariance; all else is exact and in closed form."""

    def __post_init__(self) -> None:
        self._check_positive()

    @abstractmethod
    def covariance(self, dt: float) -> ExponentialCovariance:
        """Return the autocovariance of the samples."""

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return the one-sided density of the samples, aliases included."""
        phase = 2 * np.pi * np.asarray(f, np.float64) * dt
        return 2 * dt * self.covariance(dt).spectrum(phase)

    def spectrum(self, f: ArrayLike, dt: float, stride: int = 1) -> Array:
        """Return the spectrum of the rows, in closed form."""
        phase = 2 * np.pi * np.asarray(f, np.float64) * stride * dt
        return self.covariance(dt).averaged(stride).spectrum(phase)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Allan variance, exact for samples."""
        return self.covariance(dt).avar(m)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return the Hadamard variance, exact for samples."""
        return self.covariance(dt).hvar(m)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the expected ordinates of the rows, exact."""
        return self.covariance(dt).averaged(stride).ordinates(k, n)
