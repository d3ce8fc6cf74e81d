"""A chart drawn by hand, because the viewer has neither logarithmic axes nor x-y plots.

Every chart is the same rectangle of the plane, `WIDTH` by `HEIGHT` world units with y downwards as
the viewer has it, whatever its decades are. When a run outgrows a chart, the chart is given more
decades, and its grid and curves are drawn anew into the same rectangle: the view that shows it
never has to change, so zoom and layout stay as they are, and each moment of the history keeps
the grid that it was drawn on.

A scale on each side says where a value lies between the edges, and which values get a tick. Nothing
here knows of Rerun: points in, points out, which is what makes it easy to test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.quantities import power_of_ten

__all__ = [
    "HEIGHT",
    "MARGIN",
    "WIDTH",
    "Chart",
    "InUnits",
    "Linear",
    "Log",
    "Points",
    "Scale",
    "Strips",
    "Tick",
    "dashed",
]

Tick = tuple[float, str]
"""A position between 0 and 1, and its label; an empty label makes a minor tick."""

WIDTH = 1000.0
HEIGHT = 660.0
MARGIN = {"left": 110.0, "right": 45.0, "top": 70.0, "bottom": 75.0}
"""Room around the rectangle for labels, in world units."""

_DASH, _SPACE = 14.0, 10.0
_RAISE = 22.0
_TICK = 10.0
_SMALLEST = 3.0

Points = NDArray[np.float32]
Strips = list[Points]


class Scale(Protocol):
    """Maps values to 0 (low edge) ... 1 (high edge) and back."""

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return where the values lie; outside 0 ... 1 when off the chart, NaN when impossible."""

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values that lie at these places."""

    def ticks(self) -> list[Tick]:
        """Return all ticks, ascending."""


@dataclass(frozen=True, slots=True)
class Log:
    """Whole decades from 10**low to 10**high.

    Examples
    --------
    >>> scale = Log(-2, 2)
    >>> scale.place([0.01, 1.0, 100.0]).tolist()
    [0.0, 0.5, 1.0]
    >>> Log.around([0.03, 40.0])
    Log(low=-2, high=2)
    """

    low: int
    high: int

    def __post_init__(self) -> None:
        if self.high <= self.low:
            raise ValueError(f"a scale needs low < high, got {self.low} and {self.high}")

    @classmethod
    def around(cls, values: ArrayLike, least: int = 1) -> Log:
        """Return the whole decades that hold all positive finite values; at least `least`."""
        known = np.asarray(values, np.float64)
        known = known[np.isfinite(known) & (known > 0.0)]
        if not len(known):
            return cls(0, least)
        # A value that is a decade's edge but for rounding does not open the next decade.
        low = math.floor(math.log10(known.min()) + 1e-9)
        high = math.ceil(math.log10(known.max()) - 1e-9)
        return cls(low, max(high, low + least))

    def union(self, other: Log) -> Log:
        """Return the decades of both: a chart only ever grows, so that it does not jump about."""
        return Log(min(self.low, other.low), max(self.high, other.high))

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return log10 of the values, 0 at the low edge and 1 at the high one."""
        values = np.asarray(values, np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            power = np.where(values > 0.0, np.log10(values), np.nan)
        return np.asarray((power - self.low) / (self.high - self.low))

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values at these places."""
        return np.asarray(10.0 ** (self.low + np.asarray(places) * (self.high - self.low)))

    def ticks(self) -> list[Tick]:
        """Return a labelled tick a decade, thinned beyond nine, and minor ones at 2 ... 9."""
        step = math.ceil((self.high - self.low) / 9)
        ticks: list[Tick] = []
        for power in range(self.low, self.high + 1):
            label = power_of_ten(power) if (power - self.low) % step == 0 else ""
            ticks.append((self._share(power), label))
            if power < self.high and step == 1:
                ticks += [(self._share(power + math.log10(k)), "") for k in range(2, 10)]
        return ticks

    def _share(self, power: float) -> float:
        return (power - self.low) / (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Linear:
    """From low to high with a labelled tick every `step`.

    Examples
    --------
    >>> [label for _, label in Linear(-20, 20, 10, "%").ticks()]
    ['-20 %', '-10 %', '0', '10 %', '20 %']
    """

    low: float
    high: float
    step: float
    unit: str = ""

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the share of the way from low to high."""
        return (np.asarray(values, np.float64) - self.low) / (self.high - self.low)

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values at these places."""
        return self.low + np.asarray(places, np.float64) * (self.high - self.low)

    def ticks(self) -> list[Tick]:
        """Return a tick every step."""
        number = math.floor((self.high - self.low) / self.step + 1e-9)
        values = [self.low + i * self.step for i in range(number + 1)]
        return [(float(self.place(value)), self._label(value)) for value in values]

    def _label(self, value: float) -> str:
        text = f"{round(value, 9):g}"
        return "0" if float(text) == 0.0 else f"{text} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class InUnits:
    """A scale whose values are in a smaller unit than its ticks: hours at the edge, seconds in."""

    scale: Linear
    unit: float

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return the share of the way from low to high."""
        return self.scale.place(np.asarray(values, np.float64) / self.unit)

    def read(self, places: ArrayLike) -> NDArray[np.float64]:
        """Return the values at these places."""
        return self.unit * self.scale.read(places)

    def ticks(self) -> list[Tick]:
        """Return a tick every step."""
        return self.scale.ticks()


@dataclass(frozen=True, slots=True)
class Chart:
    """A rectangle with a scale on each side, and the units of both.

    Examples
    --------
    >>> from allanscope.view.chart import Log
    >>> chart = Chart(Log(0, 4), Log(-2, 2), "s", "mdps")
    >>> chart.points([1.0, 100.0], [1.0, 1e9]).tolist()
    [[0.0, 330.0], [500.0, -1155.0]]
    >>> chart.values(chart.points([20.0], [3.0])).round(4).tolist()
    [[20.0, 3.0]]
    """

    x: Scale
    y: Scale
    x_unit: str
    y_title: str

    def points(self, x: ArrayLike, y: ArrayLike) -> Points:
        """Return the world positions of values, shape (n, 2), on the chart or off it."""
        return np.column_stack([WIDTH * self.x.place(x), HEIGHT * (1.0 - self.y.place(y))]).astype(
            np.float32
        )

    def values(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the values at world positions, shape (n, 2): the inverse of `points`."""
        at = np.asarray(points, np.float64).reshape(-1, 2)
        return np.column_stack(
            [self.x.read(at[:, 0] / WIDTH), self.y.read(1.0 - at[:, 1] / HEIGHT)]
        )

    def line(self, x: ArrayLike, y: ArrayLike) -> Strips:
        """Return the polyline through the values, cut where it leaves the chart or is unknown."""
        points = self.points(x, y)
        return _joined(*_clip(points[:-1], points[1:]))

    def whiskers(self, x: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Strips:
        """Return an upright strip from lower to upper at each x, cut to the chart.

        Those too short to be seen beside a line are left out.
        """
        low, high = self.points(x, lower), self.points(x, upper)
        low[~np.isfinite(low[:, 1]), 1] = HEIGHT
        pieces, first, last = _clip(low, high)
        return list(pieces[(last > first) & (pieces[:, 0, 1] - pieces[:, 1, 1] > _SMALLEST)])

    def band(self, x: ArrayLike, lower: ArrayLike, upper: ArrayLike, pitch: float) -> Strips:
        """Return upright strips, `pitch` world units apart, that hatch between two curves.

        What lies behind shows between them: the viewer fills no polygon, and none is translucent.
        """
        low, high = self.points(x, lower), self.points(x, upper)
        known = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
        low, high = low[known], high[known]
        if len(low) < 2:
            return []
        at = np.arange(max(low[0, 0], 0.0) + pitch / 2, min(low[-1, 0], WIDTH), pitch)
        ends = np.stack(
            [np.column_stack([at, np.interp(at, c[:, 0], c[:, 1])]) for c in (low, high)], axis=1
        ).astype(np.float32)
        ends[..., 1] = np.clip(ends[..., 1], 0.0, HEIGHT)
        return list(ends[ends[:, 0, 1] - ends[:, 1, 1] > _SMALLEST])

    def grid(self) -> tuple[Strips, Strips]:
        """Return the major grid lines, and the minor ones as ticks at the edges.

        Lines that are faint on a dark and on a light background alike cannot be drawn.
        """
        major: Strips = []
        minor: Strips = []
        for place, label in self.x.ticks():
            x = WIDTH * place
            top = 0.0 if label else HEIGHT - _TICK
            (major if label else minor).append(_strip((x, top), (x, HEIGHT)))
        for place, label in self.y.ticks():
            y = HEIGHT * (1.0 - place)
            right = WIDTH if label else _TICK
            (major if label else minor).append(_strip((0.0, y), (right, y)))
        return major, minor

    def labels(self) -> list[tuple[tuple[float, float], str]]:
        """Return the centre and the text of every label: ticks, and what stands upwards.

        The viewer sets a text below its point, by a constant number of pixels; `_RAISE` makes up
        for that at the size a chart usually has. The last tick of x carries the unit.
        """
        below = [((WIDTH * at, HEIGHT + 12.0), text) for at, text in self.x.ticks() if text]
        below[-1] = (below[-1][0], f"{below[-1][1]} {self.x_unit}")
        left = [
            ((-52.0, HEIGHT * (1.0 - at) - _RAISE), text) for at, text in self.y.ticks() if text
        ]
        title = [((170.0, -36.0 - _RAISE), self.y_title)] if self.y_title else []
        return [*below, *left, *title]


def dashed(strips: Strips) -> Strips:
    """Cut polylines into straight dashes."""
    return [piece for strip in strips for piece in _dashes(strip)]


def _dashes(strip: Points) -> Strips:
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(strip, axis=0).T))])
    start = np.arange(0.0, length[-1], _DASH + _SPACE)
    ends = np.column_stack([start, np.minimum(start + _DASH, length[-1])])
    dashes = np.stack([np.interp(ends, length, strip[:, k]) for k in (0, 1)], axis=2)
    return list(dashes.astype(np.float32))


def _clip(
    start: Points, end: Points
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """Return segments cut to the chart, shape (n, 2, 2), and the shares at which they were cut.

    A segment with `last` <= `first` lies off the chart, or an end of it is unknown. The method is
    that of Liang and Barsky (1984): each edge of the rectangle raises the first share or lowers
    the last one.
    """
    origin = start.astype(np.float64)
    step = end - origin
    first = np.zeros(len(start))
    last = np.where(np.isfinite(origin + step).all(axis=1), 1.0, -1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, size in ((0, WIDTH), (1, HEIGHT)):
            for slope, room in ((-step[:, k], origin[:, k]), (step[:, k], size - origin[:, k])):
                share = room / slope
                first = np.where(slope < 0.0, np.maximum(first, share), first)
                last = np.where(slope > 0.0, np.minimum(last, share), last)
                last = np.where((slope == 0.0) & (room < 0.0), -1.0, last)
    shares = np.stack([first, last], axis=1)
    pieces = origin[:, np.newaxis] + shares[..., np.newaxis] * step[:, np.newaxis]
    return pieces.astype(np.float32), first, last


def _joined(
    pieces: NDArray[np.float32], first: NDArray[np.float64], last: NDArray[np.float64]
) -> Strips:
    """Join segments that continue each other into polylines; drop those off the chart."""
    seen = last > first
    broken = ~seen[1:] | ~seen[:-1] | (first[1:] > 0.0)
    runs = np.split(np.arange(len(pieces)), np.flatnonzero(broken) + 1)
    return [
        np.concatenate([pieces[run, 0], pieces[run[-1:], 1]])
        for run in runs
        if len(run) and seen[run[0]]
    ]


def _strip(start: tuple[float, float], end: tuple[float, float]) -> Points:
    return np.array([start, end], np.float32)
