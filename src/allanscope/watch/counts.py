"""Are there more outliers, repeats or losses than before? Counts of what is rare.

How many a window may hold follows from how many there were: a Poisson rate that is known as well as
the blocks so far tell has a negative binomial prediction. Counts that have always come in bunches
are measured in bunches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from allanscope.watch.false_alarms import log_weight

__all__ = ["EARLIER", "WINDOWS", "Burst", "RareCounts", "scan_p_value"]

WINDOWS = (1, 2, 4, 8, 16)
_WINDOWS = np.array(WINDOWS)
LEAST_EXPOSURE = 60
"""Blocks that the rate before needs."""
HIGHEST_MEAN = 0.5
"""Mean count from which on the counts are a series like any other: see `scan`."""
JEFFREYS_COUNT = 0.5
"""Counts before the first one: the prior of Jeffreys for a Poisson rate."""
EARLIER = 64
"""Blocks that are kept to find the first of a burst: few may be in the windows that tell it."""


@dataclass(slots=True)
class Burst:
    """More of something than before.

    Attributes
    ----------
    channel, first, last : int
        What, and the first and the last block that held any.
    count : int
        How many so far.
    nats : float
        -log of the p-value when it was found.
    mean : float
        Count a block before.
    held : int
        Blocks that held any.
    """

    channel: int
    first: int
    last: int
    count: int
    nats: float
    mean: float
    held: int

    @property
    def size(self) -> int:
        """How many more than before, to the next whole number."""
        return max(round(self.count - self.mean * (self.last - self.first + 1)), 1)

    @property
    def onset_reach(self) -> float:
        """Blocks of it that may have held none before the first one did, in 19 of 20 cases.

        Of a Poisson process of unknown rate that shows n in w there was none for longer than x
        before them with the probability (1 + x / w)^(1 - n). The n is that of bunches, by how many
        blocks hold none of them.
        """
        length = self.last - self.first + 1.0
        bunches = -length * math.log1p(-self.held / (length + 1.0))
        if bunches <= 1.5:
            return float(WINDOWS[-1])
        return min(length * (math.pow(20.0, 1.0 / (bunches - 1.0)) - 1.0), float(EARLIER))


class RareCounts:
    """Follow `channels` counts a block.

    Attributes
    ----------
    open : dict of int to Burst
        Bursts that go on, by channel.
    """

    def __init__(self, channels: int, log_alpha: NDArray[np.float64]) -> None:
        self.blocks = 0
        self.open: dict[int, Burst] = {}
        self._log_alpha = log_alpha
        self._recent = np.zeros((EARLIER, channels), np.int64)
        self._total = np.zeros(channels)
        self._square = np.zeros(channels)
        self._exposure = np.zeros(channels)

    def update(self, counts: NDArray[np.int64]) -> tuple[list[Burst], list[Burst]]:
        """Take the counts of a block; return the bursts that were found, and those that ended."""
        at = self.blocks
        self.blocks += 1
        self._recent[at % EARLIER] = counts
        old = self._recent[(at + 1 - WINDOWS[-1]) % EARLIER]  # which leaves the windows next
        found: list[Burst] = []
        ended: list[Burst] = []
        if not (self.open or any(counts.tolist()) or any(old.tolist())):  # numpy takes longer
            if self.blocks >= WINDOWS[-1]:
                self._exposure += 1.0
            return found, ended
        for channel in np.flatnonzero(counts):
            one = int(channel)
            if one not in self.open and (burst := self._tested(one, at)) is not None:
                self.open[one] = burst
                found.append(burst)
        for one, burst in list(self.open.items()):
            usual = WINDOWS[-1] * burst.mean
            if int(self._in_windows(one, at).sum()) <= 2 * usual + 3 * np.sqrt(usual):
                ended.append(self.open.pop(one))
            elif counts[one] and at > burst.last:
                burst.count += int(counts[one])
                burst.held += 1
                burst.last = at
        # What leaves the windows without having been a burst is what there was before.
        free = np.array([one not in self.open for one in range(len(counts))])
        past = free & (self.blocks >= WINDOWS[-1])
        self._total += np.where(past, old, 0)
        self._square += np.where(past, old * old, 0)
        self._exposure += past
        return found, ended

    def _in_windows(self, channel: int, at: int) -> NDArray[np.int64]:
        """Return the counts of a channel in the longest window that ends with a block."""
        blocks = np.arange(at + 1 - WINDOWS[-1], at + 1)
        return np.asarray(self._recent[blocks % EARLIER, channel])

    def _tested(self, channel: int, at: int) -> Burst | None:
        exposure = float(self._exposure[channel])
        mean = float(self._total[channel]) / max(exposure, 1.0)
        if exposure < LEAST_EXPOSURE or mean > HIGHEST_MEAN:
            return None
        total, square = float(self._total[channel]), float(self._square[channel])
        bunch = max((square - total * mean) / total, 1.0) if total else 1.0
        limit = -(float(self._log_alpha[channel]) + log_weight(self.blocks))
        recent = self._in_windows(channel, at)
        seen = np.cumsum(recent[::-1])[_WINDOWS - 1]
        window, nats = scan_p_value(seen, total / bunch, exposure, bunch)
        if nats <= limit:
            return None
        first = at - window + 1 + int(np.flatnonzero(recent[-window:])[0])
        seen = recent[-window:]
        burst = Burst(channel, first, at, int(seen.sum()), nats, mean, int(np.count_nonzero(seen)))
        self._extend(burst, total, exposure)
        return burst

    def _extend(self, burst: Burst, total: float, exposure: float) -> None:
        """Begin a burst with earlier ones, as far as each is rather of it than of what is usual.

        Usual is what there was before all that is looked at. How long none may have been seen is
        that of `Burst.onset_reach`.
        """
        blocks = np.arange(max(burst.last - EARLIER, -1) + 1, burst.first)
        before = self._recent[blocks % EARLIER, burst.channel]
        past = blocks <= burst.last - WINDOWS[-1]
        usual = total - float(before[past].sum()) + JEFFREYS_COUNT
        usual /= max(exposure - np.count_nonzero(past), 1.0)
        for block, count in zip(blocks[::-1].tolist(), before[::-1].tolist(), strict=True):
            length, held = burst.last - burst.first + 1, max(burst.held, 2)
            gap = (burst.first - block) / length
            if (held - 1) / length * (1.0 + gap) ** -held <= usual:
                break
            if count:
                burst.first, burst.count, burst.held = block, burst.count + count, burst.held + 1


def scan_p_value(
    seen: NDArray[np.int64], total: float, exposure: float, bunch: float = 1.0
) -> tuple[int, float]:
    """Return the window that holds most for its length, and -log of the p-value of any such.

    Parameters
    ----------
    seen : ndarray of int64, shape (windows,)
        Counts in the last blocks, by `WINDOWS`; the last block has one at least.
    total, exposure : float
        Bunches before, and blocks in which they were.
    bunch : float
        Counts in a bunch.

    Notes
    -----
    Few counts have few p-values. The probability that any window has one as small as the smallest
    is at most the sum over windows of the largest that each can have that is no larger: less than
    the smallest times the number of windows (Tarone, "A modified Bonferroni method for discrete
    data", Biometrics 46, 1990).

    Examples
    --------
    Four in 16 blocks after one in 500:

    >>> window, nats = scan_p_value(np.array([1, 1, 1, 2, 4]), 20.0, 10_000.0)
    >>> window, round(nats, 1)
    (16, 17.4)
    """
    counts = np.arange(1, 2 * seen[-1] + 9)[:, np.newaxis] / bunch
    tails = betainc(counts, total + JEFFREYS_COUNT, _WINDOWS / (_WINDOWS + exposure))
    # That so many fall into these blocks is seen at one of their own only.
    with np.errstate(divide="ignore"):
        tails *= -np.expm1(counts * np.log1p(-1.0 / _WINDOWS))
    own = tails[seen - 1, np.arange(len(WINDOWS))]
    best = int(own.argmin())
    possible = np.where(tails <= own[best], tails, tails[-1])
    return WINDOWS[best], float(-np.log(max(possible.max(axis=0).sum(), 1e-300)))
