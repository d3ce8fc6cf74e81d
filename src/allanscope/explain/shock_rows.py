"""Where a record is shaken: rows far from their level that swing, for a moment, on all axes.

Rows beyond six robust deviations from a running median, close to each other, are a group. One that
goes to and fro is a shock, and so is a loud pulse to one side that is over before the median has
followed it; one that goes only once to the other side is a piece of something on a
single axis, and a shock where a second axis does so at the same time. A knock moves the whole
board: at a time that is known the other axes need not be as loud to be moved by it.

What rings more softly is found by all its rows together (`burst_rows`), away from what is loud.

A record may begin before its sensor has settled, and end when somebody reaches for the board. Rows
at either end that are away from the level need not swing, as they have one side only (`_at_ends`).

What goes on for longer than a shock is no shock: the board is moved (`moved_rows`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.fft import get_workers, irfft, rfft
from scipy.ndimage import median_filter, uniform_filter1d

from allanscope.compiled import Pointer, kernel
from allanscope.explain.burst_rows import Burst, find_bursts
from allanscope.explain.moved_rows import Blocks, MovedRows, blocks_of, find_moved_rows
from allanscope.explain.noise_level_border import rows_of_border
from allanscope.lazy import once
from allanscope.median import median, medians
from allanscope.quantities import MAD_TO_SIGMA

__all__ = ["Levelled", "ShockRows", "find_shock_rows"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_WINDOW_S = 5.0
"""Of the running median: half of it must be quiet."""
_FEWEST_ROWS = 25
"""In a window; longer rows do not show a shock."""
_LOUD, _MOVED = 6.0, 4.5
"""Robust deviations: of a row that is loud, and of one where another axis tells when."""
_MEANS = (4, 12)
"""Rows over which means are taken as well."""
_LEAST_ROWS = 5
"""Loud rows of a shock; fewer are outliers."""
_LOUDER = 1.5
"""Robust deviation of the rows beside a shock, over that of all, from which the noise is louder."""
_AT_KNOWN_TIME = 2
"""Loud rows of an axis that are enough where another one tells when."""
_GAP_S, _LONGEST_S = 1.0, 10.0
"""Between loud rows of one shock, and the longest one."""
_MOST, _MOST_SHOCKS = 0.1, 12
"""Share of the rows in shocks, and their number, beyond which an axis is loud all along."""
_SWINGS = 0.5
"""Standard deviation within a shock over its rms: a level that stays is an excursion."""
_PULSE_S, _FLAT = 1.0, 0.25
"""A pulse to one side that lasts longer has no flat top: with one it is an excursion."""
_SIDE, _TURNS = 3.0, 2
"""Deviations from which a row is on one side, and least changes of the side."""
_AXES = 2
"""Axes on which one change of the side at the same time is enough."""
_FINEST = 0.8
"""Deviation of rows in steps of the values, from which they tell what rings softly."""
_SHORT_S = 2.0
"""What begins to ring again and again for longer is no shock."""
_OF_ITS_ROWS, _OF_THE_REST = 0.5, 1.5
"""Share of the rows at an end of the record that are loud, and how much farther from the level they
are than as many rows elsewhere."""
_PLACES, _MOST_ELSEWHERE = 400, 0.98
"""Where such rows are compared, and the quantile of their distances that is exceeded."""
_BLOCK, _LINE, _SKIRT, _WIDEST = 128, 1e3, 8, 0.02
"""Bins of which the median is the floor, power over it of a line, bins beside it that leak, and the
share of all bins beyond which it is no line."""
_SOFTLY_S = 1.0
"""Time before the first loud row in which a motion may have begun."""
_AROUND = 2 * _MEANS[-1]
"""Rows on each side of the first loud one among which a shock begins."""
_MOST_CODES = 1 << 12
"""Steps between the values beyond which they are not counted: the median might go far each time."""

_CODES = Pointer(np.int32, 1)
_CODES_OUT = Pointer(np.int32, 1, written=True)
_median_of_codes = kernel("running_median", _CODES, int, int, _CODES_OUT, _CODES_OUT)


@dataclass(frozen=True)
class ShockRows:
    """One shock of the record.

    Attributes
    ----------
    first, stop : int
        First row, and the one after the last, of what is loud on any axis.
    sigma : mapping
        Axis that is moved to the standard deviation of its rows in quiet.
    onset : tuple of float
        When it begins, in rows: median and ends of the interval. A mean is loud some rows sooner.
    log_alternatives : float
        Log of the number of places that were looked at.
    rings : mapping
        Axis to how it rings, where no row is loud; empty for a loud shock.
    is_off : bool
        Whether it is the beginning or the end of the record, off the level.
    is_motion : bool
        Whether the board is moved, for longer than a shock.
    """

    first: int
    stop: int
    sigma: Mapping[str, float]
    onset: tuple[float, float, float]
    log_alternatives: float
    rings: Mapping[str, Burst] = field(default_factory=dict)
    is_off: bool = False
    is_motion: bool = False

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that are moved."""
        return tuple(self.sigma)


@dataclass(frozen=True)
class _Group:
    """Loud rows of one axis."""

    axis: str
    first: int
    stop: int
    turns: int
    swings: bool
    is_pulse: bool

    @property
    def is_shock(self) -> bool:
        return self.is_pulse or (self.swings and self.turns >= _TURNS)


@dataclass(frozen=True)
class _Away:
    """How far the rows of one axis are from its level, in robust deviations.

    With the deviation, that of means of some rows in units of it, and how far the level goes from
    end to end.
    """

    rows: Array
    sigma: float
    scales: tuple[float, ...]
    wanders: float

    def beyond(self, limit: float, part: slice = slice(None)) -> Flags:
        """Tell which rows, or means of some rows, are far away: vibration hides a slower swing."""
        first, stop, _ = part.indices(len(self.rows))
        found = np.abs(self.rows[part]) > limit
        begin = max(0, first - _MEANS[-1])
        means = _means(self.rows[begin : stop + _MEANS[-1]])
        for mean, scale in zip(means, self.scales, strict=True):
            if scale > 0:
                found |= np.abs(mean[first - begin : stop - begin]) > limit * scale
        return np.asarray(found)


def _means(rows: Array) -> list[Array]:
    """Return means of rows in deviations: one bad sample makes no loud mean."""
    kept = np.clip(rows, -_LOUD, _LOUD)
    return [uniform_filter1d(kept, size, mode="reflect") for size in _MEANS]


@dataclass(frozen=True, eq=False)
class Levelled:
    """One axis as shocks are looked for in it: what is known of it is computed once.

    Parameters
    ----------
    axis : str
        Its name.
    rows : ndarray, shape (n,)
        Equally spaced.
    rate_hz : float
        Rows per second.
    step : float
        Least difference of its samples.
    stride : int
        Samples of which a row is the mean.
    """

    axis: str
    rows: Array
    rate_hz: float
    step: float
    stride: int = 1

    @property
    def window(self) -> int:
        """Rows of the running median."""
        return int(_WINDOW_S * self.rate_hz) | 1

    @once
    def away(self) -> _Away | None:
        """How far it is from its level; None where it never is."""
        return _away(self.rows, self.window, self.step, self.stride)

    @once
    def blocks(self) -> Blocks | None:
        """Its blocks, that tell when the board is moved; None where it is too short."""
        return blocks_of(self.rows, self.rate_hz, self.step)

    @once
    def spans(self) -> list[tuple[int, int]]:
        """Its loud rows that are close to each other."""
        return [] if self.away is None else _spans(self.away, self.rate_hz)

    def groups(self, moved: Sequence[MovedRows]) -> list[_Group]:
        """Return the groups of its loud rows away from where the board is moved.

        None where it is loud all along.
        """
        if self.away is None:
            return []
        spans = [span for span in self.spans if not _touches(span, moved)]
        rows = sum(stop - first for first, stop in spans)
        if len(spans) > _MOST_SHOCKS or rows > _MOST * len(self.rows):
            return []
        return [_group(self.axis, self.away, *span, self.rate_hz) for span in spans]

    @property
    def is_fine(self) -> bool:
        """Whether its rows tell what rings softly."""
        return self.away is not None and self.away.sigma > _FINEST * self.step

    def bursts(self, axes: int, repeated: Flags) -> tuple[list[Burst], float]:
        """Return what `find_bursts` finds in it, of so many axes that are searched."""
        if axes not in self._bursts:
            assert self.away is not None
            self._bursts[axes] = find_bursts(self.away.rows, self.rate_hz, axes, repeated)
        return self._bursts[axes]

    @once
    def _bursts(self) -> dict[int, tuple[list[Burst], float]]:
        return {}


def find_shock_rows(axes: Sequence[Levelled], repeated: Flags) -> list[ShockRows]:
    """Return the shocks of a record, the first one first.

    Parameters
    ----------
    axes : sequence of Levelled
        All axes of the record.
    repeated : ndarray of bool, shape (n,)
        Rows that equal the row before on all axes: they were sent twice.
    """
    rate_hz, size = axes[0].rate_hz, len(axes[0].rows)
    moved = find_moved_rows({one.axis: (one.rows, one.blocks) for one in axes}, rate_hz)
    motions = [_motion(one, size, rate_hz) for one in moved]
    if axes[0].window < _FEWEST_ROWS or size < 4 * axes[0].window:
        return motions
    with ThreadPoolExecutor(get_workers()) as pool:  # as many as a transform may have
        _ = list(pool.map(lambda one: one.spans, axes))
    groups = [group for one in axes for group in one.groups(moved)]
    away = {one.axis: one.away for one in axes if one.away is not None}
    loud = [(group.first, group.stop) for group in groups]
    loud += [(one.first, one.stop) for one in moved]
    bursts, looked_at = _bursts(axes, repeated)
    found = _soft(bursts, loud, rate_hz, looked_at)
    for first, stop in _events(groups, rate_hz):
        part = slice(first, stop)
        sigma = {
            axis: one.sigma
            for axis, one in away.items()
            if np.count_nonzero(one.beyond(_MOVED, part)) >= _LEAST_ROWS
            or np.count_nonzero(one.beyond(_LOUD, part)) >= _AT_KNOWN_TIME
            or _touches((first, stop), (burst for x, burst in bursts if x.axis == axis))
        }
        onset = _onset([away[axis].rows for axis in sigma], first, stop)
        found.append(ShockRows(first, stop, sigma, onset, looked_at))
    found = _with_ends(found, _at_ends(axes), size, looked_at)
    found = [one for one in found if not _touches((one.first, one.stop), moved)]
    return sorted([*found, *motions], key=lambda one: one.first)


def _motion(moved: MovedRows, size: int, rate_hz: float) -> ShockRows:
    """Return rows in which the board is moved as what is taken out of a record of some rows.

    It may begin softly.
    """
    first, stop = moved.first, moved.stop
    onset = (float(first), max(first - _SOFTLY_S * rate_hz, 0.0), first + 0.5)
    is_off = first == 0 or stop == size
    looked_at = float(np.log(size))
    return ShockRows(first, stop, moved.sigma, onset, looked_at, is_off=is_off, is_motion=True)


def _touches(span: tuple[int, int], others: Iterable[MovedRows | Burst]) -> bool:
    """Return whether rows lie, in part, where the board is moved or something rings."""
    return any(span[0] < one.stop and one.first < span[1] for one in others)


def _at_ends(axes: Iterable[Levelled]) -> dict[bool, dict[str, tuple[int, float]]]:
    """Return for the end, and the beginning, of a record: axis to off-level rows and deviation."""
    ends: dict[bool, dict[str, tuple[int, float]]] = {False: {}, True: {}}
    for one in axes:
        for at_end, rows in ((False, one.rows), (True, one.rows[::-1])):
            if found := _off_at_first(rows, one.window, one.step):
                ends[at_end][one.axis] = found
    return ends


def _off_at_first(x: Array, window: int, step: float) -> tuple[int, float] | None:
    """Return how many of the first rows are not on the level of the rows after them, and its sigma.

    The level is that of the second window. What drifts or waves is as far from it elsewhere too.
    """
    quiet = x[window : 2 * window]
    level = float(np.median(quiet))
    halves = [(half, float(np.median(half))) for half in np.array_split(quiet, 2)]
    rest = np.concatenate([half - middle for half, middle in halves])
    sigma = _deviation(rest, step)
    if abs(halves[0][1] - halves[1][1]) > sigma:
        return None  # it settles for longer: that has a name of its own
    loud = np.abs(x[:window] - level) > _LOUD * sigma
    often = np.cumsum(loud) >= _OF_ITS_ROWS * np.arange(1, len(loud) + 1)
    size = int(np.flatnonzero(loud & often)[-1]) + 1 if (loud & often).any() else 0
    if np.count_nonzero(loud[:size]) < _LEAST_ROWS or size == window:
        return None
    starts = np.linspace(window, len(x) - 2 * window, _PLACES).astype(int)
    total = np.concatenate([[0.0], np.cumsum(x - level)])
    far = (total[starts + size] - total[starts]) / size
    far -= [median(x[i + window : i + 2 * window]) - level for i in starts.tolist()]
    most = float(np.quantile(np.abs(far), _MOST_ELSEWHERE))
    return (size, sigma) if abs(total[size]) / size > _OF_THE_REST * most else None


def _with_ends(
    found: list[ShockRows],
    ends: Mapping[bool, Mapping[str, tuple[int, float]]],
    size: int,
    looked_at: float,
) -> list[ShockRows]:
    """Return shocks with what is off at the ends of the record; what touches them is part of it."""
    for at_end, off in ends.items():
        if not off:
            continue
        rows = max(count for count, _ in off.values())
        first, stop = (size - rows, size) if at_end else (0, rows)
        inside = [one for one in found if one.first < stop and first < one.stop]
        first = min([first, *(one.first for one in inside)])
        stop = max([stop, *(one.stop for one in inside)])
        sigma = {axis: value for one in inside for axis, value in one.sigma.items()}
        sigma |= {axis: value for axis, (_, value) in off.items()}
        onset = (float(first), max(first - 0.5, 0.0), first + 0.5)
        found = [one for one in found if one not in inside]
        found.append(ShockRows(first, stop, sigma, onset, looked_at, is_off=True))
    return found


def _bursts(
    axes: Sequence[Levelled], repeated: Flags
) -> tuple[list[tuple[Levelled, Burst]], float]:
    """Return what rings, on which axis, the first one first, and the log of what was looked at."""
    fine = [one for one in axes if one.is_fine]
    with ThreadPoolExecutor(get_workers()) as pool:
        each = list(pool.map(lambda one: one.bursts(len(fine), repeated), fine))
    found = [(one, burst) for one, (own, _) in zip(fine, each, strict=True) for burst in own]
    looked_at = each[0][1] if each else float(np.log(len(axes[0].rows)))  # the same for every axis
    return sorted(found, key=lambda pair: pair[1].first), looked_at


def _soft(
    bursts: Sequence[tuple[Levelled, Burst]],
    loud: Sequence[tuple[int, int]],
    rate_hz: float,
    looked_at: float,
) -> list[ShockRows]:
    """Return the shocks of which nothing is loud."""
    sets: list[list[tuple[Levelled, Burst]]] = []
    for one in bursts:
        if _is_near(one[1], loud, rate_hz):
            continue
        if sets and one[1].first < max(burst.stop for _, burst in sets[-1]):
            sets[-1].append(one)
        else:
            sets.append([one])
    short = [s for s in sets if s[-1][1].first - s[0][1].first < _SHORT_S * rate_hz]
    return [] if len(short) > _MOST_SHOCKS else [_ringing(members, looked_at) for members in short]


def _is_near(burst: Burst, loud: Sequence[tuple[int, int]], rate_hz: float) -> bool:
    """Return whether a burst belongs to what is loud: what is left of a shock rings on."""
    return any(
        burst.first < 2 * stop - first + _GAP_S * rate_hz and burst.first + 4 * burst.decay > first
        for first, stop in loud
    )


def _ringing(members: list[tuple[Levelled, Burst]], looked_at: float) -> ShockRows:
    """Return bursts of several axes and decay times at one time as one shock."""
    rings: dict[str, Burst] = {}
    sigma: dict[str, float] = {}
    for one, burst in members:
        if one.axis not in rings or burst.gain > rings[one.axis].gain:
            rings[one.axis] = burst
        if one.away is not None:
            sigma[one.axis] = one.away.sigma
    best = max(rings.values(), key=lambda burst: burst.gain)
    return ShockRows(best.first, best.stop, sigma, best.onset, looked_at, rings)


def _onset(moved: Sequence[Array], first: int, stop: int) -> tuple[float, float, float]:
    """Return when it begins, in rows, from the mean square of the axes that are moved."""
    begin, end = max(0, first - _AROUND), min(stop, first + _AROUND)
    swings = np.mean([rows[begin:end] ** 2 for rows in moved], axis=0)
    # Near 0 the density of a swing is that of a Gaussian of pi times its mean square.
    loud = np.pi * max(float(uniform_filter1d(swings, _MEANS[-1]).max()), _LOUD)
    rows = rows_of_border(swings, 1.0, loud, weight=float(len(moved)))
    median, low, high = (begin + row for row in rows)
    return median, low, high


def _away(x: Array, window: int, step: float, stride: int) -> _Away | None:
    level = _running_median(x, window, step / stride)
    away = x - level
    away -= _lines(away)
    sigma = _deviation(away, step)
    if sigma <= 0:
        return None
    away /= sigma
    scales = tuple(_deviation(mean) for mean in _means(away))
    return _Away(away, sigma, scales, float(np.ptp(level)) / sigma)


def _running_median(x: Array, window: int, step: float) -> Array:
    """Return the median of the rows around each, an odd number of them; the ends are mirrored.

    Values on a lattice are counted, in a quarter of the time.
    """
    low = x.min()
    if x.max() - low < _MOST_CODES * step:
        codes = ((x - low) / step + 0.5).astype(np.int32)
        values, count = np.empty(_MOST_CODES + 1), np.zeros(_MOST_CODES + 1, np.int32)
        values[codes] = x
        if np.array_equal(values[codes], x):
            mirrored = np.pad(codes, window // 2, mode="symmetric")
            found = np.empty(len(x), np.int32)
            _median_of_codes(mirrored, len(x), window, count, found)
            return np.asarray(values[found])
    return np.asarray(median_filter(x, window, mode="reflect"))


def _deviation(away: Array, step: float = 0.0) -> float:
    """Return the robust standard deviation about zero, no less than half a step of the values."""
    return max(MAD_TO_SIGMA * median(np.abs(away)), 0.5 * step)


def _lines(away: Array) -> Array:
    """Return the lines that are louder than all other noise together; zeros where none are.

    Beside them no shock is loud. A shock that rings is wider than a line, and its bins stay.
    """
    spectrum = rfft(away)
    power = np.abs(spectrum) ** 2
    around = medians(power[: len(power) // _BLOCK * _BLOCK].reshape(-1, _BLOCK))
    floor = np.repeat(around, _BLOCK)
    floor = np.pad(floor, (0, len(power) - len(floor)), mode="edge")
    peaks = np.flatnonzero(power > _LINE * np.maximum(floor, median(power)))
    if not len(peaks) or power[peaks].sum() < power.sum() / 2:
        return np.zeros(len(away))
    near = np.unique(
        np.clip(peaks[:, np.newaxis] + np.arange(-_SKIRT, _SKIRT + 1), 0, len(power) - 1)
    )
    if len(near) > _WIDEST * len(power):
        return np.zeros(len(away))
    kept = np.zeros_like(spectrum)
    kept[near] = spectrum[near]
    return np.asarray(irfft(kept, len(away)))


def _spans(away: _Away, rate_hz: float) -> list[tuple[int, int]]:
    """Return the ends of the loud rows of one axis that are close to each other."""
    loud = np.flatnonzero(away.beyond(_LOUD))
    spans = [
        (int(part[0]), int(part[-1]) + 1)
        for part in np.split(loud, np.flatnonzero(np.diff(loud) > max(2.0, _GAP_S * rate_hz)) + 1)
        if len(part) >= _LEAST_ROWS and part[-1] - part[0] < _LONGEST_S * rate_hz
    ]
    reach = int(_LONGEST_S * rate_hz)
    return [span for span in spans if _stands_out(away, *span, reach)]


def _stands_out(away: _Away, first: int, stop: int, reach: int) -> bool:
    """Return whether rows are loud against those beside them: noise may be louder for a while."""
    beside = np.abs(np.r_[away.rows[max(0, first - reach) : first], away.rows[stop : stop + reach]])
    around = MAD_TO_SIGMA * median(beside) if len(beside) else 1.0
    if around < _LOUDER:
        return True
    loud = away.beyond(_LOUD * around, slice(first, stop))
    return bool(np.count_nonzero(loud) >= _LEAST_ROWS)


def _group(axis: str, loud: _Away, first: int, stop: int, rate_hz: float) -> _Group:
    """Return rows as a group: how often they change the side, whether they swing or are a pulse.

    What swings is no steady level. A pulse is all on one side, over before the running median has
    followed, no level that stays for a second, and higher than the level ever goes: else it is one
    of its hops.
    """
    away = loud.rows[first:stop]
    side = np.sign(away[np.abs(away) > _SIDE])
    rms, scatter = float(np.sqrt(np.mean(away**2))), float(np.std(away))
    turns = int(np.count_nonzero(np.diff(side)))
    rises = len(away) < _PULSE_S * rate_hz or scatter > max(_SIDE, _FLAT * rms)
    high = float(np.median(np.abs(away))) > max(_LOUD, loud.wanders)
    pulse = turns == 0 and rises and high and len(away) < _WINDOW_S / 2 * rate_hz
    return _Group(axis, first, stop, turns, scatter > max(_SIDE, _SWINGS * rms), pulse)


def _events(groups: list[_Group], rate_hz: float) -> list[tuple[int, int]]:
    """Return the ends of the shocks: groups of all axes that touch are one."""
    turning = sorted((g for g in groups if g.turns or g.is_pulse), key=lambda g: g.first)
    sets: list[list[_Group]] = []
    for group in turning:
        if sets and group.first < max(g.stop for g in sets[-1]):
            sets[-1].append(group)
        else:
            sets.append([group])
    found = []
    for members in sets:
        swinging = [g for g in members if g.swings or g.is_pulse]
        axes = {g.axis for g in swinging}
        if not any(g.is_shock for g in members) and len(axes) < _AXES:
            continue
        first, stop = min(g.first for g in swinging), max(g.stop for g in swinging)
        if stop - first < _LONGEST_S * rate_hz:
            found.append((first, stop))
        else:
            found += [(g.first, g.stop) for g in members if g.is_shock]
    return sorted(found)
