"""Waves of few cycles in a record: beside them, only the noise model tells the level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from allanscope.lazy import once
from allanscope.noise.grid import Grid

__all__ = ["SlowWaves"]

Array = NDArray[np.float64]

_MET = 1e-7
"""Ordinates from one of which a wave counts as that, beside it in phase all along."""


@dataclass(frozen=True, eq=False)
class SlowWaves:
    r"""First ordinates of cosines and sines of few cycles per record, in closed form.

    The wave exp(i w t) times the cosine of ordinate k is the sum of two geometric series, of n
    terms and the ratios exp(i (w + a)) and exp(i (w - a)); a = pi k / n, and exp(i n a) is 1 or -1.
    Their sum is a complex number that depends on the frequency and on whether k is odd, times

    .. math:: p_k = \frac{1}{\sin((w + a)/2)} + \frac{1}{\sin((w - a)/2)}
              = \frac{2 \sin(w/2) \cos(a/2)}{\sin^2(w/2) - \sin^2(a/2)}

    Where w = a one series is a sum of ones.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        In Hz.
    odd, even : ndarray, shape (f, m / 2)
        p of the ordinates k = 1, 3, ... and k = 2, 4, ...; 0 where w = a.
    factors : ndarray of complex, shape (2, f)
        What p is multiplied by, of odd and even ordinates: cosine and sine are the real and the
        imaginary part of the product.
    met : ndarray of int64, shape (f,)
        Index of the ordinate at which w = a; -1 where there is none.
    at_met : ndarray of complex, shape (f,)
        What stands there.
    """

    frequency: Array
    odd: Array
    even: Array
    factors: NDArray[np.complex128]
    met: NDArray[np.int64]
    at_met: NDArray[np.complex128]

    @classmethod
    def of(cls, grid: Grid, frequency: Array) -> Self:
        """Return those of some frequencies in Hz, shape (f,)."""
        n, m = grid.n, grid.low
        half = np.pi * np.arange(1, m + 1) / (2 * n)
        w = 2 * np.pi * frequency / grid.rate_hz
        ordinate = 2 * n * frequency / grid.rate_hz
        met = np.round(ordinate).astype(np.int64) - 1
        met[(np.abs(ordinate - 1 - met) > _MET) | (met >= m)] = -1
        sine, sines = np.sin(w / 2)[:, np.newaxis], np.sin(half)
        apart = sine**2 - sines**2
        hit = np.flatnonzero(met >= 0)
        apart[hit, met[hit]] = np.inf
        poles = 2 * sine * np.cos(half) / apart
        end = np.exp(1j * w * n)
        turned = 0.25j * np.sqrt(2 / n) * np.exp(-0.5j * w)
        return cls(
            frequency,
            np.ascontiguousarray(poles[:, 0::2]),
            np.ascontiguousarray(poles[:, 1::2]),
            np.array([turned * (1 + end), turned * (1 - end)]),
            met,
            np.sqrt(n / 2) * np.exp(-0.5j * w),
        )

    def pair(self, index: int) -> Array:
        """Return the first ordinates of cosine and sine of one frequency, shape (2, m)."""
        pair = np.empty((2, self.odd.shape[1] + self.even.shape[1]))
        for first, part in enumerate((self.odd, self.even)):
            factor = self.factors[first, index]
            np.multiply(factor.real, part[index], out=pair[0, first::2])
            np.multiply(factor.imag, part[index], out=pair[1, first::2])
        if self.met[index] >= 0:
            pair[:, self.met[index]] = self.at_met[index].real, self.at_met[index].imag
        return pair

    @once
    def squares(self) -> tuple[Array, Array]:
        """Squares of `odd` and `even`."""
        return self.odd**2, self.even**2

    def gains(self, weight: Array, data: Array) -> Array:
        """Return what every wave gains in nats, shape (f,), amplitude and phase being fitted.

        Parameters
        ----------
        weight : ndarray, shape (m,)
            1 over the variance of each ordinate; 0 where it is left out.
        data : ndarray, shape (m,)
            Ordinates of the data.
        """
        normal, right = np.zeros((2, 2, len(self.frequency))), np.zeros((2, len(self.frequency)))

        def add(wave: NDArray[np.complex128], information: Array, score: Array) -> None:
            pair = np.array([wave.real, wave.imag])
            normal[...] += information * pair[:, np.newaxis] * pair
            right[...] += score * pair

        parts = zip(self.factors, self.squares, (self.odd, self.even), strict=True)
        for first, (factor, squares, poles) in enumerate(parts):
            own = weight[first::2]
            add(factor, squares @ own, poles @ (own * data[first::2]))
        known = np.where(self.met >= 0, weight[self.met], 0.0)
        add(self.at_met, known, known * data[self.met])
        inverse = np.linalg.pinv(normal.T, hermitian=True)
        return np.asarray(np.einsum("if,fij,jf->f", right, inverse, right) / 2)
