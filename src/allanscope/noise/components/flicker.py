"""Flicker noise B: bias instability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import digamma

from allanscope.noise.part import Array, Component, Quantity
from allanscope.noise.transfer import fold

__all__ = ["Flicker"]

_ENDS = np.array(
    [
        *(1.0, 0.77370, 0.90282, 0.93109, 0.94994, 0.95916, 0.96641, 0.97093, 0.97475),
        *(0.97743, 0.97978, 0.98155, 0.98314, 0.98439, 0.98554, 0.98648, 0.98734),
    ]
)
"""E[d_k^2] over the spectrum at k = 0, 1, 2, ... in the limit of a long record."""


@dataclass(frozen=True)
class Flicker(Component):
    """1/f noise: ARFIMA(0, 1/2, 0) with innovations of standard deviation B.

    One-sided density B^2 dt / sin(pi f dt), which is B^2 / (pi f) at low frequency. AVAR tends to
    the floor (2 ln 2 / pi) B^2 = (0.664 B)^2 and is 1.443, 1.154, 1.050 times that at m = 1, 2, 4;
    HVAR tends to ln(256/27) / (2 pi) B^2. Both are exact for samples here.

    Parameters
    ----------
    B : float
        In the unit of the axis.

    Examples
    --------
    >>> Flicker(1.0).avar([1, 2**20], dt=0.01).round(6)
    array([0.63662 , 0.441271])
    """

    B: float
    symbol: ClassVar[str] = "B"
    is_filtered: ClassVar[bool] = True
    quantities: ClassVar[tuple[Quantity, ...]] = (Quantity("B", "{unit}"),)

    def __post_init__(self) -> None:
        self._check_positive()

    def density(self, f: ArrayLike, dt: float) -> Array:
        """Return B^2 dt / sin(pi f dt)."""
        return np.asarray(self.B**2 * dt / np.sin(np.pi * np.asarray(f, np.float64) * dt))

    def avar(self, m: ArrayLike, dt: float) -> Array:
        """Return 2 B^2 / (pi m^2) (g(2m) - 4 g(m))."""
        del dt
        factor = np.asarray(m, np.float64)
        rest = _sum_covariance(2 * factor) - 4 * _sum_covariance(factor)
        return np.asarray(2 * self.B**2 / np.pi * rest / factor**2)

    def hvar(self, m: ArrayLike, dt: float) -> Array:
        """Return 2 B^2 / (3 pi m^2) (6 g(2m) - 15 g(m) - g(3m))."""
        del dt
        factor = np.asarray(m, np.float64)
        one, two, three = (_sum_covariance(j * factor) for j in (1, 2, 3))
        rest = 6 * two - 15 * one - three
        return np.asarray(2 * self.B**2 / (3 * np.pi) * rest / factor**2)

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return the expected ordinates of the rows.

        The spectrum times what the ends of the record make of it: 0.774 at k = 1, 0.903 at k = 2,
        1 - 2 / (pi^2 k) for large k, whatever the length of the record.
        """
        del dt
        order = np.asarray(k, np.float64)
        spectrum = fold(lambda w: self.B**2 / (2 * np.sin(w / 2)), np.pi * order / n, stride)
        return np.asarray(spectrum * _ends(order))


def _ends(k: Array) -> Array:
    """Return what the ends of the record make of each ordinate."""
    table = _ENDS[np.minimum(k, len(_ENDS) - 1).astype(np.int64)]
    return np.where(k < len(_ENDS), table, 1 - 2 / (np.pi**2 * k))


def _sum_covariance(m: Array) -> Array:
    """g(m) = sum over j < m of (m - j) h_j with h_j = 1 + 1/3 + ... + 1/(2j - 1).

    The generalised covariance of the running sum is 2 B^2 / pi g(|m|). Summed twice by parts:
    g = (m^2 - 1/4) h / 2 - (m^2 - 1) / 8 - m (m - 1) / 4 with h = h_(m - 1).
    """
    h = 0.5 * (digamma(m - 0.5) + np.euler_gamma) + np.log(2.0)
    return np.asarray((m**2 - 0.25) * h / 2 - (m**2 - 1) / 8 - m * (m - 1) / 4)
