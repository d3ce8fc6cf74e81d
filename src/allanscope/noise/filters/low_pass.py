r"""A low-pass: the sensor's own filter, or one behind it.

:math:`|H|^2 = 1 / (1 + (g(f) / g(f_c))^{2p})` with g = sin (one pole in the sampled data, or an
analogue one aliased), tan (Butterworth by the bilinear transform) and f itself; or that of an
average over a time T, repeated p times, :math:`|\sin(\pi f T) / (\pi f T)|^{2p}` with its aliases:
the sinc or CIC filter of a converter, the boxcar or Bartlett window of a part. The mean of the last
k rows, which firmware sends with every row, is :math:`|\sin(\pi k f/f_s) / k\sin(\pi f/f_s)|^2`,
with zeros at every multiple of fs / k. All are 1 at zero frequency, so that N stays what long
averages show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.part import Filter, Quantity
from allanscope.optimise import root_between

__all__ = ["AnalogueLowPass", "Averaging", "Butterworth", "LowPass", "MovingAverage", "OnePole"]

Array = NDArray[np.float64]

_CUTOFF = Quantity("cutoff", "Hz", "shape", 1e-6, 1e7)
_ORDER = Quantity("order", "", "shape", 0.1, 20.0)
"""Ranges of cutoff and order: those of any sensor."""
_ALIASES = np.arange(-8, 9)
"""Multiples of the rate from which an average leaves something in the band."""
_TINY = float(np.finfo(np.float64).tiny)
_DARKEST = 1e-5
"""Least response at a zero: the ends of a record leak into it."""
_TOP = 0.499
"""Highest cutoff of a digital filter, as a share of the rate."""


@dataclass(frozen=True)
class LowPass(Filter):
    """A low-pass with a cutoff in Hz at which the response has fallen by 3 dB."""

    cutoff: float
    symbol: ClassVar[str] = "band_limit"

    def __post_init__(self) -> None:
        self._check_positive()

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the cutoff."""
        return (self.cutoff,) if 0 < self.cutoff < 0.5 / dt else ()


@dataclass(frozen=True)
class OnePole(LowPass):
    """One pole: y += (1 - p) (x - y), p = exp(-2 pi fc dt); the cutoff is that of p."""

    quantities: ClassVar[tuple[Quantity, ...]] = (_CUTOFF,)

    def response(self, f: Array, dt: float) -> Array:
        """Return (1 - p)^2 / (1 - 2 p cos(2 pi f dt) + p^2)."""
        p = np.exp(-2 * np.pi * self.cutoff * dt)
        sine = np.sin(np.pi * f * dt)
        return np.asarray((1 - p) ** 2 / ((1 - p) ** 2 + 4 * p * sine**2))


@dataclass(frozen=True)
class Butterworth(LowPass):
    """A digital Butterworth low-pass by the bilinear transform; its order need not be whole."""

    order: float = 2.0
    quantities: ClassVar[tuple[Quantity, ...]] = (_CUTOFF, _ORDER)

    def response(self, f: Array, dt: float) -> Array:
        """Return 1 / (1 + (tan(pi f dt) / tan(pi fc dt))^(2 order))."""
        top = np.pi * np.minimum(f * dt, 0.499999)
        ratio = np.tan(top) / np.tan(np.pi * min(self.cutoff * dt, _TOP))
        return np.asarray(1 / (1 + ratio ** (2 * self.order)))


@dataclass(frozen=True)
class AnalogueLowPass(LowPass):
    """An analogue low-pass without its aliases."""

    order: float = 1.0
    quantities: ClassVar[tuple[Quantity, ...]] = (_CUTOFF, _ORDER)

    def response(self, f: Array, dt: float) -> Array:
        """Return 1 / (1 + (f / fc)^(2 order))."""
        del dt
        return np.asarray(1 / (1 + (f / self.cutoff) ** (2 * self.order)))


@dataclass(frozen=True)
class Averaging(LowPass):
    """An average over a time, repeated `order` times, sampled: what it leaves beyond is folded."""

    order: float = 2.0
    quantities: ClassVar[tuple[Quantity, ...]] = (_CUTOFF, _ORDER)

    @property
    def span_s(self) -> float:
        """The time that each average takes; its first zero lies at the inverse."""
        return _half_power(self.order) / self.cutoff

    def response(self, f: Array, dt: float) -> Array:
        """Return the sum of sinc(f T)^(2 order) over f and its aliases, 1 at zero.

        The sine of an alias is that of a sum of angles: two sines a frequency are enough for all.
        """
        angle = np.pi * self.span_s * np.append(np.asarray(f, np.float64), 0.0)
        own_sine, own_cosine, folded = np.sin(angle), np.cos(angle), np.zeros_like(angle)
        own_sine[angle == 0.0] = angle[angle == 0.0] = _TINY  # whose ratio is 1
        sine, other = np.empty_like(angle), np.empty_like(angle)
        for turn in (np.pi * self.span_s / dt * _ALIASES).tolist():  # all at once would not be near
            np.multiply(own_sine, np.cos(turn), out=sine)
            sine += np.multiply(own_cosine, np.sin(turn), out=other)
            sine /= np.add(angle, turn, out=other)
            sine *= sine
            folded += np.power(sine, self.order, out=sine)
        return np.asarray(folded[:-1] / folded[-1])


@dataclass(frozen=True)
class MovingAverage(LowPass):
    """The mean of the last rows, at every row; their number is counted, not fitted."""

    rows: int = 2
    has_zeros: ClassVar[bool] = True
    has_ripples: ClassVar[bool] = True

    @classmethod
    def over(cls, rows: int, dt: float) -> MovingAverage:
        """Return the mean of so many rows, 2 or more.

        >>> round(MovingAverage.over(5, 0.01).cutoff, 2)
        9.02
        """

        def above_half(x: float) -> float:
            return float(np.sin(rows * x) / (rows * np.sin(x)) - np.sqrt(0.5))

        return cls(root_between(above_half, 1e-6, np.pi / rows) / (np.pi * dt), rows)

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the cutoff and the zeros."""
        zeros = np.arange(1, self.rows // 2 + 1) / (self.rows * dt)
        return (self.cutoff, *(float(f) for f in zeros if f < 0.5 / dt))

    def response(self, f: Array, dt: float) -> Array:
        """Return sin^2(pi k f dt) / (k sin(pi f dt))^2."""
        x = np.pi * np.maximum(np.asarray(f, np.float64) * dt, 1e-12)
        passed = (np.sin(self.rows * x) / (self.rows * np.sin(x))) ** 2
        return np.asarray(np.maximum(passed, _DARKEST))


@lru_cache(maxsize=64)
def _half_power(order: float) -> float:
    """Return x at which sinc(x)^(2 order) is one half."""
    left = 0.5 ** (1 / (2 * order))
    return root_between(lambda x: math.sin(math.pi * x) / (math.pi * x) - left, 1e-6, 1.0)
