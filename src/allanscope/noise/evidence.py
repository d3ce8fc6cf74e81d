"""What a likelihood is computed from: bins of cosine ordinates of rows, and bands of a density.

Rows at stride 1 are the samples: their ordinates are all the evidence there is. At a larger stride
the rows hold the low band, up to a quarter of their rate, and the streaming spectrum the rest. Both
are mean powers with known degrees of freedom, so that one likelihood takes both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct, prev_fast_len

from allanscope.noise.components import Component
from allanscope.noise.filters import Filter
from allanscope.noise.grid import Grid, Ranges, grid_of
from allanscope.spectrum import Density

__all__ = [
    "SHORTEST",
    "DensityBands",
    "Evidence",
    "Ordinates",
    "evidence_of",
    "stretches_of",
    "with_ranges",
]

Array = NDArray[np.float64]

SHORTEST = 16
"""Rows that a stretch must have to be used."""
_LOW_BAND = 0.25
"""Part of the row rate below which rows are used where there is a density: averaging has taken at
most a fifth of the power there."""
_WHOLE = 16
"""Longest stretches that are transformed in one piece; shorter ones are cut to a common length."""


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

    def column(self, component: Component) -> Array:
        """Return what a component contributes to each power, shape (b,)."""

    def response(self, low_pass: Filter) -> Array:
        """Return the power response of a filter in each bin, shape (b,)."""

    def without(self, ranges: Ranges) -> Self:
        """Return the evidence with ranges of frequencies left out: no degree of freedom there."""


@dataclass(frozen=True, eq=False)
class Ordinates:
    """DCT-II ordinates of stretches of rows of one length, binned.

    Attributes
    ----------
    grid : Grid
        Of one stretch.
    power, dof : ndarray, shape (b,)
        Mean square of the ordinates of the first b bins of the grid, and how many they are.
    raw : ndarray, shape (stretches, n - 1)
        The ordinates k = 1 ... n - 1, for regressions on them; empty where they are not kept.
    excluded : tuple of (low, high)
        Frequencies in Hz that are left out.
    worth : float
        Degrees of freedom of an ordinate: below 1 where some of the rows are filling.
    """

    grid: Grid
    power: Array
    dof: Array
    raw: Array = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    excluded: Ranges = ()
    worth: float = 1.0

    @classmethod
    def of(
        cls,
        rows: ArrayLike,
        dt: float,
        *,
        stride: int = 1,
        highest: float = np.inf,
        worth: float = 1.0,
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
        worth : float
            Degrees of freedom of an ordinate.

        Raises
        ------
        ValueError
            If there are fewer than 16 rows, or values that are not finite.
        """
        table = np.atleast_2d(np.asarray(rows, np.float64))
        if table.shape[1] < SHORTEST:
            raise ValueError(f"need at least {SHORTEST} contiguous rows, got {table.shape[1]}")
        if not np.all(np.isfinite(table)):
            raise ValueError("the rows contain values that are not finite")
        n = int(prev_fast_len(table.shape[1], real=True))
        # Ordinate 0 is the mean; leaving it out removes that.
        raw = np.asarray(dct(table[:, :n], type=2, norm="ortho", axis=1))[:, 1:]
        grid = grid_of(n, 1 / (dt * stride), stride)
        bins = max(4, int(np.searchsorted(grid.centre, highest, side="right")))
        power = np.empty(min(bins, len(grid.count)))
        return cls(grid, power, np.empty(0), raw, worth=worth).binned()

    @property
    def frequency(self) -> Array:
        """Centre of each bin in Hz."""
        return self.grid.centre[: len(self.power)]

    def column(self, component: Component) -> Array:
        """Return what a component contributes to the mean square of each bin."""
        return self.grid.column(component)[: len(self.power)]

    def response(self, low_pass: Filter) -> Array:
        """Return the mean power response of a filter in each bin."""
        return self.grid.response(low_pass)[: len(self.power)]

    def without(self, ranges: Ranges) -> Self:
        """Return the ordinates with ranges of frequencies left out."""
        return replace(self, excluded=(*self.excluded, *ranges)).binned() if ranges else self

    def less(self, pattern: Array) -> Self:
        """Return the ordinates less a pattern from k = 1 on, shape (p,) or (stretches, p)."""
        raw = self.raw.copy()
        raw[:, : pattern.shape[-1]] -= pattern
        edges = np.append(self.grid.edges, raw.shape[1])
        bins = int(np.searchsorted(edges, pattern.shape[-1]))  # that the pattern reaches
        power = self.power.copy()
        power[:bins] = self._powers(raw[:, : edges[bins]])[0][: len(power)]
        return replace(self, raw=raw, power=power)

    def binned(self) -> Self:
        """Return the same with the powers computed anew."""
        power, count = self._powers(self.raw)
        keep = len(self.power)
        return replace(self, power=power[:keep], dof=(self.worth * count * len(self.raw))[:keep])

    def _powers(self, raw: Array) -> tuple[Array, Array]:
        """Return mean square and number of ordinates of each bin, or of the first bins alone."""
        square = np.einsum("sk,sk->k", raw, raw) / len(raw)
        return self.grid.binned(square, self.excluded)


@dataclass(frozen=True, eq=False)
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

    def column(self, component: Component) -> Array:
        """Return the mean density of a component in each band."""
        return component.band_density(self.frequency, self.width, self.dt)

    def response(self, low_pass: Filter) -> Array:
        """Return the power response of a filter in the middle of each band."""
        return low_pass.response(self.frequency, self.dt)

    def without(self, ranges: Ranges) -> Self:
        """Return the bands with those that touch a range of frequencies left out."""
        dof, half = self.dof.copy(), self.width / 2
        for low, high in ranges:
            touched = (self.frequency + half > low) & (self.frequency - half < high)
            dof[touched] = 0.0
        return replace(self, dof=dof)


def with_ranges(
    evidence: Sequence[Evidence], whole: Sequence[Evidence], ranges: Ranges
) -> tuple[Evidence, ...]:
    """Return evidence with ranges that were left out of it put back.

    Parameters
    ----------
    evidence : sequence of Evidence
        Without the ranges, a ramp perhaps removed from it.
    whole : sequence of Evidence
        What it came from, part by part.
    ranges : tuple of (low, high)
        Frequencies in Hz.
    """
    if not ranges:
        return tuple(evidence)
    return tuple(
        replace(part, excluded=tuple(r for r in part.excluded if r not in ranges)).binned()
        if isinstance(part, Ordinates)
        else source
        for part, source in zip(evidence, whole, strict=True)
    )


def stretches_of(values: Array, segments: Sequence[tuple[int, int]]) -> tuple[Array, ...]:
    """Sort the segments of a record into tables of equal length.

    The longest ones, which alone know about the lowest frequencies, stay whole. The others, down to
    half their median length, are cut to pieces of one length, so that a run with a thousand gaps
    costs no more than one with few.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Rows of one column.
    segments : sequence of (first, last)
        Half-open ranges that are contiguous.

    Returns
    -------
    tuple of ndarray
        Each of shape (stretches, length).

    Raises
    ------
    ValueError
        If no segment has 16 rows.
    """
    usable = sorted((s for s in segments if s[1] - s[0] >= SHORTEST), key=lambda s: s[0] - s[1])
    if not usable:
        raise ValueError(f"no stretch of {SHORTEST} rows without a gap")
    whole, rest = usable[:_WHOLE], usable[_WHOLE:]
    tables = [values[np.newaxis, first:last] for first, last in whole]
    if rest:
        length = max(SHORTEST, int(np.median([last - first for first, last in rest])) // 2)
        starts = [np.arange(first, last - length + 1, length) for first, last in rest]
        tables.append(values[np.concatenate(starts)[:, np.newaxis] + np.arange(length)])
    return tuple(tables)


def evidence_of(
    stretches: Sequence[Array],
    dt: float,
    stride: int = 1,
    density: Density | None = None,
    worth: float = 1.0,
) -> tuple[Evidence, ...]:
    """Return the ordinates of all stretches, and the density where it knows more.

    Parameters
    ----------
    stretches : sequence of ndarray
        Tables of contiguous rows, each of shape (stretches, length).
    dt : float
        Time between samples in s.
    stride : int
        Samples averaged into a row.
    density : Density, optional
        Of the samples; used when the rows are averages.
    worth : float
        Degrees of freedom of a row (`worth_of`).
    """
    highest = np.inf
    bands: tuple[Evidence, ...] = ()
    if stride > 1 and density is not None:
        upper = DensityBands.of(density, dt, lowest=_LOW_BAND / (stride * dt))
        if len(upper.power):
            highest, bands = _LOW_BAND / (stride * dt), (upper,)
    rows = (
        Ordinates.of(table, dt, stride=stride, highest=highest, worth=worth) for table in stretches
    )
    return (*rows, *bands)
