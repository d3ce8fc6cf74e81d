"""Scans of two devices, gyroscope and accelerometer of one part, joined by their times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Numbering", "pair", "period_of"]

_SLOW = 256
"""Samples over which the period is averaged."""


def pair(
    times: NDArray[np.int64], others: NDArray[np.int64], period_ns: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the places in both of the scans that were taken within half a period of each other.

    Parameters
    ----------
    times, others : ndarray of int64, shapes (n,) and (m,)
        Times in ns, ascending.
    period_ns : float

    Examples
    --------
    >>> pair(np.array([0, 10, 20]), np.array([1, 21, 31]), 10.0)
    (array([0, 2]), array([0, 1]))
    """
    half = np.int64(period_ns / 2)
    found = np.searchsorted(others, times - half)
    there = found < len(others)
    there[there] = others[found[there]] - times[there] < half
    mine = np.flatnonzero(there)
    return mine, found[mine]


def period_of(times: NDArray[np.int64], nominal_ns: float = 0.0) -> float:
    """Return the usual step of times in ns; the nominal one where they are too few to tell."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) >= 8 else nominal_ns


class Numbering:
    """Numbers samples by their times: where a step is of several periods, samples are missing.

    Parameters
    ----------
    nominal_ns : float
        Period that the driver claims. These parts are off by several per cent: what is measured
        replaces it, so that the number of samples in a long gap is right as well.
    """

    def __init__(self, nominal_ns: float) -> None:
        self._period_ns = nominal_ns
        self._measured = 0
        self._last_ns: int | None = None
        self._next = 0

    def runs(self, times: NDArray[np.int64]) -> list[tuple[int, slice]]:
        """Return the number of the first sample of each run without a gap, and where the run is.

        Raises
        ------
        ValueError
            If the times go back: losses are unknown.
        """
        if not len(times):
            return []
        steps = np.diff(times, prepend=times[0] if self._last_ns is None else self._last_ns)
        first = int(self._last_ns is None)
        if len(steps) > first and steps[first:].min() <= 0:
            raise ValueError("times that go back")
        if self._measured == 0:
            self._period_ns = period_of(times, self._period_ns)
        periods = np.ones(len(steps), np.int64)
        if self._period_ns > 0.0:
            periods = np.maximum(np.rint(steps / self._period_ns).astype(np.int64), 1)
        single = steps[first:][periods[first:] == 1]
        if len(single):
            self._measured = min(self._measured + len(single), _SLOW)
            share = min(len(single) / self._measured, 1.0)
            self._period_ns += share * (float(single.mean()) - self._period_ns)
        numbers = self._next - 1 + np.cumsum(periods)
        starts = np.flatnonzero(np.r_[True, periods[1:] > 1])
        ends = np.r_[starts[1:], len(times)]
        self._last_ns, self._next = int(times[-1]), int(numbers[-1]) + 1
        return [
            (int(numbers[start]), slice(int(start), int(end)))
            for start, end in zip(starts, ends, strict=True)
        ]
