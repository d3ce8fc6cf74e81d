"""Losses told by time stamps alone.

Stock firmware numbers nothing, but it stamps every sample with its clock. The stamp is taken when
the sample was read, which is up to a polling loop late; so it is not the step between two stamps
that is compared with the period, but each stamp with the time that the samples before predict. A
sample that is late is followed by one that is not; a sample that is missing shifts all that follow
by a whole period.

A jump is believed only when the next stamp bears it out.

The period is the mean over up to 8192 samples. When stamps scatter by s periods and it was taken
from n samples, its relative error is 2 s / n at most; a hole of m samples can be counted while m
times that is below a quarter. What is longer is left without a number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Pacer", "mean_rate", "period_of", "resolution_of", "rows_come_in_bursts"]

_MEMORY = 8192
_PULL = 1 / 8
_FEWEST_STEPS = 4
_FIRST_TRUST = 16
_LEAST_SCATTER = 0.02
_NEARBY = 8.5
_FINEST = 1e-6
_BURSTY = 1.25
"""Mean step over median step from which rows may come in bursts."""
_FEWEST_BURSTS, _LONGEST_BURST = 4, 64
_REGULAR = 0.5
"""Relative scatter of the time from burst to burst; that between random losses is 1."""


def period_of(times: Sequence[float]) -> float | None:
    """Return the period of samples at given times, some of which may be missing.

    The mean of the steps near the median or zero; None when there are too few, or when more than a
    fifth of the steps are far from the median, so that there is no period to speak of.

    >>> period_of([0.0, 0.01, 0.02, 0.03, 0.08, 0.09, 0.1])
    0.01
    >>> period_of([0.0, 0.0, 0.0, 0.04, 0.04, 0.04, 0.08]) is None
    True
    """
    steps = np.diff(np.asarray(times, np.float64))
    if len(steps) < _FEWEST_STEPS or not np.isfinite(steps).all():
        return None
    median = float(np.median(steps))
    if median <= 0.0:
        return None
    whole = (steps > 0.4 * median) & (steps < 1.5 * median)
    if whole.mean() < 0.8:
        return None
    # Short steps stay in: coarse stamps have some, and the mean is right only with them.
    near = whole | (np.abs(steps) < 0.5 * median)
    return float(np.round(steps[near].mean(), 12))


def mean_rate(times: Sequence[float] | NDArray[np.float64]) -> float:
    """Return rows over time, in Hz; 0 where the times are too few or do not go on.

    Where rows come in bursts it is from the beginning of one burst to that of another: the part of
    a burst at the end would count for a whole one. Of a long record it is the median over half of
    it, which neither one wrong stamp nor one hole carries.

    >>> mean_rate([0.0, 0.002, 0.004, 0.02, 0.022, 0.024, 0.04, 0.042])
    150.0
    """
    stamps = np.asarray(times, np.float64)
    stamps = stamps[np.isfinite(stamps)]
    if len(stamps) < 2:
        return 0.0
    steps = np.diff(stamps)
    begins = np.flatnonzero(np.concatenate([[True], steps > 1.5 * np.median(steps)]))
    if len(begins) <= _FEWEST_BURSTS // 2:
        begins = np.arange(len(stamps))
    half = len(begins) // 2 if len(begins) >= 4 * _LONGEST_BURST else len(begins) - 1
    spans = stamps[begins[half:]] - stamps[begins[:-half]]
    rows = begins[half:] - begins[:-half]
    if not spans.min() > 0.0:
        return 0.0
    return float(f"{np.median(rows / spans):.10g}")


def rows_come_in_bursts(times: Sequence[float] | NDArray[np.float64]) -> bool:
    """Return whether stamps tell when rows were passed on, some at a time, not when they were made.

    Then the steps within a burst are far shorter than the period, and those between bursts are no
    losses. Bursts follow each other regularly, and rows over time is the same everywhere. Where
    samples are lost at random, or a reader stops now and then, neither is so.

    >>> rows_come_in_bursts([0.05 * (i // 5) + 0.002 * (i % 5) for i in range(100)])
    True
    >>> rows_come_in_bursts([0.01 * i for i in range(100)])
    False
    """
    stamps = np.asarray(times, np.float64)
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    if len(steps) < 2 * _FEWEST_BURSTS or steps.min() < 0.0:
        return False
    median = float(np.median(steps))
    if median <= 0.0 or steps.mean() < _BURSTY * median:
        return False
    ends = np.flatnonzero(steps > 1.5 * median)
    if len(ends) < _FEWEST_BURSTS or len(steps) > _LONGEST_BURST * len(ends):
        return False
    cycles = np.diff(stamps[ends])
    if len(cycles) < _FEWEST_BURSTS - 1 or cycles.std() > _REGULAR * cycles.mean():
        return False
    number = np.arange(len(stamps))
    off = stamps - np.polyval(np.polyfit(number, stamps - stamps[0], 1), number) - stamps[0]
    return bool(np.ptp(off) <= 2.0 * steps.max() + cycles.mean())


def resolution_of(times: Sequence[float]) -> float:
    """Return the step of a clock, in whole microseconds, as far as its stamps give it away.

    It is what all steps are multiples of, provided that they differ by less than a period: the
    stamps of an even stream are multiples of the period whatever the clock.

    >>> resolution_of([1.00, 1.02, 1.04, 1.05])
    0.01
    >>> resolution_of([1.00, 1.02, 1.04, 1.08])
    1e-06
    """
    steps = np.diff(np.asarray(times, np.float64))
    if len(steps) == 0 or not np.isfinite(steps).all():
        return _FINEST
    microseconds = np.abs(np.round(steps * 1e6)).astype(np.int64)
    period = max(int(np.median(microseconds)), 1)
    even = microseconds.min() > 0 and not (microseconds % period).any()
    return _FINEST if even else max(float(np.gcd.reduce(microseconds)) / 1e6, _FINEST)


class Pacer:
    """Follow the time stamps of a stream and count what is missing between them.

    Parameters
    ----------
    period_s : float
        First idea of the period, from `period_of`.
    resolution_s : float
        Step of the stamps. Where it is more than 0.6 periods a single
        missing sample does not show: holes are found, by the stamps or by the damage that made
        them, but not counted.
    scatter : float
        How far stamps are from even, in periods.
    """

    def __init__(self, period_s: float, resolution_s: float = 0.0, scatter: float = 0.5) -> None:
        self._countable = resolution_s <= 0.6 * period_s
        self._reach = min(1.0 / (8.0 * max(scatter, _LEAST_SCATTER)), 1.0)
        self._plausible = period_s / 2, period_s * 2
        self._period = period_s
        self._trusted = _FIRST_TRUST
        self._expected: float | None = None
        self._last = -math.inf
        self._samples = 0
        self._anchors: list[tuple[int, float]] = []

    @classmethod
    def of(cls, times: Sequence[float], resolution_s: float) -> Pacer | None:
        """Return a pacer for a stream that begins with these times; None when it has no period."""
        period_s = period_of(times)
        if period_s is None:
            return None
        steps = np.diff(times) / period_s
        whole = np.abs(steps - 1.0) < 0.5
        return cls(period_s, resolution_s, float(np.abs(steps[whole] - 1.0).max()))

    def missing(self, time_s: float, damaged: bool = False) -> int | Literal["back"] | None:
        """Return how many samples are missing before a sample of this time.

        Parameters
        ----------
        time_s : float
            Its stamp.
        damaged : bool
            Whether something unreadable came before it.

        Returns
        -------
        int, None or 'back'
            0 when nothing is missing; None when it cannot be told; ``back`` when time went back,
            as it does when a device restarts.
        """
        if time_s < self._last - self._period / 2:
            return "back"
        late = self._lateness(time_s)
        if not self._countable:
            return None if damaged or late > 1.5 else 0
        number = max(0, round(late))
        return number if number <= self._known() * self._reach else None

    @property
    def fresh(self) -> bool:
        """Whether no stamp has been followed yet, so that there is nothing to compare with."""
        return self._expected is None

    def believable(self, time_s: float, next_s: float, apart: bool = False) -> bool:
        """Return whether a stamp that jumps, or the first one, is borne out by the one after it.

        Text has no checksum: a lost digit makes a wrong stamp. Then the next one goes on where the
        one before had left off, and the one between must not be taken for a loss.

        Parameters
        ----------
        time_s, next_s : float
            The stamp and the one after it.
        apart : bool
            Whether something unreadable came between the two, so that they may be several periods
            from each other: a sound sample between two damaged ones is sound.
        """
        if not self._countable:
            return True
        steps = (next_s - time_s) / self._period
        off = abs(steps - (max(1, round(steps)) if apart else 1))
        if self.fresh:
            return off <= 0.5
        late = self._lateness(next_s)
        if not 0.5 <= late <= _NEARBY:
            return True
        return off <= abs(late - round(late)) + 0.25

    def follow(self, time_s: float, missing: int | Literal["back"] | None) -> None:
        """Take the next time stamp and what `missing` said of it.

        After a jump that cannot be counted everything but the period starts over.
        """
        if not isinstance(missing, int):
            self._restart()
            missing = 0
        expected = time_s if self._expected is None else self._expected + missing * self._period
        self._last = time_s
        self._samples += missing
        if not self._anchors or self._samples - self._anchors[-1][0] >= _MEMORY // 2:
            self._anchors = [*self._anchors[-1:], (self._samples, time_s)]
        first, since = self._anchors[0]
        if self._samples - first >= self._trusted:
            period = (time_s - since) / (self._samples - first)
            low, high = self._plausible
            self._period = min(max(period, low), high)
        self._expected = expected + _PULL * (time_s - expected) + self._period
        self._samples += 1

    def _restart(self) -> None:
        self._trusted = min(self._known(), _MEMORY // 2)
        self._expected = None
        self._samples = 0
        self._anchors = []

    def _lateness(self, time_s: float) -> float:
        """Return how many periods after its expected time a stamp is."""
        return 0.0 if self._expected is None else (time_s - self._expected) / self._period

    def _known(self) -> int:
        """Return how many samples the period was taken from."""
        span = self._samples - self._anchors[0][0] if self._anchors else 0
        return max(span, self._trusted)
