"""Has a series of block values changed? Windows of many lengths against what came before them.

The mean of the last m blocks is compared with the mean of the M >> m before, for m from two seconds
to four minutes: at every block for short windows, sixteen times a window for long ones. Each
difference is measured in its own standard deviation, which is that of all such differences in the
record so far: an Allan deviation with unequal windows. White noise, flicker, random walk and a
steady drift are therefore in the scale and no news; a level that leaves is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.watch.spending import log_weight

__all__ = ["LONGEST", "Alarm", "Scan", "log_tail"]

WINDOWS = np.array(
    [2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20, 24, 28, 32, 40, 48, 64, 96, 128, 192, 256]
)
"""Blocks. Densest where shifts at three times the limit are seen: a shift waits for a window."""
BEFORE = np.minimum(16 * WINDOWS, np.maximum(8 * WINDOWS, 512))
STEPS = np.maximum(WINDOWS // 16, 1)
LONGEST = int((WINDOWS + BEFORE).max())
RING = 1 << 12
"""Blocks that are kept: an hour, and more than the longest window with what is before it."""

CLIP = 6.0
"""Standard deviations beyond which a single block counts no more: one block alone is no change."""
WINSOR = 9.0
FEWEST = 8.0
BORROWED, LENT = 300.0, 3.0
DELAY = 32
"""Looks, two windows, after which a difference counts as one that means nothing: what begins slowly
must not become the measure of itself."""
MEMORY = 4096
"""Looks over which the scale of a window is averaged."""

OVERLAP = 0.8
"""Neighbouring looks share most of their blocks, so that their false alarms come together: the log
of how many fewer there are than looks allow, measured on white and on flicker noise."""


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

    def __init__(self, channels: int, log_alpha: NDArray[np.float64]) -> None:
        many = len(WINDOWS)
        self.blocks = 0
        self.start = np.zeros(channels, np.int64)
        shares = OVERLAP - np.log(many) + np.log(STEPS)
        self._log_alpha = shares[:, np.newaxis] + log_alpha
        self._sums = np.zeros((RING, channels))
        self._raw = np.zeros((RING, channels))
        self._anchor: NDArray[np.float64] | None = None
        self._square = np.zeros((many, channels))
        self._fourth = np.full((many, channels), 3.0)
        self._looks = np.zeros((many, channels))
        self._pending = np.full((DELAY, many, channels), np.nan)

    def take(self, values: NDArray[np.float64]) -> list[Alarm]:
        """Take the values of a block, shape (channels,); return at most one alarm a channel."""
        if self._anchor is None:
            self._anchor = values.copy()
        values = values - self._anchor
        at = self.blocks
        self._raw[at % RING] = values
        self._sums[(at + 1) % RING] = self._sums[at % RING] + self._clipped(values)
        self.blocks = now = at + 1
        due = np.flatnonzero((now % STEPS == 0) & (now >= WINDOWS + BEFORE))
        if not len(due):
            return []
        window, before = WINDOWS[due, np.newaxis], BEFORE[due, np.newaxis]
        here = self._sums[now % RING]
        middle = self._sums[(now - WINDOWS[due]) % RING]
        first = self._sums[(now - WINDOWS[due] - BEFORE[due]) % RING]
        difference = (here - middle) / window - (middle - first) / before
        known = now - window - before >= self.start
        nats, deviate, limit = self._judged(due, difference)
        excess = np.where(known, nats - limit, -np.inf)
        best = np.argmax(excess, axis=0)
        columns = np.arange(len(self.start))
        raised = excess[best, columns] > 0.0
        self._pending[:, :, raised] = np.nan
        slot = now // STEPS[due] % DELAY
        self._learn(due, self._pending[slot, due])
        self._pending[slot, due] = np.where(known & ~raised, difference, np.nan)
        return [
            Alarm(
                int(c),
                int(WINDOWS[due[best[c]]]),
                float(deviate[best[c], c]),
                float(nats[best[c], c]),
            )
            for c in np.flatnonzero(raised)
        ]

    def values(self, channel: int, first: int) -> NDArray[np.float64]:
        """Return the values of a series from block `first` on, as far as they are kept."""
        first = max(first, self.blocks - RING + 1, 0)
        assert self._anchor is not None
        rows = np.arange(first, self.blocks) % RING
        return np.asarray(self._raw[rows, channel] + self._anchor[channel])

    def spread(self, channel: int) -> float:
        """Return the standard deviation of a block's value about what came just before it."""
        return float(np.sqrt(self._variance()[channel]))

    def _variance(self) -> NDArray[np.float64]:
        """Return the variance of a block's value, of all series, by the shortest window."""
        return np.asarray(self._square[0] / (1 / WINDOWS[0] + 1 / BEFORE[0]))

    def _clipped(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values, no farther from the last ones than a single block may count."""
        now, before = self.blocks, int(BEFORE[0])
        past = self._sums[now % RING] - self._sums[(now - before) % RING]
        centre = past / before
        room = CLIP * np.sqrt(self._variance())
        clip = (now - self.start >= before) & (self._looks[0] >= FEWEST)
        return np.where(clip, np.clip(values, centre - room, centre + room), values)

    def _judged(
        self, due: NDArray[np.int64], difference: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        own = self._square[due]
        span = self._looks[due] * STEPS[due, np.newaxis]
        window, before = WINDOWS[due, np.newaxis], BEFORE[due, np.newaxis]
        # Of white noise, differences a window apart have nothing in common; of flicker and random
        # walk, what came before is in all of them.
        white = self._variance() * (1 / window + 1 / before)
        coloured = 1.0 - _share(white, own, 1.0)
        dof = span / (window + coloured * (window + before / 4))
        # Where nothing speaks against white noise, short windows tell of the long ones.
        is_white = (own < white * (1.0 + np.sqrt(2.0 / np.maximum(dof, 1.0)))) & (own > 0.0)
        borrowed = np.where(is_white, np.minimum(BORROWED, LENT * dof), 0.0)
        square = (dof * own + borrowed * white) / np.maximum(dof + borrowed, 1e-300)
        dof = dof + np.where(dof >= FEWEST, borrowed, 0.0)
        deviate = difference / np.sqrt(np.maximum(square, 1e-300))
        deviate[square <= 0.0] = 0.0
        doubt = 2.0 * np.sqrt(24.0 / np.maximum(dof - borrowed, 1.0))
        tails = 4.0 + 6.0 / np.maximum(self._fourth[due] - 3.0 - doubt, 0.01)
        dof = np.minimum(dof, tails)
        nats = np.where(dof >= FEWEST, log_tail(deviate, np.maximum(dof, 1.0)), 0.0)
        limit = -(self._log_alpha[due] + log_weight(self.blocks))
        return nats, deviate, limit

    def _learn(self, due: NDArray[np.int64], difference: NDArray[np.float64]) -> None:
        """Let differences that no alarm has followed move the scales; NaN is none."""
        use = np.isfinite(difference)
        looks = self._looks[due] + use
        gain = np.where(use, 1.0 / np.clip(looks, 1.0, MEMORY), 0.0)
        square, new = self._square[due], np.where(use, difference, 0.0) ** 2
        early = looks <= 16
        calm = np.where(early, new, np.minimum(new, WINSOR * square))
        self._square[due] = square + gain * (calm - square)
        fourth = _share(new, square, 16.0) ** 2
        self._fourth[due] += gain * (np.where(early, 3.0, fourth) - self._fourth[due])
        self._looks[due] = looks


def _share(
    part: NDArray[np.float64], whole: NDArray[np.float64], most: float
) -> NDArray[np.float64]:
    """Return part / whole, at most `most`, also where the whole is nothing."""
    share = np.where(part > 0.0, most, 0.0)
    np.divide(np.minimum(part, most * whole), whole, out=share, where=whole > 0.0)
    return share


def log_tail(deviate: NDArray[np.float64], dof: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return -log of the two-sided tail of a t distribution, to a few per cent of itself.

    Notes
    -----
    Wallace's transformation to a normal deviate (1959), and the tail of that.

    Examples
    --------
    >>> from scipy.stats import t
    >>> for dof in (10.0, 100.0):
    ...     exact = -np.log(2 * t.sf(6.0, dof))
    ...     print(round(float(log_tail(np.array(6.0), np.array(dof)) / exact), 2))
    1.0
    1.0
    """
    normal = (8 * dof + 1) / (8 * dof + 3) * np.sqrt(dof * np.log1p(deviate**2 / dof))
    # 2 Q(x) <= sqrt(2/pi) exp(-x^2/2) / ((1 + 1/pi) ... ): the bound of Borjesson and Sundberg
    tail = 0.661 * normal + 0.339 * np.sqrt(normal**2 + 5.51)
    return np.asarray(normal**2 / 2 + np.log(np.sqrt(np.pi / 2) * tail))
