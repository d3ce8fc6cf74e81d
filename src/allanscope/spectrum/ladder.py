"""The levels and the low-passes between them: all that a spectrum bank holds of its samples.

A `Level` is one rate of the ladder: Welch's average of windowed, half-overlapping segments.
A `Decimator` is one step down the ladder of rates: a low-pass and every fourth sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.compiled import Pointer, kernel

__all__ = ["FACTOR", "SEGMENT", "TAPS", "Decimator", "Ladder", "Level", "hann", "narrow_columns"]

SEGMENT = 2048
"""Samples in a segment."""
_HOP = SEGMENT // 2
_TOGETHER = 8
"""Segments that are transformed at once, in the lanes of a vector register."""
_SHORTEST = 64
"""Samples from which an unfinished segment is worth looking at."""
_BINS = SEGMENT // 2 + 1
FACTOR = 4
_LENGTH = 48
_STOP_DB = 75.0


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


_TURNS = np.arange(SEGMENT) * (2 * np.pi / SEGMENT)
_WAVES = np.ascontiguousarray(np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1), np.float32)

_periodograms = kernel(
    "periodograms",
    *(Pointer(np.float32, 2), Pointer(np.float32, 2), *(int,) * 5),
    *(Pointer(np.float32, 1), Pointer(np.float32, 2)),
    *(Pointer(np.float32, 1, written=True), Pointer(np.float64, 2, written=True)),
)
"""Add |FFT|^2 / SEGMENT of segments of samples (axes, p), then (axes, n), to power (axes, bins)."""
_narrow_columns_of_int16 = kernel(
    "narrow_columns_of_int16",
    *(Pointer(np.int16, 2), Pointer(np.float64, 1), int, int),
    Pointer(np.float32, 2, written=True),
)


def narrow_columns(samples: NDArray[Any], anchor: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return samples of shape (n, axes) less the anchor of each axis, shape (axes, n).

    Differences from an anchor keep their digits in float32.
    """
    if samples.dtype != np.int16:
        return (samples - anchor).T.astype(np.float32, order="C")
    own = np.ascontiguousarray(samples)
    found = np.empty(own.shape[::-1], np.float32)
    _narrow_columns_of_int16(own, anchor, *found.shape, found)
    return found


def _after(
    before: NDArray[np.float32], samples: NDArray[np.float32], start: int
) -> NDArray[np.float32]:
    """Return a copy of what two pieces (axes, ...) hold from a sample on."""
    if start >= before.shape[1]:
        return samples[:, start - before.shape[1] :].copy()
    return np.concatenate([before[:, start:], samples], axis=1)


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
        if self._waiting + samples.shape[1] < SEGMENT:
            self._parts.append(samples)
            self._waiting += samples.shape[1]
            return
        before, samples = self.pending, np.ascontiguousarray(samples)
        sizes = *before.shape, samples.shape[1]
        segments = (self._waiting + samples.shape[1] - SEGMENT) // _HOP + 1
        room = np.empty(2 * _TOGETHER * SEGMENT, np.float32)
        _periodograms(before, samples, *sizes, segments, _HOP, _WINDOW, _WAVES, room, self.power)
        self.count += segments
        self.pending = _after(before, samples, segments * _HOP)

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
        from scipy.fft import rfft  # not to begin with: a segment of another length is rare

        spectra = rfft(self.pending * hann(length), axis=1, norm="ortho")
        return np.asarray(np.abs(spectra) ** 2, np.float64)


class Ladder:
    """Levels 0, 1, 2, ... at 1, 1/4, 1/16, ... of the rate; one more when a sample reaches it.

    Parameters
    ----------
    axes : int
        Rows of the samples.
    """

    def __init__(self, axes: int) -> None:
        self.axes = axes
        self.levels: list[Level] = []
        self.decimators: list[Decimator] = []

    def push(self, samples: NDArray[np.float32], depth: int = 0) -> None:
        """Take contiguous samples of one level, shape (axes, n)."""
        while samples.shape[1]:
            self.grow(depth + 1)
            self.levels[depth].push(samples)
            samples = self.decimators[depth].push(samples)
            depth += 1

    def join(self, low: Ladder, above: NDArray[np.float32]) -> None:
        """Go on with low levels that have passed a piece elsewhere, and what came out above them.

        Parameters
        ----------
        low : Ladder
            Its levels as one pass has them at the end of the piece, with the sums of the piece.
        above : ndarray, shape (axes, n)
            Samples for the level above.
        """
        self.grow(len(low.levels))
        for depth, theirs in enumerate(low.levels):
            mine = self.levels[depth]
            mine.power += theirs.power
            mine.count += theirs.count
            mine.pending = theirs.pending
            self.decimators[depth].rest = low.decimators[depth].rest
        self.push(above, len(low.levels))

    def clear(self) -> None:
        """Give up every unfinished segment: a gap follows."""
        for level in self.levels:
            level.clear()
        for decimator in self.decimators:
            decimator.clear()

    def merge(self, other: Ladder) -> None:
        """Add what another ladder has averaged; what was unfinished here is dropped."""
        self.clear()
        self.grow(len(other.levels))
        for mine, theirs in zip(self.levels, other.levels, strict=False):
            mine.power += theirs.power
            mine.count += theirs.count

    def grow(self, levels: int) -> None:
        """Make sure that there are so many levels."""
        while len(self.levels) < levels:
            self.levels.append(Level(self.axes))
            self.decimators.append(Decimator(self.axes))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything as plain arrays, those of all levels side by side."""
        pending = [level.pending for level in self.levels]
        rests = [decimator.rest for decimator in self.decimators]
        none = np.empty((self.axes, 0), np.float32)
        return {
            "count": np.array([level.count for level in self.levels], np.int64),
            "power": np.array([level.power for level in self.levels]).reshape(-1, self.axes, _BINS),
            "pending": np.concatenate([none, *pending], axis=1),
            "pending_sizes": np.array([part.shape[1] for part in pending], np.int64),
            "rest": np.concatenate([none, *rests], axis=1),
            "rest_sizes": np.array([part.shape[1] for part in rests], np.int64),
        }

    def restore(self, arrays: Mapping[str, ArrayLike]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            Where the arrays do not fit together.
        """
        count = np.array(arrays["count"], np.int64)
        power = np.array(arrays["power"], np.float64)
        if power.shape != (len(count), self.axes, _BINS) or np.any(count < 0):
            raise ValueError("state of a spectrum is damaged: power and count are inconsistent")
        if not np.all(np.isfinite(power)):
            raise ValueError("state of a spectrum is damaged: its powers are not finite")
        pending = self._split(arrays, "pending", len(count))
        rests = self._split(arrays, "rest", len(count))
        self.grow(len(count))
        for i, level in enumerate(self.levels):
            level.power, level.count, level.pending = power[i], int(count[i]), pending[i]
            self.decimators[i].rest = rests[i]

    def _split(
        self, arrays: Mapping[str, ArrayLike], name: str, parts: int
    ) -> list[NDArray[np.float32]]:
        joined = np.array(arrays[name], np.float32)
        sizes = np.array(arrays[f"{name}_sizes"], np.int64)
        sound = sizes.shape == (parts,) and np.all((sizes >= 0) & (sizes < SEGMENT))
        if not sound or joined.shape != (self.axes, sizes.sum()):
            raise ValueError(f"state of a spectrum is damaged: {name!r} has another size")
        return [part.copy() for part in np.split(joined, np.cumsum(sizes)[:-1], axis=1)][:parts]


def _design() -> NDArray[np.float32]:
    """Windowed sinc with its edge at half the new Nyquist band and 75 dB beyond (Kaiser, 1974).

    Flat to 5e-4 in power up to 0.3 of the new rate, closed from 0.7 of it on: what folds onto the
    band in between, which is not used, may be wrong.
    """
    beta = 0.1102 * (_STOP_DB - 8.7)
    at = np.arange(_LENGTH) - (_LENGTH - 1) / 2
    taps = np.sinc(at / FACTOR) * np.kaiser(_LENGTH, beta)
    return np.asarray(taps / taps.sum(), np.float32)


TAPS = _design()


_decimate = kernel(
    "decimate",
    *(Pointer(np.float32, 2), Pointer(np.float32, 2), Pointer(np.float32, 1), *(int,) * 4),
    Pointer(np.float32, 2, written=True),
)
"""Low-pass samples (axes, p), then (axes, n), with the taps and keep one output of four."""


class Decimator:
    """Low-pass and keep every fourth sample, as a stream; nothing comes out of half-filled taps.

    Parameters
    ----------
    axes : int
        Number of rows.

    Examples
    --------
    >>> Decimator(1).push(np.ones((1, 56), np.float32)).round(3).tolist()
    [[1.0, 1.0, 1.0]]
    """

    def __init__(self, axes: int) -> None:
        self.rest = np.empty((axes, 0), np.float32)

    def push(self, samples: NDArray[np.float32]) -> NDArray[np.float32]:
        """Take contiguous samples, shape (axes, n), and return what comes out of them."""
        samples = np.ascontiguousarray(samples)
        axes, rest = self.rest.shape
        count = max(0, (rest + samples.shape[1] - _LENGTH) // FACTOR + 1)
        out = np.empty((axes, count), np.float32)
        _decimate(self.rest, samples, TAPS, axes, rest, samples.shape[1], count, out)
        self.rest = _after(self.rest, samples, FACTOR * count)
        return out

    def clear(self) -> None:
        """Forget what is half filtered: a gap follows."""
        self.rest = self.rest[:, :0].copy()
