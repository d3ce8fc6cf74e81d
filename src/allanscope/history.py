"""The bounded memory of a run: block means at a stride that doubles whenever the room is full.

A night at 6.66 kHz does not fit in memory, but what is slow in it does: drifts, steps, warm-ups,
temperature, the low end of the spectrum. A History keeps the means of `stride` consecutive samples
of every axis. It starts with stride 1, and when its rows are used up it averages them in pairs and
doubles the stride, so that it never holds more than `rows` of them and always covers the whole run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["History", "Record"]


@dataclass(frozen=True, slots=True)
class Record:
    """What a History holds at one moment, in physical units.

    Attributes
    ----------
    rate_hz : float
        Rows per second: the true sample rate over `stride`.
    stride : int
        Samples averaged into each row.
    axes : tuple of str
        Names of the columns.
    values : ndarray of float64, shape (n, k)
        Row means in dps or g. No row spans a gap.
    lsb : tuple of float
        Step of the samples (not of the means) of each column.
    temperature_c : ndarray of float64, shape (n,)
        Mean temperature of each row; NaN where there was none.
    start_s : ndarray of float64, shape (n,)
        Time of the beginning of each row since the start of the run, holes included.
    segments : ndarray of int64, shape (s, 2)
        Half-open ranges of rows that are contiguous in time.
    filled : ndarray of bool, shape (n,), or None
        Rows that were not measured but drawn to bridge a short gap (`noise.bridging`).
    """

    rate_hz: float
    stride: int
    axes: tuple[str, ...]
    values: NDArray[np.float64]
    lsb: tuple[float, ...]
    temperature_c: NDArray[np.float64]
    start_s: NDArray[np.float64]
    segments: NDArray[np.int64]
    filled: NDArray[np.bool_] | None = None

    def between(self, begin_s: float, end_s: float = np.inf) -> Record:
        """Return the rows that begin within a stretch of time and do not reach beyond it."""
        first = int(np.searchsorted(self.start_s, begin_s))
        last = int(np.searchsorted(self.start_s, end_s - 1.0 / self.rate_hz, side="right"))
        rows = slice(first, max(first, last))
        segments = np.clip(self.segments, rows.start, rows.stop) - first
        return replace(
            self,
            values=self.values[rows],
            temperature_c=self.temperature_c[rows],
            start_s=self.start_s[rows],
            segments=segments[segments[:, 1] > segments[:, 0]],
            filled=None if self.filled is None else self.filled[rows],
        )

    def coarsened(self, most: int) -> Record:
        """Return the means of 2, 4, 8 ... rows each, so many that at most `most` of them are left.

        As in a History, no row spans a gap, and rows at the end of a segment that fill no new one
        are given up.

        Examples
        --------
        >>> history = History(axes=1, rows=8)
        >>> history.update(np.array([[1], [3], [5], [7], [9], [11]], np.int16))
        >>> record = history.record(104.0, ("gx",), (1.0,)).coarsened(3)
        >>> record.stride, record.rate_hz, record.values.ravel().tolist()
        (2, 52.0, [2.0, 6.0, 10.0])
        """
        each = 1
        while len(self.values) > most * each:
            each *= 2
        if each == 1:
            return self
        whole = (self.segments[:, 1] - self.segments[:, 0]) // each
        ends = np.cumsum(whole)
        within = np.arange(whole.sum()) - np.repeat(ends - whole, whole)
        first = np.repeat(self.segments[:, 0], whole) + each * within
        values = self.values[first]
        for further in range(1, each):
            values += self.values[first + further]
        rows = first[:, np.newaxis] + np.arange(each)
        kept = np.column_stack([ends - whole, ends])
        return replace(
            self,
            rate_hz=self.rate_hz / each,
            stride=self.stride * each,
            values=values / each,
            temperature_c=_mean(self.temperature_c[rows]),
            start_s=self.start_s[first],
            segments=kept[whole > 0],
            filled=None if self.filled is None else self.filled[rows].any(axis=1),
        )


class History:
    """Keep the row means of a stream in at most `rows` rows.

    Parameters
    ----------
    axes : int
        Number of columns.
    rows : int
        Most rows ever held; even.

    Examples
    --------
    >>> history = History(axes=1, rows=4)
    >>> history.update(np.array([[1], [3], [5], [7], [9], [11]], np.int16))
    >>> history.stride, history.means().ravel().tolist()
    (2, [2.0, 6.0, 10.0])
    """

    def __init__(self, axes: int, rows: int = 1 << 20) -> None:
        if axes < 1 or rows < 2 or rows % 2:
            raise ValueError(f"need axes >= 1 and an even number of rows, got {axes} and {rows}")
        self.axes = axes
        self.rows = rows
        self.stride = 1
        self._sums = np.zeros((min(rows, 1 << 14), axes))
        self._temperature = np.full(self._sums.shape[0], np.nan)
        self._position = np.zeros(self._sums.shape[0], np.int64)
        self._segment = np.zeros(self._sums.shape[0], np.int64)
        self._used = 0
        self._rest = np.empty((0, axes))
        self._rest_temperature = np.empty(0)
        self._next = 0
        self._gaps = 0

    def update(self, counts: ArrayLike, temperature_c: ArrayLike | None = None) -> None:
        """Take the next samples.

        Parameters
        ----------
        counts : array_like, shape (n, axes)
            Samples.
        temperature_c : array_like, shape (n,), optional
            Temperature at each of them.
        """
        counts = np.asarray(counts)
        if counts.ndim == 1:
            counts = counts[:, np.newaxis]
        if temperature_c is None:
            temperature = np.full(len(counts), np.nan)
        else:
            temperature = np.asarray(temperature_c, np.float64)
        taken = 0
        while taken < len(counts):
            if self._used == self.rows:
                self._halve()
            room = (self.rows - self._used) * self.stride - len(self._rest)
            stop = taken + room
            self._append(counts[taken:stop], temperature[taken:stop])
            taken = stop

    def gap(self, lost: int | None = None) -> None:
        """Mark a hole of `lost` samples (0 when unknown): no row spans it."""
        self._next += len(self._rest) + (lost or 0)
        self._rest = self._rest[:0]
        self._rest_temperature = self._rest_temperature[:0]
        self._gaps += 1

    def means(self) -> NDArray[np.float64]:
        """Return the row means in counts, shape (n, axes)."""
        return self._sums[: self._used] / self.stride

    def record(
        self, sample_rate_hz: float, axes: tuple[str, ...], scale: tuple[float, ...]
    ) -> Record:
        """Return what is held now, in physical units."""
        segment = self._segment[: self._used]
        starts = np.flatnonzero(np.diff(segment, prepend=-1))
        bounds = np.append(starts, self._used)
        return Record(
            rate_hz=sample_rate_hz / self.stride,
            stride=self.stride,
            axes=axes,
            values=self.means() * np.asarray(scale),
            lsb=scale,
            temperature_c=self._temperature[: self._used].copy(),
            start_s=self._position[: self._used] / sample_rate_hz,
            segments=np.column_stack([bounds[:-1], bounds[1:]]).astype(np.int64),
        )

    def _append(self, counts: NDArray[np.generic], temperature: NDArray[np.float64]) -> None:
        counts = np.concatenate([self._rest, counts]) if len(self._rest) else counts
        temperature = np.concatenate([self._rest_temperature, temperature])
        whole = len(counts) // self.stride
        end = whole * self.stride
        if whole:
            self._grow(self._used + whole)
            new = slice(self._used, self._used + whole)
            self._sums[new] = (
                counts[:end].reshape(whole, self.stride, self.axes).sum(axis=1, dtype=np.float64)
            )
            self._temperature[new] = _mean(temperature[:end].reshape(whole, self.stride))
            self._position[new] = self._next + self.stride * np.arange(whole)
            self._segment[new] = self._gaps
            self._used += whole
            self._next += end
        self._rest = counts[end:].astype(np.float64)
        self._rest_temperature = temperature[end:].copy()

    def _grow(self, needed: int) -> None:
        have = len(self._sums)
        if needed <= have:
            return
        size = min(self.rows, max(needed, 2 * have))
        for name in ("_sums", "_temperature", "_position", "_segment"):
            old = getattr(self, name)
            new = np.zeros((size, *old.shape[1:]), old.dtype)
            new[:have] = old
            setattr(self, name, new)

    def _halve(self) -> None:
        """Average neighbours of one segment in pairs; a row without a neighbour is given up."""
        segment = self._segment[: self._used]
        first = np.flatnonzero(np.diff(segment, prepend=-1))
        within = np.arange(self._used) - np.repeat(first, np.diff(np.append(first, self._used)))
        left = np.flatnonzero((within[:-1] % 2 == 0) & (segment[:-1] == segment[1:]))
        kept = len(left)
        self._sums[:kept] = self._sums[left] + self._sums[left + 1]
        self._temperature[:kept] = _mean(
            np.column_stack([self._temperature[left], self._temperature[left + 1]])
        )
        self._position[:kept] = self._position[left]
        self._segment[:kept] = segment[left]
        open_row = self._used - 1 if within[-1] % 2 == 0 and segment[-1] == self._gaps else None
        if open_row is not None:
            # The last row of the running segment is half of the next one: hand it back as samples.
            mean = self._sums[open_row] / self.stride
            self._rest = np.concatenate([np.tile(mean, (self.stride, 1)), self._rest])
            self._rest_temperature = np.concatenate(
                [np.full(self.stride, self._temperature[open_row]), self._rest_temperature]
            )
            self._next = int(self._position[open_row])
        self._used = kept
        self.stride *= 2


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the last axis of what is not NaN; NaN where nothing is."""
    seen = np.isfinite(values)
    count = seen.sum(axis=-1)
    total = np.where(seen, values, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
