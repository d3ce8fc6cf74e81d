"""The result of the streaming spectrum: a power spectral density with its reliability.

The bins of all levels are joined to bands of equal width on a logarithmic scale (`assemble`).

Segments of a white record windowed with a Hann window and shifted by half their length have Fourier
ordinates that are correlated: with the neighbours of the same segment, because the window widens
every line, and with the next segment, because half of the samples are the same. The squared
correlations tell how many independent ordinates a mean over segments and bins is worth (Welch, IEEE
Trans. AU-15, 1967; Percival and Walden, 1993, section 6.17).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Density", "Stretch", "assemble", "independent_averages"]

Array = NDArray[np.float64]

_SAME = (1.0, (2 / 3) ** 2, (1 / 6) ** 2)
"""Squared correlation of ordinates 0, 1 and 2 bins apart in one segment; zero beyond."""
_NEXT = (1 / 36, 0.020014, 1 / 144, 0.000801)
"""The same between a segment and the next one, half a segment on."""


@dataclass(frozen=True, slots=True)
class Density:
    """One-sided power spectral density of one axis on log-spaced frequencies.

    Attributes
    ----------
    frequency : ndarray, shape (k,)
        Centre of each band in Hz, ascending.
    width : ndarray, shape (k,)
        Width of each band in Hz.
    density : ndarray, shape (k,)
        Mean one-sided density in the band, unit^2 / Hz.
    averages : ndarray, shape (k,)
        Effective number of independent periodogram ordinates in it: the density is distributed as
        its expectation times chi-square(2 averages) / (2 averages).
    """

    frequency: NDArray[np.float64]
    width: NDArray[np.float64]
    density: NDArray[np.float64]
    averages: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stretch:
    """Adjacent bins of one level.

    Attributes
    ----------
    turns : ndarray, shape (b,)
        Centres in cycles per sample of the stream, ascending.
    width : float
        Distance of the bins in the same unit.
    power : ndarray, shape (b,) or (axes, b)
        One-sided density in unit^2 samples.
    segments : float
        Segments in the mean.
    """

    turns: Array
    width: float
    power: Array
    segments: float


def assemble(
    stretches: Sequence[Stretch], rate: float, scale: float, per_decade: int | None
) -> Density:
    """Join stretches to one density in unit^2 / Hz, in bands or bin by bin."""
    parts = [_banded(s, per_decade) if per_decade else _single(s) for s in reversed(stretches)]
    if not parts:
        return Density(*(np.empty(0) for _ in range(4)))
    columns = (np.concatenate(column) for column in zip(*parts, strict=True))
    frequency, width, power, averages = columns
    return Density(
        frequency=frequency * rate,
        width=width * rate,
        density=power * scale**2 / rate,
        averages=averages,
    )


def _single(stretch: Stretch) -> tuple[Array, Array, Array, Array]:
    bins = len(stretch.turns)
    worth = independent_averages(stretch.segments, 1.0, alone=True)
    return (
        stretch.turns,
        np.full(bins, stretch.width),
        stretch.power,
        np.full(bins, float(worth)),
    )


def _banded(stretch: Stretch, per_decade: int) -> tuple[Array, Array, Array, Array]:
    """Mean of the bins whose centres fall into each band of a grid that is the same for all."""
    band = np.floor(np.log10(stretch.turns) * per_decade).astype(np.int64)
    first = np.flatnonzero(np.diff(band, prepend=band[0] - 1))
    bins = np.diff(np.append(first, len(band))).astype(np.float64)
    centre = np.add.reduceat(stretch.turns, first) / bins
    power = np.add.reduceat(stretch.power, first) / bins
    joint = independent_averages(stretch.segments, bins)
    alone = independent_averages(stretch.segments, bins, alone=True)
    # The lowest bands of a run have one or two bins and hardly any neighbours to share with.
    averages = np.where(bins < 3, alone, joint)
    return centre, bins * stretch.width, power, averages


def independent_averages(
    segments: NDArray[np.float64] | float, bins: NDArray[np.float64] | float, *, alone: bool = False
) -> NDArray[np.float64]:
    """Return how many independent periodogram ordinates a mean over bins and segments is worth.

    Parameters
    ----------
    segments : float or ndarray
        Segments of half-overlapping Hann windows.
    bins : float or ndarray
        Adjacent bins in the mean.
    alone : bool
        Judge one band by itself. Otherwise what it shares with the bands beside it counts against
        it as well, so that sums over bands, as in a likelihood, have the right variance.

    Returns
    -------
    ndarray
        Effective number; its inverse is the squared relative error of the mean.

    Examples
    --------
    >>> float(independent_averages(1.0, 1.0, alone=True))
    1.0
    >>> round(float(independent_averages(1000.0, 1.0, alone=True)))
    947
    """
    overlap = 1 - 1 / np.maximum(segments, 1.0)
    shared = np.zeros(np.broadcast_shapes(np.shape(segments), np.shape(bins)))
    for lag in range(len(_NEXT)):
        both = (1 if lag == 0 else 2) * (np.maximum(0.0, 1 - lag / bins) if alone else 1.0)
        same = _SAME[lag] if lag < len(_SAME) else 0.0
        shared = shared + both * (same + 2 * overlap * _NEXT[lag])
    return np.asarray(segments * bins / shared)
