"""What has happened so far: each change with the times at which it came and went.

An alarm is not yet an event. The same change may be seen again while it goes on, a ramp most of
all; it goes, and comes back, as a fridge does every forty minutes. A `Track` is what is one thing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from allanscope.quantities import TWO_SIDED_95
from allanscope.samples import unit_of
from allanscope.watch.events import Event, Occurrence

__all__ = ["Span", "Track", "Tracks"]

MOST_TRACKS, MOST_SPANS = 256, 64
"""A stream that changes all night must not fill the memory."""

SAME_SIZE_RATIO = 2.0
"""Ratio of sizes up to which a change that comes back is the same one."""
LEAST_LINE_ERROR = 0.01
"""Bins by which the frequency of a line is uncertain at least. The interval is that of its mean
frequency: how far a fan strays from that is its own."""
HANN = np.array([[1.0, 2 / 3, 2 / 3], [2 / 3, 1.0, 1 / 6], [2 / 3, 1 / 6, 1.0]])
"""Correlation, in phase with a line, of the noise in a bin and in those below and above it."""
SIMULTANEOUS_S = 2.0
"""Changes of a kind that begin so close to each other on several axes are one event."""


@dataclass(slots=True)
class Span:
    """One time that a change was there; in numbers of samples, sizes in counts or ratios.

    Attributes
    ----------
    block : int
        Block of the onset.
    onset, lower, upper : float
        Samples: of the onset, and its interval.
    found : int
        The last sample that was needed to know.
    end : int or None
        Sample at which it was over.
    """

    block: int
    onset: float
    lower: float
    upper: float
    found: int
    size: float
    end: int | None = None


@dataclass(slots=True)
class Track:
    """One change of one series.

    Attributes
    ----------
    kind : str
        Of the event.
    axis : int
        Column; -1 for the stream.
    before : float
        Value of the series before it.
    window : int
        Blocks that it took to see it.
    bin : float
        Place of a line in the spectrum, the nearest bin.
    is_counted : bool
        Whether it is a count of what is rare, and not a series.
    count : int
        How often it came.
    recent, mean : float
        Strength of a line in the last `window` blocks, and since it is followed.
    followed : int
        Blocks for which it has been followed.
    powers : tuple of float
        Mean power of a line in its bin and in the ones below and above, and of the noise there.
    """

    kind: str
    axis: int
    before: float
    window: int
    nats: float
    spans: list[Span]
    bin: float = 0.0
    is_counted: bool = False
    count: int = 1
    recent: float = 0.0
    mean: float = 0.0
    followed: int = 0
    powers: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def place(self) -> tuple[float, float, float]:
        """Where in the spectrum a line is, in bins, with a 95 % interval.

        A Hann window shows a line d bins above a bin there as 1, above as (1 + d) / (2 - d), below
        as (1 - d) / (2 + d) of its amplitude. Their mean powers so far are known.
        """
        *powers, noise = self.powers
        if self.followed == 0 or powers[0] <= 0.0 or max(powers[1:]) <= 0.0:
            return self.bin, self.bin - 1.5, self.bin + 1.5
        known = np.array(powers)
        error = TWO_SIDED_95 * _error_of_offset(known, noise) / math.sqrt(self.followed)
        reach = min(math.hypot(error, LEAST_LINE_ERROR), 1.5)
        at = self.bin + _offset(known)
        return at, at - reach, at + reach

    @property
    def last(self) -> Span:
        """The last time that it came."""
        return self.spans[-1]

    @property
    def is_open(self) -> bool:
        """Whether it is there."""
        return self.last.end is None

    def begin_again(self, span: Span) -> None:
        """Note that it is there again."""
        self.spans = [*self.spans, span][-MOST_SPANS:]
        self.count += 1
        self.followed = 0

    def follow(self, strength: float, powers: NDArray[np.float64]) -> None:
        """Take the strength of a line in a block, and the `powers` of its bin and about it."""
        self.followed += 1
        pairs = zip(self.powers, powers.tolist(), strict=True)
        middle, below, above, noise = (old + (new - old) / self.followed for old, new in pairs)
        self.powers = middle, below, above, noise
        self.mean += (strength - self.mean) / self.followed
        self.recent += (strength - self.recent) / min(self.followed, self.window)


@dataclass(slots=True)
class Tracks:
    """All changes of a stream.

    Attributes
    ----------
    all : list of Track
        In the order in which they were found.
    unreported : list of (Track, str)
        Events to report, not yet fetched: begun, or ended.
    """

    all: list[Track] = field(default_factory=list)
    unreported: list[tuple[Track, str]] = field(default_factory=list)

    def open(self, axis: int, kinds: Iterable[str]) -> list[Track]:
        """Return the changes of these kinds that are there, latest first."""
        wanted = set(kinds)
        chosen = (one for one in self.all if one.axis == axis and one.kind in wanted)
        return [one for one in chosen if one.is_open][::-1]

    def add(self, track: Track, same: Callable[[Track], bool] | None = None) -> Track:
        """Take a change that was found; return the one that it is an occurrence of.

        Parameters
        ----------
        track : Track
            With one span.
        same : callable, optional
            Tells whether an earlier one of its kind and axis is the same; by default when the size
            is alike.
        """
        same = same or (lambda other: _is_same_size(other.last.size, track.last.size))
        for other in reversed(self.all):
            is_kind = (other.kind, other.axis) == (track.kind, track.axis)
            if is_kind and not other.is_open and same(other):
                other.begin_again(track.last)
                other.before, other.window = track.before, track.window
                other.bin = track.bin
                self.unreported.append((other, "found"))
                return other
        self.all.append(track)
        self.unreported.append((track, "found"))
        if len(self.all) > MOST_TRACKS:
            closed = [one for one in self.all if not one.is_open]
            self.all.remove(min(closed or self.all, key=lambda one: one.count))
        return track

    def forget(self, track: Track) -> None:
        """Take back a change that turns out to be a part of another one."""
        self.all = [one for one in self.all if one is not track]
        self.unreported = [(one, what) for one, what in self.unreported if one is not track]

    def close(self, track: Track, sample: int) -> None:
        """Note that a change has gone."""
        track.last.end = max(sample, math.ceil(track.last.onset))
        self.unreported.append((track, "gone"))


def _offset(powers: NDArray[np.float64]) -> float:
    """Return how far from its bin a line of given powers is: in it, below and above."""
    middle, below, above = np.maximum(powers, 0.0).tolist()
    down, up = (min(math.sqrt(one / middle), 5.0) for one in (below, above))
    share = up**2 / (up**2 + down**2)
    return share * (2.0 * up - 1.0) / (up + 1.0) - (1.0 - share) * (2.0 * down - 1.0) / (down + 1.0)


def _error_of_offset(powers: NDArray[np.float64], noise: float) -> float:
    """Return the standard error of that from one block.

    Noise moves the power p of a line in a bin by 2 sqrt(p) times its part in phase, and by its own;
    what neighbouring bins have of it is alike, as they share it (`HANN`).
    """
    p = np.maximum(powers, 0.0)
    covariance = 2.0 * noise * HANN * np.sqrt(np.outer(p, p)) + (noise * HANN) ** 2
    step = 1e-3 * p[0]
    slope = [(_offset(p + step * one) - _offset(p)) / step for one in np.eye(3)]
    return float(np.sqrt(slope @ covariance @ slope))


def _is_same_size(first: float, second: float) -> bool:
    return first * second > 0.0 and 1.0 / SAME_SIZE_RATIO <= first / second <= SAME_SIZE_RATIO


def event_of(
    tracks: list[Track],
    rate_hz: float,
    names: tuple[str, ...],
    scale: tuple[float, ...],
    bin_hz: float,
) -> Event:
    """Return the event that changes of one kind on several axes are, in physical units."""
    leading = max(tracks, key=lambda one: one.nats)

    def sized(track: Track, size: float) -> float:
        if track.kind in ("step", "ramp", "sinusoid"):
            return size * scale[track.axis]
        if track.kind == "variance_change":
            return float(max(1.0 + size / 3.0, 0.0) ** 1.5)
        return -1e6 * float(np.expm1(size) / np.exp(size)) if track.kind == "rate_change" else size

    def occurrence(span: Span) -> Occurrence:
        return Occurrence(
            span.onset / rate_hz,
            span.lower / rate_hz,
            span.upper / rate_hz,
            span.found / rate_hz,
            None if span.end is None else span.end / rate_hz,
            sized(leading, span.size),
            round(span.onset),
            span.found,
        )

    ordered = sorted(tracks, key=lambda one: -one.nats)
    axes = tuple(names[one.axis] for one in ordered if one.axis >= 0)
    units: Mapping[str, str] = {"variance_change": "times", "rate_change": "ppm"}
    physical = leading.kind in ("step", "ramp", "sinusoid")
    is_line = leading.kind == "sinusoid"
    frequency, lower, upper = (max(bin_hz * one, 0.0) for one in leading.place)
    return Event(
        leading.kind,
        axes,
        unit_of(names[leading.axis]) if physical else units.get(leading.kind, ""),
        tuple(occurrence(span) for span in leading.spans),
        leading.count,
        leading.nats,
        frequency if is_line else None,
        (lower, upper) if is_line else None,
        {names[one.axis]: sized(one, one.last.size) for one in ordered if one.axis >= 0},
    )


def grouped(tracks: Iterable[Track], samples: float) -> list[list[Track]]:
    """Return the changes, with those of a kind that began together put together.

    Parameters
    ----------
    tracks : iterable of Track
        In any order.
    samples : float
        Samples by which onsets may differ beyond their intervals.
    """
    groups: list[list[Track]] = []
    for track in sorted(tracks, key=lambda one: one.spans[0].onset):
        for group in groups:
            first = group[0]
            if first.kind != track.kind or any(one.axis == track.axis for one in group):
                continue
            one, other = first.spans[0], track.spans[0]
            near = other.lower - samples <= one.upper and one.lower - samples <= other.upper
            if near and (track.kind != "sinusoid" or abs(first.bin - track.bin) < 2.0):
                group.append(track)
                break
        else:
            groups.append([track])
    return groups
