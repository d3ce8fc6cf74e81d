"""Where the board is moved: carried to another place, turned over, or not yet laid down.

That lasts longer than a shock, and a running median follows it. So blocks of about a second are
compared with what blocks of the record usually are. A block in which the board moves scatters by
many times more, and its mean jumps against those of its neighbours: vibration leaves the means
where they are, noise that is louder lets them scatter as its rows do over the root of their number,
and a level that jumps does not scatter. More than one axis moves: a level that hops all the time
does so alone. Pauses of some seconds belong to it, and what lies between it and an end of the
record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.median import median

__all__ = ["Blocks", "MovedRows", "blocks_of", "find_moved_rows"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_BLOCK_S, _BLOCK_ROWS = 1.0, 8
"""Length of a block, and the rows that it has at the least."""
_FEWEST = 60
"""Blocks of a record that tell what is usual."""
_LOUD = 6.0
"""Times what is usual, of a block in which an axis moves."""
_WHITE, _TURNS = 2.0, 0.6
"""Standard errors of white noise, and deviations of its rows, beyond which means of blocks jump by
more than such noise."""
_ANY, _MEAN, _BESIDE = 4.5, 2.5, 2.0
"""The same where other axes tell when: of the loudest block, of the mean of all, and of the scatter
of blocks beside them, which belong to it."""
_AXES = 2
"""Axes that move together."""
_PAUSE_S, _SHORTEST_S = 5.0, 8.0
"""Longest pause, and the shortest motion: what is over sooner is a shock."""
_SHORTEST_ROWS, _SLOW_HZ = 4, 5.0
"""Shortest motion below a rate at which no shocks are looked for: rows so far apart are white."""
_LOUD_SHARE = 0.5
"""Blocks of a motion in which the board moves, at the least."""
_MOST, _MOST_MOTIONS = 0.25, 12
"""Share of the rows in motion, and number of motions, beyond which the record is not at rest."""


@dataclass(frozen=True)
class MovedRows:
    """Rows in which the board is moved.

    Attributes
    ----------
    first, stop : int
        First row, and the one after the last.
    sigma : mapping
        Axis that is moved to the standard deviation of its rows in quiet.
    """

    first: int
    stop: int
    sigma: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of an axis, each against what is usual.

    Attributes
    ----------
    size : int
        Rows in a block; rows beyond the last whole one are in none.
    scatter : ndarray, shape (blocks,)
        Standard deviation of the rows of each, over the median of all.
    jumps : ndarray, shape (blocks,)
        Larger one of the distances of its mean from those of its neighbours, over the median of
        all.
    turns : ndarray of bool, shape (blocks,)
        Whether the mean jumps by more than that of white noise.
    sigma : float
        Median of the standard deviations, no less than half a step of the values.
    """

    size: int
    scatter: Array
    jumps: Array
    turns: Flags
    sigma: float

    @property
    def loud(self) -> Flags:
        """Whether the axis moves in each."""
        return np.asarray(self.turns & (self.scatter > _LOUD))


def blocks_of(rows: Array, rate_hz: float, step: float) -> Blocks | None:
    """Return the blocks of an axis in steps of `step`; None of a record that is too short."""
    size = max(_BLOCK_ROWS, int(np.ceil(_BLOCK_S * rate_hz)))
    number = len(rows) // size
    if number < _FEWEST:
        return None
    blocks = rows[: number * size].reshape(number, size)
    scatter, means = blocks.std(axis=1), blocks.mean(axis=1)
    sigma = max(median(scatter), 0.5 * step)
    if sigma <= 0:
        return None
    jumps = np.abs(np.diff(means))
    usual = max(median(jumps), sigma / np.sqrt(size))
    jumps = np.maximum(np.append(jumps, 0.0), np.append(0.0, jumps))
    white = 0.0 if rate_hz < _SLOW_HZ else min(_WHITE * np.sqrt(2 / size), _TURNS)
    turns = jumps > white * scatter
    return Blocks(size, scatter / sigma, jumps / usual, turns, sigma)


def find_moved_rows(
    axes: Mapping[str, tuple[Array, Blocks | None]], rate_hz: float
) -> list[MovedRows]:
    """Return where the board is moved, the first one first.

    Parameters
    ----------
    axes : mapping
        Axis to its rows and their blocks.
    rate_hz : float
        Rows per second.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> rows = rng.standard_normal((2, 30_000))
    >>> rows[:, 9_000:11_000] += 100 * np.sin(np.arange(2_000) / 40)
    >>> axes = {name: (x, blocks_of(x, 100.0, 0.0)) for name, x in zip("xy", rows)}
    >>> [(one.first, one.stop) for one in find_moved_rows(axes, 100.0)]
    [(9002, 11000)]
    """
    known = {axis: (x, blocks) for axis, (x, blocks) in axes.items() if blocks is not None}
    if not known:
        return []
    size = next(blocks.size for _, blocks in known.values())
    total = len(next(iter(known.values()))[0])
    many = np.sum([blocks.loud for _, blocks in known.values()], axis=0)
    loud = np.flatnonzero(many >= _AXES)
    scatter = np.max([blocks.scatter for _, blocks in known.values()], axis=0)
    quiet = np.flatnonzero(scatter < _BESIDE)
    pause = _PAUSE_S * rate_hz
    shortest = _SHORTEST_ROWS if rate_hz < _SLOW_HZ else _SHORTEST_S * rate_hz
    found: list[MovedRows] = []
    for part in np.split(loud, np.flatnonzero(np.diff(loud) > max(2.0, pause / size)) + 1):
        if not len(part) or len(part) < _LOUD_SHARE * (part[-1] + 1 - part[0]):
            continue
        before, after = quiet[quiet < part[0]], quiet[quiet > part[-1]]
        first = int(before[-1]) + 1 if len(before) else 0
        last = int(after[0]) - 1 if len(after) else len(many) - 1
        one = _motion(known, first, last, pause)
        is_new = not found or found[-1].stop <= one.first
        if is_new and one.stop - one.first >= shortest:
            found.append(one)
    rows = sum(one.stop - one.first for one in found)
    return [] if rows > _MOST * total or len(found) > _MOST_MOTIONS else found


def _motion(
    axes: Mapping[str, tuple[Array, Blocks]], first: int, last: int, pause: float
) -> MovedRows:
    """Return the motion that some blocks show, to the row."""
    sigma, spans = {}, []
    part = slice(first, last + 1)
    for axis, (x, blocks) in axes.items():
        both = blocks.scatter[part], blocks.jumps[part]
        if all(one.max() < _ANY and one.mean() < _MEAN for one in both):
            continue
        sigma[axis] = blocks.sigma
        spans.append(_span(x, blocks, first, last))
    total = len(next(iter(axes.values()))[0])
    begin, stop = min(span[0] for span in spans), max(span[1] for span in spans)
    return MovedRows(0 if begin < pause else begin, total if total - stop < pause else stop, sigma)


def _span(x: Array, blocks: Blocks, first: int, last: int) -> tuple[int, int]:
    """Return the first row of an axis that is off the level before, and the one after the last."""
    size, total = blocks.size, len(x)
    begin, stop = first * size, (last + 1) * size
    early = _off(x, blocks, begin) if begin >= 3 * size else 0
    late = _off(x[::-1], blocks, total - stop) if stop + 3 * size <= total else 0
    return begin - early, stop + late


def _off(x: Array, blocks: Blocks, begin: int) -> int:
    """Return how many rows before one the first row is that is off the level before; it may follow.

    It lies in the block before or in the next one. The level is that of the block before these, and
    drifts.
    """
    size = blocks.size
    level = median(x[begin - 2 * size : begin - size])
    drift = abs(level - median(x[begin - 3 * size : begin - 2 * size]))
    near = np.abs(x[begin - size : begin + size] - level)
    off = near > _LOUD * max(blocks.sigma, drift)
    return size - int(np.argmax(off)) if off.any() else 0
