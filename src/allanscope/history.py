"""The bounded memory of a run: block means at a stride that doubles whenever the room is full.

A night at 6.66 kHz does not fit in memory, but what is slow in it does: drifts, steps, warm-ups,
temperature, the low end of the spectrum. A History keeps the means of `stride` consecutive samples
of every axis. It starts with stride 1, and when its rows are used up it averages them in pairs and
doubles the stride, so that it never holds more than `rows` of them and always covers the whole run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.compiled import Pointer, kernel

__all__ = ["History", "Record"]


_ROWS = (
    *(int, Pointer(np.float64, 1), int, int, int),
    *(Pointer(np.float64, 1, written=True), int),
    *(Pointer(np.float64, 2, written=True), Pointer(np.float64, 1, written=True)),
)
_rows_of_int16 = kernel("history_rows_int16", Pointer(np.int16, 2), *_ROWS)
"""Sum samples (n, axes) up in rows of `stride` each.

Parameters
----------
samples : ndarray, shape (n, axes)
n : int
temperature_c : ndarray of float64, shape (n,) or (0,)
temperatures : int
    How many there are.
axes, stride : int
part : ndarray of float64, shape (axes + 3,)
    The row that is not complete: its sums; the first of its temperatures, by how much the others
    lie above it, together, and how many there were. Equal temperatures have no other mean.
filled : int
    Samples in it.
sums : ndarray of float64, shape (k, axes)
    Receives the rows that are complete.
means : ndarray of float64, shape (k,)
    Receives their temperatures; NaN of a row without any.
"""
_rows_of_float64 = kernel("history_rows_float64", Pointer(np.float64, 2), *_ROWS)

_halved = kernel(
    "history_halve",
    *(Pointer(np.float64, 2), Pointer(np.float64, 1), Pointer(np.int64, 1), Pointer(np.int64, 1)),
    *(int, int),
    *(Pointer(np.float64, 2, written=True), Pointer(np.float64, 1, written=True)),
    *(Pointer(np.int64, 1, written=True), Pointer(np.int64, 1, written=True)),
    returns=int,
)
"""Join rows (sums, temperature, position, segment) of a segment in pairs; return how many."""

_sums_of = kernel(
    "history_sums",
    *(Pointer(np.float64, 2), Pointer(np.int64, 1), int, int, int),
    Pointer(np.float64, 2, written=True),
)
"""Sum as many rows (n, axes) up from each of some rows on."""

_FIRST_ROWS = 1 << 14
"""Rows that there is room for at first: most runs that are tried are short."""
_TABLE = ("_sums", "_temperature", "_position", "_segment")


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
        Time of the beginning of each row since the start of the run, gaps included.
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
        are dropped.

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
        held = np.ascontiguousarray(self.values)
        values = np.empty((len(first), held.shape[1]))
        _sums_of(held, first, len(first), each, held.shape[1], values)
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
        first = min(rows, _FIRST_ROWS)
        self._sums = np.empty((first, axes))
        self._temperature = np.empty(first)
        self._position = np.empty(first, np.int64)
        self._segment = np.empty(first, np.int64)
        self._used = 0
        self._part = np.zeros(axes + 3)
        """The row that is not complete, of `_filled` samples so far: see `_rows_of`."""
        self._filled = 0
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
        samples = np.asarray(counts)
        if samples.ndim == 1:
            samples = samples[:, np.newaxis]
        kind = np.int16 if samples.dtype == np.int16 else np.float64
        samples = np.ascontiguousarray(samples, kind)
        if samples.shape[1:] != (self.axes,):
            raise ValueError(f"need samples of shape (n, {self.axes}), got {samples.shape}")
        temperature = np.empty(0)
        if temperature_c is not None:
            temperature = np.ascontiguousarray(temperature_c, np.float64)
            if len(temperature) != len(samples):
                raise ValueError(f"{len(temperature)} temperatures of {len(samples)} samples")
        taken = 0
        while taken < len(samples):
            if self._used == self.rows:
                self._halve()
            stop = taken + (self.rows - self._used) * self.stride - self._filled
            self._append(samples[taken:stop], temperature[taken:stop])
            taken = stop

    def gap(self, lost: int | None = None) -> None:
        """Mark a gap of `lost` samples (0 when unknown): no row spans it."""
        self._next += self._filled + (lost or 0)
        self._filled = 0
        self._part[:] = 0.0
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

    def _append(self, samples: NDArray[Any], temperature: NDArray[np.float64]) -> None:
        have = self._filled + len(samples)
        whole = have // self.stride
        self._grow(self._used + whole)
        new = slice(self._used, self._used + whole)
        rows_of = _rows_of_int16 if samples.dtype == np.int16 else _rows_of_float64
        rows_of(
            *(samples, len(samples), temperature, len(temperature), self.axes, self.stride),
            *(self._part, self._filled, self._sums[new], self._temperature[new]),
        )
        after = self._next + self.stride * whole
        self._position[new] = np.arange(self._next, after, self.stride)
        self._segment[new] = self._gaps
        self._used += whole
        self._next = after
        self._filled = have % self.stride

    def _grow(self, needed: int) -> None:
        """Make room for rows that come."""
        if needed > len(self._sums):
            old, new = self._table(), self._empty_table()
            for name, held, room in zip(_TABLE, old, new, strict=True):
                room[: self._used] = held[: self._used]
                setattr(self, name, room)

    def _table(self) -> list[NDArray[Any]]:
        return [getattr(self, name) for name in _TABLE]

    def _empty_table(self) -> list[NDArray[Any]]:
        """Return room for all rows there ever are: what is not written to takes no memory."""
        return [np.empty((self.rows, *old.shape[1:]), old.dtype) for old in self._table()]

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs: no rows that are not in use."""
        return vars(self) | {name: getattr(self, name)[: self._used] for name in _TABLE}

    def _halve(self) -> None:
        """Average neighbours of one segment in pairs; a row without a neighbour is given up."""
        last = self._used - 1
        first = int(np.searchsorted(self._segment[: self._used], self._segment[last]))
        if self._segment[last] == self._gaps and (last - first) % 2 == 0:
            # The last row of the running segment is half of the next one.
            mean = self._temperature[last]
            known = (0.0, 0.0, 0.0) if np.isnan(mean) else (mean, 0.0, self.stride)
            self._part[:] = *self._sums[last], *known
            self._filled = self.stride
            self._next = int(self._position[last])
        new = self._empty_table()
        self._used = _halved(*self._table(), self._used, self.axes, *new)
        vars(self).update(zip(_TABLE, new, strict=True))
        self.stride *= 2


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the last axis of what is not NaN; NaN where nothing is."""
    seen = np.isfinite(values)
    count = seen.sum(axis=-1)
    total = np.where(seen, values, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
