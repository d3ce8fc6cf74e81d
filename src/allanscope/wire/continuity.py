"""Losses told by time stamps alone: what lies between one row and the next.

It is nothing, a gap of known length, or a gap of unknown length. Stock firmware numbers nothing,
but it stamps every sample with its clock. The stamp is taken when the sample was read, which is up
to a polling loop late; so it is not the step between two stamps that is compared with the period,
but each stamp with the time that the samples before predict (`PeriodTracker`). A sample that is
late is followed by one that is not; one that is missing shifts all that follow by a whole period.
Where stamps are late and none came after a long step, the device has become slower, as a polling
loop does that has more to print, and its period is learnt anew.

A jump is believed only when the next stamp confirms it.

Stamps that scatter by a good part of a period say little one by one (`Comb`): then it is the
likeliest course of the next few that decides, in which each is a whole number of periods late,
by more after a loss and by one less after a row that came twice.

The period is the mean over up to 8192 samples. When stamps scatter by s periods and it was taken
from n samples, its relative error is 2 s / n at most; a gap of m samples can be counted while m
times that is below a quarter. What is longer is left without a number.

Where there are no times, or they tell nothing, rows without values count as the samples that they
should have been.

Some clocks stand still for several samples: hundredths of a second at 416 Hz, milliseconds at
6.66 kHz. Most stamps repeat the one before, so there is no period to compare with. Such a clock
still goes step by step (`CoarseClock`): when it jumps over some, samples are missing; how many,
nothing tells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel
from allanscope.samples import Gap, GapReason
from allanscope.wire.rows import Row
from allanscope.wire.timestamps import comb_of, period_of

__all__ = ["CoarseClock", "Continuity", "Missing", "PeriodTracker", "losses_of"]

Missing = int | Literal["back", "repeat"] | None
"""Samples that are missing: 0 none, None an unknown number, ``back`` where time went back,
``repeat`` where the row may be the one before it again."""

_LOOKED_AT = 1024
"""Stamps from which the period of a record is taken."""
_NOTHING = np.empty(0)
_MEMORY = 8192
_ANCHORED = _MEMORY // 2
_PULL = 1 / 8
_FIRST_TRUST = 16
_LEAST_SCATTER = 0.02
_NEARBY = 8.5
_STEPS = 2.5
_LEAST_STEP = 1.4
"""Step in periods below which nothing is missing, however late a stamp is."""
_ROUGH = 0.08
"""Scatter of the stamps, in periods, from which several of them decide."""
_LOSS, _REPEAT, _OTHER, _OUTLIER = 8.0, 4.0, 12.0, 6.0
"""Minus the log of how often samples are lost, rows of equal values and of other values are one too
many, and stamps are off by anything."""


class Continuity:
    """Follows the rows that are accepted, by their time stamps where they have any.

    Parameters
    ----------
    checked : bool
        Whether rows come with a checksum: a jump of the time where a damaged one was is then
        believed at once.

    Attributes
    ----------
    accepted : int
        Rows so far.
    """

    def __init__(self, checked: bool = False) -> None:
        self.accepted = 0
        self._checked = checked
        self._times: list[float] = []
        self._resolution_s = 0.0
        self._farthest_s: float | None = None
        self._blank_is_lost = True
        self._tracker: PeriodTracker | None = None
        self._coarse_clock = CoarseClock()
        self._due: GapReason | None = None
        self._discarded = False

    def learn(
        self,
        times: list[float],
        resolution_s: float,
        farthest_s: float | None = None,
        blank_is_lost: bool = True,
    ) -> None:
        """Take the times of some rows, and the step of their clock, to find their period.

        Where `farthest_s` is given the times do not tell single losses, only steps above it. Rows
        without values are lost samples if `blank_is_lost`, and those of another rate if not.
        """
        self._blank_is_lost = blank_is_lost
        self._times = times
        self._resolution_s = resolution_s
        self._farthest_s = farthest_s
        self._start_over()

    def interrupt(self, reason: GapReason) -> None:
        """Note why the next row does not follow the last one; the first reason stands."""
        if self.accepted and self._due is None:
            self._due = reason

    @property
    def lookahead(self) -> int:
        """How many of the rows after one are needed to decide about it."""
        return self._tracker.lookahead if self._tracker is not None else 1

    def missing(
        self, row: Row, after: NDArray[np.float64] = _NOTHING, again: bool = False
    ) -> Missing:
        """Return what is missing before a row, given the times of the rows after it.

        `again` says that its values are those of the row before.
        """
        if self.accepted == 0:
            return 0
        if self._due is not None:
            self._start_over()
            return 0
        damaged = row.damaged_before or self._discarded
        if not self._timed(row):
            if row.blank_before and self._blank_is_lost and not damaged:
                return row.blank_before
            return None if damaged or self._coarse_clock.jumped(row.device_s) else 0
        assert self._tracker is not None
        return self._tracker.missing(row.device_s, damaged, after, again)

    def blank_losses(self, blank_before: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the samples lost before each row, where only rows without values show it."""
        counted = self._tracker is None and self._blank_is_lost
        return blank_before if counted else np.zeros_like(blank_before)

    def needs_confirmation(self, row: Row, missing: Missing) -> bool:
        """Return whether the time of a row is to be believed only if the next one confirms it."""
        if self._tracker is None or not self._timed(row) or (self._checked and row.damaged_before):
            return False
        return missing != 0 or self._tracker.is_new

    def is_confirmed(self, row: Row, after: Row) -> bool:
        """Return whether the row after one that needs confirmation agrees with it."""
        return self._tracker is None or self._tracker.is_confirmed(
            row.device_s, after.device_s, damaged_between=after.damaged_before
        )

    def note_discarded(self) -> None:
        """Note that a row was thrown away as damaged."""
        self._discarded = True

    def update(self, row: Row, missing: Missing) -> Gap | None:
        """Accept a row and return the gap before it, if there is one."""
        self.accepted += 1
        due, self._due = self._due, None
        damaged, self._discarded = row.damaged_before or self._discarded, False
        self._coarse_clock.update(row.device_s)
        if self._tracker is not None and self._timed(row):
            self._tracker.update(row.device_s, missing)
        if due is not None:
            return Gap(due, None)
        if missing == "back":
            return Gap("restarted", None)
        if missing == "repeat":
            return None
        return None if missing == 0 else Gap("link" if damaged else "device", missing)

    def accept(self, device_s: NDArray[np.float64]) -> int:
        """Accept rows of these times, without damage, up to the first that needs a closer look.

        That is one before which something is missing, or that needs confirmation. Return how many
        came before it: for each of them `missing` says 0, and `update` no gap.
        """
        if self.accepted == 0 or self._due is not None or self._discarded:
            return 0
        follower = self._coarse_clock if self._tracker is None else self._tracker
        count = follower.accept(device_s)
        if count:
            self.accepted += count
            self._coarse_clock.update(float(device_s[count - 1]))
        return count

    def _timed(self, row: Row) -> bool:
        return self._tracker is not None and not math.isnan(row.device_s)

    def _start_over(self) -> None:
        if self._farthest_s is not None:
            self._tracker, self._coarse_clock = None, CoarseClock(self._farthest_s)
            return
        self._tracker = PeriodTracker.of(self._times, self._resolution_s)
        self._coarse_clock = CoarseClock.of(self._times, self._resolution_s)


class PeriodTracker:
    """Follow the time stamps of a stream and count what is missing between them.

    Parameters
    ----------
    period_s : float
        First idea of the period, from `period_of`.
    resolution_s : float
        Step of the stamps. Where it is more than 0.6 periods a single
        missing sample does not show: gaps are found, by the stamps or by the damage that made
        them, but not counted.
    scatter : float
        How far stamps are from even, in periods.
    rms : float
        Standard deviation of the stamps, in periods.
    rows : int
        How many the period was taken from.

    Attributes
    ----------
    lookahead : int
        How many of the stamps after one are needed to decide about it.
    """

    def __init__(
        self,
        period_s: float,
        resolution_s: float = 0.0,
        scatter: float = 0.5,
        rms: float = 0.0,
        rows: int = 0,
    ) -> None:
        self._rms = rms if rms > _ROUGH else 0.0
        self.lookahead = max(4, round(200.0 * rms * rms)) if self._rms else 1
        self._countable = resolution_s <= 0.6 * period_s
        self._reach = min(1.0 / (8.0 * max(scatter, _LEAST_SCATTER)), 1.0)
        self._plausible = period_s / 2, period_s * 2
        self._period = period_s
        self._trusted = max(_FIRST_TRUST, rows // 2)
        self._expected: float | None = None
        self._last = -math.inf
        self._samples = 0
        self._anchors: list[tuple[int, float]] = []

    @classmethod
    def of(cls, times: Sequence[float], resolution_s: float) -> PeriodTracker | None:
        """Return a tracker of a stream that begins with these times; None without a period."""
        comb_once = cache(lambda: comb_of(times))
        period_s = period_of(times, comb_once)
        if period_s is None:
            return None
        steps = np.diff(times) / period_s
        off = np.abs(steps[np.abs(steps - 1.0) < 0.5] - 1.0)
        if not len(off):
            return None
        comb = comb_once() if math.sqrt(float(np.mean(off**2)) / 2.0) > _ROUGH else None
        if comb is None:
            return cls(period_s, resolution_s, float(off.max()))
        return cls(period_s, resolution_s, float(off.max()), comb.scatter, len(times))

    def missing(
        self,
        time_s: float,
        damaged: bool = False,
        after: NDArray[np.float64] = _NOTHING,
        again: bool = False,
    ) -> Missing:
        """Return how many samples are missing before a sample of this time.

        Parameters
        ----------
        time_s : float
            Its stamp.
        damaged : bool
            Whether something unreadable came before it.
        after : ndarray
            The stamps of the samples after it.
        again : bool
            Whether its values are those of the sample before.

        Returns
        -------
        Missing
            None when it cannot be told; ``back`` when time went back, as it does when a device
            restarts; ``repeat`` where a row too many came.
        """
        if self._rms and self._expected is not None and not damaged:
            stamps = np.append(time_s, after[: self.lookahead])
            late_by = (stamps - self._expected) / self._period - np.arange(len(stamps))
            return self._likeliest(late_by, again)
        if time_s < self._last - self._period / 2:
            return "back"
        late = self._lateness(time_s)
        if not self._countable:
            return None if damaged or late > 1.5 else 0
        early = -1.5 < late < -0.5 and again and len(after)
        if early and -1.5 < self._lateness(float(after[0])) - 1.0 < -0.5:
            return "repeat"
        if not damaged and time_s - self._last < _LEAST_STEP * self._period:
            return 0
        number = max(0, round(late))
        return number if number <= self._known() * self._reach else None

    def _likeliest(self, late: NDArray[np.float64], again: bool) -> Missing:
        """Return what is missing before the first of some stamps, by the likeliest course of all.

        The course is the number of periods that each is late: it rises by what is lost, falls by
        one where a row comes twice, and by more where the clock is set back (Viterbi, 1967).
        """
        if not late.min() > -_NEARBY and np.median(late) < -1.5:
            return "back"
        near = np.unique(np.clip(np.rint(late), -1, None).astype(np.int64))
        levels = np.unique(np.concatenate([near, near + 1, [-1, 0, 1]]))
        misfit = (late[:, None] - levels) ** 2 / (2.0 * self._rms**2)
        misfit = np.minimum(misfit, _OUTLIER)
        rise = levels - levels[:, None]  # from row to column
        price = np.where(rise > 0, _LOSS, np.where(rise == 0, 0.0, -_OTHER * rise))
        cost = misfit[-1]
        for one in misfit[-2::-1]:
            cost = one + (price + cost).min(axis=1)
        first = price[levels == 0][0]
        if again:
            first[levels == -1] = _REPEAT
        number = int(levels[int((first + cost).argmin())])
        if number < 0:
            return "repeat"
        return number if number <= self._known() * self._reach else None

    @property
    def is_new(self) -> bool:
        """Whether no stamp has been followed yet, so that there is nothing to compare with."""
        return self._expected is None

    def is_confirmed(self, time_s: float, next_s: float, damaged_between: bool = False) -> bool:
        """Return whether a stamp that jumps, or the first one, is confirmed by the one after it.

        Text has no checksum: a lost digit makes a wrong stamp. Then the next one goes on where the
        one before had left off, and the one between must not be taken for a loss.

        Parameters
        ----------
        time_s, next_s : float
            The stamp and the one after it.
        damaged_between : bool
            Whether something unreadable came between the two, so that they may be several periods
            from each other: a sound sample between two damaged ones is sound.
        """
        if not self._countable or (self._rms and not self.is_new):
            return True
        steps = (next_s - time_s) / self._period
        off = abs(steps - (max(1, round(steps)) if damaged_between else 1))
        if self.is_new:
            return off <= 0.5 + 4.0 * self._rms
        late = self._lateness(next_s)
        if not 0.5 <= late <= _NEARBY:
            return True
        return off <= abs(late - round(late)) + 0.25

    def update(self, time_s: float, missing: Missing) -> None:
        """Take the next time stamp and what `missing` said of it.

        After a jump that cannot be counted everything but the period starts over.
        """
        if missing == "repeat":  # of other values: then a sample was taken for lost before
            missing = -1
        if not isinstance(missing, int):
            self._restart()
            missing = 0
        expected = time_s if self._expected is None else self._expected + missing * self._period
        self._last = time_s
        self._samples += missing
        if not self._anchors or self._samples - self._anchors[-1][0] >= _ANCHORED:
            self._anchors = [*self._anchors[-1:], (self._samples, time_s)]
        first, since = self._anchors[0]
        if self._samples - first >= self._trusted:
            period = (time_s - since) / (self._samples - first)
            low, high = self._plausible
            self._period = min(max(period, low), high)
        off = time_s - expected
        if missing == 0 and not self._rms and off > self._period / 2.0:
            # No step was long, and yet they add up: the device has become slower.
            self._anchors, self._trusted = [(self._samples, time_s)], _FIRST_TRUST
            expected, off = time_s, 0.0
        if self._rms:
            off = min(max(off, -self._period / 2.0), self._period / 2.0)
        self._expected = expected + _PULL * off + self._period
        self._samples += 1

    def accept(self, times_s: NDArray[np.float64]) -> int:
        """Take time stamps up to the first that `missing` has something to say of.

        Returns how many; none after a jump that could not be counted.
        """
        if self._expected is None:
            return 0
        (first, since), (last, until) = self._anchors[0], self._anchors[-1]
        state = np.array([self._period, self._expected, self._last, since, until])
        counts = np.array([self._samples, first, last], np.int64)
        back = 1.5 if self._rms else 0.5
        limits = np.array([*self._plausible, _PULL, 0.5 if self._countable else 1.5, back])
        taken = int(
            _accept_stamps(times_s, len(times_s), self._trusted, _ANCHORED, limits, state, counts)
        )
        self._period, self._expected, self._last, since, until = state.tolist()
        self._samples, first, last = counts.tolist()
        self._anchors = [(first, since)] if first == last else [(first, since), (last, until)]
        return taken

    def _restart(self) -> None:
        self._trusted = min(self._known(), _ANCHORED)
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


def losses_of(times_s: NDArray[np.float64], resolution_s: float = 0.0) -> dict[int, int] | None:
    """Return how many samples are missing before which row, where the stamps scatter; else None.

    >>> rng = np.random.default_rng(1)
    >>> kept = np.delete(np.arange(1000), [300, 301, 700])
    >>> losses_of(0.01 * kept + rng.normal(0.0, 0.002, len(kept)))
    {300: 2, 698: 1}
    """
    tracker = PeriodTracker.of(times_s[:_LOOKED_AT].tolist(), resolution_s)
    if tracker is None or tracker.lookahead == 1:
        return None
    lost = {}
    row = 0
    while row < len(times_s):
        row += tracker.accept(times_s[row:])
        if row == len(times_s):
            break
        after = times_s[row + 1 : row + 1 + tracker.lookahead]
        missing = tracker.missing(times_s[row], after=after)
        tracker.update(times_s[row], missing)
        if isinstance(missing, int) and missing > 0:
            lost[row] = missing
        row += 1
    return lost


class CoarseClock:
    """Follow the stamps of a clock that is coarser than the samples.

    Parameters
    ----------
    farthest_s : float
        A stamp that is farther than this from the one before has jumped.
    """

    def __init__(self, farthest_s: float = math.inf) -> None:
        self._farthest_s = farthest_s
        self._last_s = math.nan

    @classmethod
    def of(cls, times: Sequence[float], resolution_s: float) -> CoarseClock:
        """Return the clock of a stream that begins with these times; no jump unless they repeat.

        >>> clock = CoarseClock.of([0.0, 0.0, 0.0, 0.01, 0.01, 0.01], 0.01)
        >>> clock.update(0.01)
        >>> clock.jumped(0.02), clock.jumped(0.5)
        (False, True)
        """
        steps = np.diff(np.asarray(times, np.float64))
        size = np.abs(steps[steps != 0.0])
        still = len(size) > 0 and float(np.median(np.abs(steps))) == 0.0
        if still and float(np.median(size)) > _STEPS * resolution_s:  # rows that come in bursts
            return cls(_STEPS * float(size.max()))
        return cls(_STEPS * resolution_s if still and resolution_s > 0.0 else math.inf)

    def jumped(self, time_s: float) -> bool:
        """Return whether the clock went farther than a step or two since the last stamp."""
        return abs(time_s - self._last_s) > self._farthest_s

    def update(self, time_s: float) -> None:
        """Take the next stamp."""
        self._last_s = time_s

    def accept(self, times_s: NDArray[np.float64]) -> int:
        """Return how many stamps come before the first that has jumped."""
        if self._farthest_s == math.inf:
            return len(times_s)
        steps = np.abs(times_s - np.append(self._last_s, times_s[:-1]))
        jumps = np.flatnonzero(steps > self._farthest_s)
        return int(jumps[0]) if len(jumps) else len(times_s)


_accept_stamps = kernel(
    "accept_stamps",
    *(Pointer(np.float64, 1), int, int, int, Pointer(np.float64, 1)),
    *(Pointer(np.float64, 1, written=True), Pointer(np.int64, 1, written=True)),
    returns=int,
)
