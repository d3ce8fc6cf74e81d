"""One rate of the ladder: Welch's average of windowed, half-overlapping segments."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import rfft

from allanscope.compiled import njit

__all__ = ["SEGMENT", "Level", "hann"]

SEGMENT = 2048
"""Samples in a segment."""
_HOP = SEGMENT // 2
_TOGETHER = 8
"""Segments that are transformed in one call: few enough for the second-level cache."""
_SHORTEST = 64
"""Samples from which an unfinished segment is worth looking at."""


def hann(length: int) -> NDArray[np.float32]:
    """Return the periodic Hann window with a mean square of 1.

    Examples
    --------
    >>> hann(4) ** 2 * 3
    array([0., 2., 8., 2.], dtype=float32)
    """
    window = 1 - np.cos(2 * np.pi * np.arange(length) / length)
    return np.asarray(window / np.sqrt(np.mean(window**2)), np.float32)


_WINDOW = hann(SEGMENT)


@njit(cache=True, nogil=True)
def _add_squares(spectra: NDArray[np.complex64], power: NDArray[np.float64]) -> None:
    """Add |z|^2 of spectra (axes, segments, bins) to power (axes, bins)."""
    for axis in range(spectra.shape[0]):
        for segment in range(spectra.shape[1]):
            for k in range(spectra.shape[2]):
                z = spectra[axis, segment, k]
                power[axis, k] += z.real * z.real + z.imag * z.imag


class Level:
    """Sum of periodograms of everything that has passed at one rate.

    Attributes
    ----------
    power : ndarray of float64, shape (axes, SEGMENT // 2 + 1)
        Sum of |FFT|^2 / SEGMENT over all segments.
    count : int
        Segments in it.
    """

    def __init__(self, axes: int) -> None:
        self.power = np.zeros((axes, SEGMENT // 2 + 1))
        self.count = 0
        self._parts = [np.empty((axes, 0), np.float32)]
        self._waiting = 0

    @property
    def pending(self) -> NDArray[np.float32]:
        """Samples of the segment that is not complete yet, shape (axes, p), p < SEGMENT."""
        return np.concatenate(self._parts, axis=1)

    @pending.setter
    def pending(self, samples: NDArray[np.float32]) -> None:
        self._parts = [samples]
        self._waiting = samples.shape[1]

    def push(self, samples: NDArray[np.float32]) -> None:
        """Take contiguous samples, shape (axes, n)."""
        self._parts.append(samples)
        self._waiting += samples.shape[1]
        if self._waiting < SEGMENT:
            return
        joined = self.pending
        segments = (self._waiting - SEGMENT) // _HOP + 1
        frames = sliding_window_view(joined, SEGMENT, axis=1)[:, ::_HOP]
        for first in range(0, segments, _TOGETHER):
            windowed = frames[:, first : first + _TOGETHER] * _WINDOW
            _add_squares(rfft(windowed, axis=2, norm="ortho", overwrite_x=True), self.power)
        self.count += segments
        self.pending = joined[:, segments * _HOP :].copy()

    def clear(self) -> None:
        """Give up the unfinished segment: a gap follows."""
        self.pending = self._parts[0][:, :0].copy()

    def unfinished(self) -> NDArray[np.float64] | None:
        """Return the periodogram of the unfinished segment alone, shape (axes, p // 2 + 1).

        None where it is too short to say anything.
        """
        length = self._waiting
        if length < _SHORTEST:
            return None
        spectra = rfft(self.pending * hann(length), axis=1, norm="ortho")
        return np.asarray(np.abs(spectra) ** 2, np.float64)
