"""The Hann window, and how much its overlapping, leaking segments have in common.

Segments of a white record windowed with w and shifted by half their length have Fourier ordinates
that are correlated: with the neighbours of the same segment, because the window widens every line,
and with the next segment, because half of the samples are the same. The squared correlations tell
how many independent ordinates a mean over segments and bins is worth (Welch, IEEE Trans. AU-15,
1967; Percival and Walden, 1993, section 6.17).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["hann", "independent_averages"]


def hann(length: int) -> NDArray[np.float32]:
    """Return the periodic Hann window with a mean square of 1.

    Examples
    --------
    >>> hann(4) ** 2 * 3
    array([0., 2., 8., 2.], dtype=float32)
    """
    window = 1 - np.cos(2 * np.pi * np.arange(length) / length)
    return np.asarray(window / np.sqrt(np.mean(window**2)), np.float32)


_SAME = (1.0, (2 / 3) ** 2, (1 / 6) ** 2)
"""Squared correlation of ordinates 0, 1 and 2 bins apart in one segment; zero beyond."""
_NEXT = (1 / 36, 0.020014, 1 / 144, 0.000801)
"""The same between a segment and the next one, half a segment on."""


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
