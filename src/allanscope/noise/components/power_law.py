r"""Noise whose density falls as a power of the frequency between those of IEEE 952.

White noise integrated d = a / 2 times, ARFIMA(0, d, 0): a = 0, 1 and 2 would be N, B and K. Its
sums over m samples have the variance (Hosking, Biometrika 68, 1981; continued beyond d = 1/2, where
only differences of them have one)

.. math:: V(m) = \sigma^2 \frac{\Gamma(1 - 2d)}{(1 + 2d) \Gamma(1 + d) \Gamma(1 - d)}
          \left(\frac{\Gamma(1 + d + m)}{\Gamma(m - d)} - \frac{\Gamma(1 + d)}{\Gamma(-d)}\right)

from which :math:`AVAR = (4 V(m) - V(2m)) / 2 m^2`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gamma, poch

from allanscope.noise.part import Array, Component, Quantity
from allanscope.noise.transfer import fold

__all__ = ["PowerLaw"]

_LEAST, _MOST = 0.05, 1.95
"""Exponents: within, it is none of the classical ones."""
_SINGULAR = 2e-6
"""Distance of the exponent from 1 within which the terms of the variance cancel."""
_MANY = 1e4
"""Samples from which the second term of an expansion in 1/m^2 is the last that counts."""
_ORDERS, _TABULATED = 16, 0.05
"""Ordinates, and steps of the exponent, of the table of what the ends of a record make of them."""
_CYCLES, _PER_CYCLE = 400, 100
"""Periods of the response that are summed, and points in each."""


@dataclass(frozen=True)
class PowerLaw(Component):
    """Noise of a free slope: two-sided density P^2 (f / 1 Hz)^-exponent at low frequency.

    In discrete time P^2 (sin(pi f dt) / (pi dt))^-exponent, a fractional sum of white noise.

    Parameters
    ----------
    P : float
        Square root of the two-sided density at 1 Hz, in unit/sqrt(Hz).
    exponent : float
        Between 0 (white) and 2 (random walk).

    Examples
    --------
    >>> PowerLaw(1.0, 1.5).density([1e-3, 4e-3], dt=0.01).round(2)
    array([63245.55,  7905.69])
    """

    P: float
    exponent: float
    symbol: ClassVar[str] = "power_law"
    is_filtered: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("P", "{unit}/sqrt(Hz)"),
        Quantity("exponent", "", "shape", _LEAST, _MOST),
    )

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return 2 P^2 (sin(pi f dt) / (pi dt))^-exponent."""
        rising = np.sin(np.pi * np.asarray(f, np.float64) * dt) / (np.pi * dt)
        return np.asarray(2 * self.P**2 * rising**-self.exponent)

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return (4 V(m) - V(2m)) / 2 m^2."""
        factor = np.asarray(m, np.float64)
        rest = 4 * self._sums(factor, dt) - self._sums(2 * factor, dt)
        return np.asarray(rest / (2 * factor**2))

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return (15 V(m) - 6 V(2m) + V(3m)) / 6 m^2."""
        factor = np.asarray(m, np.float64)
        one, two, three = (self._sums(j * factor, dt) for j in (1, 2, 3))
        return np.asarray((15 * one - 6 * two + three) / (6 * factor**2))

    def _sums(self, m: Array, dt: float) -> Array:
        """Return the variance of the sums over m samples."""
        d = self.exponent / 2
        if abs(d - 0.5) < _SINGULAR / 2:
            d = 0.5 + _SINGULAR / 2
        variance = self.P**2 / dt * (2 * np.pi * dt) ** self.exponent
        factor = variance * gamma(1 - 2 * d) / ((1 + 2 * d) * gamma(1 + d) * gamma(1 - d))
        return np.asarray(factor * (_rising(m, d) - gamma(1 + d) / gamma(-d)))

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the spectrum of the rows times what the ends of the record make of it."""
        order = np.asarray(k, np.float64)
        spectrum = fold(
            lambda w: self.P**2 / dt * (2 * np.sin(w / 2) / (2 * np.pi * dt)) ** -self.exponent,
            np.pi * order / n,
            stride,
        )
        return np.asarray(spectrum * self._ends(order))

    def _ends(self, k: Array) -> Array:
        """Return what the ends of the record make of each ordinate, whatever its length."""
        table = _table()
        at = self.exponent / _TABULATED
        low = min(int(at), len(table) - 2)
        row = (low + 1 - at) * table[low] + (at - low) * table[low + 1]
        lost = row[np.minimum(k, _ORDERS).astype(np.int64) - 1]
        return np.asarray(1 - lost / k)


def _rising(m: Array, d: float) -> Array:
    """Return Gamma(1 + d + m) / Gamma(m - d), to which a difference of logarithms is too coarse."""
    q = 1 + 2 * d
    few = poch(np.minimum(m, _MANY) - d, q)
    return np.where(m <= _MANY, few, m**q * (1 - q * (q**2 - 1) / (24 * m**2)))


@lru_cache(maxsize=1)
def _table() -> Array:
    r"""Return k (1 - E[d_k^2] / spectrum) of the first ordinates of long records, (exponents, k).

    The integral of :math:`(\omega / \pi k)^{-a}` over the squared transform of the cosine of order
    k, :math:`2 \omega^2 (1 - (-1)^k \cos \omega) / (\omega^2 - \pi^2 k^2)^2`, beyond some hundred
    cycles with the cosine averaged out. For flicker the first is 0.2263.
    """
    step = np.pi / _PER_CYCLE
    w = (np.arange(_CYCLES * _PER_CYCLE) + 0.5) * step
    k = np.arange(1, _ORDERS + 1)[:, np.newaxis]
    passed = 2 * w**2 * (1 - (-1.0) ** k * np.cos(w)) / (w**2 - (np.pi * k) ** 2) ** 2
    rows = []
    for a in np.arange(0.0, 2.0 + _TABULATED / 2, _TABULATED):
        near = (passed @ w**-a) * step
        beyond = 2 * (w[-1] + step / 2) ** (-1 - a) / (1 + a)
        kept = 2 / np.pi * (np.pi * k[:, 0]) ** a * (near + beyond)
        rows.append(k[:, 0] * (1 - kept))
    return np.array(rows)
