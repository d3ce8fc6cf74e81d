"""The whole run in at most 8192 rows: what estimators need that no running sum can give.

MTOT, TTOT, HTOT and the Theo family bend, reflect or weight the record by its own length, so they
are evaluated when asked. They matter at long tau, where the record has few independent pieces, and
there it may be thinned: a row is a stretch of `stride` samples, summed (u) and summed twice (v),

    u = y[0] + ... + y[s-1],     v = sum of the running sums before each sample,

from which the phase at its start (`picked`) and averaged over it (`averaged`) follow exactly. When
the rows are used up neighbours are joined, ``u = u1 + u2, v = v1 + v2 + s2 u1``, and the stride
doubles. Up to 8192 samples the stride is 1 and nothing is lost. No row spans a gap; what is left of
a segment after its last full row is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.kernels import rows_of
from allanscope.compiled import Pointer, kernel

__all__ = ["ROWS", "Archive"]

Floats = NDArray[np.float64]

ROWS = 8192
"""Most rows held: 128 KiB an axis."""


class Archive:
    """Rows (u, v) of every axis at a stride that doubles whenever the room is full.

    The stride is the least power of two at which all full rows of all segments fit, so it does not
    depend on the order in which runs are merged.

    Parameters
    ----------
    axes : int
        Number of axes.
    rows : int
        Most rows ever held; even.

    Attributes
    ----------
    stride : int
        Samples in a row.
    starts : list of int
        First row of each segment; the last one is open and may be empty.

    Examples
    --------
    >>> archive = Archive(axes=1, rows=4)
    >>> archive.extend(np.arange(10.0)[:, np.newaxis])
    >>> archive.stride, archive.sums.tolist()
    (4, [[[6.0, 22.0], [4.0, 28.0]]])
    >>> [phase.tolist() for phase in archive.picked(0)]
    [[0.0, 6.0, 28.0]]
    """

    def __init__(self, axes: int, rows: int = ROWS) -> None:
        self.axes = axes
        self.stride = 1
        self.used = 0
        self.filled = 0
        self.starts = [0]
        self.rows = np.zeros((axes, 2, rows))
        self.part = np.zeros((axes, 2))

    @property
    def sums(self) -> Floats:
        """The rows in use, (u, v), shape (axes, 2, used)."""
        return self.rows[:, :, : self.used]

    def extend(self, samples: NDArray[Any], anchor: Floats | None = None) -> None:
        """Take in the next samples, shape (n, axes), which lie above the anchor of each axis."""
        samples = rows_of(samples)
        zero = np.zeros(self.axes) if anchor is None else anchor
        if not samples.shape[1:] == zero.shape == (self.axes,):
            raise ValueError(f"{self.axes} axes take as many columns, got {samples.shape}")
        summarise = _summarise[samples.dtype.name]
        done = 0
        while done < len(samples):
            # One sample less than completes a row for which there is no room.
            room = (self.rows.shape[2] - self.used + 1) * self.stride - 1 - self.filled
            if room == 0:
                self.thin()
                continue
            piece = samples[done : done + room]
            summarise(piece, zero, self.axes, len(piece), *self._rows())
            done += len(piece)
            full, self.filled = divmod(self.filled + len(piece), self.stride)
            self.used += full

    def join(self, block_sums: Floats, length: int) -> None:
        """Go on with sums of blocks of `length` samples, shape (axes, k, 2 or more), (u, v) first.

        Rows become at least as long as a block, which a power of two and the number of samples
        of the open segment must be multiples of.
        """
        while self.stride < length:
            self.thin()
        block_sums = np.ascontiguousarray(block_sums, np.float64)
        done = 0
        while done < block_sums.shape[1]:
            room = ((self.rows.shape[2] - self.used + 1) * self.stride - 1 - self.filled) // length
            if room == 0:
                self.thin()
                continue
            size = min(room, block_sums.shape[1] - done)
            _add_block_sums(block_sums, *block_sums.shape, done, size, length, *self._rows())
            done += size
            full, self.filled = divmod(self.filled + size * length, self.stride)
            self.used += full

    def gap(self) -> None:
        """Begin a new segment."""
        self.filled = 0
        self.part[:] = 0.0
        if self.starts[-1] != self.used:
            self.starts.append(self.used)

    def thin(self) -> None:
        """Join rows in pairs within each segment and double the stride."""
        begin = np.array(self.starts)
        length = np.diff(np.append(begin, self.used))
        left = np.concatenate(
            [np.arange(b, b + n - 1, 2) for b, n in zip(begin, length, strict=True)]
        )
        if length[-1] % 2:
            # The last row is the first half of the one that is being filled.
            last = self.rows[:, :, self.used - 1]
            self.part = _joined(last, self.part, self.filled)
            self.filled += self.stride
        self.rows[:, :, : left.size] = _joined(
            self.rows[:, :, left], self.rows[:, :, left + 1], self.stride
        )
        self.used = left.size
        self.stride *= 2
        pairs = length // 2
        keep = pairs > 0
        keep[-1] = True
        self.starts = (np.cumsum(pairs) - pairs)[keep].tolist()

    def merge(self, other: Archive) -> None:
        """Add the segments of another archive; both end here."""
        theirs = other.copy()
        self.gap()
        theirs.gap()
        while self.stride != theirs.stride or self.used + theirs.used > self.rows.shape[2]:
            (self if self.stride <= theirs.stride else theirs).thin()
        end = self.used + theirs.used
        self.rows[:, :, self.used : end] = theirs.sums
        self.starts = self.starts[:-1] + [self.used + start for start in theirs.starts]
        self.used = end

    def copy(self) -> Archive:
        """Return an independent copy."""
        copy = Archive.__new__(Archive)
        copy.__dict__.update(self.__dict__)
        copy.rows, copy.part, copy.starts = self.rows.copy(), self.part.copy(), self.starts.copy()
        return copy

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything that changes, by name."""
        return {
            "archive": np.array([self.stride, self.used, self.filled], np.int64),
            "starts": np.array(self.starts, np.int64),
            "rows": self.rows,
            "part": self.part,
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what `arrays` returned; ValueError when that does not fit together."""
        stride, used, filled = arrays["archive"].tolist()
        starts = arrays["starts"].tolist()
        fits = arrays["rows"].shape == self.rows.shape and arrays["part"].shape == self.part.shape
        power = stride > 0 and stride & (stride - 1) == 0
        ascending = starts[:1] == [0] and starts == sorted(set(starts)) and starts[-1] <= used
        if not (
            fits and power and ascending and used <= self.rows.shape[2] and 0 <= filled < stride
        ):
            raise ValueError("state of a bank is damaged: its archive is inconsistent")
        self.stride, self.used, self.filled, self.starts = stride, used, filled, starts
        self.rows, self.part = arrays["rows"], arrays["part"]

    def picked(self, axis: int) -> list[Floats]:
        """Return the phase of each segment at the borders of its rows, in data x samples."""
        return [np.append(0.0, np.cumsum(u)) for u, _ in self.segments(axis)]

    def averaged(self, axis: int) -> list[Floats]:
        """Return the phase of each segment averaged over each row; exact phase at stride 1."""
        if self.stride == 1:
            return self.picked(axis)
        return [np.cumsum(u) - u + v / self.stride for u, v in self.segments(axis)]

    def drift(self) -> Floats:
        """Return the slope of a straight line through the rates, per sample, shape (axes,).

        Each segment has its own level, all share the slope. Nought for fewer than two rows.
        """
        slopes = np.zeros(self.axes)
        for axis in range(self.axes):
            product = square = 0.0
            for u, _ in self.segments(axis):
                time = self.stride * (np.arange(u.size) - (u.size - 1) / 2)
                product += float(time @ u) / self.stride
                square += float(time @ time)
            slopes[axis] = product / square if square > 0 else 0.0
        return slopes

    def mean_second_differences(self, m: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Return the slope of the rate as OAVAR and MVAR see it at each m, shape (axes, k).

        Mean of ``(x[i] - 2 x[i+m] + x[i+2m]) / m^2`` over i, and of its mean over m neighbours;
        the slope of `drift` where m is no multiple of a row or no segment is long enough.
        """
        slope = self.drift()
        plain = np.repeat(slope[:, np.newaxis], m.size, axis=1)
        modified = plain.copy()
        rows, part = np.divmod(m, self.stride)
        for axis in range(self.axes):
            phases = self.picked(axis)
            for t in np.flatnonzero(part == 0).tolist():
                k = int(rows[t])
                second = [
                    x[2 * k :] - 2.0 * x[k:-k] + x[: -2 * k] for x in phases if x.size > 2 * k
                ]
                terms = sum(one.size for one in second)
                if terms == 0:
                    continue
                square = float(m[t]) ** 2  # beyond int64 at the longest
                plain[axis, t] = sum(float(one.sum()) for one in second) / (terms * square)
                sums = [np.cumsum(np.append(0.0, one)) for one in second if one.size >= k]
                windows = [one[k:] - one[:-k] for one in sums]
                count = sum(one.size for one in windows) * k
                if count:
                    total = sum(float(one.sum()) for one in windows)
                    modified[axis, t] = total / (count * square)
        return plain, modified

    def _rows(self) -> tuple[Any, ...]:
        """Return the rows as loops take them."""
        return self.rows, self.rows.shape[2], self.used, self.part, self.filled, self.stride

    def segments(self, axis: int) -> list[Floats]:
        """Return the rows (u, v) of each segment, shape (2, rows)."""
        return np.split(self.sums[axis], self.starts[1:], axis=1)


def _joined(first: Floats, second: Floats, count: int) -> Floats:
    """Return (u, v) of two neighbours, shape (axes, 2, ...), the second of `count` samples."""
    joined = first + second
    joined[:, 1] += count * first[:, 0]
    return joined


_ROWS = (Pointer(np.float64, 3, written=True), int, int)
_PART = (Pointer(np.float64, 2, written=True), int, int)
_summarise = {
    name: kernel(
        *(f"archive_summarise_{name}", Pointer(kind, 2), Pointer(np.float64, 1), int, int),
        *(*_ROWS, *_PART),
    )
    for name, kind in (("int16", np.int16), ("float64", np.float64))
}
"""Fill rows from samples, shape (n, axes)."""
_add_block_sums = kernel("archive_add_blocks", Pointer(np.float64, 3), *(int,) * 6, *_ROWS, *_PART)
"""Fill rows from sums (u, v, ...) of blocks; their length divides `stride` and `filled`."""
