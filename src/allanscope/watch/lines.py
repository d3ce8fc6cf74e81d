"""Has a line begun? One CUSUM for each bin of the spectrum, against its own reference.

The periodogram of a block over its reference is exponentially distributed with mean 1. For two
alternatives, the running sum of log-likelihood ratios that is set back to zero whenever it falls
below (Page) is the largest of e-processes begun at every block. A weak line, which may come and go
within its minutes, makes the mean 1 + rho. A clear one, a sine as a rule, has an amplitude: with r
the root of the ratio, the density of noise, 2 r exp(-r^2), is tilted by exp(k r - b), which is what
that of noise with a sine of the amplitude k / 2 differs by, but for a factor that hardly changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e

from allanscope.compiled import Fixed, Pointer, kernel
from allanscope.watch.false_alarms import log_weight
from allanscope.watch.scan import LEFT, moment_of
from allanscope.watch.summary import LANES, groups_of, of_axis

__all__ = ["LineAlarm", "LineCusums"]

WEAK_EXCESS = 0.7
"""rho, power that a weak line adds to its bin, in units of the noise there."""
CLEAR_TILT = 5.0
"""k of a clear line: see above."""
ALPHA_SHARES = (0.1, 0.9)
"""Of the probability of a false alarm that each of the two may spend."""

LOG_OVERSHOOT = np.array([2.8, 2.0])
"""-log(p exp(h)), p the probability that the sum of each raises an alarm at a block, in noise, at
the limit h: few blocks begin a sum, most sums begin by falling, one that arrives is over h by far,
and it must have lasted for `LEAST_BLOCKS`. Neighbouring bins share 0.44 of their power, but
hardly any alarms."""

RATIO_CAP = 18.0
"""Ratio beyond which a block counts no more: a knock is in all bins of one block."""
MILD_RATIO, MEMORY_BLOCKS = 6.0, 1800
"""Ratio beyond which a block adds no more to the mean square of its bin, and blocks of that mean.
"""

MEAN_SQUARE_ERROR = 0.03
"""Standard error of the mean square of the ratios of half an hour, in units of the expected one."""

LEAST_BLOCKS = 3
"""Blocks that a line lasts, and it is there in the last one: a board that is touched swings for a
second or two, and what it did then stays in the sums for some more."""

RECENT = 128
"""Blocks that are kept to tell when a line began."""
RECENT_VALUES, FEWEST_RECENT = 1 << 22, 16
"""Ratios that are kept at most, and blocks of them at the least: where a block has many bins, fewer
blocks."""
MOST_KEPT = 6e4
"""Ratio of the largest half-precision numbers."""

EXCESSES = np.geomspace(0.25, 4.0, 9)
"""Powers of a line that are allowed for when its beginning is told, over the mean one seen."""

WARM_UP = 120
"""Blocks that the reference needs before lines are looked for."""


@dataclass(frozen=True, slots=True)
class LineAlarm:
    """A bin whose power is not what it was.

    Attributes
    ----------
    axis, bin : int
        Where.
    since : int
        Blocks for which it has been so: the last of them at which the sum was zero.
    ratio : float
        Mean power in these blocks, in units of the reference.
    nats : float
        The sum.
    moment, lower, upper : float
        When it began, in blocks: median and ends of the 95 % interval.
    """

    axis: int
    bin: int
    since: int
    ratio: float
    nats: float
    moment: float
    lower: float
    upper: float


def _log_mean(tilt: float) -> float:
    """Return log E exp(k r) of noise, r being its amplitude.

    Examples
    --------
    >>> r = np.sqrt(np.random.default_rng(1).exponential(size=100_000))
    >>> bool(abs(np.exp(2.0 * r - _log_mean(2.0)).mean() - 1.0) < 0.02)
    True
    """
    root = math.sqrt(math.pi) / 2.0 * tilt * math.exp(tilt**2 / 4.0)
    return math.log1p(root * (1.0 + math.erf(tilt / 2.0)))


def _spread_before(spread: float, ratio: NDArray[np.float64], blocks: int) -> float:
    """Return what the mean square of a bin was before its last ratios: a line raises it itself.

    Examples
    --------
    >>> spread = 1.0
    >>> for block in (200, 201, 202):
    ...     spread += (6.0**2 / 2.0 - spread) / block
    >>> round(spread, 2), round(_spread_before(spread, np.full(3, 9.0), 202), 2)
    (1.25, 1.0)
    """
    for back, one in enumerate(ratio[::-1].tolist()):
        gain = 1.0 / min(blocks - back, MEMORY_BLOCKS)
        spread = (spread - gain * min(one, MILD_RATIO) ** 2 / 2.0) / (1.0 - gain)
    return spread


WEAK_INCREMENT = (WEAK_EXCESS / (1.0 + WEAK_EXCESS), math.log1p(WEAK_EXCESS))
CLEAR_INCREMENT = (CLEAR_TILT, _log_mean(CLEAR_TILT))
"""By how much a ratio, or the root of it, adds to a sum, and what is taken off."""


_lines = kernel(
    "watch_lines",
    *(int, int, float, int, int, Pointer(np.float32, 3), Pointer(np.float32, 2)),
    *(Pointer(np.int32, 3), float, float, float, Pointer(np.float16, 3, written=True)),
    *(Pointer(np.float32, 1), Pointer(np.float32, 3, written=True)),
    *(Pointer(np.float32, 4, written=True), Pointer(np.int32, 4, written=True)),
    Pointer(np.float32, 3, written=True),
)


class LineCusums:
    """Follow the bins of `axes` spectra; arrays are (groups of eight axes, bins, 8)."""

    def __init__(self, axes: int, bins: int, log_alpha: float) -> None:
        self.blocks = 0
        self._axes = axes
        penalty = math.log(bins) - log_alpha
        self._limits = penalty - np.log(ALPHA_SHARES) - LOG_OVERSHOOT
        shape = groups_of(axes), bins, LANES
        self._spread = np.ones(shape, np.float32)
        self._sums = np.zeros((len(ALPHA_SHARES), *shape), np.float32)
        self._since = np.zeros((len(ALPHA_SHARES), *shape), np.int32)
        self._tops = np.zeros((len(ALPHA_SHARES), shape[0], LANES), np.float32)
        kept = min(max(RECENT_VALUES // math.prod(shape), FEWEST_RECENT), RECENT)
        self._recent = np.zeros((kept, *shape), np.float16)
        gains = np.array([*WEAK_INCREMENT, *CLEAR_INCREMENT], np.float32)
        self._fixed = Fixed(gains, self._spread, self._sums, self._since, self._tops)

    def update(
        self, ratio: NDArray[np.float32], scale: NDArray[np.float32], held: NDArray[np.int32]
    ) -> list[LineAlarm]:
        """Take the ratios of a block; return one alarm an axis at most.

        Parameters
        ----------
        ratio : ndarray of float32, shape (groups, bins, 8)
            Power over reference.
        scale : ndarray of float32, shape (groups, 8)
            By which the ratios of an axis are multiplied.
        held : ndarray of int32, shape (groups, bins, 8)
            Bins that are not looked at, -1: an event is known there.
        """
        kept = self._recent[self.blocks % len(self._recent)]
        self.blocks += 1
        # Exponential ratios have a mean square of 2. Where it is larger, as on a line that was
        # always there and beats with another, ratios count for less.
        gain, is_on = 1.0 / min(self.blocks, MEMORY_BLOCKS), self.blocks > WARM_UP
        groups, bins = ratio.shape[:2]
        block = groups, bins, gain, self.blocks, is_on, ratio, scale, held
        self._fixed.call(_lines, *block, RATIO_CAP, MEAN_SQUARE_ERROR, MOST_KEPT, kept)
        if not is_on:
            return []
        weight, tops = log_weight(self.blocks), self._tops.reshape(len(ALPHA_SHARES), -1)
        if all(
            max(row) - limit + weight < 0.0
            for row, limit in zip(tops.tolist(), self._limits, strict=True)
        ):
            return []
        over = tops - self._limits[:, np.newaxis] + weight
        alarms: dict[int, LineAlarm] = {}
        for number, axis in np.argwhere(over >= 0.0):
            if axis < self._axes:
                alarm, adds = self._alarm(int(number), int(axis), ratio, scale)
                known = alarms.get(alarm.axis)
                if alarm.since < LEAST_BLOCKS or not adds:
                    continue
                if known is None or alarm.nats > known.nats:
                    alarms[alarm.axis] = alarm
        return list(alarms.values())

    def _alarm(
        self, number: int, axis: int, ratio: NDArray[np.float32], scale: NDArray[np.float32]
    ) -> tuple[LineAlarm, bool]:
        """Return what has the largest sum, and whether the last block added to it."""
        sums = of_axis(self._sums[number], axis)
        at = int(sums.argmax())
        nats = float(sums[at])
        length = self.blocks - int(of_axis(self._since[number], axis)[at])
        spread = max(float(of_axis(self._spread, axis)[at]) - MEAN_SQUARE_ERROR, 1.0)
        last = float(of_axis(ratio, axis)[at] * of_axis(scale, axis))
        by, less = (WEAK_INCREMENT, CLEAR_INCREMENT)[number]
        mean, usual = (nats / length + less) / by, last / spread
        if number:
            mean, usual = mean**2, math.sqrt(usual)
        mean *= spread
        adds = by * usual > less
        # The sum is one of ratios that are capped; beyond the cap, the last one tells more.
        mean = max(mean, last) if last > RATIO_CAP else mean
        moments = self._moments(axis, at, length, is_clear=number == 1)
        return LineAlarm(axis, at, length, mean, nats, *moments), adds

    def _moments(
        self, axis: int, place: int, since: int, is_clear: bool
    ) -> tuple[float, float, float]:
        """Return when a line began, in blocks: median and ends of the 95 % interval.

        Of a block in which it begins, the Hann window shows as much of its amplitude as is left.
        A clear line is a sine in noise, a weak one noise itself. Every place of the amplitude in
        its plane is as likely beforehand, so every excess of power is.
        """
        looked_at = min(2 * since + LEAST_BLOCKS, len(self._recent), self.blocks)
        first = self.blocks - looked_at
        blocks = np.arange(first, self.blocks)
        ratio = self._recent[blocks % len(self._recent), axis // LANES, place, axis % LANES]
        ratio = ratio.astype(np.float64)
        line = ratio[-min(since + 1, looked_at) :]
        spread = float(of_axis(self._spread, axis)[place])
        spread = _spread_before(spread, line, self.blocks) - MEAN_SQUARE_ERROR
        ratio /= max(spread, 1.0)
        whole = ratio[-max(min(since, looked_at) - 1, 1) :]
        excess = max(float(whole.mean()) - 1.0, 0.1) * EXCESSES[:, np.newaxis, np.newaxis]
        shown = LEFT - np.sin(2.0 * np.pi * LEFT) / (2.0 * np.pi)
        power = excess * np.append(shown, 1.0) ** 2
        ratio = ratio[:, np.newaxis]
        if is_clear:
            z = 2.0 * np.sqrt(power * ratio)
            gains = np.log(i0e(z)) + z - power
        else:
            gains = ratio * power / (1.0 + power) - np.log1p(power)
        median, lower, upper = moment_of(gains, EXCESSES)
        return first + median, first + lower, first + upper

    def forget(self, axis: int, bins: slice | NDArray[np.bool_] = slice(None)) -> None:
        """Begin the sums of an axis anew, of all bins or of some."""
        for sums, since in zip(self._sums, self._since, strict=True):
            of_axis(sums, axis)[bins] = 0.0
            of_axis(since, axis)[bins] = self.blocks
