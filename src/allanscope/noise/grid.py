r"""Where a likelihood is computed: cosine ordinates, and the bins that they fall into.

The orthonormal DCT-II of n rows has the ordinates k = 1 .. n-1 at :math:`f_k = k f_s / 2n`. Its
ordinates are independent, exactly for white noise plus a random walk that started anywhere, to a
few per cent at the lowest six for flicker. (Those of a Fourier transform are not: the two ends of a
random walk do not meet, and the step leaks everywhere.) What a component puts into an ordinate or
into a bin depends on the grid alone, so it is computed once for all axes of a record.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel
from allanscope.lazy import once
from allanscope.noise.part import Component, Filter

__all__ = ["Grid", "Ranges", "grid_of"]

Array = NDArray[np.float64]
Ranges = tuple[tuple[float, float], ...]
"""Frequencies in Hz from and to which ordinates are left out of a fit."""

_between = kernel(
    "between_logarithms",
    *(Pointer(np.float64, 1), Pointer(np.float64, 1), int, int),
    Pointer(np.float64, 1, written=True),
)

_LOW = 8192
"""Ordinates kept one by one for slow regressors: what is slow has no power beyond."""
_SINGLE, _BINS_PER_OCTAVE = 128, 32
"""Ordinates that are taken one by one, and bins an octave above them."""
_SIMPSON = np.array([1, 4, 2, 4, 1]) / 12
"""Weights of two panels of Simpson's rule."""
_GAUSS_NODES = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_GAUSS_WEIGHTS = np.array([5, 8, 5]) / 18
"""Three nodes of Gauss and Legendre on [-1, 1], with weights whose sum is 1."""
_ACROSS = np.concatenate([sign * np.geomspace(0.1, 10.0, 24) for sign in (-1, 1)])
"""Edges of bins across a band, in widths from its centre."""
_RESOLVED = 16.0
"""Least width of a band in ordinates: those within twice that are taken one by one."""
_AWAY = np.concatenate([np.linspace(0.0, 2.0, 33), np.geomspace(2.0, 1e8, 96)[1:]])
"""Distances from a band, in bandwidths, at which it is cut finer than the bins are."""
_BESIDE = np.concatenate([np.linspace(0.0, 2.0, 257), np.geomspace(2.0, 1e8, 512)[1:]])
"""Those between which the logarithm of its density is a line, within 1e-3."""
_TOP_NODES = 4096
"""Nodes from half of the Nyquist frequency on, where filters bend the density."""
_FINEST_NODES = 64
"""Nodes just below the Nyquist frequency, where a zero may lie."""


@dataclass(frozen=True)
class Grid:
    """Frequencies of the ordinates of n rows, and the bins they fall into.

    Attributes
    ----------
    n : int
        Rows; there are n - 1 ordinates.
    rate_hz : float
        Rows per second.
    stride : int
        Samples averaged into a row.
    bands : tuple of (centre, width)
        In Hz; within them and around them bins are narrower than they are.
    """

    n: int
    rate_hz: float
    stride: int = 1
    bands: Ranges = ()

    @property
    def dt(self) -> float:
        """Time between samples in s."""
        return 1 / (self.rate_hz * self.stride)

    @once
    def frequency(self) -> Array:
        """Frequency of every ordinate in Hz, shape (n - 1,)."""
        return np.arange(1, self.n, dtype=np.float64) * (self.rate_hz / (2 * self.n))

    def around(self, centre: float, reach: float) -> slice:
        """Return ordinates that hold all which are so near to a frequency, and few others."""
        unit = self.rate_hz / (2 * self.n)
        first, stop = (centre - reach) / unit - 2, (centre + reach) / unit + 1
        return slice(int(np.clip(first, 0, self.n - 1)), int(np.clip(stop, 0, self.n - 1)))

    @property
    def low(self) -> int:
        """Number of ordinates kept one by one."""
        return min(_LOW, self.n - 1)

    @once
    def edges(self) -> NDArray[np.int64]:
        """First ordinate of every bin (0 stands for k = 1), shape (bins,)."""
        octaves = max(np.log2(self.n / _SINGLE), 0.1)
        wide = np.geomspace(_SINGLE, max(self.n - 1, _SINGLE), 2 + int(octaves * _BINS_PER_OCTAVE))
        single = np.arange(min(_SINGLE, self.n - 1))
        edges = np.concatenate([single, np.round(wide[:-1]) - 1, [min(self.low, self.n - 2)]])
        for centre, width in self.bands:
            k = (centre + width * _ACROSS) * (2 * self.n / self.rate_hz)
            edges = np.append(edges, np.round(k[k >= 1]) - 1)
        return np.unique(edges[edges < self.n - 1]).astype(np.int64)

    def finer(self, bands: Ranges) -> Grid:
        """Return the grid with more bins in some bands; what is as long as a record is shared."""
        finer = replace(self, bands=bands)
        vars(finer)["frequency"] = self.frequency
        return finer

    @once
    def count(self) -> Array:
        """Ordinates in every bin."""
        return np.diff(np.append(self.edges, self.n - 1)).astype(np.float64)

    @once
    def centre(self) -> Array:
        """Mean frequency of every bin in Hz."""
        after = np.append(self.edges[1:], self.n - 1)
        return np.asarray((self.edges + after + 1) / 2 * (self.rate_hz / (2 * self.n)))

    def bin_means(self, per_ordinate: Array) -> Array:
        """Average something over every bin."""
        return np.asarray(np.add.reduceat(per_ordinate, self.edges) / self.count, np.float64)

    def kept(self, excluded: Ranges) -> NDArray[np.bool_]:
        """Tell which ordinates lie outside ranges of frequencies in Hz."""
        return _kept(self, excluded)

    def counts(self, excluded: Ranges = ()) -> Array:
        """Return the number of ordinates of every bin that are not left out."""
        if not excluded:
            return self.count
        return _counts(self, excluded)

    def binned(self, squares: Array, excluded: Ranges = ()) -> tuple[Array, Array]:
        """Return mean and number of the squared ordinates of every bin that are not left out.

        Of the first ordinates, up to the end of a bin, those of the first bins.
        """
        count = self.counts(excluded)
        bins = int(np.searchsorted(self.edges, len(squares)))
        if excluded:
            squares = squares * self.kept(excluded)[: len(squares)]
        total = np.add.reduceat(squares, self.edges[:bins])
        return np.asarray(total / np.maximum(count[:bins], 1.0)), count

    def column(self, component: Component) -> Array:
        """Return the mean square that a component gives the ordinates of every bin."""
        if component.power == 1.0:
            return _column(self, component)
        return component.power * _column(self, component.with_power(1.0))

    def response(self, low_pass: Filter) -> Array:
        """Return the mean power response of a filter in every bin."""
        return _response(self, low_pass)

    def first_response(self, low_pass: Filter) -> Array:
        """Return the power response of a filter at the first ordinates, those kept one by one."""
        return _first_response(self, low_pass)

    def first(self, component: Component, m: int) -> Array:
        """Return the mean squares of the first m ordinates, of those kept one by one."""
        return component.power * _first(self, component.with_power(1.0))[:m]

    def at(self, component: Component, frequency: Array) -> Array:
        """Return the mean square of an ordinate at any frequency in Hz."""
        k = frequency * (2 * self.n / self.rate_hz)
        return component.ordinates(k, self.n, self.dt, self.stride)

    @once
    def nodes(self) -> Array:
        """Ordinates (as numbers) between which what is smooth may be interpolated.

        Centres of the bins, then ever closer to the top: there a low-pass falls by orders of
        magnitude within a bin.
        """
        centre = self.centre * (2 * self.n / self.rate_hz)
        first, last = self.edges + 1.0, np.append(self.edges[1:], self.n - 1.0)
        top = np.linspace(self.n / 2, self.n - 1.0, min(_TOP_NODES, self.n // 2))
        finest = self.n - np.geomspace(1.0, max(self.n / 64, 2.0), _FINEST_NODES)
        nodes = np.concatenate([first[:1], centre, last[-1:], top, finest])
        return np.unique(nodes[nodes >= 1])

    def nodes_beside(self, peaks: Iterable[tuple[float, float]]) -> Array:
        """Return the nodes, and those that peaks of a (centre, width) in Hz need."""
        nodes = [self.nodes]
        spacing = self.rate_hz / (2 * self.n)
        for frequency, width in peaks:
            near = _BESIDE * max(width / spacing, _RESOLVED / 2)
            centre = self.alias(frequency) / spacing
            nodes.append(np.round(np.concatenate([centre - near, centre + near])))
        if len(nodes) == 1:
            return self.nodes
        every = np.unique(np.concatenate(nodes))
        return every[(every >= 1) & (every <= self.n - 1)]

    def alias(self, frequency: float) -> float:
        """Return where a frequency in Hz is seen in the rows."""
        return abs(frequency - self.rate_hz * round(frequency / self.rate_hz))

    def interpolate(self, at_nodes: Array, nodes: Array | None = None) -> Array:
        """Return every ordinate of something positive that is known at the nodes, or at others."""
        nodes = self.nodes if nodes is None else nodes
        logarithms, found = np.log(np.maximum(at_nodes, 1e-300)), np.empty(self.n - 1)
        _between(nodes, logarithms, len(logarithms), self.n - 1, found)
        return found


@lru_cache(maxsize=16)
def _kept(grid: Grid, excluded: Ranges) -> NDArray[np.bool_]:
    kept = np.ones(grid.n - 1, bool)
    for low, high in excluded:
        kept &= (grid.frequency < low) | (grid.frequency > high)
    return kept


@lru_cache(maxsize=16)  # a search fits the same ranges thousands of times
def _counts(grid: Grid, excluded: Ranges) -> Array:
    counts = np.add.reduceat(grid.kept(excluded).astype(np.float64), grid.edges)
    counts.flags.writeable = False
    return counts


@lru_cache(maxsize=1024)  # of some kilobytes
def _column(grid: Grid, unit: Component) -> Array:
    if unit.band is not None:
        column = _narrow_column(grid, unit, *unit.band)
    else:
        nodes, place = _bin_nodes(grid)
        values = unit.ordinates(nodes, grid.n, grid.dt, grid.stride)[place]
        column = np.asarray(_SIMPSON @ values)
    column.flags.writeable = False  # it is given away
    return column


def _narrow_column(grid: Grid, unit: Component, frequency: float, width: float) -> Array:
    """Return the column of a component that changes within a bin, from panels around its band.

    Panels are narrow beside the distance from the band; over each the mean is that of a Gauss rule
    for the ordinates in it.
    """
    spacing = grid.rate_hz / (2 * grid.n)
    alias = grid.alias(frequency) / spacing
    away = _AWAY * max(width / spacing, _RESOLVED)
    ends = np.array(unit.corners(grid.dt)) / spacing - 0.5
    around = np.concatenate([alias - away, alias + away, np.round(ends)])
    around = around[(around > 0) & (around < grid.n - 1)].astype(np.int64)
    edges = np.sort(np.concatenate([grid.edges, around]))
    edges = edges[np.diff(edges, prepend=-1) > 0]
    count = np.diff(np.append(edges, grid.n - 1)).astype(np.float64)
    nodes = edges + (count + 1) / 2 + _GAUSS_NODES[:, np.newaxis] * np.sqrt(count**2 - 1) / 2
    values = unit.spectrum(nodes.ravel() * spacing, grid.dt, grid.stride).reshape(nodes.shape)
    total = np.add.reduceat(count * (_GAUSS_WEIGHTS @ values), np.searchsorted(edges, grid.edges))
    return np.asarray(total / grid.count)


@lru_cache(maxsize=128)
def _response(grid: Grid, low_pass: Filter) -> Array:
    if low_pass.has_ripples:
        return _rippled(grid, low_pass)
    nodes, place = _bin_nodes(grid)
    return np.asarray(
        _SIMPSON @ low_pass.response(nodes * (grid.rate_hz / (2 * grid.n)), grid.dt)[place]
    )


@lru_cache(maxsize=128)  # of every ordinate: a search asks for the same few again and again
def _rippled(grid: Grid, low_pass: Filter) -> Array:
    return grid.bin_means(low_pass.response(grid.frequency, grid.dt))


@lru_cache(maxsize=16)  # a search changes the components more often than the filters
def _first_response(grid: Grid, low_pass: Filter) -> Array:
    return low_pass.response(grid.frequency[: grid.low], grid.dt)


@lru_cache(maxsize=64)
def _first(grid: Grid, unit: Component) -> Array:
    return unit.ordinates(np.arange(1.0, grid.low + 1), grid.n, grid.dt, grid.stride)


@lru_cache(maxsize=4)
def _bin_nodes(grid: Grid) -> tuple[Array, NDArray[np.intp]]:
    """Return the ordinates from which the mean of a bin is found by Simpson's rule.

    Those that differ, and where among them those of every bin are, shape (5, bins): a bin of one
    ordinate has one.
    """
    first, last = grid.edges + 1.0, np.append(grid.edges[1:], grid.n - 1.0)
    share = np.linspace(0, 1, len(_SIMPSON))[:, np.newaxis]
    nodes = np.asarray(first + share * (last - first))
    different, place = np.unique(nodes, return_inverse=True)
    return different, place.reshape(nodes.shape)


@lru_cache(maxsize=8)  # a record, its half and what a resumed search needs, for all of its axes
def grid_of(n: int, rate_hz: float, stride: int = 1) -> Grid:
    """Return the grid of n rows; it carries tables that are worth sharing."""
    return Grid(n, rate_hz, stride)
