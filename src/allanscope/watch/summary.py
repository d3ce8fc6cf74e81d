"""What a second of samples is reduced to: levels, spectra, outliers, repeats.

A stream is cut into blocks of a second's worth of rows, counted from its beginning, so that what is
made of them depends on the samples and not on how reads were cut. The loops over samples and bins
are `compiled/watch.c`, with eight axes side by side: an array of a spectrum is (groups of eight
axes, bins, 8). They give the same to the last bit in every run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Fixed, Pointer, kernel

__all__ = ["FEWEST_ROWS", "LANES", "BlockSummary", "Summariser", "of_axis", "rows_of_block"]

FEWEST_ROWS, MOST_ROWS = 32, 1 << 17
"""Of a block: a stream may claim any rate, and memory goes with it."""
FIRST_BIN = 2
"""Bins below it hold the level, which leaks through the window."""
LANES = 8
"""Axes that the loops take side by side."""

OUTLIER_SIGMAS = 6.0
"""Standard deviations that an outlier is away from the median of five samples about it."""
MEDIAN_TO_SIGMA = 2.04
"""Standard deviation of white noise over the median of its distances from a median of five."""
MOST_OUTLIERS = 0.1
"""Share of the samples of a block above which they are no outliers but other noise."""
START_BLOCKS = 16
"""Blocks in which the spread of an axis is found from medians alone."""
REFERENCE_BLOCKS = 1800
"""Blocks over which references are averaged: half an hour."""
KNOCK_RATIO = 1.6
"""Times its mean from which on the level of a block is taken by itself."""
MOST_RATIO = 5.0
"""Times its reference that the power of a bin may be where it moves the reference."""

_Floats, _Doubles = (Pointer(kind, 3, written=True) for kind in (np.float32, np.float64))
_Pairs = Pointer(np.float32, 2)
_repeats = kernel(
    "watch_repeats", Pointer(np.uint8, 2), int, int, Pointer(np.uint8, 1), returns=int
)
_rows = (Pointer(np.float64, 2), Pointer(np.float64, 2), _Floats, _Doubles)
_rows_int16 = kernel("watch_rows_int16", Pointer(np.int16, 2), int, int, *_rows, returns=int)
_rows_float64 = kernel("watch_rows_float64", Pointer(np.float64, 2), int, int, *_rows, returns=int)
_levels = kernel(
    "watch_levels",
    *(int, int, int, int, float, _Doubles),
    *(Pointer(np.float64, 2, written=True) for _ in range(5)),
)
_spectrum = kernel(
    "watch_spectrum",
    *(int, int, int, int, int, int, float, float, Pointer(np.int32, 3)),
    *(Pointer(np.int64, 1), _Pairs, _Pairs, Pointer(np.int64, 1)),
    *(_Floats, Pointer(np.float32, 2, written=True), _Floats, _Floats),
    Pointer(np.float32, 4, written=True),
)
_noise = kernel(
    "watch_noise",
    *(int, int, int, int, float, float, Pointer(np.bool_, 2), Pointer(np.float32, 4), _Doubles),
    *(Pointer(np.float32, 2, written=True), Pointer(np.float32, 2, written=True)),
    *(Pointer(np.float64, 2, written=True), Pointer(np.float32, 2, written=True)),
)


def rows_of_block(rate_hz: float) -> int:
    """Return the rows of a second at this nominal rate (at 100 Hz where none is claimed).

    >>> rows_of_block(104.0), rows_of_block(1e8)
    (104, 131072)
    """
    return min(max(round(rate_hz or 100.0), FEWEST_ROWS), MOST_ROWS)


def groups_of(axes: int) -> int:
    """Return how many groups of eight so many axes are."""
    return -(-axes // LANES)


def of_axis(spectra: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return what an array (groups, ..., 8) has of one axis; a view."""
    return spectra[axis // LANES, ..., axis % LANES]


@dataclass(frozen=True, slots=True)
class BlockSummary:
    """One block.

    Attributes
    ----------
    level : ndarray of float64, shape (k,)
        Mean without outliers, in counts.
    noise : ndarray of float64, shape (k,)
        3 (r^(1/3) - 1), of the power r against the reference, as a trimmed mean over bands: a line
        is in one or two of them, a change of the noise level in all.
    ratio : ndarray of float32, shape (groups, bins, 8)
        Periodogram (Hann) against its reference; the next block overwrites it.
    scale : ndarray of float32, shape (groups, 8)
        What makes of the ratio one against the noise of this block: exponentially distributed with
        mean 1 as long as nothing changes.
    outliers : ndarray of int64, shape (k,)
        Isolated samples far from their neighbours.
    repeats : int
        Rows that repeat the row before on every axis.
    first : ndarray of int64, shape (k + 1,)
        Row of the first outlier of each axis, and of the first repeat; of no meaning without any.
    """

    level: NDArray[np.float64]
    noise: NDArray[np.float64]
    ratio: NDArray[np.float32]
    scale: NDArray[np.float32]
    outliers: NDArray[np.int64]
    repeats: int
    first: NDArray[np.int64]


class Summariser:
    """Reduce blocks of `rows` rows of `axes` columns, each against a reference that moves slowly.

    Attributes
    ----------
    length : int
        Samples of a block that are transformed.
    bins : int
        Bins of its spectrum that are looked at, from `FIRST_BIN` on.
    power : ndarray of float32, shape (groups, bins, 8)
        Reference: mean periodogram of the last half hour, the squares of Hann-weighted counts.
    """

    def __init__(self, axes: int, rows: int) -> None:
        groups = groups_of(axes)
        self.rows, self._axes = rows, axes
        self.length = 2 * _transform(rows // 2).length
        self.bins = self.length // 2 - FIRST_BIN - 1
        many = min(max(self.bins // 6, 8 if self.bins > 24 else 4), 16)
        self._edges = np.linspace(0, self.bins, many + 1).astype(np.int64)
        self._trim = max(many // 8, 1)
        shape = groups, self.bins, LANES
        self.power = np.zeros(shape, np.float32)
        self._ratio = np.zeros(shape, np.float32)
        self._bands = np.zeros((groups, 2, many, LANES), np.float32)
        self._spread = np.zeros((groups, LANES))
        self._anchor, self._mean, self._level, self._reach = np.zeros((4, groups, LANES))
        self._x = np.zeros((groups, rows, LANES), np.float32)
        self._summed = np.zeros((4, groups, LANES))
        self._noise = np.zeros((groups, LANES))
        self._scale = np.ones((groups, LANES), np.float32)
        self._blocks = 0
        self._last_row: NDArray[np.uint8] | None = None
        plan, room = _transform(self.length // 2), np.zeros((self.length, LANES), np.float32)
        self._of_rows = Fixed(self._reach, self._anchor, self._x, self._summed)
        self._of_wide_rows = Fixed(self._reach, self._anchor, self._x, self._summed)
        self._of_levels = Fixed(
            *(self._summed, self._mean, self._anchor, self._spread, self._level, self._reach)
        )
        self._of_spectrum = Fixed(
            *(plan.radices, plan.turns, plan.halves, self._edges),
            *(self._x, room, self.power, self._ratio, self._bands),
        )
        usual = np.zeros((groups, many, LANES))
        level, rest = np.ones((2, groups, LANES), np.float32)
        self._of_noise = Fixed(self._bands, usual, level, rest, self._noise, self._scale)

    def update(
        self, block: NDArray[Any], held: NDArray[np.int32], other: NDArray[np.bool_]
    ) -> BlockSummary:
        """Reduce a block, then let it move the references.

        Parameters
        ----------
        block : ndarray, shape (rows, axes)
            Samples in counts.
        held : ndarray of int32, shape (groups, bins, 8)
            Bins whose reference stays, -1: a line that is an event must not become normal.
        other : ndarray of bool, shape (groups, 8)
            Axes whose noise is another one by now, which must not become normal either.
        """
        block = np.ascontiguousarray(block)
        repeats, first = self._repeats(block), np.zeros(self._axes + 1, np.int64)
        if repeats:
            again = (block[1:] == block[:-1]).all(axis=1)
            first[-1] = 1 + int(again.argmax()) if np.count_nonzero(again) == repeats else 0
        if block.dtype != np.int16:
            block = block.astype(np.float64)
        if self._blocks == 0:
            self._anchor.ravel()[: self._axes] = np.rint(block[0])
        by_type = (self._of_rows, _rows_int16), (self._of_wide_rows, _rows_float64)
        fixed, loop = by_type[block.dtype != np.int16]
        wide, early = fixed.call(loop, block, *block.shape), self._blocks < START_BLOCKS
        np.divide(self._summed[0], self.rows, out=self._mean)
        outliers = np.zeros(self._axes, np.int64)
        if wide or early:
            self._replace_outliers(outliers, first, self._mean, self._reach)
        memory = min(self._blocks + 1, REFERENCE_BLOCKS)
        self._of_levels.call(_levels, len(self._x), self.rows, early, memory, 0.8 * OUTLIER_SIGMAS)
        level = self._level.ravel()[: self._axes].copy()
        self._transformed(held, other)
        noise = self._noise.ravel()[: self._axes].copy()
        self._blocks += 1
        return BlockSummary(level, noise, self._ratio, self._scale, outliers, repeats, first)

    def _repeats(self, block: NDArray[Any]) -> int:
        rows = block.view(np.uint8)
        last, self._last_row = self._last_row, rows[-1].copy()
        if last is None:
            return int(_repeats(rows[1:], len(rows) - 1, rows.shape[1], rows[0]))
        return int(_repeats(rows, len(rows), rows.shape[1], last))

    def _replace_outliers(
        self,
        found: NDArray[np.int64],
        first: NDArray[np.int64],
        mean: NDArray[np.float64],
        reach: NDArray[np.float64],
    ) -> None:
        """Count the outliers of axes with wide extremes, and put the mean in their place."""
        for axis in range(self._axes):
            at = divmod(axis, LANES)
            middle, summed = float(mean[at]), self._summed[:, *at]
            widest = max(summed[3] - middle, middle - summed[2])
            if self._blocks >= START_BLOCKS and widest <= reach[at]:
                continue
            row = of_axis(self._x, axis)
            x = row - np.float32(middle)
            away = np.abs(x - _median_of_five(x))
            if _is_usual(away):
                continue
            usual = max(MEDIAN_TO_SIGMA * float(np.median(away)), 0.7 * float(self._spread[at]))
            where = away > OUTLIER_SIGMAS * usual
            count = int(np.count_nonzero(where)) if usual > 0.0 else 0
            if 0 < count <= MOST_OUTLIERS * len(row):
                far = row[where].astype(np.float64)
                summed[0] += float(np.sum(middle - far))
                summed[1] += float(np.sum(middle**2 - far**2))
                row[where] = middle
                found[axis], first[axis] = count, int(where.argmax())

    def _transformed(self, held: NDArray[np.int32], other: NDArray[np.bool_]) -> None:
        """Find the ratio of each bin to its reference, and what the noise is.

        The noise without a window, which would throw away half of what a block knows of it.
        """
        gain = 1.0 / min(self._blocks + 1, REFERENCE_BLOCKS)
        most = MOST_RATIO if self._blocks > START_BLOCKS else math.inf
        groups, many, is_first = len(self._x), len(self._edges) - 1, self._blocks == 0
        n = self.length // 2
        steps = len(_transform(n).radices)
        self._of_spectrum.call(
            _spectrum, groups, self.rows, n, steps, FIRST_BIN, many, gain, most, held
        )
        self._of_noise.call(_noise, groups, many, self._trim, is_first, gain, KNOCK_RATIO, other)
        if is_first:
            self._ratio[:] = 1.0


@dataclass(frozen=True, slots=True)
class _Transform:
    """How a transform of a length is taken apart.

    Attributes
    ----------
    length : int
        Complex values.
    radices : ndarray of int64
        Factors of the length.
    turns, halves : ndarray of float32, shape (length, 2)
        exp(-2 pi i k / length), and exp(-pi i k / length).
    """

    length: int
    radices: NDArray[np.int64]
    turns: NDArray[np.float32]
    halves: NDArray[np.float32]


@cache
def _transform(most: int) -> _Transform:
    """Return the longest transform of at most so many values: a product of 2, 3, 4 and 5."""
    length = most
    while (radices := _radices(length)) is None:
        length -= 1
    angle = np.arange(length) / length
    turns, halves = (
        np.ascontiguousarray(np.exp(-2j * math.pi * a)[:, np.newaxis].view(np.float64), np.float32)
        for a in (angle, angle / 2)
    )
    return _Transform(length, np.array(radices, np.int64), turns, halves)


def _radices(length: int) -> list[int] | None:
    found = []
    for radix in (5, 4, 3, 2):
        while length % radix == 0:
            length //= radix
            found.append(radix)
    return found if length == 1 else None


def _is_usual(away: NDArray[np.float32]) -> bool:
    """Return whether the largest is no outlier, by a count: the median itself takes much longer.

    It is none where more than half are so large that it is not `OUTLIER_SIGMAS` of the standard
    deviations that they tell of. Rounding errors of single precision are allowed for.
    """
    enough = float(away.max()) / (OUTLIER_SIGMAS * MEDIAN_TO_SIGMA) * (1.0 + 1e-6)
    return 2 * int(np.count_nonzero(away >= enough)) > len(away)


def _median_of_five(row: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the median of each value and its two neighbours to both sides.

    Examples
    --------
    >>> _median_of_five(np.array([1, 9, 2, 3, 4, 5], np.float32)).tolist()
    [2.0, 3.0, 3.0, 4.0, 4.0, 4.0]
    """
    padded = np.concatenate([row[2:0:-1], row, row[-2:-4:-1]])
    a, b, c, d, e = (padded[i : i + len(row)] for i in range(5))
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c)))
