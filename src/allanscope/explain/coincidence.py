"""How often rows are equal by chance: what rows far from each other show.

Samples on a coarse lattice are often equal, all axes at once the more so where their noise comes
and goes together, or where they hear the same vibration. Rows that lie farther apart than any run
of repeats are equal by nothing but chance, and that in the same lattice, of the same distribution,
with the same ups and downs as neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Coincidence", "beyond_runs", "typical_and_limit"]

Array = NDArray[np.float64]

LAGS = 24
"""Distances that are looked at: what neighbours show must be more than any of them does."""
_SIGMAS = 3.0
_FEWEST = 3
"""Equal rows that tell of a dependence; one or two of them are nothing but chance."""
_ALIKE = 2.0
"""Scatter over that of counting which the correlation of the noise may make."""
_MOVING = 0.9


@dataclass(frozen=True, slots=True)
class Coincidence:
    """Equal rows at distances beyond every run of repeats.

    Attributes
    ----------
    moving : tuple of int
        Columns of which not nearly every row equals the row before.
    dependence : float
        How much more often all of these are equal at once than if each were by itself; 1 at least.
    limit : float
        What it may be at most.
    far : float
        Share of the rows at a distance that are equal on all of them.
    """

    moving: tuple[int, ...]
    dependence: float
    limit: float
    far: float

    @classmethod
    def of(cls, values: Array, equal: NDArray[np.bool_]) -> Coincidence:
        """Count equal rows.

        Parameters
        ----------
        values : ndarray, shape (n, axes)
            The samples.
        equal : ndarray of bool, shape (n - 1, axes)
            Whether a row equals the row before, axis by axis.
        """
        moving = tuple(np.flatnonzero(equal.mean(axis=0) < _MOVING).tolist())
        if len(moving) < 2:
            return cls(moving, 1.0, 1.0, 0.0)
        columns = np.ascontiguousarray(values[:, moving].T)
        repeat = np.logical_and.reduce(equal[:, moving], axis=1)
        single = 1.0 - float(repeat.mean())  # of equal rows, those that are not of the same run
        found, counts = [], []
        for lag in beyond_runs(repeat):
            same = columns[:, lag:] == columns[:, :-lag]
            apart = float(np.prod(same.mean(axis=1)))
            together = np.count_nonzero(np.logical_and.reduce(same, axis=0))
            counts.append(together)
            found.append(together / same.shape[1] / apart if together * single >= _FEWEST else 0.0)
        count = float(sum(counts)) / max(len(counts), 1)
        relative = np.full(len(found), 1.0 / np.sqrt(max(count * single, 1.0)))
        typical, limit = typical_and_limit(np.array(found), relative)
        return cls(moving, max(1.0, typical), max(1.0, limit), count / len(values))


def beyond_runs(repeat: NDArray[np.bool_]) -> range:
    """Return distances at which rows are no repeats of the same row any more.

    Parameters
    ----------
    repeat : ndarray of bool, shape (n - 1,)
        Whether a row equals the row before.

    Examples
    --------
    >>> beyond_runs(np.array([True, True, False] * 10)).start
    4
    """
    bounds = np.flatnonzero(np.concatenate([[True], ~repeat, [True]]))
    runs = np.diff(bounds) - 1
    runs = runs[runs > 0]
    longest = int(runs.max()) if len(runs) else 0
    first = min(longest, len(repeat) // 4) + 2
    return range(first, min(first + LAGS, len(repeat)))


def typical_and_limit(found: Array, relative: Array) -> tuple[float, float]:
    """Return the mean of what several distances show, and what one more must exceed.

    Where they scatter as counting alone makes them, the mean is known far better than each. Where
    they scatter more, some distances are like each other and others are not, as in what repeats
    every few rows: then no distance may show as much.

    Parameters
    ----------
    found : ndarray, shape (k,)
        What each distance shows.
    relative : ndarray, shape (k,)
        Relative standard deviation of each by counting.
    """
    if not len(found):
        return 0.0, 0.0
    mean, scatter = float(found.mean()), float(found.std())
    counting = mean * float(np.sqrt(np.mean(relative**2)))
    if scatter <= _ALIKE * counting:
        return mean, mean + _SIGMAS * _ALIKE * max(scatter, counting) / np.sqrt(len(found))
    return mean, float(max(found.max(), mean + _SIGMAS * scatter))
