"""From what a run keeps to what a likelihood is computed from.

Rows at stride 1 are the samples: their ordinates are all the evidence there is. At a larger stride
the rows hold the low band, up to a quarter of their rate, and the streaming spectrum the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.noise.ordinates import SHORTEST, DensityBands, Evidence, Ordinates
from allanscope.spectrum.density import Density

__all__ = ["Stretches", "evidence_of", "stretches_of"]

Array = NDArray[np.float64]

_LOW_BAND = 0.25
"""Part of the row rate below which rows are used where there is a density: averaging has taken at
most a fifth of the power there."""
_WHOLE = 16
"""Longest stretches that are transformed in one piece; shorter ones are cut to a common length."""


@dataclass(frozen=True)
class Stretches:
    """Contiguous rows of one column.

    Attributes
    ----------
    rows : tuple of ndarray
        Each of shape (stretches, n): all of equal length in a table.
    start : tuple of ndarray
        Time of the first row of each, in s.
    """

    rows: tuple[Array, ...]
    start: tuple[Array, ...]


def stretches_of(values: Array, segments: Sequence[tuple[int, int]], start_s: Array) -> Stretches:
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
    start_s : ndarray, shape (n,)
        Time of each row in s.

    Raises
    ------
    ValueError
        If no segment has 16 rows.
    """
    usable = sorted((s for s in segments if s[1] - s[0] >= SHORTEST), key=lambda s: s[0] - s[1])
    if not usable:
        raise ValueError(f"no stretch of {SHORTEST} rows without a gap")
    whole, rest = usable[:_WHOLE], usable[_WHOLE:]
    rows = [values[np.newaxis, first:last] for first, last in whole]
    start = [start_s[first : first + 1] for first, _ in whole]
    if rest:
        length = max(SHORTEST, int(np.median([last - first for first, last in rest])) // 2)
        firsts = np.concatenate(
            [np.arange(first, last - length + 1, length) for first, last in rest]
        )
        rows.append(values[firsts[:, np.newaxis] + np.arange(length)])
        start.append(start_s[firsts])
    return Stretches(tuple(rows), tuple(start))


def evidence_of(
    stretches: Stretches, dt: float, stride: int = 1, density: Density | None = None
) -> tuple[Evidence, ...]:
    """Return the ordinates of all stretches, and the density where it knows more.

    Parameters
    ----------
    stretches : Stretches
        Rows.
    dt : float
        Time between samples in s.
    stride : int
        Samples averaged into a row.
    density : Density, optional
        Of the samples; used when the rows are averages.
    """
    bands: list[Evidence] = []
    highest = np.inf
    if stride > 1 and density is not None and len(density.frequency):
        highest = _LOW_BAND / (stride * dt)
        upper = DensityBands.of(density, dt, lowest=highest)
        if len(upper.power):
            bands.append(upper)
        else:
            highest = np.inf
    lower = [
        Ordinates.of(rows, dt, stride=stride, highest=highest, start=start)
        for rows, start in zip(stretches.rows, stretches.start, strict=True)
    ]
    return (*lower, *bands)


def plain(values: ArrayLike) -> Stretches:
    """Return one contiguous record as stretches."""
    rows = np.asarray(values, np.float64)
    if rows.ndim != 1:
        raise ValueError(f"need values of shape (n,), got {rows.shape}")
    return Stretches((rows[np.newaxis],), (np.zeros(1),))
