"""Time stamps of a device: counters that wrap made to run on, and what a series of them shows.

Its period, its rate, the step of its clock, and whether rows come in bursts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Comb",
    "WrappingCounter",
    "comb_of",
    "long_gaps",
    "mean_rate",
    "period_of",
    "resolution_of",
    "rows_come_in_bursts",
    "rows_come_unevenly",
]

_SHORTEST_S = 1e-12
"""WrappingCounter that differ by less are no times."""
_FEWEST_STEPS = 4
_FINEST = 1e-6
_BURSTY = 1.25
"""Mean step over median step from which rows may come in bursts."""
_FEWEST_BURSTS, _LONGEST_BURST = 4, 64
_LONG_S = 1.0
"""A step from which rows may be missing where the times do not tell when rows were made."""
_NEAR, _MOSTLY, _MULTIPLE = 0.25, 0.8, 64
"""Distance from a multiple of the period, in periods, at which a step may be losses, the share of
the steps that are so near where they are (by chance it is half), and the largest multiple that is
known well enough."""
_SCATTERED, _MADE_UP_FOR, _USUALLY = 0.25, -0.25, 0.6
"""Relative scatter of the steps from which stamps tell no single loss, the correlation of
neighbours below which it is that of the stamps, and median over mean step of what is no burst."""
_FASTER, _SLOWER, _OVERSAMPLED = 1.5, 0.95, 6
"""Sampling rate over the rate of rows: above one by what is lost, below by what is doubled; and
steps of frequency in a width of the peak of the comb."""
_ROUGH = 0.1
"""Scatter of the steps, in periods, from which their mean says less than the comb."""
_FEWEST_IN_COMB, _CHANCE, _PARTS = 25, 1e-3, 64
"""Fewest stamps of a comb, how often chance may make one, and parts that must agree on it."""
_MEDIAN_OFF, _RUSHED = 0.6745, 1.4
"""Median over standard deviation of the distances of a Gaussian's draws from their median, and the
scatter of the steps of a comb over that of its stamps from which these are no Gaussian's."""
_ROUNDED, _LONGEST_CYCLE, _ALIKE = 1.5, 16, 0.5
"""Scatter of stamps over that of their rounding from which it is not all there is, the longest
cycle of a loop in rows, and the correlation of steps a cycle apart."""
_REGULAR = 0.5
"""Relative scatter of the time from burst to burst; that between random losses is 1."""


class WrappingCounter:
    """Unwrap a counter of a device's time.

    Parameters
    ----------
    modulus : int
        Where the counter starts over, in its own units: 2^32 for most, a day for a clock.
    per_second : float
        Counts in a second.

    Examples
    --------
    >>> milliseconds = WrappingCounter(1 << 32, 1000.0)
    >>> [milliseconds.seconds(stamp) for stamp in (2147483647, -2147483648, -2147483628)]
    [2147483.647, 2147483.648, 2147483.668]
    """

    def __init__(self, modulus: int, per_second: float) -> None:
        self._modulus = modulus
        self._per_second = per_second
        self._total: int | None = None

    def seconds(self, stamp: int) -> float:
        """Return the unwrapped time; it goes back where the counter does, as after a restart."""
        if self._total is None:
            self._total = stamp
        ahead = (stamp - self._total) % self._modulus
        back = ahead >= self._modulus // 2
        self._total += ahead - self._modulus if back else ahead
        return self._total / self._per_second


def period_of(
    times: Sequence[float] | NDArray[np.float64], comb: Callable[[], Comb | None] | None = None
) -> float | None:
    """Return the period of samples at given times, some of which may be missing.

    The mean of the steps near the median or zero; None when there are too few, or when more than a
    fifth of the steps are far from the median and from its multiples, so that there is no period to
    speak of. `comb` returns `comb_of` the times, to whoever needs it besides: it takes a tenth of a
    second.

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
    if whole.mean() < 0.8 or steps[whole].std() > _ROUGH * median:
        found = comb_of(times) if comb is None else comb()
        if found is not None:
            return found.period_s
    if whole.mean() < 0.8 and not _far_are_multiples(steps / median):
        return None
    # Short steps stay in: coarse stamps have some, and the mean is right only with them.
    near = whole | (np.abs(steps) < 0.5 * median)
    return float(np.round(steps[near].mean(), 12))


class Comb(NamedTuple):
    """Period of a clock whose stamps scatter, and by how many periods they do (rms)."""

    period_s: float
    scatter: float


def comb_of(times: Sequence[float] | NDArray[np.float64]) -> Comb | None:
    """Return the period of which all stamps are multiples but for their scatter; None without one.

    Neither lost nor doubled rows move the others off their multiples, nor does the jitter of one
    row. So with stamps t the mean of exp(2 pi i f t) peaks at the sampling rate f, and of stamps
    that scatter by s periods its size is exp(-2 pi^2 s^2). By chance it is larger than r in n rows
    once in exp(n r^2).

    >>> rng = np.random.default_rng(1)
    >>> kept = np.flatnonzero(rng.random(1000) > 0.1)
    >>> comb = comb_of(0.01 * kept + rng.normal(0.0, 0.002, len(kept)))
    >>> round(comb.period_s, 5), round(comb.scatter, 1)
    (0.01, 0.2)
    """
    stamps = np.asarray(times, np.float64)
    mean = mean_rate(stamps)
    if len(stamps) < _FEWEST_IN_COMB or not np.isfinite(stamps).all() or mean <= 0.0:
        return None
    width = 1.0 / float(np.ptp(stamps))
    hz = np.arange(_SLOWER * mean, _FASTER * mean, width / _OVERSAMPLED)
    if len(hz) > len(stamps) * _OVERSAMPLED:  # a gap far longer than all that came
        return None
    since = stamps - stamps[0]
    size = np.array([abs(np.exp(2j * np.pi * f * since).mean()) for f in hz.tolist()])
    best = int(size.argmax())
    alternatives = max(len(hz) / _OVERSAMPLED, 1.0)
    if best in (0, len(hz) - 1) or len(stamps) * size[best] ** 2 < math.log(alternatives / _CHANCE):
        return None
    if rows_come_in_bursts(stamps) or not _all_along(since, float(hz[best]), alternatives):
        return None
    left, top, right = size[best - 1 : best + 2].tolist()
    shift = (left - right) / (2.0 * (left - 2.0 * top + right))
    period_s = 1.0 / (hz[best] + shift * width / _OVERSAMPLED)
    scatter = math.sqrt(-math.log(min(top, 1.0)) / 2.0) / math.pi
    rounding_s = resolution_of(stamps.tolist()) / math.sqrt(12.0)
    if not _steps_scatter_as(np.diff(stamps), scatter * period_s, rounding_s):
        return None
    return Comb(float(f"{period_s:.10g}"), scatter)


def _steps_scatter_as(steps: NDArray[np.float64], rms_s: float, rounding_s: float) -> bool:
    """Return whether steps scatter as those between stamps do that are off by so much.

    A loop that takes 12, 12, 12 and 20 ms keeps to a comb of 11.2 ms, from which no row is off by
    chance: its steps are of two lengths, and one is no multiple of the other, and they come again.
    So does the rounding of stamps, which is known. Stamps that come late in a rush, now and then,
    are farther off than their comb tells, and would pass for losses.
    """
    median = float(np.median(steps))
    usual = steps[(steps > 0.4 * median) & (steps < 1.5 * median)]
    if usual.std() < rms_s / 2.0 and not _far_are_multiples(steps / median):
        return False
    if rms_s > _ROUNDED * rounding_s and _come_again(np.minimum(steps, 2.0 * median)):
        return False
    spread = float(np.median(np.abs(steps - median))) / _MEDIAN_OFF
    return spread <= _RUSHED * math.sqrt(2.0) * rms_s


def _come_again(steps: NDArray[np.float64]) -> bool:
    """Return whether steps are those of some steps before.

    >>> _come_again(np.tile([0.012, 0.012, 0.020], 100))
    True
    >>> _come_again(np.diff(0.01 * np.arange(300) + np.random.default_rng(1).normal(0, 2e-3, 300)))
    False
    """
    if len(steps) < 4 * _LONGEST_CYCLE:
        return False
    off = steps - steps.mean()
    power = float(off @ off) / len(off)
    products = [float(np.mean(off[lag:] * off[:-lag])) for lag in range(2, _LONGEST_CYCLE + 1)]
    return max(products) > _ALIKE * power > 0.0


def _all_along(since: NDArray[np.float64], hz: float, alternatives: float) -> bool:
    """Return whether a comb is one through all of the record, not from row to row only.

    The steps of a polling loop add up: its stamps keep to a comb for some rows, at about its mean
    rate, and then leave it. So it is the means over parts of the record that must agree.

    >>> rng = np.random.default_rng(2)
    >>> comb_of(np.cumsum(rng.uniform(0.012, 0.020, 1000))) is None
    True
    """
    turns = np.exp(2j * np.pi * hz * since)
    parts = np.array([part.mean() for part in np.array_split(turns, min(len(turns), _PARTS))])
    power = float(np.mean(np.abs(parts) ** 2))
    together = float(abs(parts.mean())) ** 2
    return len(parts) * together >= power * math.log(alternatives / _CHANCE)


def _far_are_multiples(steps: NDArray[np.float64]) -> bool:
    """Return whether steps, in medians, are what losses leave: one period, or several of them."""
    one = (steps > 0.5) & (steps < 1.5)
    if one.mean() < 0.5:
        return False
    periods = steps / steps[one].mean()
    far = periods[(periods >= 1.5) & (periods < _MULTIPLE)]
    return bool(len(far) and np.mean(np.abs(far - np.round(far)) < _NEAR) > _MOSTLY)


def mean_rate(times: Sequence[float] | NDArray[np.float64]) -> float:
    """Return rows over time, in Hz; 0 where the times are too few or do not go on.

    Where rows come in bursts it is from the beginning of one burst to that of another: the part of
    a burst at the end would count for a whole one. Of a long record it is the median over half of
    it, which neither one wrong stamp nor one gap carries.

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
    if not spans.min() > _SHORTEST_S:
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
    if _stands_still(stamps, steps) or steps.mean() < _BURSTY * median:
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


def _stands_still(stamps: NDArray[np.float64], steps: NDArray[np.float64]) -> bool:
    """Return whether most rows repeat a stamp of a clock that then goes on by its least step."""
    if np.median(steps) > 0.0:
        return False
    moved = steps[steps > 0.0]
    return not len(moved) or bool(np.median(moved) <= _BURSTY * resolution_of(stamps.tolist()))


def rows_come_unevenly(times: Sequence[float] | NDArray[np.float64]) -> bool:
    """Return whether stamps have no period although they go on.

    Rows come in bursts of no regular length, a busy host stamps them now sooner and now later, or a
    polling loop takes now 12 and now 20 ms. The steps are neither alike nor multiples of one. Then
    the median step says nothing of the rate and single steps say nothing of losses; rows over time
    is the rate. Stamps that scatter about even times make such steps as well: those have a `Comb`.

    >>> steps = [0.002, 0.002, 0.031, 0.002, 0.017, 0.002, 0.009, 0.002, 0.0254] * 9
    >>> rows_come_unevenly(np.cumsum(steps)), rows_come_unevenly(np.cumsum([0.01, 0.01, 0.02] * 9))
    (True, False)
    >>> rows_come_unevenly(np.cumsum([0.012, 0.012, 0.012, 0.020] * 25))
    True
    """
    steps = np.diff(np.asarray(times, np.float64))
    if len(steps) < _LONGEST_BURST or not np.isfinite(steps).all():
        return False
    if _scatter(steps):
        return True
    median = float(np.median(steps))
    if steps.min() < 0.0 or median <= 0.0:
        return False
    whole = (steps > 0.4 * median) & (steps < 1.5 * median)
    if whole.mean() >= 0.5 and steps[whole].std() > _ROUGH * median:
        return True
    longer = np.count_nonzero(steps > 1.5 * median)
    many = longer >= max(4 * _FEWEST_BURSTS, len(steps) / _LONGEST_BURST)
    return bool(many and not _far_are_multiples(steps / median))


def _scatter(steps: NDArray[np.float64]) -> bool:
    """Return whether stamps come so much sooner or later that no step tells a lost row.

    Then a step is too long by as much as the next is too short: the correlation of neighbours is
    -1/2, and that of losses, of bursts, and of a clock that drifts, nought or more. A few long gaps
    say nothing of the others.
    """
    mean = float(steps.mean())
    usual = np.minimum(steps, 4.0 * mean)
    if not (usual.std() > _SCATTERED * mean and np.median(steps) > _USUALLY * mean):
        return False
    return bool(np.corrcoef(usual[1:], usual[:-1])[0, 1] < _MADE_UP_FOR)


def long_gaps(times: NDArray[np.float64], rate_hz: float) -> dict[int, int]:
    """Return the row after each long gap, and how many rows it lacks, where times are uneven.

    A step above 1 s is a gap as far as the rows after it do not catch up: a host that was busy
    hands over in a rush what has waited.

    >>> times = np.concatenate([np.arange(200), np.arange(500, 700)]) / 100
    >>> long_gaps(times, 100.0)
    {200: 300}
    """
    steps = np.diff(times)
    found = {}
    for row in np.flatnonzero(steps > _LONG_S).tolist():
        after = times[row + 1]
        span = min(float(steps[row]), float(times[-1]) - after)
        came = int(np.searchsorted(times, after + span)) - row - 1
        lost = round(steps[row] * rate_hz) - 1 - max(0, came - round(span * rate_hz))
        if lost > _LONG_S * rate_hz / 2:
            found[row + 1] = lost
    return found


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
