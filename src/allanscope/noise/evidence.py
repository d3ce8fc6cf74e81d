"""From what a run keeps to what a likelihood is computed from.

Rows at stride 1 are the samples: their ordinates are all the evidence there is. At a larger stride
the rows hold the low band, up to a quarter of their rate, and the streaming spectrum the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.ordinates import SHORTEST, DensityBands, Evidence, Ordinates
from allanscope.spectrum.density import Density

__all__ = ["evidence_of", "stretches_of"]

Array = NDArray[np.float64]

_LOW_BAND = 0.25
"""Part of the row rate below which rows are used where there is a density: averaging has taken at
most a fifth of the power there."""
_WHOLE = 16
"""Longest stretches that are transformed in one piece; shorter ones are cut to a common length."""


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
    stretches: Sequence[Array], dt: float, stride: int = 1, density: Density | None = None
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
    """
    highest = np.inf
    bands: tuple[Evidence, ...] = ()
    if stride > 1 and density is not None:
        upper = DensityBands.of(density, dt, lowest=_LOW_BAND / (stride * dt))
        if len(upper.power):
            highest, bands = _LOW_BAND / (stride * dt), (upper,)
    rows = (Ordinates.of(table, dt, stride=stride, highest=highest) for table in stretches)
    return (*rows, *bands)
