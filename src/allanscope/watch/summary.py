"""What a second of samples is reduced to: levels, spectra, outliers, repeats.

A stream is cut into blocks of a second's worth of rows, counted from its beginning, so that what is
made of them depends on the samples and not on how reads were cut. Everything is plain numpy on
arrays of one shape, and therefore the same to the last bit in every run on a machine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import next_fast_len, prev_fast_len, rfft

__all__ = ["FEWEST_ROWS", "BlockSummary", "Summariser", "rows_of_block"]

FEWEST_ROWS = 32
FIRST_BIN = 2
"""Bins below it hold the level, which leaks through the window."""

OUTLYING = 6.0
"""Standard deviations that an outlier is away from the median of five samples about it."""
OF_MEDIAN = 2.04
"""Standard deviation of white noise over the median of its distances from a median of five."""
BURST = 0.1
"""Share of the samples of a block above which they are no outliers but other noise."""
FIRST_BLOCKS = 16
"""Blocks in which the spread of an axis is found from medians alone."""
TINY = np.float32(1e-20)
MEMORY = 1800
"""Blocks over which references are averaged: half an hour."""


def rows_of_block(rate_hz: float) -> int:
    """Return the rows of a second at this nominal rate (at 100 Hz where none is claimed)."""
    return max(round(rate_hz or 100.0), FEWEST_ROWS)


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
    ratio : ndarray of float32, shape (k, bins)
        Periodogram (Hann) against its reference and against the noise of this block: exponentially
        distributed with mean 1 as long as nothing changes.
    outliers : ndarray of int64, shape (k,)
        Isolated samples far from their neighbours.
    repeats : int
        Rows that repeat the row before on every axis.
    """

    level: NDArray[np.float64]
    noise: NDArray[np.float64]
    ratio: NDArray[np.float32]
    outliers: NDArray[np.int64]
    repeats: int


class Summariser:
    """Reduce blocks of `rows` rows of `axes` columns, each against a reference that moves slowly.

    Attributes
    ----------
    power : ndarray of float32, shape (axes, bins)
        Reference: mean periodogram of the last half hour, the squares of Hann-weighted counts.
    """

    def __init__(self, axes: int, rows: int) -> None:
        self.rows = rows
        self._length = rows if rows == next_fast_len(rows, real=True) else prev_fast_len(rows, True)
        self.length = max(self._length, FEWEST_ROWS)
        self.bins = self.length // 2 - FIRST_BIN - 1
        many = min(max(self.bins // 6, 8 if self.bins > 24 else 4), 16)
        self._bands = np.linspace(0, self.bins, many + 1).astype(np.int64)[:-1]
        self._widths = np.diff(np.append(self._bands, self.bins)).astype(np.float32)
        self._trim = max(many // 8, 1)
        self.power = np.zeros((axes, self.bins), np.float32)
        self._band_log = np.zeros((axes, many))
        self._spread = np.zeros(axes)
        self._blocks = 0
        self._last_row: NDArray[Any] | None = None

    def take(
        self, block: NDArray[Any], held: NDArray[np.bool_], other: NDArray[np.bool_]
    ) -> BlockSummary:
        """Reduce a block, then let it move the references.

        Parameters
        ----------
        block : ndarray, shape (rows, axes)
            Samples in counts.
        held : ndarray of bool, shape (axes, bins)
            Bins whose reference stays: a line that is an event must not become normal.
        other : ndarray of bool, shape (axes,)
            Axes whose noise is another one by now, which must not become normal either.
        """
        columns = np.ascontiguousarray(block.T)
        repeats = self._repeats(columns)
        mean = columns.mean(axis=1, dtype=np.float64)
        x = (columns - mean[:, np.newaxis]).astype(np.float32)
        outliers = self._outliers(x)
        rest = x.mean(axis=1, dtype=np.float64)
        spectrum = rfft(x[:, : self.length], axis=1)
        noise = self._noise(_squares(spectrum[:, FIRST_BIN : FIRST_BIN + self.bins]), other)
        ratio = self._ratio(_squares(_hann(spectrum, FIRST_BIN, self.bins)), held)
        self._blocks += 1
        return BlockSummary(mean + rest, noise, ratio, outliers, repeats)

    def _repeats(self, columns: NDArray[Any]) -> int:
        same = np.ones(columns.shape[1] - 1, np.bool_)
        for column in columns:
            same &= column[1:] == column[:-1]
        first = self._last_row is not None and bool((columns[:, 0] == self._last_row).all())
        self._last_row = columns[:, -1].copy()
        return int(np.count_nonzero(same)) + first

    def _outliers(self, x: NDArray[np.float32]) -> NDArray[np.int64]:
        """Count outliers and set them to zero; looks closely only where the extremes are wide."""
        found = np.zeros(len(x), np.int64)
        widest = np.maximum(x.max(axis=1), -x.min(axis=1))
        early = self._blocks < FIRST_BLOCKS
        for axis in np.flatnonzero(early | (widest > 0.8 * OUTLYING * self._spread)):
            row = x[axis]
            away = np.abs(row - _median_of_five(row))
            usual = max(OF_MEDIAN * float(np.median(away)), 0.7 * float(self._spread[axis]))
            if usual == 0.0:
                continue
            where = away > OUTLYING * usual
            count = int(np.count_nonzero(where))
            if 0 < count <= BURST * len(row):
                row[where] = 0.0
                found[axis] = count
        gain = 1.0 / min(self._blocks + 1, MEMORY)
        spread = np.sqrt(np.mean(np.square(x), axis=1, dtype=np.float64))
        calm = spread if early else np.minimum(spread, 1.5 * self._spread)
        self._spread += gain * (calm - self._spread)
        return found

    def _noise(self, power: NDArray[np.float32], other: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the power of each axis against its reference, without the bands far off.

        Without a window, which would throw away half of what a block knows of its noise.
        """
        means = np.add.reduceat(power, self._bands, axis=1) / self._widths
        bands = np.log(means.astype(np.float64) + TINY)
        if self._blocks == 0:
            self._band_log[:] = bands
        away = bands - self._band_log
        # The cube root of a power is as good as normal (Wilson and Hilferty), its log is lopsided.
        root = 3.0 * np.expm1(away / 3.0)
        move = np.clip(away, -2.0, 2.0) / min(self._blocks + 1, MEMORY)
        move[other] = 0.0
        self._band_log += move
        return np.asarray(np.sort(root, axis=1)[:, self._trim : -self._trim].mean(axis=1))

    def _ratio(self, power: NDArray[np.float32], held: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Return the power of each bin against its reference and the level of this block."""
        if self._blocks == 0:
            self.power[:] = power
        ratio = power / (self.power + TINY)
        level = np.median(ratio, axis=1) / np.float32(math.log(2.0))
        move = np.minimum(power, 5.0 * self.power) if self._blocks > FIRST_BLOCKS else power
        move = move - self.power
        move[held] = 0.0
        self.power += move * np.float32(1.0 / min(self._blocks + 1, MEMORY))
        return np.asarray(ratio / np.maximum(level, np.float32(0.05))[:, np.newaxis])


def _squares(spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
    return np.asarray(spectrum.real**2 + spectrum.imag**2)


def _hann(spectrum: NDArray[np.complex64], first: int, many: int) -> NDArray[np.complex64]:
    """Return bins of the transform as it were with a Hann window: a sum of three neighbours."""
    middle = spectrum[:, first : first + many]
    beside = spectrum[:, first - 1 : first + many - 1] + spectrum[:, first + 1 : first + many + 1]
    return np.asarray(np.float32(0.5) * middle - np.float32(0.25) * beside)


def _median_of_five(row: NDArray[np.float32]) -> NDArray[np.float32]:
    padded = np.concatenate([row[2:0:-1], row, row[-2:-4:-1]])
    return np.asarray(np.median(sliding_window_view(padded, 5), axis=1), np.float32)
