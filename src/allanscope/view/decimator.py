"""How much of a run a viewer is given, so that it can bear a whole night.

Samples: at 6.66 kHz a plot has more samples than pixels within a second, and a viewer keeps 52
bytes for each. Mean, minimum and maximum of every tenth of a second show the same picture, spikes
included.

Results: they are spaced evenly in the logarithm of time, because a curve after 1 h and one after
1 h and 1 s look the same, one after 1 s and one after 2 s do not. A result is drawn when the run
has grown by `SHARE` since the last one, but not more often than once a second of the run and not
less often than once a minute: some 1100 in twelve hours, which can be scrubbed through like a film.

A file keeps fewer of both: results without that minute, rows ever longer as the run grows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Gap, StreamInfo

__all__ = ["Decimator", "LogSpacing", "RowThinner", "Rows"]

ROWS_HZ = 10.0

SHARE = 0.01
SHORTEST_S = 1.0
LONGEST_S = 60.0
"""Between two results: this share of the run, and limits in seconds of the run."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Some rows of the decimated series.

    Attributes
    ----------
    elapsed_s : ndarray, shape (n,)
        Middle of each row since the first sample of the run, gaps included.
    mean, low, high : ndarray, shape (n, axes)
        In dps or g.
    temperature_c : float
        Last temperature, NaN when none has come.
    """

    elapsed_s: NDArray[np.float64]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    temperature_c: float

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Return rows that follow each other as one."""
        return cls(
            elapsed_s=np.concatenate([part.elapsed_s for part in parts]),
            mean=np.concatenate([part.mean for part in parts]),
            low=np.concatenate([part.low for part in parts]),
            high=np.concatenate([part.high for part in parts]),
            temperature_c=parts[-1].temperature_c,
        )


class Decimator:
    """Collects blocks of any size, gives rows of a tenth of a second.

    Blocks are only kept until they make `rows` rows, so a call costs next to nothing; the
    arithmetic is done on the int16 counts, once for many samples.
    """

    def __init__(self) -> None:
        self.elapsed_s = 0.0
        """Stream time of the last sample taken."""
        self.temperature_c = float("nan")
        self._rate_hz = 0.0
        self._pending: list[NDArray[np.generic]] = []
        self._waiting = 0
        self._host_s: float | None = None
        self._lost_track = False

    def rate(self, hz: float, elapsed_s: float = 0.0) -> None:
        """Set the sample rate as it becomes known, or known better.

        A stream that claims no rate has no time of its own either: nothing is drawn until the
        first result brings both.
        """
        if hz > 0.0:
            if not self._rate_hz:
                self.elapsed_s = elapsed_s
            self._rate_hz = hz

    def restart(self) -> None:
        """Drop the unfinished row: what follows has other columns or another scale."""
        self._pending, self._waiting = [], 0

    def gap(self, gap: Gap) -> None:
        """Drop the unfinished row; no row spans a gap."""
        self.restart()
        if gap.lost is None:
            self._lost_track = True
        elif self._rate_hz:
            self.elapsed_s += gap.lost / self._rate_hz

    def update(self, info: StreamInfo, block: Block, rows: int = 2) -> Rows | None:
        """Take a block; return rows when at least `rows` of them are complete, else None."""
        if not self._rate_hz:
            self.rate(info.nominal_hz)
        self._follow(block)
        if not self._rate_hz or not len(block):
            return None
        self._pending.append(block.counts)
        self._waiting += len(block)
        self.elapsed_s += len(block) / self._rate_hz
        stride = max(1, round(self._rate_hz / ROWS_HZ))
        if self._waiting < rows * stride:
            return None
        return self._reduce(stride, np.asarray(info.scale))

    def _reduce(self, stride: int, scale: NDArray[np.float64]) -> Rows:
        counts = np.concatenate(self._pending)
        whole = len(counts) // stride
        rest = counts[whole * stride :]
        first_s = self.elapsed_s - self._waiting / self._rate_hz
        self._pending, self._waiting = [rest], len(rest)
        cut = counts[: whole * stride].reshape(whole, stride, -1)
        return Rows(
            elapsed_s=first_s + stride / self._rate_hz * (np.arange(whole, dtype=np.float64) + 0.5),
            mean=cut.mean(axis=1) * scale,
            low=cut.min(axis=1) * scale,
            high=cut.max(axis=1) * scale,
            temperature_c=self.temperature_c,
        )

    def _follow(self, block: Block) -> None:
        """Note temperature and host time; after a gap of unknown length the host tells it."""
        ticks = block.ticks
        known = ticks.temperature_c[np.isfinite(ticks.temperature_c)]
        if len(known):
            self.temperature_c = float(known[-1])
        arrived = np.flatnonzero(np.isfinite(ticks.host_s))
        if not len(arrived):
            return
        first = arrived[0]
        host_s = float(ticks.host_s[first])
        if self._host_s is None:
            self._host_s = host_s - self.elapsed_s
        elif self._lost_track:
            self.elapsed_s = max(self.elapsed_s, host_s - self._host_s)
        self._lost_track = False


class RowThinner:
    """Makes rows longer as the run grows, so that their number grows with its logarithm only.

    Rows stay as they are in the first hour, are twice as long in the second, four times until the
    fourth, and so on. Minimum and maximum are kept, so spikes are. They are handed on many at a
    time, because each time costs as much as fifty rows.
    """

    FINE_S = 3600.0
    TOGETHER = 50

    def __init__(self) -> None:
        self._waiting: list[Rows] = []

    @classmethod
    def stride(cls, elapsed_s: float) -> int:
        """Return how many rows become one after so much of the run.

        Examples
        --------
        >>> [RowThinner.stride(hours * 3600.0) for hours in (0.5, 1.5, 3.0, 12.0)]
        [1, 2, 4, 16]
        """
        return 1 << max(0, math.ceil(math.log2(max(elapsed_s, 1.0) / cls.FINE_S)))

    @classmethod
    def expected(cls, seconds: float) -> float:
        """Return about how many rows a run has."""
        doublings = math.log2(max(seconds / cls.FINE_S, 1.0))
        return ROWS_HZ * (min(seconds, cls.FINE_S) + 0.5 * cls.FINE_S * doublings)

    def update(self, rows: Rows) -> Rows | None:
        """Take rows; return longer ones when there are enough of them."""
        self._waiting.append(rows)
        span_s = float(rows.elapsed_s[-1] - self._waiting[0].elapsed_s[0])
        stride = self.stride(float(rows.elapsed_s[-1]))
        return self.flush() if span_s * ROWS_HZ >= self.TOGETHER * stride else None

    def flush(self) -> Rows | None:
        """Return all that waits."""
        if not self._waiting:
            return None
        rows, self._waiting = Rows.joined(self._waiting), []
        stride = self.stride(float(rows.elapsed_s[-1]))
        if stride == 1:
            return rows
        # By time and not by number: a gap between two rows stays one.
        which = np.floor(rows.elapsed_s * (ROWS_HZ / stride))
        first = np.flatnonzero(np.diff(which, prepend=-1.0))
        count = np.diff(first, append=len(which))
        return Rows(
            elapsed_s=np.add.reduceat(rows.elapsed_s, first) / count,
            mean=np.add.reduceat(rows.mean, first, axis=0) / count[:, None],
            low=np.minimum.reduceat(rows.low, first, axis=0),
            high=np.maximum.reduceat(rows.high, first, axis=0),
            temperature_c=rows.temperature_c,
        )


@dataclass(slots=True)
class LogSpacing:
    """Says which results to keep.

    Attributes
    ----------
    stretch : float
        Multiplies every spacing, for what is needed less often.
    share : float
        Of the run, between two results.
    longest_s : float
        Longest spacing before it is multiplied.

    Examples
    --------
    >>> spacing = LogSpacing()
    >>> [t for t in (1.0, 1.5, 2.0, 1000.0, 1009.0, 1011.0) if spacing.due(t)]
    [1.0, 2.0, 1000.0, 1011.0]
    """

    stretch: float = 1.0
    share: float = SHARE
    longest_s: float = LONGEST_S
    _last_s: float | None = None

    @staticmethod
    def expected(seconds: float, share: float) -> float:
        """Return about how many results a run has without a longest spacing."""
        even_s = SHORTEST_S / share
        return min(seconds, even_s) + math.log(max(seconds / even_s, 1.0)) / share

    def due(self, elapsed_s: float) -> bool:
        """Return whether to keep the result after this much of the run; if so, remember it."""
        last = self._last_s
        if last is not None and last <= elapsed_s:
            spacing = self.stretch * min(max(self.share * last, SHORTEST_S), self.longest_s)
            if elapsed_s - last < spacing * (1.0 - 1e-9):
                return False
        self._last_s = elapsed_s
        return True
