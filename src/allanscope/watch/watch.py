"""The watch over a stream: block by block, each axis is asked whether it is still what it was."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Gap, StreamInfo, Ticks
from allanscope.watch.counts import EARLIER, Burst, RareCounts
from allanscope.watch.events import Event
from allanscope.watch.false_alarms import ALPHA
from allanscope.watch.lines import LineAlarm, LineCusums
from allanscope.watch.scan import (
    KEPT_BLOCKS,
    Alarm,
    Change,
    Scan,
    is_one_ramp,
    locate,
    moment_of_counts,
    moment_of_powers,
)
from allanscope.watch.summary import (
    FIRST_BIN,
    LANES,
    BlockSummary,
    Summariser,
    of_axis,
    rows_of_block,
)
from allanscope.watch.tracks import SIMULTANEOUS_S, Span, Track, Tracks, event_of, grouped

__all__ = ["Watch"]

ALPHA_SHARES = {"level": 0.2, "noise": 0.18, "lines": 0.58, "outliers": 0.04}
"""Of what an axis may spend. What is rare needs least: a burst is so many counts that a stricter
limit is no delay."""
STREAM_ALPHA_SHARES = {"repeats": 0.3, "losses": 0.3, "rate": 0.4}
"""Of what the stream may spend, which is as much as an axis. Repeats are looked at in two ways."""

LONG_GAP_SHARE = 0.5
"""Share of a block that may be missing within it."""
MOST_LOST_COUNTED = 8
"""A gap counts for no more losses than this: how many matters less than that there are."""

LINE_HALF_WIDTH = 3
"""Bins to each side of a line that belong to it."""
GONE_SHARE = 0.3
"""Share of a change below which it has gone."""
LEAST_WINDOW = 16
LEAKAGE_RATIO = 0.3
"""Power that leaks into a bin, in units of the noise there, which a line would be told from."""
MOST_PIECES = 4
"""Changes of a level that may turn out to be one ramp."""
LEVEL_KINDS = ("step", "ramp")
"""Changes of the level of an axis."""
FEWEST_AFTER = 8
"""Blocks, and at least as many as it took to see a change, after which it is measured again."""
ANSCOMBE = 0.375
"""2 sqrt(n + 3/8) of a Poisson count n has a variance of 1 (Anscombe, Biometrika 35, 1948)."""
LEAST_ROOT = 1e-3
"""Cube root of the ratio of a power, below which a sensor is silent."""
NOISE_GUARD_BLOCKS = 4
"""Blocks about another event of an axis in which its noise says nothing of its own."""


def log_alphas(axes: int) -> dict[str, float]:
    """Return the logs of the probabilities that tests of an axis, or of the stream, ever err.

    So many axes may spend `ALPHA` each. The stream as a whole is one more that spends.

    Examples
    --------
    >>> spent = {kind: math.exp(value) for kind, value in log_alphas(6).items()}
    >>> of_axis = sum(spent[kind] for kind in ALPHA_SHARES)
    >>> of_stream = sum(spent[kind] for kind in STREAM_ALPHA_SHARES)
    >>> round((6 * of_axis + of_stream) / ALPHA, 6)
    6.0
    """
    each = math.log(ALPHA * axes / (axes + 1))
    return {
        kind: each + math.log(share)
        for kind, share in {**ALPHA_SHARES, **STREAM_ALPHA_SHARES}.items()
    }


class Watch:
    """Watch one configuration of a stream; nothing depends on how its samples are handed over.

    Parameters
    ----------
    info : StreamInfo
        What the samples mean.

    Attributes
    ----------
    blocks : int
        Blocks taken.
    tracks : Tracks
        What was found.
    """

    def __init__(self, info: StreamInfo) -> None:
        axes = len(info.axes)
        self.info = info
        self.tracks = Tracks()
        self.blocks = 0
        self._axes = axes
        self._rows = rows_of_block(info.nominal_hz)
        self._summarise = Summariser(axes, self._rows)
        bins = self._summarise.bins
        of = log_alphas(axes)
        repeats = of["repeats"] - math.log(2.0)
        # Series: the level of each axis, its noise, then repeats and rate of the stream.
        series = np.repeat([of["level"], of["noise"], repeats, of["rate"]], [axes, axes, 1, 1])
        counts = np.repeat([of["outliers"], repeats, of["losses"]], [axes, 1, 1])
        self._scan = Scan(2 * axes + 2, series)
        self._lines = LineCusums(axes, bins, of["lines"])
        self._rare = RareCounts(axes + 2, counts)
        self._masked = np.zeros(self._summarise.power.shape, np.int32)
        self._axes_with_lines: set[int] = set()
        self._has_changed_noise = np.zeros((len(self._masked), LANES), np.bool_)
        self._buffer: NDArray[Any] = np.empty((self._rows, axes), np.int16)
        self._buffered = 0
        self._lost = self._first_lost = 0
        self._position = 0
        self._first_row = 0
        self._starts = np.zeros(KEPT_BLOCKS, np.int64)
        self._firsts = np.zeros((EARLIER, axes + 2), np.int64)
        self._clock = BlockClock(info.nominal_hz or 100.0)
        self._late = np.zeros(KEPT_BLOCKS)
        self._recent: list[_Recent] = []

    def ticks(self, position: int, ticks: Ticks) -> None:
        """Take the times of samples, of which the first has this number; before the samples."""
        self._clock.update(position, ticks)

    def rows(self, counts: NDArray[Any]) -> None:
        """Take contiguous samples, shape (n, axes)."""
        taken = 0
        if self._buffer.dtype != counts.dtype:
            self._buffer, self._buffered = np.empty((self._rows, self._axes), counts.dtype), 0
        while taken < len(counts):
            if not self._buffered:
                self._first_row = self._position
            piece = counts[taken : taken + self._rows - self._buffered]
            many = len(piece)
            taken += many
            self._position += many
            if many == self._rows:
                self._block(piece)
                continue
            self._buffer[self._buffered : self._buffered + many] = piece
            self._buffered += many
            if self._buffered == self._rows:
                self._buffered = 0
                self._block(self._buffer)

    def gap(self, gap: Gap) -> None:
        """Take a gap."""
        if not self._lost:
            self._first_lost = self._position
        self._lost += min(1 if gap.lost is None else gap.lost, MOST_LOST_COUNTED)
        self._position += gap.lost or 0
        if gap.lost is None or gap.lost > LONG_GAP_SHARE * self._rows:
            self._buffered = 0
        if gap.lost is None:
            self._clock.restart()

    def events(self, rate_hz: float) -> tuple[Event, ...]:
        """Return what was found so far, with what began together on several axes as one event.

        Parameters
        ----------
        rate_hz : float
            Samples a second.
        """
        groups = grouped(self.tracks.all, SIMULTANEOUS_S * rate_hz)
        return tuple(self._event(group, rate_hz) for group in groups)

    def unsearched(self, after: int, settled: int) -> Span | None:
        """Return the first change on an axis that was found after a sample, and long enough ago.

        Parameters
        ----------
        after : int
            Sample that the one before was found at.
        settled : int
            Samples that must have come since.
        """
        spans = (track.last for track in self.tracks.all if track.axis >= 0)
        due = (one for one in spans if after < one.found <= self._position - settled)
        return min(due, key=lambda one: one.found, default=None)

    def changes(self, rate_hz: float) -> Iterator[tuple[str, Event]]:
        """Yield what was found or has gone since this was last asked for."""
        unreported, self.tracks.unreported = self.tracks.unreported, []
        for what in ("found", "gone"):
            told = {id(track): track for track, how in unreported if how == what}
            for group in grouped(told.values(), SIMULTANEOUS_S * rate_hz):
                yield what, self._event(group, rate_hz)

    def _event(self, group: list[Track], rate_hz: float) -> Event:
        bin_hz = rate_hz / self._summarise.length
        return event_of(group, rate_hz, self.info.axes, self.info.scale, bin_hz)

    # --- a block --------------------------------------------------------------------------------

    def _block(self, block: NDArray[Any]) -> None:
        self._starts[self.blocks % KEPT_BLOCKS] = self._first_row
        known = self._summarise.update(block, self._masked, self._has_changed_noise)
        lost, self._lost = self._lost, 0
        self.blocks += 1
        axes = self._axes
        counts, series = np.empty(axes + 2, np.int64), np.empty(2 * axes + 2)
        counts[:axes], counts[axes], counts[axes + 1] = known.outliers, known.repeats, lost
        firsts = self._firsts[(self.blocks - 1) % len(self._firsts)]
        firsts[:-1], firsts[-1] = self._first_row + known.first, self._first_lost
        series[:axes], series[axes : 2 * axes] = known.level, known.noise
        series[-2] = 2.0 * math.sqrt(known.repeats + ANSCOMBE)
        series[-1] = self._clock.log_duration(self._position)
        self._late[self.blocks % KEPT_BLOCKS] = self._clock.late
        self._bursts(*self._rare.update(counts))
        alarms = self._scan.update(series)
        self._follow_lines(known)
        for found in self._lines.update(known.ratio, known.scale, self._masked):
            self._line(found)
        for alarm in alarms:
            self._alarm(alarm)
        if self._recent:
            self._measure_again()
        if self.blocks % LEAST_WINDOW == 0:
            self._close_faded()
        if alarms or self.blocks % LEAST_WINDOW == 0:
            noise = ("variance_change",)
            for axis in range(self._axes):
                self._has_changed_noise[divmod(axis, LANES)] = bool(self.tracks.open(axis, noise))

    def _sample(self, block: int) -> int:
        """Return the number of the first sample of a block that is not too long ago."""
        if block >= self.blocks:
            return self._position
        return int(self._starts[max(block, self.blocks - KEPT_BLOCKS, 0) % KEPT_BLOCKS])

    def _between(self, kind: str, first: int, change: Change, size: float) -> Span:
        """Return the span of a change of a series that begins with a block."""
        onset, lower, upper = (
            self._moment(first + one, kind) for one in (change.moment, change.lower, change.upper)
        )
        return Span(first + change.at, onset, lower, upper, self._position, size)

    def _moment(self, place: float, kind: str = "") -> float:
        """Return the number of a sample within a block.

        A rate that changes after the last time within a block is seen in the next one, as what
        begins in the last rows, which are not transformed.
        """
        block = math.floor(place)
        start, stop = (
            self._sample(one) - (self._late[one % KEPT_BLOCKS] if kind == "rate_change" else 0.0)
            for one in (block, block + 1)
        )
        within = place - block
        if kind in ("variance_change", "sinusoid"):
            within *= self._summarise.length / self._summarise.rows
        return max(start + within * (stop - start), 0.0)

    # --- series ---------------------------------------------------------------------------------

    def _series(self, channel: int) -> tuple[str, int]:
        """Return the kind of event and the axis of a series."""
        if channel < 2 * self._axes:
            kind = "step" if channel < self._axes else "variance_change"
            return kind, channel % self._axes
        return ("repeated_samples", "rate_change")[channel - 2 * self._axes], -1

    def _alarm(self, alarm: Alarm) -> None:
        channel = alarm.channel
        kind, axis = self._series(channel)
        start, now = int(self._scan.start[channel]), self.blocks
        first = max(start, now - max(8 * alarm.window, 128) - 16)
        values = self._scan.values(channel, first)
        first = now - len(values)
        spread = self._scan.spread(channel)
        earliest = len(values) - 4 * alarm.window - 16
        change = _located(kind, values, earliest, spread)
        at = first + change.at
        lower, upper = (first + math.floor(one) for one in (change.lower, change.upper))
        self._scan.restart(channel, min(upper + 1, now))  # not in its midst
        kinds = LEVEL_KINDS if kind == "step" else (kind,)
        after = float(values[change.at :].mean())
        if kind == "repeated_samples" and self._tracks_of(self._axes):
            return  # they are counted
        for track in self.tracks.open(axis, kinds):
            if abs(after - track.before) < 0.5 * abs(track.last.size):
                self.tracks.close(track, self._sample(at))
                return
        latest = self.tracks.open(axis, kinds)[:MOST_PIECES] if kind == "step" else []
        if any(self._extend_ramp(channel, track, at, after) for track in latest[::-1]):
            return
        if kind == "variance_change" and self._has_another_cause(axis, lower, at):
            return
        size = change.size
        if kind == "step":
            self._forget_leakage(axis, size)
            kind = change.kind
        span = self._between(kind, first, change, size)
        window = max(alarm.window, LEAST_WINDOW)
        track = self.tracks.add(Track(kind, axis, change.before, window, alarm.nats, [span]))
        due = now + max(now - at, FEWEST_AFTER)
        restarted = int(self._scan.start[channel])
        recent = _Recent(track, track.last, kind, channel, restarted, first, earliest, due)
        self._recent.append(recent)

    def _measure_again(self) -> None:
        """Locate changes again that were found early: the level after them is better known now.

        One that was found by the block in which it began shows as much of itself as it had left.
        """
        for one in [one for one in self._recent if one.due <= self.blocks]:
            self._recent.remove(one)
            is_alone = int(self._scan.start[one.channel]) == one.restarted
            if not (is_alone and one.span is one.track.last and one.track.is_open):
                continue
            values = self._scan.values(one.channel, one.first)
            spread = self._scan.spread(one.channel)
            change = _located(one.kind, values, one.earliest, spread)
            if one.kind in LEVEL_KINDS and change.kind != one.kind:
                continue
            span = self._between(one.kind, one.first, change, change.size)
            one.track.spans[-1] = replace(span, found=one.span.found)

    def _extend_ramp(self, channel: int, track: Track, at: int, after: float) -> bool:
        """Return whether a change is the next piece of a ramp, and draw the ramp longer then.

        What was found of it since the track began belongs to it as well.
        """
        size = after - track.before
        if size * track.last.size <= 0.0 or abs(size) <= abs(track.last.size):
            return False
        first = max(track.last.block - 64, self._level_since(track))
        values = self._scan.values(channel, first)
        first = self.blocks - len(values)
        begin = track.last.block - first
        others = self.tracks.open(track.axis, LEVEL_KINDS)
        pieces = [one for one in others if one.last.block > track.last.block]
        places = sorted([begin, *(one.last.block - first for one in pieces), at - first])
        if begin < 8 or not is_one_ramp(values, places):
            return False
        change = locate(values, begin // 2, self._scan.spread(channel))
        if change.kind != "ramp":
            return False
        found = track.last.found
        track.kind = "ramp"
        track.spans[-1] = self._between(change.kind, first, change, change.size)
        track.last.found = found
        for one in pieces:
            self.tracks.forget(one)
        self._scan.restart(channel, self.blocks)
        return True

    def _level_since(self, track: Track) -> int:
        """Return the block in which the change before the last one of an axis began."""
        levels = (
            one for one in self.tracks.all if one.axis == track.axis and one.kind in LEVEL_KINDS
        )
        blocks = (span.block for one in levels for span in one.spans)
        return max((block for block in blocks if block < track.last.block), default=0)

    def _forget_leakage(self, axis: int, size: float) -> None:
        """Begin the sums of bins anew into which a step within a block may have leaked.

        In the middle of a Hann window, a step of size s leaks into bin k as n s / (2 pi k).
        """
        length, power = self._summarise.length, of_axis(self._summarise.power, axis)
        leaked = length * size / (2.0 * np.pi * (FIRST_BIN + np.arange(len(power))))
        self._lines.forget(axis, leaked**2 > LEAKAGE_RATIO * power)

    def _has_another_cause(self, axis: int, lower: int, at: int) -> bool:
        """Return whether an event of the axis, or of the stream, began when its noise changed."""
        near = (lower - NOISE_GUARD_BLOCKS, at + NOISE_GUARD_BLOCKS)
        return any(
            one.axis in (axis, -1)
            and one.kind != "variance_change"
            and any(near[0] <= span.block <= near[1] for span in one.spans)
            for one in self.tracks.all
        )

    def _close_faded(self) -> None:
        """Close changes of series that have faded away."""
        for channel in range(2 * self._axes + 2):
            kind, axis = self._series(channel)
            for track in self.tracks.open(axis, LEVEL_KINDS if kind == "step" else (kind,)):
                if self.blocks - track.last.block < 2 * track.window or track.is_counted:
                    continue
                recent = self._scan.values(channel, self.blocks - track.window)
                scale = track.last.size
                if kind == "repeated_samples":
                    scale = 2 * math.sqrt((track.before / 2) ** 2 + scale) - track.before
                if abs(float(recent.mean()) - track.before) < GONE_SHARE * abs(scale):
                    self.tracks.close(track, self._sample(self.blocks - track.window))

    # --- counts ---------------------------------------------------------------------------------

    def _bursts(self, found: list[Burst], ended: list[Burst]) -> None:
        for burst in found:
            kind, axis = self._count(burst.channel)
            onset = int(self._firsts[burst.first % len(self._firsts), burst.channel])
            span = Span(burst.first, onset, onset, onset, self._position, burst.count)
            track = Track(kind, axis, 0.0, 1, burst.nats, [span], is_counted=True)
            self.tracks.add(track, same=lambda _: True)
        for channel, burst in self._rare.open.items():
            self._counted(channel, burst)
        for burst in ended:
            self._counted(burst.channel, burst)
            for track in self._tracks_of(burst.channel):
                self.tracks.close(track, self._sample(burst.last + 1))

    def _counted(self, channel: int, burst: Burst) -> None:
        for track in self._tracks_of(channel):
            track.last.size = float(burst.size)
            reach = round(burst.onset_reach * self._rows)
            track.last.lower = max(track.last.onset - reach, 0)

    def _tracks_of(self, channel: int) -> list[Track]:
        kind, axis = self._count(channel)
        return [one for one in self.tracks.open(axis, (kind,)) if one.is_counted][:1]

    def _count(self, channel: int) -> tuple[str, int]:
        if channel < self._axes:
            return "outliers", channel
        return ("repeated_samples", "lost_samples")[channel - self._axes], -1

    # --- lines ----------------------------------------------------------------------------------

    def _line(self, found: LineAlarm) -> None:
        begun = self.blocks - found.since
        length, power = self._summarise.length, of_axis(self._summarise.power, found.axis)
        excess = max(found.ratio - 1.0, 0.1) * float(power[found.bin])
        amplitude = 4.4 / length * math.sqrt(excess)
        self._lines.forget(found.axis)
        self._exclude_bins(found.axis, found.bin)
        for track in self.tracks.open(found.axis, ("sinusoid",)):
            if abs(track.last.block - begun) <= max(3, found.since // 2):
                return  # a harmonic of the line, or its skirt
        onset, lower, upper = (
            self._moment(one, "sinusoid") for one in (found.moment, found.lower, found.upper)
        )
        span = Span(math.floor(found.moment), onset, lower, upper, self._position, amplitude)
        window = min(max(found.since, LEAST_WINDOW), 256)
        place = float(found.bin + FIRST_BIN)
        track = Track("sinusoid", found.axis, 0.0, window, found.nats, [span], place)
        self.tracks.add(track, same=lambda other: abs(other.bin - place) <= max(4, 0.05 * place))

    def _exclude_bins(self, axis: int, place: int) -> None:
        of_axis(self._masked, axis)[
            max(place - LINE_HALF_WIDTH, 0) : place + LINE_HALF_WIDTH + 1
        ] = -1
        self._axes_with_lines.add(axis)

    def _follow_lines(self, known: BlockSummary) -> None:
        """Measure the lines that are there, and notice when they go."""
        for axis in sorted(self._axes_with_lines):
            open_lines = self.tracks.open(axis, ("sinusoid",))
            for track in open_lines:
                self._follow_line(track, known)
            if not any(track.is_open for track in open_lines):
                of_axis(self._masked, axis)[:] = 0
                self._axes_with_lines.remove(axis)

    def _follow_line(self, track: Track, known: BlockSummary) -> None:
        place = round(track.bin) - FIRST_BIN
        scale, ratio = of_axis(known.scale, track.axis), of_axis(known.ratio, track.axis)
        bins = np.arange(max(place - 2, 0), min(place + 3, self._summarise.bins))
        noise = of_axis(self._summarise.power, track.axis)[bins].astype(np.float64)
        excess = (ratio[bins] * scale - 1.0) * noise
        # The scale is of all bins: where these are few the line itself lowers it.
        beside = ratio[of_axis(self._masked, track.axis) == 0]
        usual = noise * (float(beside.mean()) if len(beside) else 1.0 / scale)
        above = ratio[bins] * noise - usual
        power = dict(zip((bins - place).tolist(), above.tolist(), strict=True))
        powers = np.array([*(power.get(at, 0.0) for at in (0, -1, 1)), usual[place - bins[0]]])
        track.follow(float(excess.sum()), powers)
        if track.mean > 0.0 and track.followed >= LEAST_WINDOW:
            track.last.size = math.sqrt(track.mean / 0.09375) / self._summarise.length
        if track.followed >= 2 * track.window and track.recent < GONE_SHARE * track.mean:
            self.tracks.close(track, self._sample(self.blocks - track.window))
            of_axis(self._masked, track.axis)[
                max(place - LINE_HALF_WIDTH, 0) : place + LINE_HALF_WIDTH + 1
            ] = 0


@dataclass(slots=True)
class _Recent:
    """A change of a series that is measured again when more blocks have come.

    Attributes
    ----------
    track, span, kind
        The change, as it was found.
    channel : int
        Its series.
    restarted : int
        Block from which on that has been compared since.
    first, earliest : int
        Block from which on its values are looked at, and the first of them where it may be.
    due : int
        Blocks when it is measured again.
    """

    track: Track
    span: Span
    kind: str
    channel: int
    restarted: int
    first: int
    earliest: int
    due: int


def _located(kind: str, values: NDArray[np.float64], earliest: int, spread: float) -> Change:
    """Return the change of a series of this kind."""
    change = locate(values, earliest, spread)
    earliest = max(earliest, 0)
    if kind == "variance_change":
        powers = np.maximum(1.0 + values / 3.0, LEAST_ROOT) ** 3
        moment, lower, upper = moment_of_powers(powers, earliest, change.at)
        return replace(change, moment=moment, lower=lower, upper=upper)
    if kind != "repeated_samples":
        return change
    counts = np.maximum((values / 2.0) ** 2 - ANSCOMBE, 0.0)
    size = (float(values[change.at :].mean()) / 2.0) ** 2 - (change.before / 2.0) ** 2
    moment, lower, upper = moment_of_counts(counts, earliest, change.at)
    return replace(change, moment=moment, lower=lower, upper=upper, size=size)


class BlockClock:
    """How long blocks take, by the times of their samples.

    Parameters
    ----------
    rate_hz : float
        Nominal samples a second.

    Attributes
    ----------
    late : int
        Samples between the last time that was used and the end of the block.
    """

    def __init__(self, rate_hz: float) -> None:
        self.late = 0
        self._nominal_s = 1.0 / rate_hz
        self._positions = np.empty(0, np.int64)
        self._times = np.empty(0)
        self._waiting: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
        self._last: tuple[int, float] | None = None
        self._value = 0.0

    def update(self, position: int, ticks: Ticks) -> None:
        """Take the times of some samples after `position`."""
        if not len(ticks.offset):
            return
        times = np.where(np.isfinite(ticks.device_s), ticks.device_s, ticks.host_s)
        known = np.isfinite(times)
        if known.any():
            self._waiting.append((ticks.offset[known] + position, times[known]))

    def restart(self) -> None:
        """Forget when the block began: the loss is unknown."""
        self._last = None

    def log_duration(self, end: int) -> float:
        """Return the log of how long samples take, in nominal periods, up to the sample `end`.

        The value of the block before is held where nothing tells.
        """
        tick = self._tick_before(end)
        if tick is None:
            return self._value
        last, self._last = self._last, tick
        if last is not None and tick[0] > last[0] and tick[1] > last[1]:
            period = (tick[1] - last[1]) / (tick[0] - last[0])
            if 0.5 < period / self._nominal_s < 2.0:
                self._value = math.log(period / self._nominal_s)
        return self._value

    def _tick_before(self, end: int) -> tuple[int, float] | None:
        """Return the last sample before `end` of which the time is known, and that.

        Later ones may not be here yet, and what is found must not depend on that.
        """
        if self._waiting:
            positions, times = zip(*self._waiting, strict=True)
            self._positions = np.concatenate([self._positions, *positions])
            self._times = np.concatenate([self._times, *times])
            self._waiting = []
        before = int(np.searchsorted(self._positions, end)) - 1
        if before < 0:
            return None
        position, time_s = int(self._positions[before]), float(self._times[before])
        self._positions = self._positions[before:]
        self._times = self._times[before:]
        if end - position > 1.0 / self._nominal_s:
            return None
        self.late = end - position
        return position, time_s
