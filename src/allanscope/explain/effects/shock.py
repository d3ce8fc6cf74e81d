r"""A shock: something is knocked, dropped or driven over, and rings for a moment.

For a second or ten the samples move by many times their noise, to and fro, and then it is over;
perhaps the level is another one afterwards, which is a `step` of its own. In the spectrum a shock
is everywhere, in the curve it looks like white noise or a random walk, and one that is explained by
steps and excursions takes a dozen of them. So it is found in time, before everything else: rows
beyond six robust deviations from a running median, close to each other, that swing. These rows are
taken out: the level is drawn straight through them, with the noise of the rows before them on it,
so that the spectrum has no hole there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.view import View
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]

_WINDOW_S = 5.0
"""Of the running median: half of it must be quiet."""
_FEWEST_ROWS = 25
"""In a window; longer rows do not show a shock."""
_LOUD = 6.0
"""Robust deviations."""
_MEANS = (4, 12)
"""Rows over which means are taken as well."""
_LEAST_ROWS = 5
"""Loud rows of a shock; fewer are outliers."""
_GAP_S, _MARGIN_S, _LONGEST_S = 1.0, 0.3, 10.0
"""Between loud rows of one shock, before and after it, and the longest one."""
_MOST, _MOST_SHOCKS = 0.1, 12
"""Share of the rows in shocks, and their number, beyond which the record is loud all along."""
_SWINGS = 0.5
"""Standard deviation within a shock over its rms: a level that stays is an excursion."""
_SIDE, _TURNS = 3.0, 2
"""Deviations from which a row is on one side, and least changes of the side."""
_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


@dataclass(frozen=True)
class Shock(EffectKind):
    """One shock."""

    time: Estimate
    duration: Estimate
    peak: Estimate

    kind = "shock"
    meaning = "a knock that rings for a moment"
    stage = 0
    located_by = "time"
    shared_by = "time"
    is_rival = False
    is_not_gaussian = False
    confused_with: ClassVar[Mapping[str, str]] = {
        "outliers": "last one sample each",
        "excursion": "stays away at one level",
        "variance_change": "is a few times louder than the rest, not ten times",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return (
            f"a shock of up to {self.peak.value:.3g} {self.peak.unit} at {self.time.value:.1f} s "
            f"for {self.duration.value:.2g} s, taken out"
        )

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Tell whether another shock is the same."""
        del grid
        return abs(self.time.value - other.time.value) < _GAP_S

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look for rows that swing far beyond the noise, for a short while."""
        rate = view.grid.rate_hz
        window = int(_WINDOW_S * rate) | 1
        if window < _FEWEST_ROWS or len(view.data) < 4 * window:
            return []
        away = view.data - median_filter(view.data, window, mode="nearest")
        sigma = max(_SIGMA * float(np.median(np.abs(away))), 0.5 * view.step)
        if sigma <= 0:
            return []
        spans = _spans(np.flatnonzero(_is_loud(away, sigma)), rate)
        rows = sum(stop - first for first, stop in spans)
        if len(spans) > _MOST_SHOCKS or rows > _MOST * len(view.data):
            return []
        shocks = [span for span in spans if _swings(away[slice(*span)], sigma)]
        return [_candidate(view, away, sigma, span) for span in shocks]


def _is_loud(away: Array, sigma: float) -> NDArray[np.bool_]:
    """Tell which rows, or means of some rows, are far away: vibration hides a slower swing."""
    loud = np.abs(away) > _LOUD * sigma
    kept = np.clip(away, -_LOUD * sigma, _LOUD * sigma)  # one bad sample makes no loud mean
    for rows in _MEANS:
        mean = uniform_filter1d(kept, rows, mode="nearest")
        loud |= np.abs(mean) > _LOUD * _SIGMA * float(np.median(np.abs(mean)))
    return loud


def _spans(loud: NDArray[np.int64], rate: float) -> list[tuple[int, int]]:
    """Return the first row and the end of every group of loud rows that is long enough."""
    if len(loud) == 0:
        return []
    groups = np.split(loud, np.flatnonzero(np.diff(loud) > max(2.0, _GAP_S * rate)) + 1)
    return [
        (int(group[0]), int(group[-1]) + 1)
        for group in groups
        if len(group) >= _LEAST_ROWS and group[-1] - group[0] < _LONGEST_S * rate
    ]


def _swings(away: Array, sigma: float) -> bool:
    """Tell whether the rows go to and fro, which those at a level that hops once do not."""
    rms = float(np.sqrt(np.mean(away**2)))
    side = np.sign(away[np.abs(away) > _SIDE * sigma])
    turns = int(np.count_nonzero(np.diff(side)))
    return turns >= _TURNS and float(np.std(away)) > max(_SIDE * sigma, _SWINGS * rms)


def _candidate(view: View, away: Array, sigma: float, span: tuple[int, int]) -> Candidate:
    rate, n = view.grid.rate_hz, len(view.data)
    margin = int(np.ceil(_MARGIN_S * rate))
    first, stop = max(0, span[0] - margin), min(n, span[1] + margin)
    signal = np.zeros(n)
    signal[first:stop] = view.data[first:stop] - _quiet(view.data, first, stop)
    size = np.abs(away[slice(*span)])
    gain = 0.5 * float(np.sum((size / sigma) ** 2))
    off = _MEANS[-1] / rate  # where a mean begins to be loud
    time, duration = span[0] / rate, (span[1] - span[0]) / rate
    start = view.series.start_s + time
    effect = Shock(
        Estimate(start, start - off, start + off, "s"),
        Estimate(duration, max(duration - 2 * off, 0.0), duration + off, "s"),
        Estimate.of(float(size.max()), sigma, view.unit),
    )
    return Candidate(effect, gain, float(np.log(n)), signal=signal)


def _quiet(data: Array, first: int, stop: int) -> Array:
    """Return a straight level from before to after, with the noise of the rows before on it.

    At the beginning of a record it is the noise of the rows after.
    """
    size = stop - first
    before, after = data[max(0, first - size) : first], data[stop : stop + size]
    source = before if len(before) == size else after
    if len(source) < size:
        source = np.resize(np.concatenate([before, after]), size)
    ends = [float(np.median(side)) for side in (before, after) if len(side)]
    level = np.linspace(ends[0], ends[-1], size)
    return np.asarray(level + source - np.median(source))
