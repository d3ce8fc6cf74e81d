r"""The ordinates of a series: their frequencies, their bins, and the textbook noise in them.

The orthonormal DCT-II of n samples has the ordinates k = 1 .. n-1 at :math:`f_k = k f_s / 2n`. For
a unit :math:`N^2, B^2, K^2, Q^2` their variances are, with :math:`s_k = 2 \sin(\pi k / 2n)`,

.. math:: f_s, \qquad c_k / s_k, \qquad 1 / (f_s s_k^2), \qquad f_s^2 (s_k^2 + 4 / n)

where c_k is what a finite record does to flicker noise. All this depends on n and the rate alone,
so that the axes of a record share it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.once import once

__all__ = ["Grid", "grid_of"]

Array = NDArray[np.float64]

_FLICKER_EDGE = np.array([0.774, 0.903, 0.931, 0.950, 0.959, 0.966])
"""E[d_k^2] of flicker noise relative to its density, first ordinates (finite-record bias)."""
_LOW = 8192
"""Ordinates kept one by one for slow regressors: what is slow has no power beyond."""
_BINS_PER_OCTAVE = 32


@dataclass(frozen=True)
class Grid:
    """Frequencies of the ordinates of a series of n samples, and the bins they fall into.

    Attributes
    ----------
    n : int
        Samples; there are n - 1 ordinates.
    rate_hz : float
        Sample rate.
    """

    n: int
    rate_hz: float

    @once
    def frequency(self) -> Array:
        """Frequency of every ordinate in Hz, shape (n - 1,)."""
        return np.arange(1, self.n, dtype=np.float64) * (self.rate_hz / (2 * self.n))

    @property
    def low(self) -> int:
        """Number of ordinates kept one by one."""
        return min(_LOW, self.n - 1)

    @once
    def edges(self) -> NDArray[np.int64]:
        """First ordinate of every bin (0 stands for k = 1), shape (bins,)."""
        ratio = 2 ** (1 / _BINS_PER_OCTAVE)
        edges = np.unique(
            np.round(np.geomspace(1, self.n - 1, 2 + int(np.log(self.n) / np.log(ratio))))
        ).astype(np.int64)
        return np.unique(np.concatenate([edges[:-1] - 1, [min(self.low, self.n - 2)]]))

    @once
    def count(self) -> Array:
        """Ordinates in every bin."""
        return np.diff(np.append(self.edges, self.n - 1)).astype(np.float64)

    @once
    def centre(self) -> Array:
        """Mean frequency of every bin in Hz."""
        return self.bin_means(self.frequency)

    def bin_means(self, per_ordinate: Array) -> Array:
        """Average something over every bin."""
        return np.asarray(np.add.reduceat(per_ordinate, self.edges) / self.count, np.float64)

    def textbook(self, letters: str, frequency: Array) -> dict[str, Array]:
        """Variance of an ordinate for a unit N^2, B^2, K^2 or Q^2 at given frequencies."""
        s = 2 * np.sin(np.pi * frequency / self.rate_hz)
        found: dict[str, Array] = {}
        for letter in letters:
            if letter == "N":
                found[letter] = np.full_like(s, self.rate_hz)
            elif letter == "B":
                found[letter] = self._flicker_edge(frequency) / s
            elif letter == "K":
                found[letter] = 1 / (self.rate_hz * s**2)
            else:
                found[letter] = self.rate_hz**2 * (s**2 + 4 / self.n)
        return found

    def _flicker_edge(self, frequency: Array) -> Array:
        k = np.maximum(1.0, np.round(frequency * (2 * self.n / self.rate_hz)))
        edge = 1 - 0.202 / k
        first = k <= len(_FLICKER_EDGE)
        edge[first] = _FLICKER_EDGE[k[first].astype(np.int64) - 1]
        return np.asarray(edge)

    @once
    def textbook_all(self) -> dict[str, Array]:
        """The unit variances of N, B, K, Q at every ordinate."""
        return self.textbook("NBKQ", self.frequency)

    @once
    def textbook_bins(self) -> dict[str, Array]:
        """The unit variances of N, B, K, Q averaged over the bins."""
        return {w: self.bin_means(unit) for w, unit in self.textbook_all.items()}


@lru_cache(maxsize=2)  # a record and its half, for all of its axes
def grid_of(n: int, rate_hz: float) -> Grid:
    """Return the grid of n samples; it carries tables that are worth sharing."""
    return Grid(n, rate_hz)
