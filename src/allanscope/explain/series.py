"""The record on one uniform time grid: what every effect looks at.

The transforms of the loop need equally spaced samples. Short gaps have been bridged before
(`noise.bridging`), in the record that the noise is fitted to as well. A long gap is bridged with
the line between the levels on its two sides plus noise resampled from its neighbourhood, so that
neither the level nor the density around it changes; where there is much of that only the longest
stretch is taken. `bridged` tells which rows are filling. What must be said of an axis before any
search (constant, too short, saturated, bridged) is said here too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct, prev_fast_len
from scipy.ndimage import uniform_filter1d

from allanscope.allan import AllanBank, Deviation
from allanscope.explain.shock_removal import extent_of, quiet_rows, shaken_rows, with_pulse
from allanscope.explain.shock_rows import Levelled, ShockRows, find_shock_rows
from allanscope.history import Record
from allanscope.lazy import once
from allanscope.median import medians
from allanscope.noise.grid import Grid, grid_of
from allanscope.parts import full_scale_of
from allanscope.quantities import CHI_SQUARE_MEDIAN, MAD_TO_SIGMA, count, duration

__all__ = [
    "LOUD",
    "SHORTEST_ROWS",
    "SHORTEST_S",
    "Series",
    "Source",
    "block_means",
    "deviation_of",
    "in_time",
    "multiple_of",
    "observations",
    "series_of",
    "why_not_searched",
]

Array = NDArray[np.float64]

_LEVEL = 100
"""Fewest rows on each side of a gap whose mean is taken as the level there."""
_JUMPED, _FEWEST_MEANS = 6.0, 8
"""Usual changes that a level hardly drifts by across a gap, and means from which they are known."""
_MOST_BRIDGED = 0.1
"""With more long gaps than this share, the longest stretch without one is used instead."""
_LONG = 1 << 14
"""Rows below which any transform is quick."""
_MOVING = 0.9
"""Share of equal neighbours below which an axis moves at all."""
LOUD = 25.0
"""Power of an ordinate over the noise around it that noise hardly has: it holds a line."""
_WIDTH, _STANDS_OUT, _SKIRT = 32, 2.5, 0.05
"""Ordinates over which the power of a line is averaged, that mean over the noise around it, six of
its standard errors, and the share of a line's frequency to which what is left of it reaches."""
_THERMAL_S = 30.0
"""A package does not change its temperature faster: what moves faster is the converter's noise."""
_THERMAL_DECADE = 10.0
"""So far beyond the package's own frequencies the noise is measured."""
_ROUNDED, _COPIED, _EXACT = 1.5, 0.02, 1e-12
"""What one axis may differ by from a multiple of another and still be one: in units of the
rounding's power, as a share of its own, and where nothing was rounded."""
_HALF_AN_OCTAVE = 17
"""Bins over which the power of the temperature is averaged."""
SHORTEST_ROWS = 2048
"""Fewest rows that are searched."""
SHORTEST_S = 10.0
"""Effects are held out in blocks of a second: of fewer than ten, nothing can be told."""
_MANY_GAPS = 10
"""Gaps from which not the length of a record but the loss of rows is why no stretch is long."""
_BESIDE, _OFTEN, _AWAY = 2000, 0.99, 3.0
"""Rows beside the ends of a record, a distance from their median that few exceed, and how much
farther is away from it: eight standard deviations."""
_LONGEST_PERIOD = 256
"""Rows after which a pattern may begin anew: noise never does."""
_FULL_SCALE = 32767
"""Largest number of a 16-bit sample."""
_PER_OCTAVE = 2
"""Averaging times an octave at which a curve is compared with a model."""
_AT_THE_RAIL = 1e-4
"""Share of samples at full scale from which an axis is saturated."""


@dataclass(frozen=True, eq=False)
class Source:
    """One axis as what others may follow.

    Attributes
    ----------
    rows : ndarray, shape (n,)
        In dps or g.
    ordinates : ndarray, shape (n - 1,)
        DCT-II ordinates.
    loud, lines : ndarray of bool, shape (n - 1,)
        Ordinates that hold a line of it, by the median around them; and those in and beside a line
        that may be as wide as some tens of them.
    """

    rows: Array
    ordinates: Array
    loud: NDArray[np.bool_]
    lines: NDArray[np.bool_]


@dataclass(frozen=True)
class Series:
    """All axes of a record at equal spacing.

    Attributes
    ----------
    values : ndarray, shape (n, axes)
        In dps or g.
    rate_hz : float
        Rows per second.
    stride : int
        Samples averaged into a row; only with 1 can single samples be judged.
    temperature_c : ndarray, shape (n,), or None
        As measured; None where the record has none or it never moves.
    bridged : ndarray of bool, shape (n,)
        Rows that are filling.
    rows : ndarray of int, shape (rows of the record,)
        Where each row of the record lies on the grid; it may lie beyond.
    gaps : int
        Gaps that were too many to bridge, so that only the longest stretch is taken; else 0.
    """

    axes: tuple[str, ...]
    values: Array
    rate_hz: float
    stride: int
    lsb: tuple[float, ...]
    temperature_c: Array | None
    bridged: NDArray[np.bool_]
    start_s: float = 0.0
    remarks: tuple[str, ...] = ()
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64), repr=False)
    gaps: int = 0

    def __len__(self) -> int:
        return int(self.values.shape[0])

    @property
    def duration_s(self) -> float:
        """Length of the grid in s."""
        return len(self) / self.rate_hz

    @property
    def grid(self) -> Grid:
        """Frequencies of the ordinates of the rows."""
        return grid_of(len(self), self.rate_hz, self.stride)

    def at_record(self, signal: Array) -> Array:
        """Return a signal on the grid at the rows of the record; beyond the grid it stays level."""
        return signal[np.clip(self.rows, 0, len(self) - 1)]

    def gap_around(self, row: int) -> tuple[int, int]:
        """Return the first filled row around one, and the first behind that is not; it itself."""
        first = last = row
        while first > 0 and self.bridged[first - 1]:
            first -= 1
        while last < len(self) and self.bridged[last]:
            last += 1
        return first, last

    def column(self, axis: str) -> int:
        """Return the column of an axis."""
        return self.axes.index(axis)

    @once
    def thermal(self) -> Array | None:
        """Temperature less the converter's noise, mean removed; None without one."""
        if self.thermal_ordinates is None:
            return None
        return in_time(self.thermal_ordinates)

    @once
    def thermal_ordinates(self) -> Array | None:
        """DCT-II ordinates of the temperature as far as it is known, shape (n - 1,).

        The converter's noise would attenuate a regression on it (errors in variables): whitening
        weighs high frequencies most, where the measured temperature is noise alone. What moves
        faster than a package can tells the power of that noise; of every slower ordinate the share
        beyond it is kept (Wiener), which is what may be expected of the true temperature, so the
        slope is neither drawn down by the noise nor drawn up by smoothing away what is not noise.
        """
        if self.temperature_c is None:
            return None
        ordinates = np.asarray(dct(self.temperature_c, norm="ortho")[1:])
        grid = self.grid
        fastest = 1 / _THERMAL_S
        beyond = (grid.frequency >= fastest) & (grid.frequency < _THERMAL_DECADE * fastest)
        noise = (
            float(np.median(ordinates[beyond] ** 2)) / CHI_SQUARE_MEDIAN if beyond.any() else 0.0
        )
        around = uniform_filter1d(grid.bin_means(ordinates**2), _HALF_AN_OCTAVE, mode="nearest")
        share = np.clip(1 - noise / np.maximum(around, 1e-300), 0.0, 1.0)
        return ordinates * np.repeat(share, grid.count.astype(int)) * (grid.frequency < fastest)

    @once
    def temperature_ordinates(self) -> dict[tuple[float, bool], Array]:
        """Ordinates of the temperature behind a lag, and of its square: what `Temperature` kept."""
        return {}

    @once
    def acceleration(self) -> float | None:
        """Size in g of the means of all axes of an accelerometer; None where one is missing."""
        columns = [self.column(axis) for axis in self.axes if axis.startswith("a")]
        if len(columns) < 3:
            return None
        return float(np.linalg.norm(self.values[:, columns].mean(axis=0)))

    @once
    def repeats(self) -> dict[tuple[int, ...], tuple[float, float, float]]:
        """What `RepeatedSamples` counted on some axes together, whatever else is found there."""
        return {}

    @once
    def directions(self) -> dict[tuple[str, str], float]:
        """What tells in nats that one axis takes from another, as `CrossCoupling` found it."""
        return {}

    @once
    def steps_of_noise(self) -> dict[tuple[str, float], float]:
        """Noise of an axis beneath the rounding to a step, as `Quantization` found it."""
        return {}

    @once
    def equal(self) -> NDArray[np.bool_]:
        """Which rows equal the row before, for every axis, shape (n - 1, axes).

        Pairs of which one is filling are left out: it repeats nothing.
        """
        equal = np.asarray(self.values[1:] == self.values[:-1])
        if not self.bridged.any():
            return equal
        return equal[~(self.bridged[1:] | self.bridged[:-1])]

    @once
    def shocks(self) -> tuple[ShockRows, ...]:
        """Shocks, on whichever axis."""
        return self.shocks_in()

    def shocks_in(self, **others: Array) -> tuple[ShockRows, ...]:
        """Return the shocks where axes have other rows than were measured."""
        axes = (
            Levelled(one.axis, others[one.axis], self.rate_hz, one.step, self.stride)
            if one.axis in others
            else one
            for one in self.levelled
        )
        return tuple(find_shock_rows(tuple(axes), self.repeated))

    @once
    def levelled(self) -> tuple[Levelled, ...]:
        """The axes as shocks are looked for in them."""
        rows = map(np.ascontiguousarray, self.values.T)
        known = zip(self.axes, rows, self.lsb, strict=True)
        return tuple(Levelled(axis, x, self.rate_hz, q, self.stride) for axis, x, q in known)

    @once
    def repeated(self) -> NDArray[np.bool_]:
        """Rows that equal the row before on all axes: they were sent twice."""
        return np.append(False, np.all(self.values[1:] == self.values[:-1], axis=1))

    @property
    def all_shocks(self) -> frozenset[int]:
        """Their numbers."""
        return frozenset(range(len(self.shocks)))

    @once
    def deviation(self) -> Deviation:
        """Deviation of every axis (`deviation_of`)."""
        return deviation_of(self.values, self.rate_hz)

    @once
    def moving(self) -> tuple[int, ...]:
        """Columns of which not nearly every row equals the row before."""
        return tuple(np.flatnonzero(self.equal.mean(axis=0) < _MOVING).tolist())

    @once
    def products(self) -> Array:
        """Sums of the products of any two axes about their means, shape (axes, axes)."""
        centred = self.values - self.values.mean(axis=0)
        return np.asarray(centred.T @ centred)

    @once
    def ordinates(self) -> Array:
        """DCT-II ordinates of every axis, shape (axes, n - 1)."""
        centred = (self.values - self.values.mean(axis=0)).T
        return np.asarray(dct(centred, axis=1, norm="ortho")[:, 1:])

    @once
    def loud(self) -> NDArray[np.bool_]:
        """Ordinates that hold a line of their axis, by the median around them, (axes, n - 1)."""
        return self._above_level > LOUD

    @once
    def lines(self) -> NDArray[np.bool_]:
        """Ordinates in and beside a line of their axis that may be as wide as some tens of them."""
        return _with_lines(self._above_level)

    @once
    def _above_level(self) -> Array:
        """Power of every ordinate over that of the noise around it, by the median of its bin."""
        return _over_noise(self.ordinates, self.grid)

    def source(self, axis: str, shocks: frozenset[int] = frozenset()) -> Source:
        """Return an axis without some of the shocks of the record, by their numbers."""
        k = self.column(axis)
        moving = tuple(one for one in sorted(shocks) if axis in self.shocks[one].sigma)
        if not moving:
            return Source(self.values[:, k], self.ordinates[k], self.loud[k], self.lines[k])
        if (k, moving) not in self._quiet:
            self._quiet[k, moving] = self._without_shocks(axis, moving)
        return self._quiet[k, moving]

    @once
    def _quiet(self) -> dict[tuple[int, tuple[int, ...]], Source]:
        """Axes without shocks, by column and numbers."""
        return {}

    def _without_shocks(self, axis: str, shocks: tuple[int, ...]) -> Source:
        rows = np.array(self.values[:, self.column(axis)])
        for one in (self.shocks[number] for number in shocks):
            whole = with_pulse(rows, one, self.rate_hz)
            first, stop = extent_of(rows, whole, self.rate_hz)
            others = shaken_rows(self.shocks, one, len(rows), self.rate_hz)
            rows[first:stop] = quiet_rows(rows, first, stop, one.sigma[axis], others)[0]
        ordinates = np.asarray(dct(rows - rows.mean(), norm="ortho")[1:])
        power = _over_noise(ordinates[np.newaxis], self.grid)
        return Source(rows, ordinates, power[0] > LOUD, _with_lines(power)[0])


def _over_noise(ordinates: Array, grid: Grid) -> Array:
    """Return the power of ordinates over that of the noise around them, (axes, n - 1)."""
    power = ordinates**2
    for low, high in pairwise([*grid.edges, power.shape[1]]):
        level = medians(power[:, low:high])[:, np.newaxis] / CHI_SQUARE_MEDIAN
        power[:, low:high] /= np.maximum(level, np.finfo(float).tiny)
    return power


def _with_lines(power: Array) -> NDArray[np.bool_]:
    """Tell which ordinates, by their power over the noise, are in a line or beside one."""
    means = uniform_filter1d(power, _WIDTH, axis=1)
    return np.array([_beside(one > _STANDS_OUT) for one in means])


def deviation_of(values: Array, rate_hz: float) -> Deviation:
    """Overlapping Allan deviation on a half-octave grid; its intervals are those of white noise.

    They are not asked for here, and those of the noise at hand take longer than the deviation.

    Parameters
    ----------
    values : ndarray, shape (n, axes)
        Rows; several axes take hardly longer than one.
    """
    bank = AllanBank(rate_hz, values.shape[1], _PER_OCTAVE)
    bank.update(values)
    return bank.deviation("oadev", noise="WFM")


def block_means(values: Array, blocks: int) -> Array:
    """Return the means of so many blocks, about equally long: those of `numpy.array_split`.

    Examples
    --------
    >>> block_means(np.arange(7.0), 3).tolist()
    [1.0, 3.5, 5.5]
    """
    length, longer = divmod(len(values), blocks)
    cut = longer * (length + 1)
    parts = values[:cut].reshape(longer, length + 1), values[cut:].reshape(blocks - longer, length)
    return np.concatenate([part.mean(axis=1) for part in parts])


def in_time(ordinates: Array, n: int | None = None) -> Array:
    """Return the samples without a mean that have these DCT-II ordinates.

    Parameters
    ----------
    ordinates : ndarray, shape (..., m)
        From the first on.
    n : int, optional
        Samples, where the ordinates beyond are 0; m + 1 without it.

    Examples
    --------
    >>> in_time(np.array([1.0, 0.0])).round(3).tolist()
    [0.707, 0.0, -0.707]
    >>> in_time(np.array([1.0]), 3).round(3).tolist()
    [0.707, 0.0, -0.707]
    """
    m = ordinates.shape[-1]
    padded = np.zeros((*ordinates.shape[:-1], n or m + 1))
    padded[..., 1 : m + 1] = ordinates
    return np.asarray(idct(padded, norm="ortho", overwrite_x=True))


def _beside(loud: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which ordinates are as near to a loud one as what is left of a line reaches.

    >>> loud = np.arange(1000) == 499
    >>> np.flatnonzero(_beside(loud))[[0, -1]].tolist()
    [474, 524]
    """
    number = 1 + np.flatnonzero(loud)
    first = np.maximum((number * (1 - _SKIRT)).astype(int) - 1, 0)
    stop = np.minimum((number * (1 + _SKIRT)).astype(int), len(loud))
    covered = np.zeros(len(loud) + 1, np.int64)
    np.add.at(covered, first, 1)
    np.add.at(covered, stop, -1)
    return np.asarray(np.cumsum(covered[:-1]) > 0)


def multiple_of(series: Series, axis: str, other: str) -> float | None:
    """Return by what one axis is a multiple of another, to the rounding; None where it is not."""
    here, there = series.column(axis), series.column(other)
    whole, power = float(series.products[here, here]), float(series.products[there, there])
    common = float(series.products[here, there])
    factor = common / power if power > 0 else 0.0
    # Of what is left after a copy the products do not know the last digits; elsewhere they do.
    if whole - factor * common > 2 * _COPIED * whole:
        return None
    own = series.values[:, here] - series.values[:, here].mean()
    source = series.values[:, there] - series.values[:, there].mean()
    rest = own - factor * source
    rounding = (series.lsb[here] ** 2 + (factor * series.lsb[there]) ** 2) / 12 / series.stride
    allowed = min(_ROUNDED * rounding * len(own), _COPIED * whole)
    left = float(rest @ rest)
    return factor if factor and left < max(allowed, _EXACT * whole) else None


def series_of(record: Record) -> Series:
    """Put a record on a uniform grid.

    Raises
    ------
    ValueError
        If the record has no rows, or values that are not finite.
    """
    if record.values.ndim != 2 or len(record.values) == 0:
        raise ValueError("the record contains no rows")
    if not np.all(np.isfinite(record.values)):
        raise ValueError("the record contains values that are not finite")
    remarks: list[str] = []
    row = np.round((record.start_s - record.start_s[0]) * record.rate_hz).astype(np.int64)
    if np.any(np.diff(row) < 1):
        row = np.arange(len(row))
    size, rows, taken, gaps = int(row[-1]) + 1, row, slice(0, len(row)), 0
    if size > len(row) * (1 + _MOST_BRIDGED):
        first, last = max(record.segments, key=lambda s: int(s[1] - s[0]))
        remarks.append(
            f"{100 * (1 - len(row) / size):.0f} % of the run is missing: only its longest stretch "
            f"without a long gap ({(last - first) / record.rate_hz:.0f} s) was searched for effects"
        )
        taken, gaps = slice(first, last), len(record.segments) - 1
        rows = row - row[first]
        row = rows[taken]
        size = len(row)
    grid, bridged = _bridge(record.values[taken], row, size)
    if record.filled is not None:
        bridged[row] = record.filled[taken]
    warmth = _temperature(record.temperature_c[taken], row, size, remarks)
    kept = _transformable(grid)
    return Series(
        axes=record.axes,
        values=np.asfortranarray(grid[kept]),  # a search takes one axis at a time
        rate_hz=record.rate_hz,
        stride=record.stride,
        lsb=record.lsb,
        temperature_c=None if warmth is None else warmth[kept],
        bridged=bridged[kept],
        start_s=float(record.start_s[taken.start]) + kept.start / record.rate_hz,
        remarks=tuple(remarks),
        rows=rows - kept.start,
        gaps=gaps,
    )


def _transformable(grid: Array) -> slice:
    """Return which rows of a grid to take: of a length whose cosine transform is quick.

    Of a million rows a transform takes 10 ms when the length has no prime factor above 11, and up
    to 150 ms otherwise; a search has hundreds of them. The rows left out are one in a thousand, and
    never more than one in a hundred. They are the last, or the first where the last show that
    somebody has reached for the board, which is to be found.
    """
    size = len(grid)
    whole = size if size < _LONG else int(prev_fast_len(size))
    left = size - whole
    at_front = left > 0 and _is_away(grid[::-1], left) and not _is_away(grid, left)
    return slice(left, size) if at_front else slice(0, whole)


def _is_away(grid: Array, first: int) -> bool:
    """Return whether the first rows of a grid are, on any axis, away from those after them."""
    beside = grid[first : first + _BESIDE]
    level = np.median(beside, axis=0)
    usual = np.quantile(np.abs(beside - level), _OFTEN, axis=0)
    return bool((np.abs(grid[:first] - level) > _AWAY * usual).any())


def _bridge(values: Array, row: NDArray[np.int64], size: int) -> tuple[Array, NDArray[np.bool_]]:
    bridged = np.ones(size, bool)
    bridged[row] = False
    if not bridged.any():
        return np.ascontiguousarray(values, np.float64), bridged
    grid = np.zeros((size, values.shape[1]))
    grid[row] = values
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    for gap in np.flatnonzero(np.diff(row) > 1):
        left, right = row[gap] + 1, row[gap + 1]
        # As long on both sides as the gap is: what lasts shorter tells nothing of its middle.
        beside = max(_LEVEL, int(right - left))
        before = values[max(0, gap + 1 - beside) : gap + 1]
        after = values[gap + 1 : gap + 1 + beside]
        share = ((np.arange(left, right) - left + 0.5) / (right - left))[:, np.newaxis]
        first, last = before.mean(axis=0), after.mean(axis=0)
        # A level drifts across; one that is another afterwards has jumped, once.
        jumped = np.abs(last - first) > _JUMPED * _usual_change(total, beside)
        level = first + np.where(jumped, share > 0.5, share) * (last - first)
        # Mirrored at the edges, noise keeps its colour, and in this sum its size.
        angle, shape = np.pi / 2 * share, (right - left, values.shape[1])
        grid[left:right] = (
            level
            + np.cos(angle) * np.resize((before - first)[::-1], shape)
            + np.sin(angle) * np.resize(after - last, shape)[::-1]
        )
    return grid, bridged


def _usual_change(total: Array, rows: int) -> Array:
    """Return the usual change of each axis between means over so many rows, from running sums.

    Infinite where there are too few to tell.
    """
    means = np.diff(total[::rows], axis=0) / rows
    if len(means) < _FEWEST_MEANS:
        return np.full(total.shape[1], np.inf)
    return np.asarray(np.median(np.abs(np.diff(means, axis=0)), axis=0) * MAD_TO_SIGMA)


def _temperature(
    measured: Array, row: NDArray[np.int64], size: int, remarks: list[str]
) -> Array | None:
    known = np.isfinite(measured)
    if not known.any():
        return None
    if np.all(measured[known] == 0.0):
        remarks.append("the temperature is 0 throughout: probably no sensor; not used")
        return None
    if np.ptp(measured[known]) == 0.0:
        remarks.append("the temperature never changes: nothing can be regressed on it")
        return None
    return np.asarray(np.interp(np.arange(size), row[known], measured[known]))


def why_not_searched(series: Series, axis: str) -> tuple[str, ...]:
    """Return why an axis cannot be searched; empty when it can."""
    samples = series.values[:, series.column(axis)]
    n = len(samples)
    measured = samples[~series.bridged]
    if n == 0 or np.all(samples == samples[0]):
        value = f" at {samples[0]:.6g}" if n else ""
        return (f"constant{value}: no noise to measure",)
    period = _period(samples)
    if period:
        return (
            f"the samples repeat every {period} rows to the last digit: a test pattern or a "
            "repeated buffer; no noise to analyse",
        )
    needed = max(SHORTEST_S, SHORTEST_ROWS / series.rate_hz)
    if n < SHORTEST_ROWS or series.duration_s < SHORTEST_S:
        missing = duration(np.ceil(needed - series.duration_s))
        if series.gaps >= _MANY_GAPS:
            return (
                f"rows are missing throughout: {count(series.gaps)} gaps; the longest stretch "
                f"without one is {duration(series.duration_s)} of the {duration(needed)} needed to "
                "search; find where rows are lost (logger or link): a longer run does not help",
            )
        return (
            f"too short: {duration(series.duration_s)} of the {duration(needed)} needed to search; "
            f"record at least {missing} longer",
        )
    if (
        np.unique(measured[:: max(1, n // 4096)]).size < 2
        or float(np.mean(np.diff(measured) != 0)) < 1e-3
    ):
        return (
            "fewer than one sample in a thousand changes: quantization hides the noise; "
            "choose a smaller full scale",
        )
    return ()


def _period(samples: Array) -> int:
    """Return after how many rows all samples come again exactly, 0 where they do not."""
    for period in range(2, min(_LONGEST_PERIOD, len(samples) // 4) + 1):
        if samples[period] == samples[0] and np.array_equal(samples[period:], samples[:-period]):
            return period
    return 0


def observations(series: Series, axis: str) -> tuple[str, ...]:
    """Return what the reader must know of an axis although it can be searched."""
    column = series.column(axis)
    samples, lsb = series.values[:, column], series.lsb[column]
    found = list(series.remarks)
    if full_scale_of(axis, lsb) is not None:  # else the end of the range is unknown
        rail = float(np.mean(np.abs(samples) >= (_FULL_SCALE - 1) * lsb))
        if rail > _AT_THE_RAIL:
            found.append(
                f"{100 * rail:.2g} % of the samples are at the end of the range: the axis is "
                "saturated; its noise values are not valid"
            )
    for other in series.axes:
        factor = multiple_of(series, axis, other) if other != axis else None
        if factor is not None:
            found.append(
                f"{axis} is {factor:.6g} times {other}: both carry one signal, so their "
                "coupling is not known"
            )
    share = float(series.bridged.mean())
    if share > 0:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], series.bridged, [0]])))
        longest = duration(float(np.max(edges[1::2] - edges[::2])) / series.rate_hz)
        gaps = (
            f"in {count(len(edges) // 2)} gaps of up to {longest}"
            if len(edges) > 2
            else "in one gap"
        )
        found.append(f"{100 * share:.2g} % of the samples are missing, {gaps}, and were bridged")
    if series.stride > 1:
        found.append(
            f"rows are means of {series.stride} samples: single samples (outliers, repeats, "
            "the lattice) were not examined, and above "
            f"{series.rate_hz / 2:.3g} Hz there is only the streaming spectrum"
        )
    return tuple(found)
