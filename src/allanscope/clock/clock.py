"""The clock of a run: the earliest arrivals of its samples, and which rate is the true one.

A sample that was taken at time t is seen at t plus a delay. The delay is never less than the way
over the bus takes, and now and then much more: frames wait for each other in a USB transfer, the
reader sleeps, the system is busy. Means and least squares over all arrivals take every hiccup for
news. The earliest arrival in a stretch of time does not: with many arrivals it is close to the
shortest possible delay, which does not change. (Moon, Skelly and Towsley, "Estimation and removal
of clock skew from network delay measurements", INFOCOM 1999, use the same lower envelope.) So an
`Envelope` keeps these, all that a night needs, and a `Clock` has one for each of its two clocks.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.clock.rate import (
    DISAGREEMENT,
    SHORTEST_PERIOD_S,
    LineFit,
    RateFit,
    fit_line,
    rate_of_line,
)
from allanscope.compiled import Pointer, kernel
from allanscope.samples import Gap, StreamInfo, Ticks

__all__ = ["Clock", "Envelope"]

USB_FRAME_S = 1e-3
"""A host asks a full-speed USB device once in a millisecond; arrivals have that step."""

ROUNDING_S = 1e-7
"""No device time is trusted more finely than this."""

KNOWN_BELOW = 0.01
"""A rate whose relative standard deviation is larger than this is not worth replacing the nominal
one: these parts are off by several per cent at most."""

CRYSTAL = 40e-6
"""Standard deviation of a crystal's rate: 50 ppm of tolerance, temperature and ageing."""

CONTRADICTION = 4.0
"""Standard deviations that two clocks may be apart."""

ROWS = 256
FIRST_WINDOW_S = 2.0**-10
BATCH = 2048
"""Arrivals are sorted in by so many, counted from the start of a segment: numpy likes many at a
time, and what is kept must not depend on how they were handed over."""

MOST_SEGMENTS = ROWS // 8
IN_STEP_S = 5.0
"""For so long a reader and a device may keep in step without being alike to a per cent."""

FEWEST_READS, EVEN, CLEAR, MOST_PAUSES = 16, 0.9, 0.1, 8.0
"""Reads that tell the cadence of a reader, the share that find as many samples as most where the
cadence is that of the frames, the scatter of arrivals in units of a pause that is seen, and pauses
between reads up to which they can be counted."""

LONGEST_PAUSE_S = 20e-3
"""No adapter makes bytes wait for longer, and no reader whose pauses are not seen."""

SETTLED_S = 10.0
"""So long a time of a device is better than what its first rows showed."""

SETTLED_ROWS = 16
"""With more rows than this, the window that is still filling up is left out of the fit."""

_earliest_of_windows = kernel(
    "earliest_of_windows",
    *(Pointer(np.int64, 1), Pointer(np.float64, 1), Pointer(np.int64, 1), int, int, float, float),
    Pointer(np.int64, 1, written=True),
    returns=int,
)


class Clock:
    """Follow a stream and know its true sample rate, in memory that does not grow.

    Parameters
    ----------
    nominal_hz : float
        Rate that the device claims; 0 when it claims none.
    device_clock : bool
        Whether the device's time is a clock of its own, a crystal. The time of the sensor's own
        oscillator is not: it is off by as much as the rate is.
    device_resolution_s : float
        Step of the device's time.
    crystal : bool
        Whether the device's clock is known to be a crystal, which overrules the host.
    guessed : bool
        Whether `device_resolution_s` is a guess from the first times.
    seen : bool
        Whether `nominal_hz` is only what the first rows showed: then the device's time is better
        however unevenly it goes, as that of a polling loop which has become slower.

    Examples
    --------
    Records of a file, 51 in a second, with no other time than the device's:

    >>> import numpy as np
    >>> clock = Clock(nominal_hz=50.0)
    >>> offset, unknown = np.arange(1000), np.full(1000, np.nan)
    >>> clock.update(0, Ticks(offset, offset / 51.0, unknown, unknown))
    >>> rate = clock.rate()
    >>> print(f"{rate.hz:.3f} Hz by the {rate.source}, {rate.clock_error.relative:+.1%}")
    51.000 Hz by the device, +2.0%
    """

    def __init__(
        self,
        nominal_hz: float = 0.0,
        device_clock: bool = True,
        device_resolution_s: float = 0.0,
        crystal: bool = False,
        guessed: bool = False,
        seen: bool = False,
    ) -> None:
        self.nominal_hz = nominal_hz
        self._guessed = guessed
        self._seen = seen
        self._device_clock = device_clock
        self._crystal = crystal
        self._device_resolution_s = device_resolution_s
        self.restart()

    @classmethod
    def of(cls, info: StreamInfo) -> Clock:
        """Return the clock of a stream that describes itself."""
        crystal = info.device_clock and not info.tabular
        seen = info.tabular and not info.rate_claimed
        return cls(
            info.nominal_hz, info.device_clock, info.time_resolution_s, crystal, info.tabular, seen
        )

    def update(self, index: int, ticks: Ticks) -> None:
        """Take the ticks of a block whose first sample has the number `index`."""
        number = index + ticks.offset
        self._host.add(number, ticks.host_s, ticks.temperature_c)
        if self._device_clock:
            self._device.add(number, ticks.device_s, ticks.temperature_c)

    def gap(self, gap: Gap) -> None:
        """Take a gap; only one that leaves the numbers without meaning breaks the lines."""
        if gap.lost is None or gap.reason in ("restarted", "resumed", "file"):
            self._host.begin_segment()
            self._device.begin_segment()

    def restart(self, nominal_hz: float | None = None) -> None:
        """Forget everything, because the device was set to another rate."""
        if nominal_hz is not None:
            self.nominal_hz = nominal_hz
        self._host = Envelope(USB_FRAME_S, self.nominal_hz, polled=True)
        resolution_s = max(self._device_resolution_s, ROUNDING_S)
        self._device = Envelope(resolution_s, self.nominal_hz, guessed=self._guessed)

    def rate(self) -> RateFit:
        """Return the best rate that is known now: by the host, by the device, or the nominal one.

        The host's clock is the truth. But its arrivals come unevenly, and in the first seconds the
        crystal of the device knows better: then its rate is given, with all that a crystal may be
        off. Where the two contradict each other by more than crystals can, a device that says that
        its clock is a crystal is used: the host has read late. Otherwise its time is none.
        """
        host, device = self._host.fit(), self._device.fit()
        host_sigma = host.relative_sigma if host is not None else math.inf
        device_sigma = device.relative_sigma if device is not None else math.inf
        if host is not None and device is not None:
            if self._crystal and device_sigma < KNOWN_BELOW and _clocks_disagree(host, device):
                return self._fit(device, "device", device_sigma, host, device)
            device_sigma = math.hypot(device_sigma, CRYSTAL)
            apart = abs(host.hz / device.hz - 1.0)
            if apart > CONTRADICTION * math.hypot(host_sigma, device_sigma):
                device_sigma = math.inf
        if device is not None and device_sigma < min(host_sigma, KNOWN_BELOW):
            return self._fit(device, "device", device_sigma, host, device)
        if host is not None and host_sigma < KNOWN_BELOW:
            return self._fit(host, "host", host_sigma, host, device)
        if self._seen and host is None and device is not None and device.span_s > SETTLED_S:
            return self._fit(device, "device", device.relative_sigma, host, device)
        return RateFit(self.nominal_hz, self.nominal_hz, "nominal", host=host, device=device)

    def arrivals(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]] | None:
        """Return numbers of samples, times in s and segments, each (k,), by the clock of `rate`.

        They tell how the rate wandered. Within a segment numbers and times have one origin. None
        while the rate is not measured.
        """
        source = self.rate().source
        if source == "nominal":
            return None
        return (self._host if source == "host" else self._device).arrivals()

    def _fit(
        self,
        fit: LineFit,
        source: Literal["host", "device"],
        relative_sigma: float,
        host: LineFit | None,
        device: LineFit | None,
    ) -> RateFit:
        return RateFit(
            self.nominal_hz,
            fit.hz,
            source,
            relative_sigma * 1e6,
            fit.residual_s,
            fit.span_s,
            fit.drift_per_h * 1e6,
            fit.drift_sigma_per_h * 1e6,
            fit.per_degc * 1e6,
            fit.per_degc_sigma * 1e6,
            fit.steps,
            host,
            device,
        )


def _clocks_disagree(host: LineFit, device: LineFit) -> bool:
    """Return whether two clocks disagree by more than crystals do, and more than by chance."""
    sigma = math.hypot(host.relative_sigma, device.relative_sigma)
    return abs(host.hz / device.hz - 1.0) > DISAGREEMENT + 3.0 * sigma


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
    guessed : bool
        Whether the step is a guess.
    """

    def __init__(
        self,
        resolution_s: float,
        nominal_hz: float = 0.0,
        polled: bool = False,
        guessed: bool = False,
    ) -> None:
        self._resolution_s = resolution_s
        self._guessed = guessed
        self._polled = polled
        self._pause_s = 0.0
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
        self._known: tuple[LineFit | None] | None = None  # what `fit` found, until more comes

    def add(
        self,
        index: NDArray[np.int64],
        time_s: NDArray[np.float64],
        temperature_c: NDArray[np.float64],
    ) -> None:
        """Take samples, by number, the times at which they were seen, and their temperatures.

        NaN where a time or a temperature is unknown.
        """
        taken, self._known = 0, None
        while taken < len(index):
            size = min(BATCH - self._waiting, len(index) - taken)
            new, old = slice(self._waiting, self._waiting + size), slice(taken, taken + size)
            self._waiting_index[new], self._waiting_time_s[new] = index[old], time_s[old]
            self._waiting_temperature_c[new] = temperature_c[old]
            self._waiting += size
            taken += size
            if self._waiting == BATCH:
                self._add_waiting()

    def begin_segment(self) -> None:
        """Begin a segment: numbers or times from here on have another origin."""
        self._add_waiting()
        self._current += 1

    def fit(self) -> LineFit | None:
        """Return the rate at which numbers pass, or None while too little is known."""
        if self._known is None:
            self._add_waiting()
            self._known = (self._fit(),)
        return self._known[0]

    def arrivals(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]] | None:
        """Return numbers, times and segments of what is kept, each (k,); None of nothing."""
        self._add_waiting()
        rows = slice(0, self._used)
        if not self._used:
            return None
        return self._index[rows].copy(), self._time_s[rows].copy(), self._segment[rows].copy()

    def _fit(self) -> LineFit | None:
        rows = self._settled()
        return fit_line(
            self._index[rows],
            self._time_s[rows],
            self._segment[rows],
            self._resolution_s,
            self._temperature_c[rows],
            self._pause_s,
            self._cadence_s(self._time_s[rows]),
            self._guessed,
        )

    def _settled(self) -> slice:
        """Return the rows to fit, but for the last one of many; look at the pauses of a reader."""
        rows = slice(0, self._used - 1 if self._used > SETTLED_ROWS else self._used)
        if self._polled and self._window_s == FIRST_WINDOW_S:  # every read is there
            self._pause_s = _pause(self._index[rows], self._time_s[rows])
        return rows

    def _cadence_s(self, time_s: NDArray[np.float64]) -> float:
        """Return the step in which arrivals may creep, as long as that cannot be excluded.

        A reader that comes back after a pause of nearly the length of a frame finds one frame each
        time, at its own pace: the arrivals are as regular as a clock, and their rate is the
        reader's. When the two part is seen within seconds, if they are not alike by chance.
        """
        if not self._polled or len(time_s) < 2 or np.ptp(time_s) > IN_STEP_S:
            return 0.0
        return min(float(np.median(np.diff(time_s))), LONGEST_PAUSE_S)

    def _add_waiting(self) -> None:
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
        best = self._earliest(index, time_s, np.zeros_like(index), from_first=True)
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
        rows = self._settled()
        hz = rate_of_line(self._index[rows], self._time_s[rows], self._segment[rows])
        if hz is not None:
            self._period_s = 1.0 / hz
        self._drop_short_segments()
        while self._used > 3 * ROWS // 4:
            self._window_s *= 2.0
            self._join()

    def _drop_short_segments(self) -> None:
        """Keep the longest segments: what joins nothing must not crowd out what tells most."""
        segment = self._segment[: self._used]
        names, count = np.unique(segment, return_counts=True)
        longest = names[np.argsort(count, kind="stable")[-MOST_SEGMENTS:]]
        self._keep_rows(np.flatnonzero(np.isin(segment, longest)))

    def _join(self) -> None:
        """Join rows of the same window and segment."""
        rows = slice(0, self._used)
        found = (self._index[rows], self._time_s[rows], self._segment[rows])
        best = self._earliest(*found, from_first=False)
        if len(best) < self._used:
            self._keep_rows(best)

    def _earliest(
        self,
        index: NDArray[np.int64],
        time_s: NDArray[np.float64],
        segment: NDArray[np.int64],
        *,
        from_first: bool,
    ) -> NDArray[np.int64]:
        """Return the row with the shortest delay of each window and segment, the first of several.

        Delays count from the first row, or in each window from its own.
        """
        best = np.empty(len(index), np.int64)
        many = _earliest_of_windows(
            *(index, time_s, segment, len(index), from_first),
            *(self._window_s, self._period_s, best),
        )
        return best[:many]

    def _keep_rows(self, rows: NDArray[np.int64]) -> None:
        for table in (self._index, self._time_s, self._segment, self._temperature_c):
            table[: len(rows)] = table[rows]
        self._used = len(rows)


def _pause(index: NDArray[np.int64], time_s: NDArray[np.float64]) -> float:
    """Return the cadence of a reader in s, 0 where it has none that is seen.

    One that pauses for longer than a frame takes finds now fewer, now more samples, each time after
    its pause. One that pauses for less finds one frame, now a pause earlier, now later.
    """
    reads = np.flatnonzero(np.diff(time_s) > USB_FRAME_S / 2) + 1
    if len(reads) < FEWEST_READS:
        return 0.0
    many, apart = np.diff(index[reads]), np.diff(time_s[reads])
    usual = float(np.median(apart))
    if usual <= 0.0:  # times that fall back tell nothing
        return 0.0
    alike = apart[np.abs(apart - usual) < CLEAR * usual]
    pause_s = float(alike.mean()) if len(alike) else 0.0
    if np.mean(many == np.median(many)) > EVEN:
        middle = float(apart.mean())
        early, late = np.median(apart[apart <= middle]), np.median(apart[apart >= middle])
        scatter = np.median(np.minimum(np.abs(apart - early), np.abs(apart - late)))
        pause_s = float(late - early) if scatter < CLEAR * (late - early) else 0.0
    if not usual <= MOST_PAUSES * pause_s:
        return pause_s
    pauses = np.rint(apart / pause_s)
    counted = (pauses > 0) & (np.abs(apart - pauses * pause_s) < pause_s / 4.0)
    if np.mean(counted) < EVEN:  # of a reader that keeps no time
        return pause_s
    return float(apart[counted].sum() / pauses[counted].sum())
