"""Take the rows of a shock out of an axis, so that the spectrum has no gap there.

The level before is drawn through them to the level after, with noise like that beside them on it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from allanscope.explain.shock_rows import ShockRows

__all__ = ["LONGEST_PULSE_S", "MARGIN_S", "extent_of", "quiet_rows", "shaken_rows", "with_pulse"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MARGIN_S = 0.3
"""Before and after what is loud, taken out too."""
_BLOCKS = 10
"""Blocks before a shock that tell how loud noise is by chance."""
_ALIKE_ROWS, _ALIKE_SIZES = 50, 4
"""Rows that are compared to go on from them, and how far back, in lengths of what is missing."""
_AT_A_TIME = 100_000
"""Windows that are compared at a time."""
LONGEST_PULSE_S, _AWAY = 2.5, 4.0
"""A level that comes back so soon after the first row of a shock is part of it, where it was away
by so many standard errors of the means of blocks."""
_LEVELS = 3.0
"""Standard errors from which the levels before and after a shock differ."""
_ROBUST = 1.19
"""Variance of the mean of the middle half of Gaussian noise over that of the mean of all."""


def with_pulse(data: Array, shaken: ShockRows, rate_hz: float) -> ShockRows:
    """Return a shock until the level of an axis is that from before it, if that comes back soon.

    Other axes, on which it was found, may be quiet before.
    """
    size = int(np.ceil(MARGIN_S * rate_hz))
    before = data[max(0, shaken.first - (_BLOCKS + 1) * size) : max(0, shaken.first - size)]
    if len(before) < _BLOCKS * size:
        return shaken
    means = before.reshape(_BLOCKS, size).mean(axis=1)
    level, most = float(means.mean()), _AWAY * float(means.std(ddof=1))
    last = min(shaken.first + int(LONGEST_PULSE_S * rate_hz), len(data) - size)
    for row in range(shaken.stop, last, size):
        if abs(float(data[row : row + size].mean()) - level) < most:
            return replace(shaken, stop=row)
    return shaken


def extent_of(data: Array, shaken: ShockRows, rate_hz: float) -> tuple[int, int]:
    """Return the first row of an axis that a shock takes with it, and the one after the last."""
    margin = int(np.ceil(MARGIN_S * rate_hz))
    first = max(0, shaken.first - margin)
    stop = shaken.stop + _tail(data, first, shaken.stop, margin) + margin
    return first, min(len(data), stop)


def shaken_rows(
    shocks: Iterable[ShockRows], besides: ShockRows, rows: int, rate_hz: float
) -> Flags:
    """Tell which of so many rows the shocks besides one may take with them."""
    margin = int(np.ceil(MARGIN_S * rate_hz))
    found = np.zeros(rows, bool)
    for one in shocks:
        if one.stop <= besides.first or besides.stop <= one.first:
            found[max(0, one.first - margin) : one.stop + 2 * margin] = True
    return found


def quiet_rows(
    data: Array, first: int, stop: int, sigma: float, shaken: Flags
) -> tuple[Array, Array]:
    """Return the level from before to after with noise on it, and the level alone.

    The level is straight; where it is clearly another one afterwards it changes in the middle, so
    that one step is all there is left of it. The noise goes on from before and leads to what comes
    after: a line in it must not break off. It is none of `shaken`, the rows of other shocks.
    """
    size = stop - first
    sides = slice(max(0, first - size), first), slice(stop, stop + size)
    rest = [quiet if len(quiet := data[s][~shaken[s]]) else data[s] for s in sides]
    ends = [_level(side) for side in rest if len(side)]
    level = np.linspace(ends[0], ends[-1], size)
    counts = [len(side) for side in rest if len(side)]
    error = sigma * float(np.sqrt(sum(_ROBUST / count for count in counts)))
    if abs(ends[-1] - ends[0]) > _LEVELS * error:
        level = np.where(np.arange(size) < size // 2, ends[0], ends[-1])
    onward = _continued(data[:first], shaken[:first], size)
    back = _continued(data[stop:][::-1], shaken[stop:][::-1], size)
    turn = np.pi / 2 * (np.arange(size) + 0.5) / size
    if onward is not None and back is not None:
        noise = np.cos(turn) * onward + np.sin(turn) * back[::-1]  # the power stays
    elif onward is not None:
        noise = onward
    elif back is not None:
        noise = back[::-1]
    else:
        both = np.concatenate(rest)
        noise = np.resize(both - _level(both), size)
    return np.asarray(level + noise), level


def _level(rows: Array) -> float:
    """Return the mean of the middle half of some rows.

    A median of coarse values is one of them, and goes a whole step where the level hardly moves.
    """
    cut = len(rows) // 4
    return float(np.mean(np.sort(rows)[cut : len(rows) - cut]))


def _continued(rows: Array, shaken: Flags, size: int) -> Array | None:
    """Return rows that go on from some, taken from where these were most alike before."""
    reach = _ALIKE_SIZES * size + _ALIKE_ROWS
    near, loud = rows[-reach:], shaken[-reach:]
    if len(near) < size + 2 * _ALIKE_ROWS:
        return None
    near = near - _level(near[-size - _ALIKE_ROWS :])
    windows = sliding_window_view(near[:-size], _ALIKE_ROWS)
    parts = np.array_split(windows, len(windows) // _AT_A_TIME + 1)  # each copies its windows
    apart = np.concatenate([np.sum((part - near[-_ALIKE_ROWS:]) ** 2, axis=1) for part in parts])
    before = np.concatenate([[0], np.cumsum(loud)])
    taken = slice(_ALIKE_ROWS, _ALIKE_ROWS + len(apart))
    apart[before[taken.start + size : taken.stop + size] > before[taken]] = np.inf
    begin = int(np.argmin(apart))
    if apart[begin] == np.inf:
        return None
    return near[begin + _ALIKE_ROWS : begin + _ALIKE_ROWS + size]


def _tail(data: Array, first: int, stop: int, size: int) -> int:
    """Return the rows for which a shock rings on below what is loud, in blocks of a size.

    A ringing falls: each block is louder than all of those before the shock, and quieter than the
    last one. Slopes are the level's.
    """
    begins = range(max(first % size, first - _BLOCKS * size), first, size)
    quiet = max((_loudness(data[i : i + size]) for i in begins), default=np.inf)
    rows, last = 0, np.inf
    while stop + rows + size <= len(data):
        loud = _loudness(data[stop + rows : stop + rows + size])
        if not quiet < loud < last:
            break
        rows, last = rows + size, loud
    return rows


def _loudness(rows: Array) -> float:
    """Return the mean square of rows about a straight line."""
    time = np.arange(len(rows)) - (len(rows) - 1) / 2
    rest = rows - rows.mean()
    return float(np.mean((rest - time * (time @ rest) / max(time @ time, 1.0)) ** 2))
