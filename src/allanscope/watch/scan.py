"""Has a series of block values changed, when and how? Windows of many lengths against before.

The mean of the last m blocks is compared with the mean of the M >> m before, for m from two seconds
to four minutes: at every block for short windows, sixteen times a window for long ones. As soon as
there are half as many blocks before as there should be, those are taken; after a change twice the
window and a little, because the next one may come soon. Each difference is measured in its own
standard deviation, which is that of all such differences in the record so far: an Allan deviation
with unequal windows. White noise, flicker, random walk and a steady drift are therefore in the
scale and no news; a level that leaves is.

When a stretch has changed, and whether by a step or a ramp, is then told by least squares over
every moment (`locate`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Fixed, Pointer, kernel
from allanscope.watch.false_alarms import log_weight

__all__ = [
    "Alarm",
    "Change",
    "Scan",
    "is_one_ramp",
    "locate",
    "log_tail",
    "moment_of",
    "moment_of_counts",
    "moment_of_powers",
]

Array = NDArray[np.float64]

WINDOWS = np.array(
    [2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20, 24, 28, 32, 40, 48, 64, 96, 128, 192, 256]
)
"""Blocks. Densest where shifts at three times the limit are seen: a shift waits for a window."""
REFERENCE = np.minimum(32 * WINDOWS, np.maximum(8 * WINDOWS, 1024))
LEAST_REFERENCE = np.minimum(16 * WINDOWS, np.maximum(8 * WINDOWS, 512))
HOPS = np.maximum(WINDOWS // 16, 1)
KEPT_BLOCKS = 1 << 12
"""Blocks that are kept: an hour, and more than the longest window with what is before it."""

CLIP_SIGMAS = 6.0
"""Standard deviations beyond which a single block counts no more: one block alone is no change."""
WINSOR_RATIO = 9.0
"""Largest square of a difference that moves the scale, in units of the mean square."""
LEAST_DOF = 8.0
"""Degrees of freedom that a scale needs before its window is tested."""
MOST_BORROWED_DOF, BORROWED_DOF_RATIO = 600.0, 3.0
"""Degrees of freedom that the scale of a window takes over from that of the shortest one, as long
as the noise may be white: at most so many, and so many times its own."""
SCALE_DELAY = 32
"""Looks, two windows, after which a difference counts as one that means nothing: what begins slowly
must not become the measure of itself."""
SCALE_MEMORY = 4096
"""Looks over which the scale of a window is averaged."""
SETTLING_BLOCKS = 4
"""Blocks after a change, besides twice the window, that are enough to compare with.

The scale of a difference with so few before it is that of white noise: with flicker or a random
walk such a difference scatters less. It moves no scale itself.
"""

ALPHA_SHARES = 1.0 / (1.0 + (np.log2(WINDOWS / 28.0) / 1.5) ** 2)
ALPHA_SHARES /= ALPHA_SHARES.sum()
"""Of the probability of a false alarm that each window may spend. Most goes to windows that see
three times what the longest sees; short windows see shifts so large that it matters little there.
"""

LOG_OVERLAP = 0.8
"""Neighbouring looks share most of their blocks, so that their false alarms come together: the log
of how many fewer there are than looks allow, in white noise at 16 to 18 nats."""

USUALLY_ALIKE, ENOUGH_VALUES = 0.13, 64
"""Correlation of neighbouring values, and how many of them it takes to measure it."""
MOST_ALIKE = 0.9
"""Correlation from which on a change cannot be told from it."""
PARTS = 100
"""Of a block, in each of which the moment of a step may be."""
LEFT = 1.0 - (np.arange(PARTS) + 0.5) / PARTS
"""How much of a block is left after the middle of each."""
QUANTILES = (0.5, 0.025, 0.975)
"""Of the moment, which are told."""
RAMP_NATS = 4.0
"""By how much a ramp must be better than a step: a step is the rule."""
MIXED_SIGMAS = 5.0
"""Standard deviations from its level from which on a value next to a step is a mixture of both."""
SHORTEST_RAMP = 8
"""Blocks: a step within a block looks like a ramp at first."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """A series that is not what it was.

    Attributes
    ----------
    channel : int
        Which of the series.
    window : int
        Blocks by which it was seen.
    deviate : float
        Difference in standard deviations, signed.
    nats : float
        -log of its p-value.
    """

    channel: int
    window: int
    deviate: float
    nats: float


_SCHEDULE = np.ascontiguousarray(np.stack([WINDOWS, REFERENCE, LEAST_REFERENCE, HOPS], axis=1))
_CONSTANTS = np.array(
    [
        CLIP_SIGMAS,
        WINSOR_RATIO,
        LEAST_DOF,
        MOST_BORROWED_DOF,
        BORROWED_DOF_RATIO,
        KEPT_BLOCKS,
        SCALE_DELAY,
        SCALE_MEMORY,
        SETTLING_BLOCKS,
    ]
)
_State = Pointer(np.float64, 2, written=True)
_scan = kernel(
    "scan_block",
    *(Pointer(np.float64, 1), int, int, int, float, Pointer(np.int64, 2)),
    *(Pointer(np.float64, 1), Pointer(np.float64, 2), Pointer(np.int64, 1)),
    *(_State, _State, _State, _State, _State, Pointer(np.float64, 3, written=True), _State, _State),
    returns=int,
)
_log_tail = kernel("log_tail", float, float, returns=float)


class Scan:
    """Follow `channels` series, a value each a block.

    Parameters
    ----------
    channels : int
        Number of series.
    log_alpha : ndarray, shape (channels,)
        Log of the probability that a series may ever raise a false alarm.

    Attributes
    ----------
    blocks : int
        Blocks taken.
    start : ndarray of int64, shape (channels,)
        Block from which on each series is compared: after an alarm, that of the change.
    """

    def __init__(self, channels: int, log_alpha: Array) -> None:
        many = len(WINDOWS)
        self.blocks = 0
        self.start = np.zeros(channels, np.int64)
        shares = LOG_OVERLAP + np.log(ALPHA_SHARES * HOPS)
        self._log_alpha = shares[:, np.newaxis] + log_alpha
        self._sums = np.zeros((KEPT_BLOCKS, channels))
        self._raw = np.zeros((KEPT_BLOCKS, channels))
        self._anchor: Array | None = None
        self._square = np.zeros((many, channels))
        self._fourth = np.full((many, channels), 3.0)
        self._looks = np.zeros((many, channels))
        self._pending = np.full((SCALE_DELAY, many, channels), np.nan)
        self._room = np.zeros((many, channels))
        self._found = np.zeros((channels, 4))
        self._fixed = Fixed(
            *(_SCHEDULE, _CONSTANTS, self._log_alpha, self.start, self._sums, self._raw),
            *(self._square, self._fourth, self._looks, self._pending, self._room, self._found),
        )

    def update(self, values: Array) -> list[Alarm]:
        """Take the values of a block, shape (channels,); return at most one alarm a channel."""
        if self._anchor is None:
            self._anchor = values.copy()
        weight = log_weight(self.blocks + 1)
        values = values - self._anchor
        alarms = self._fixed.call(_scan, values, len(values), self.blocks, len(_SCHEDULE), weight)
        self.blocks += 1
        if not alarms:
            return []
        return [
            Alarm(int(channel), int(window), float(deviate), float(nats))
            for channel, (window, deviate, nats, excess) in enumerate(self._found)
            if excess > 0.0
        ]

    def restart(self, channel: int, block: int) -> None:
        """Compare a series from a block on, that of a change, with nothing before it.

        What was clipped since as far from the level before counts in full: it is the level now.
        """
        self.start[channel] = block
        since = np.arange(max(block, self.blocks - KEPT_BLOCKS + 1), self.blocks)
        added = np.cumsum(self._raw[since % KEPT_BLOCKS, channel])
        self._sums[(since + 1) % KEPT_BLOCKS, channel] = (
            self._sums[since[:1] % KEPT_BLOCKS, channel] + added
        )

    def values(self, channel: int, first: int) -> Array:
        """Return the values of a series from block `first` on, as far as they are kept."""
        first = max(first, self.blocks - KEPT_BLOCKS + 1, 0)
        assert self._anchor is not None
        rows = np.arange(first, self.blocks) % KEPT_BLOCKS
        return np.asarray(self._raw[rows, channel] + self._anchor[channel])

    def spread(self, channel: int) -> float:
        """Return the standard deviation of a block's value about what came just before it."""
        shortest = 1 / WINDOWS[0] + 1 / REFERENCE[0]
        return float(np.sqrt(self._square[0, channel] / shortest))


def log_tail(deviate: float, dof: float) -> float:
    """Return -log of the two-sided tail of a t distribution, to a few per cent of itself.

    Notes
    -----
    Wallace's transformation to a normal deviate (1959), and the tail of that.

    Examples
    --------
    >>> from scipy.stats import t
    >>> for dof in (10.0, 100.0):
    ...     exact = -np.log(2 * t.sf(6.0, dof))
    ...     print(round(float(log_tail(6.0, dof) / exact), 2))
    1.0
    1.0
    """
    return float(_log_tail(deviate, dof))


@dataclass(frozen=True, slots=True)
class Change:
    """A change within a stretch of values.

    Attributes
    ----------
    kind : {'step', 'ramp'}
        Whether the level is another one from a moment on, or moves.
    at : int
        Likeliest first value after it.
    moment, lower, upper : float
        When it was, in values: median and ends of the 95 % interval. One of 3.4 is within the value
        3, the mean of a block, of which four tenths had passed.
    before : float
        Level before it.
    size : float
        Level at the end less that before.
    """

    kind: Literal["step", "ramp"]
    at: int
    moment: float
    lower: float
    upper: float
    before: float
    size: float


def locate(values: Array, earliest: int, spread: float) -> Change:
    """Return the change that fits a stretch best.

    Parameters
    ----------
    values : ndarray of float64, shape (n,)
        The stretch, n >= 3.
    earliest : int
        First place where it may be.
    spread : float
        Least standard deviation of a value about a level.

    Notes
    -----
    Values that are alike from block to block tell less about a moment: the log-likelihood is
    divided by (1 + r) / (1 - r), with the correlation r of neighbours beside the change.

    Examples
    --------
    >>> values = np.repeat([0.0, 0.3, 1.0], [40, 1, 6]) + 0.01 * np.sin(7.0 * np.arange(47) ** 2)
    >>> change = locate(values, earliest=20, spread=0.01)
    >>> change.kind, change.at, round(change.moment, 1), round(change.size, 1)
    ('step', 41, 40.7, 1.0)
    """
    steps, ramps = _gains(values)
    earliest = min(max(earliest, 1), len(values) - 1)
    total = float(np.sum((values - values.mean()) ** 2))
    best = earliest + int(np.argmax(steps[earliest:]))
    best_ramp = earliest + int(np.argmax(ramps[earliest:-1])) if len(values) > earliest + 1 else 0
    left = total - max(steps[best], ramps[best_ramp] if best_ramp else 0.0)
    variance = max(left / len(values), spread**2, 1e-300)
    is_long = best_ramp > 0 and len(values) - best_ramp >= SHORTEST_RAMP
    is_ramp = is_long and (ramps[best_ramp] - steps[best]) / (2 * variance) > RAMP_NATS
    at = best_ramp if is_ramp else best
    before = _level(values[:at][::-1], spread)
    if is_ramp:
        # The mean of a block is that of its middle: half a block after it began is the first value.
        gains, first = ramps[earliest:-1, np.newaxis], earliest
        bend = _bend(len(values), at)
        slope = float(bend @ values / (bend @ bend))
        size = slope * (len(values) - 1 - at)
        rest = values - values.mean() - slope * bend
    else:
        after = _level(values[at:], spread)
        size, first = after - before, max(earliest - 1, 1)
        gains = _gains_within(values)[first:]
        # What a step within a block leaves of it is no noise.
        left = total - max(float(gains.max()), float(steps[best]))
        variance = max(left / len(values), spread**2, 1e-300)
        rest = np.concatenate([values[: at - 1] - before, values[at:] - after])
    moment, lower, upper = _quantiles(gains / (2 * variance * _memory(rest))).tolist()
    times = first + moment, first + lower, first + upper
    return Change("ramp" if is_ramp else "step", at, *times, before, size)


def _memory(rest: Array) -> float:
    """Return by how much less values tell than independent ones."""
    alike = USUALLY_ALIKE
    if len(rest) >= ENOUGH_VALUES:
        alike = float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-300) + 1.0 / len(rest)
    alike = min(max(alike, 0.0), MOST_ALIKE)
    return (1.0 + alike) / (1.0 - alike)


def _gains_within(values: Array) -> Array:
    """Return by how much a step within each value reduces the sum of squares, shape (n, parts)."""
    n = len(values)
    v = (values - values.mean())[:, np.newaxis]
    after = (n - 1.0 - np.arange(n))[:, np.newaxis]
    tail = np.cumsum(v[::-1], axis=0)[::-1] - v
    squares = after + LEFT**2 - (after + LEFT) ** 2 / n
    return np.asarray((tail + LEFT * v) ** 2 / np.maximum(squares, 1e-12))


def _quantiles(loglik: Array) -> Array:
    """Return `QUANTILES` of a moment, each part of each value being as likely beforehand."""
    weight = np.exp(loglik - loglik.max()).ravel()
    below = np.concatenate([[0.0], np.cumsum(weight)])
    borders = np.arange(len(below)) / loglik.shape[1]
    return np.asarray(np.interp(np.array(QUANTILES) * below[-1], below, borders))


def moment_of(gains: Array, weights: Array) -> tuple[float, float, float]:
    """Return the median of a moment and the ends of its 95 % interval, in blocks.

    Parameters
    ----------
    gains : ndarray of float64, shape (k, n, PARTS + 1)
        Log-likelihood that each block gains if the change is in one of its parts; last, if it was
        before it. Of k sizes of the change.
    weights : ndarray of float64, shape (k,)
        How likely each size is beforehand.
    """
    later = np.cumsum(gains[..., ::-1, -1], axis=-1)[..., ::-1] - gains[..., -1]
    loglik = gains[..., :-1] + later[..., np.newaxis]
    size = weights[:, np.newaxis, np.newaxis]
    loglik = np.log(np.sum(size * np.exp(loglik - loglik.max()), axis=0) + 1e-300)
    median, lower, upper = _quantiles(loglik).tolist()
    return median, lower, upper


def moment_of_counts(counts: Array, earliest: int, at: int) -> tuple[float, float, float]:
    """Return the same of a Poisson rate that is another one from a block on.

    Parameters
    ----------
    counts : ndarray of float64, shape (n,)
        Counts of blocks.
    earliest, at : int
        First block in which it may have changed, and the likeliest first one after it.
    """
    before, after = max(float(counts[:at].mean()), 1e-3), max(float(counts[at:].mean()), 1e-3)
    bunch = max(float(counts[:at].var()) / before, 1.0)
    rates = _mixed(before, after * _factors(np.sqrt(bunch / after / (len(counts) - at))))
    counts = counts[earliest:, np.newaxis]
    gains = (counts * np.log(rates / before) - (rates - before)) / bunch
    median, lower, upper = moment_of(gains, np.ones(len(gains)))
    return earliest + median, earliest + lower, earliest + upper


def moment_of_powers(powers: Array, earliest: int, at: int) -> tuple[float, float, float]:
    """Return the same of noise whose power is another one: it scatters more where it is louder.

    Parameters
    ----------
    powers : ndarray of float64, shape (n,)
        Mean powers of blocks, as of chi-square whose degrees of freedom they tell.
    earliest, at : int
        As for counts.
    """
    before, after = float(powers[:at].mean()), float(powers[at:].mean())
    rest = np.concatenate([powers[: at - 1] / before, powers[at:] / after]) - 1.0
    half = 1.0 / (max(float(rest @ rest) / len(rest), 1e-12) * _memory(rest))
    expected = _mixed(before, after * _factors(1.0 / np.sqrt(half * (len(powers) - at))))
    away = powers[earliest:, np.newaxis]
    gains = -half * (np.log(expected / before) + away * (1.0 / expected - 1.0 / before))
    median, lower, upper = moment_of(gains, np.ones(len(gains)))
    return earliest + median, earliest + lower, earliest + upper


def _factors(error: float) -> Array:
    """Return factors about 1 within which the level after a change is, by its relative error."""
    return np.asarray(np.exp(min(error, 1.0) * np.linspace(-3.0, 3.0, 13)))


def _mixed(before: float, after: Array) -> Array:
    """Return the mean over a block by where in it the change is; last, if it was before.

    `after` are the levels that may follow, shape (k,); the result has shape (k, 1, parts + 1).
    """
    left = np.append(LEFT, 1.0)
    return np.asarray(before + left * (after - before)[:, np.newaxis, np.newaxis])


def is_one_ramp(values: Array, places: list[int]) -> bool:
    """Return whether changes of a stretch are one ramp rather than so many steps."""
    _, ramps = _gains(values)
    total = float(np.sum((values - values.mean()) ** 2))
    levels = np.split(values, places)
    steps = sum(float(np.sum((one - one.mean()) ** 2)) for one in levels if len(one))
    room = max(places[0] // 2, 1)
    return total - float(ramps[room:-1].max(initial=0.0)) < steps


def _gains(values: Array) -> tuple[Array, Array]:
    """Return by how much a step and a bend at each place reduce the sum of squares."""
    n = len(values)
    v = values - values.mean()
    place = np.arange(n, dtype=np.float64)
    after = n - place
    tail = np.cumsum(v[::-1])[::-1]
    moment = np.cumsum((v * place)[::-1])[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.where(place > 0, tail**2 * n / (after * place), 0.0)
        # the regressor max(0, i - place)
        total = after * (after - 1) / 2
        squares = (after - 1) * after * (2 * after - 1) / 6 - total**2 / n
        product = moment - place * tail
        ramps = np.where(squares > 0.0, product**2 / squares, 0.0)
    ramps[0] = 0.0
    return steps, ramps


def _level(values: Array, spread: float) -> float:
    """Return the mean; without the first value, next to a step, where it lies between two levels.

    Examples
    --------
    >>> _level(np.array([5.0, 9.0, 9.0]), spread=0.1)
    9.0
    """
    rest = values[1:]
    is_mixed = len(rest) > 0 and abs(values[0] - rest.mean()) > MIXED_SIGMAS * spread
    return float((rest if is_mixed else values).mean())


def _bend(n: int, at: int) -> Array:
    """Return what rises by 1 a value from a place on, about its mean."""
    bend = np.maximum(np.arange(n) - float(at), 0.0)
    return np.asarray(bend - bend.mean())
