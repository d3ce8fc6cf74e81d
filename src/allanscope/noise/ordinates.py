"""What a likelihood is computed from: cosine ordinates of rows, and bands of a density.

The orthonormal DCT-II of a record, mean removed, is the domain in which noise is white: its
ordinates are independent, exactly for white noise plus a random walk that started anywhere, to a
few per cent at the lowest six for flicker. (Those of a Fourier transform are not: the two ends of a
random walk do not meet, and the step leaks everywhere.) Ordinate k belongs to the frequency
k / (2 n dt); its square has expectation lambda_k, computed by every component, and one degree of
freedom. Neighbouring squares are averaged in bins, which lose nothing where lambda is smooth.

Two kinds of evidence share one interface, so that a fit can use both at once: the low band from
the rows that a History keeps, the high band from the streaming spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct, prev_fast_len

from allanscope.noise.components import Component
from allanscope.spectrum.density import Density

__all__ = ["SHORTEST", "DensityBands", "Evidence", "Ordinates", "bin_edges"]

Array = NDArray[np.float64]

SHORTEST = 16
"""Rows that a stretch must have to be used."""
_SINGLE = 128
_PER_DECADE = 40


class Evidence(Protocol):
    """Mean powers whose expectation a model predicts."""

    @property
    def power(self) -> Array:
        """Mean power of each bin, shape (b,)."""

    @property
    def dof(self) -> Array:
        """Degrees of freedom: power is distributed as expected * chi2(dof) / dof."""

    @property
    def frequency(self) -> Array:
        """Centre of each bin in Hz."""

    def expected(self, component: Component) -> Array:
        """Return what a component contributes to each power, shape (b,)."""

    def up_to(self, highest: float) -> Self:
        """Return the bins whose centres lie at or below a frequency in Hz."""


@dataclass(frozen=True)
class Ordinates:
    """DCT-II ordinates of one stretch of rows, or of several stretches of equal length.

    Attributes
    ----------
    raw : ndarray, shape (stretches, n - 1)
        The ordinates k = 1 ... n - 1, for regressions on them.
    dt : float
        Time between samples in s.
    stride : int
        Samples averaged into a row.
    first, last : ndarray of int, shape (b,)
        Lowest and highest k of each bin.
    power : ndarray, shape (b,)
        Mean square of the ordinates of each bin.
    """

    raw: Array
    dt: float
    stride: int
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    power: Array

    @classmethod
    def of(
        cls,
        rows: ArrayLike,
        dt: float,
        *,
        stride: int = 1,
        highest: float = np.inf,
        fine: Sequence[tuple[float, float]] = (),
    ) -> Ordinates:
        """Transform contiguous rows.

        Parameters
        ----------
        rows : array_like, shape (n,) or (stretches, n)
            Samples, or means over `stride` of them. A few at the end may be left out so that the
            transform is fast.
        dt : float
            Time between samples in s.
        stride : int
            Samples in a row.
        highest : float
            Frequency in Hz up to which ordinates are used; above it a `DensityBands` takes over.
        fine : sequence of (low, high)
            Ranges in Hz in which every ordinate is its own bin, e.g. around a narrow resonance.

        Raises
        ------
        ValueError
            If there are fewer than 16 rows, or values that are not finite.
        """
        table = np.atleast_2d(np.asarray(rows, np.float64))
        if table.shape[1] < SHORTEST:
            raise ValueError(f"need at least {SHORTEST} contiguous rows, got {table.shape[1]}")
        if not np.all(np.isfinite(table)):
            raise ValueError("the rows hold values that are not finite")
        n = int(prev_fast_len(table.shape[1], real=True))
        # Ordinate 0 is the mean; leaving it out removes that.
        raw = np.asarray(dct(table[:, :n], type=2, norm="ortho", axis=1))[:, 1:]
        per_hz = 2 * n * stride * dt
        top = n - 1 if np.isinf(highest) else int(np.clip(highest * per_hz, 4, n - 1))
        edges = bin_edges(top, [(low * per_hz, high * per_hz) for low, high in fine])
        bare = cls(raw, dt, stride, edges[:-1], edges[1:] - 1, np.empty(0))
        return replace(bare, power=bare._means(raw, len(bare.first)))

    @property
    def n(self) -> int:
        """Rows in each stretch."""
        return int(self.raw.shape[1]) + 1

    @property
    def dof(self) -> Array:
        """Number of ordinates in each bin, over all stretches."""
        return np.asarray((self.last - self.first + 1.0) * len(self.raw), np.float64)

    @property
    def frequency(self) -> Array:
        """Centre of each bin in Hz."""
        return self._middle() / (2 * self.n * self.stride * self.dt)

    def expected(self, component: Component) -> Array:
        """Return what a component contributes to the mean square of each bin."""
        return component.ordinates(self._middle(), self.n, self.dt, self.stride)

    def up_to(self, highest: float) -> Self:
        """Return the ordinates with the bins up to a frequency in Hz; at least four of them."""
        keep = max(4, int(np.searchsorted(self.frequency, highest, side="right")))
        return replace(
            self, first=self.first[:keep], last=self.last[:keep], power=self.power[:keep]
        )

    def less(self, pattern: Array) -> Ordinates:
        """Return the ordinates with a pattern, shape (p,) from k = 1 on, subtracted."""
        raw = self.raw.copy()
        raw[:, : len(pattern)] -= pattern
        bins = int(np.searchsorted(self.first, len(pattern), side="right"))
        power = self.power.copy()
        power[:bins] = self._means(raw, bins)
        return replace(self, raw=raw, power=power)

    def single(self, per_bin: Array) -> Array:
        """Return the part of a quantity per bin that belongs to bins of one ordinate from k = 1."""
        return per_bin[: int(np.argmin(np.append(self.first == self.last, False)))]

    def _middle(self) -> NDArray[np.int64]:
        return (self.first + self.last) // 2

    def _means(self, raw: Array, bins: int) -> Array:
        """Return the mean squares of the first bins."""
        first, last = self.first[:bins], self.last[:bins]
        top = int(last[-1])
        square = np.einsum("sk,sk->k", raw[:, :top], raw[:, :top]) / len(raw)
        return np.asarray(np.add.reduceat(square, first - 1) / (last - first + 1))


@dataclass(frozen=True)
class DensityBands:
    """Bands of a one-sided density that was averaged while the samples came in.

    Attributes
    ----------
    frequency, width : ndarray, shape (b,)
        Centre and width of each band in Hz.
    power : ndarray, shape (b,)
        Mean density in unit^2 / Hz.
    dof : ndarray, shape (b,)
        Twice the effective averages.
    dt : float
        Time between samples in s.
    """

    frequency: Array
    width: Array
    power: Array
    dof: Array
    dt: float

    @classmethod
    def of(cls, density: Density, dt: float, *, lowest: float = 0.0) -> DensityBands:
        """Take the bands that lie wholly above `lowest` (Hz) and hold power."""
        above = density.frequency - 0.5 * density.width >= lowest * (1 - 1e-9)
        keep = above & (density.averages > 0) & (density.density > 0)
        return cls(
            density.frequency[keep],
            density.width[keep],
            density.density[keep],
            2 * density.averages[keep],
            dt,
        )

    def expected(self, component: Component) -> Array:
        """Return the mean density of a component in each band."""
        return component.band_density(self.frequency, self.width, self.dt)

    def up_to(self, highest: float) -> Self:
        """Return the bands up to a frequency in Hz."""
        keep = self.frequency <= highest
        return replace(
            self,
            frequency=self.frequency[keep],
            width=self.width[keep],
            power=self.power[keep],
            dof=self.dof[keep],
        )


def bin_edges(top: int, fine: Sequence[tuple[float, float]] = ()) -> NDArray[np.int64]:
    """Return the edges of bins over the ordinates 1 ... top, the last edge being top + 1.

    The lowest 127 are bins of their own, as are those of the ranges `fine` (in k); above, there
    are 40 bins a decade.
    """
    single = np.arange(1, min(_SINGLE, top + 1))
    count = 1 + int(np.ceil(_PER_DECADE * max(0.0, np.log10((top + 1) / _SINGLE))))
    coarse = np.round(np.geomspace(min(_SINGLE, top + 1), top + 1, count + 1)).astype(np.int64)
    ranges = [np.arange(max(1, int(a)), min(top, int(np.ceil(b))) + 2) for a, b in fine]
    return np.unique(np.concatenate([single, coarse, *ranges, [top + 1]]).astype(np.int64))
