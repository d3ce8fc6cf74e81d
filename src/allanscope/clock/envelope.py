"""The earliest arrivals of a stream, one for each stretch of time: all that a night needs to keep.

A sample that was taken at time t is seen at t plus a delay. The delay is never less than the way
over the bus takes, and now and then much more: frames wait for each other in a USB transfer, the
reader sleeps, the system is busy. Means and least squares over all arrivals take every hiccup for
news. The earliest arrival in a stretch of time does not: with many arrivals it is close to the
shortest possible delay, which does not change. (Moon, Skelly and Towsley, "Estimation and removal
of clock skew from network delay measurements", INFOCOM 1999, use the same lower envelope.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.clock.line import LineFit, fit_line

__all__ = ["Envelope"]

ROWS = 256
FIRST_WINDOW_S = 2.0**-10
SHORTEST_PERIOD_S = 1e-7
BATCH = 2048
"""Arrivals are sorted in by so many, counted from the start of a segment: numpy likes many at a
time, and what is kept must not depend on how they were handed over."""

MOST_SEGMENTS = ROWS // 8
IN_STEP_S = 5.0
"""For so long a reader and a device may keep in step without being alike to a per cent."""

LONGEST_PAUSE_S = 20e-3
"""No reader and no adapter makes bytes wait for longer."""

SETTLED_ROWS = 16
"""With more rows than this, the window that is still filling up is left out of the fit."""


class Envelope:
    """Keep the arrival with the shortest delay of every window of host time.

    Windows are short at first, and twice as long whenever the table is full: neighbours are joined
    and the better of their two points stays. "Better" is judged against the period known so far.
    The first windows are so short that a period which is off by several per cent judges well, and
    by the time they are long the period has been fitted.

    Parameters
    ----------
    resolution_s : float
        Step of the time stamps.
    nominal_hz : float
        Rate that is claimed; 0 when none is.
    polled : bool
        Whether the times are those of a reader with a cadence of its own.
    """

    def __init__(self, resolution_s: float, nominal_hz: float = 0.0, polled: bool = False) -> None:
        self._resolution_s = resolution_s
        self._polled = polled
        self._window_s = FIRST_WINDOW_S
        # Not zero: of samples that are seen at the same moment the last one has waited least.
        self._period_s = 1.0 / nominal_hz if nominal_hz > 0.0 else SHORTEST_PERIOD_S
        self._used = 0
        self._index = np.zeros(ROWS, np.int64)
        self._time_s = np.zeros(ROWS)
        self._segment = np.zeros(ROWS, np.int64)
        self._temperature_c = np.full(ROWS, np.nan)
        self._current = 0
        self._waiting_index = np.zeros(BATCH, np.int64)
        self._waiting_time_s = np.zeros(BATCH)
        self._waiting_temperature_c = np.zeros(BATCH)
        self._waiting = 0

    def add(
        self,
        index: NDArray[np.int64],
        time_s: NDArray[np.float64],
        temperature_c: NDArray[np.float64],
    ) -> None:
        """Take samples, by number, the times at which they were seen, and their temperatures.

        NaN where a time or a temperature is unknown.
        """
        taken = 0
        while taken < len(index):
            size = min(BATCH - self._waiting, len(index) - taken)
            new, old = slice(self._waiting, self._waiting + size), slice(taken, taken + size)
            self._waiting_index[new], self._waiting_time_s[new] = index[old], time_s[old]
            self._waiting_temperature_c[new] = temperature_c[old]
            self._waiting += size
            taken += size
            if self._waiting == BATCH:
                self._take()

    def cut(self) -> None:
        """Begin a segment: numbers or times from here on have another origin."""
        self._take()
        self._current += 1

    def fit(self) -> LineFit | None:
        """Return the rate at which numbers pass, or None while too little is known."""
        self._take()
        return self._fit()

    def _fit(self) -> LineFit | None:
        used = self._used - 1 if self._used > SETTLED_ROWS else self._used
        rows = slice(0, used)
        return fit_line(
            self._index[rows],
            self._time_s[rows],
            self._segment[rows],
            max(self._resolution_s, self._cadence_s(self._time_s[rows])),
            self._temperature_c[rows],
        )

    def _cadence_s(self, time_s: NDArray[np.float64]) -> float:
        """Return the step in which arrivals may creep, as long as that cannot be excluded.

        A reader that comes back after a pause of nearly the length of a frame finds one frame each
        time, at its own pace: the arrivals are as regular as a clock, and their rate is the
        reader's. When the two part is seen within seconds, if they are not alike by chance.
        """
        if not self._polled or len(time_s) < 2 or np.ptp(time_s) > IN_STEP_S:
            return 0.0
        return min(float(np.median(np.diff(time_s))), LONGEST_PAUSE_S)

    def _take(self) -> None:
        """Sort in what has been waiting."""
        index, time_s = self._waiting_index[: self._waiting], self._waiting_time_s[: self._waiting]
        self._waiting = 0
        known = np.isfinite(time_s)
        if known.any():
            temperature_c = self._waiting_temperature_c[: len(known)]
            self._add(index[known], time_s[known], temperature_c[known])

    def _add(
        self,
        index: NDArray[np.int64],
        time_s: NDArray[np.float64],
        temperature_c: NDArray[np.float64],
    ) -> None:
        window = np.floor(time_s / self._window_s)
        delay = (time_s - time_s[0]) - (index - index[0]) * self._period_s
        starts = np.flatnonzero(np.diff(window, prepend=np.nan) != 0.0)
        least = np.minimum.reduceat(delay, starts)
        at_least = np.flatnonzero(delay == np.repeat(least, np.diff(starts, append=len(delay))))
        best = at_least[np.searchsorted(at_least, starts)]
        taken = 0
        while taken < len(best):
            if self._used == ROWS:
                self._widen()
            room = best[taken : taken + ROWS - self._used]
            new = slice(self._used, self._used + len(room))
            self._index[new], self._time_s[new] = index[room], time_s[room]
            self._segment[new] = self._current
            self._temperature_c[new] = temperature_c[room]
            self._used += len(room)
            taken += len(room)
        self._join()

    def _widen(self) -> None:
        """Join rows, and double the windows until there is room."""
        self._join()
        fit = self._fit()
        if fit is not None:
            self._period_s = 1.0 / fit.hz
        self._give_up_short_segments()
        while self._used > 3 * ROWS // 4:
            self._window_s *= 2.0
            self._join()

    def _give_up_short_segments(self) -> None:
        """Keep the longest segments: what joins nothing must not crowd out what tells most."""
        segment = self._segment[: self._used]
        names, count = np.unique(segment, return_counts=True)
        longest = names[np.argsort(count, kind="stable")[-MOST_SEGMENTS:]]
        self._keep(np.flatnonzero(np.isin(segment, longest)))

    def _join(self) -> None:
        """Join rows of the same window and segment."""
        rows = slice(0, self._used)
        window = np.floor(self._time_s[rows] / self._window_s)
        segment = self._segment[rows]
        first = (np.diff(window, prepend=np.nan) != 0.0) | (np.diff(segment, prepend=-1) != 0)
        starts = np.flatnonzero(first)
        if len(starts) == self._used:
            return
        origin = np.repeat(starts, np.diff(starts, append=self._used))
        delay = (self._time_s[rows] - self._time_s[origin]) - self._period_s * (
            self._index[rows] - self._index[origin]
        )
        least = np.minimum.reduceat(delay, starts)
        at_least = np.flatnonzero(delay == least[np.cumsum(first) - 1])
        self._keep(at_least[np.searchsorted(at_least, starts)])

    def _keep(self, rows: NDArray[np.int64]) -> None:
        for table in (self._index, self._time_s, self._segment, self._temperature_c):
            table[: len(rows)] = table[rows]
        self._used = len(rows)
