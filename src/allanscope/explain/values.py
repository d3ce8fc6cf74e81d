"""The values that occur: their step, and how often rows are equal by chance.

*The step*: the greatest of which all differences are multiples, and how a Gaussian falls onto it.

*Equal rows*: samples on a coarse lattice are often equal, all axes at once the more so where their
noise comes and goes together, or where they sense the same vibration. Rows that lie farther apart
than any run of repeats are equal by nothing but chance, and that in the same lattice, of the same
distribution, with the same ups and downs as neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from allanscope.noise import find_step
from allanscope.optimise import minimise

__all__ = [
    "Coincidence",
    "beyond_runs",
    "counted",
    "noise_on_lattice",
    "step_of",
    "typical_and_limit",
]

Array = NDArray[np.float64]

_SPARSE = 8
"""Room that a table of all codes may have, in samples, before sorting is quicker."""
_WINDOWS = 48
"""Places of a record at which equal neighbours are counted."""
_PARTS = (0.5, 0.0, -0.25)
"""Beside the smallest distance of two codes, what their step may be: each of them is rounded."""
_OFF = 5e-3
"""Distance from a whole count, in counts, that single precision may leave."""
LAGS = 24
"""Distances that are looked at: what neighbours show must be more than any of them does."""
_FAR_SIGMAS = 3.0
"""Standard deviations that no other distance reaches where one row repeats another."""
_FEWEST_EQUAL = 3
"""Equal rows that tell of a dependence; one or two of them are nothing but chance."""
_ALIKE = 2.0
"""Scatter over that of counting which the correlation of the noise may make."""


def step_of(samples: Array, lsb: float) -> float:
    """Return the greatest step of which all differences are multiples, 0 where there is none.

    A sender that rounds to whole mg after scaling leaves a coarser step than the sensor's. Samples
    that are no multiples of the LSB (physical units come with an LSB of 1 for want of a better)
    are asked for a step of their own: numbers printed in dps still lie on the sensor's lattice.

    Examples
    --------
    >>> step_of(np.array([1.0, 1.5, 3.0, 0.5]), lsb=0.25)
    0.5
    """
    if lsb <= 0 or len(samples) < 2:
        return 0.0
    counts = (samples - samples[0]) / lsb
    whole = np.round(counts)
    if np.max(np.abs(counts - whole)) > _OFF or (not whole.any() and counts.any()):
        return find_step(samples)
    codes = counted(whole.astype(np.int64))[0]
    common = int(np.gcd.reduce(codes))
    if common > 1 or len(codes) < 2:
        return float(max(common, 1) * lsb)
    return _uneven_step(codes) * lsb


def counted(codes: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the codes that occur, ascending, and how often each does.

    Counted in a table, which takes a tenth of the time of sorting a long record.

    Examples
    --------
    >>> counted(np.array([7, -2, 7, 0]))
    (array([-2,  0,  7]), array([1, 1, 2]))
    """
    lowest = int(codes.min())
    if int(codes.max()) - lowest > _SPARSE * len(codes):
        return np.unique(codes, return_counts=True)
    seen = np.bincount(codes - lowest)
    occurring = np.flatnonzero(seen)
    return occurring + lowest, seen[occurring]


def _uneven_step(codes: NDArray[np.int64]) -> float:
    """Return the step in counts where a coarser rounding came before the converter's own.

    The codes that occur are then the multiples of some step that is no whole number of counts, each
    rounded: neighbours are alternately, say, 11 and 12 counts apart.
    """
    apart = np.diff(codes)
    smallest = int(apart.min())
    if smallest < 2:
        return 1.0
    # A code in between may be missing: a gap may be of several steps.
    found = [_line_through(codes, smallest + part) for part in _PARTS]
    slope, off = min(found, key=lambda one: one[1])
    return slope if off <= 1.0 else 1.0


def _line_through(codes: NDArray[np.int64], step: float) -> tuple[float, float]:
    """Return the step of codes numbered by about this step, and how far a code is off the line."""
    index = np.concatenate([[0], np.cumsum(np.round(np.diff(codes) / step))])
    slope, start = np.polyfit(index, codes.astype(np.float64), 1)
    return float(slope), float(np.max(np.abs(start + slope * index - codes)))


def noise_on_lattice(samples: Array, step: float) -> float:
    """Return the median standard deviation, in steps, of the noise before it was rounded.

    In each of many short windows mean and deviation are found by maximum likelihood from how often
    each value occurs; a window that holds one value only counts as 0.1.
    """
    length = max(64, min(2000, len(samples) // _WINDOWS))
    starts = np.linspace(0, len(samples) - length, min(_WINDOWS, len(samples) // length)).astype(
        int
    )
    rows = samples[starts[:, np.newaxis] + np.arange(length)]
    windows = np.round((rows - rows[:, :1]) / step)
    found = []
    for codes, variance in zip(windows, windows.var(axis=1).tolist(), strict=True):
        if variance > 1.5**2:
            found.append(float(np.sqrt(max(variance - 1 / 12, 0.01))))
            continue
        values, seen = np.unique(codes, return_counts=True)
        counts = seen.astype(np.float64)
        if len(values) == 1:
            found.append(0.1)
            continue

        def loss(p: Array, values: Array = values, counts: Array = counts) -> float:
            sigma = np.exp(p[1])
            chance = ndtr((values + 0.5 - p[0]) / sigma) - ndtr((values - 0.5 - p[0]) / sigma)
            return float(-np.sum(counts * np.log(np.maximum(chance, 1e-12))))

        first = [codes.mean(), np.log(max(np.sqrt(max(variance - 1 / 12, 0.0)), 0.15))]
        found.append(float(np.exp(minimise(loss, np.array(first)).x[1])))
    return float(np.median(found))


@dataclass(frozen=True, slots=True)
class Coincidence:
    """Equal rows at distances beyond every run of repeats.

    Attributes
    ----------
    dependence : float
        How much more often all axes are equal at once than if each were by itself; 1 at least.
    limit : float
        What it may be at most.
    far : float
        Share of the rows at a distance that are equal on all of them.
    """

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
        columns = np.ascontiguousarray(values.T)
        repeat = np.logical_and.reduce(equal, axis=1)
        single = 1.0 - float(repeat.mean())  # of equal rows, those that are not of the same run
        found, counts = [], []
        for lag in beyond_runs(repeat):
            same = columns[:, lag:] == columns[:, :-lag]
            apart = float(np.prod([np.count_nonzero(own) / same.shape[1] for own in same]))
            together = np.count_nonzero(np.logical_and.reduce(same, axis=0))
            counts.append(together)
            found.append(
                together / same.shape[1] / apart if together * single >= _FEWEST_EQUAL else 0.0
            )
        count = float(sum(counts)) / max(len(counts), 1)
        relative = np.full(len(found), 1.0 / np.sqrt(max(count * single, 1.0)))
        typical, limit = typical_and_limit(np.array(found), relative)
        return cls(max(1.0, typical), max(1.0, limit), count / len(values))


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
        return mean, mean + _FAR_SIGMAS * _ALIKE * max(scatter, counting) / np.sqrt(len(found))
    return mean, float(max(found.max(), mean + _FAR_SIGMAS * scatter))
