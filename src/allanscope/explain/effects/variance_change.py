r"""The white level is not one level: a noisy stretch, a neighbour that runs for an hour.

The Allan variance sees only the mean of the variance, so a curve that looks perfect can hide this.
The data are whitened; over blocks of half a second the mean squares are chi-square, and every
interval on a ladder of lengths is tested against the rest,

.. math:: G = \tfrac12 [n \ln \bar s - n_1 \ln s_1 - n_2 \ln s_2].

Tails heavier than a Gaussian's raise the scatter of the squares, and the gain is divided by that.
The borders of the most telling interval are then placed to the row (`noise_level_border`).

A filter that is switched changes the level in a part of the band only. Then that part is looked at
alone. So that no tone which comes and goes is taken for one, the change must be there in half of
the band at least, and last until an end of the record.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.noise_level_border import instant_of, loglik_of_level, rows_of_loglik
from allanscope.explain.series import in_time
from allanscope.explain.view import View
from allanscope.quantities import measured, moment

Array = NDArray[np.float64]
_Found = tuple[float, int, int, float]
"""Gain, first and last block of an interval, and its power over the rest's."""

_BLOCK_S = 0.5
"""Length of a block, whose power is one number."""
_MOST = 40
"""Most stretches of one record."""
_QUARTERS = 4
"""Quarters of the band in each of which the power must have changed."""
_LEFT = 0.2
"""Least share of a quarter of the band that must not have been cut out of the fit."""
_CAP = 20.0
"""Squares are cut here, so that one sample cannot make a stretch."""
_CLEAR, _AS_MUCH = 6.0, 0.5
"""Standard errors of the log of a ratio, and its share of the largest one, from which the power in
a quarter of the band has changed with it."""
_RUNS = 10
"""Runs of neighbouring quarters."""
_AT_THE_END, _LASTING = 2, 1 / 16
"""Blocks from an end of the record from which a stretch lasts until it, and within which it is what
whitening leaves of a strong tone there, or a jump that took its time; and the share of the record
from which it is more than what filters do at the ends."""
_LONGEST = 0.5
"""Longest stretch as a share of the record: beyond, the rest is the one that changed."""
_REACH = 22.0
"""Blocks beside a border among which it is looked for, times the squared contrast of a block: twice
as far as it is off in one of twenty."""


@dataclass(frozen=True)
class VarianceChange(EffectKind):
    """Intervals of another white level.

    Attributes
    ----------
    rms, unit : tuple of (float, float), str
        Noise in the stretch and in the rest.
    band : tuple of (float, float), optional
        Frequencies in Hz between which it changed, where it is not the same at all of them.
    """

    intervals: Estimate
    start: Estimate
    stop: Estimate
    ratio: Estimate
    blocks: int
    rms: tuple[float, float]
    unit: str
    band: tuple[float, float] | None = None

    kind = "variance_change"
    meaning = "the white level is not one level"
    phrase = "noise level changed at {event}, by a factor of {ratio}"
    motion = "burst"
    sized_by = "ratio"
    size_of_none = 1.0
    located_by = "start"
    shared_by = "start"
    is_single = True
    is_not_gaussian = True
    excluded_by = frozenset({"quantization", "random_telegraph"})  # a hop is whitened to a burst
    stage = 3
    confused_with: ClassVar[Mapping[str, str]] = {
        "outliers": "single samples, not a stretch",
        "unexplained": "heavy tails are everywhere",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        stretch, rest = (measured(rms, unit=self.unit) for rms in self.rms)
        noise = "white noise"
        if self.band is not None:
            noise = f"noise between {self.band[0]:.3g} and {self.band[1]:.3g} Hz"
        length = self.stop.value - self.start.value
        start, stop = (moment(border.value, length) for border in (self.start, self.stop))
        words = (
            f"between {start} and {stop} the {noise} is "
            f"{self.ratio.value:.3g} times that of the rest ({stretch} rms, {rest})"
        )
        return words if self.band is None else f"{words}, as after a change of a filter"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look for intervals whose mean square differs from the rest's."""
        size = max(8, int(_BLOCK_S * view.grid.rate_hz))
        blocks = len(view.innovations) // size
        if blocks < 16:
            return []
        rows = view.innovations
        power, found = _powers(view, rows, size)
        if not found:
            return []
        band, alternatives = None, 0.0
        if not _at_all_frequencies(view, max(found), size):
            band, alternatives = _changed_band(view, max(found), size, blocks), np.log(_RUNS)
            if band is None:
                return []
            rows = _in_band(view, band)
            power, found = _powers(view, rows, size)
            if not found or not _until_an_end(max(found), blocks):
                return []
        best = max(found)
        for _, first, last, times in found:
            power[first:last] /= times  # loud blocks scatter more: at one level tails are seen
        freedom = _freedom(power, size)
        ratio, inside = float(np.sqrt(best[3])), best[2] - best[1]
        gain = float(sum(g for g, *_ in found))
        looked_at = log_alternatives(blocks) + alternatives
        count = float(len(found))
        weak = float(sum(g < 2 * (looked_at - np.log(ALPHA)) for g, *_ in found))
        quarters = slice(None) if band is None else band
        rest = float(np.sum(view.spectrum.ordinates[quarters])) / view.grid.n
        rest /= 1 + inside / blocks * (best[3] - 1)
        unit = view.grid.rate_hz / (2 * view.grid.n)
        effect = cls(
            intervals=Estimate(count, count - weak, count + weak),
            start=_border(view, rows, best, size, freedom, is_start=True),
            stop=_border(view, rows, best, size, freedom, is_start=False),
            ratio=Estimate.of(ratio, ratio / np.sqrt(2 * freedom * inside)),
            blocks=blocks,
            rms=(float(np.sqrt(best[3] * rest)), float(np.sqrt(rest))),
            unit=view.unit,
            band=None if band is None else (band.start * unit, band.stop * unit),
        )
        return [Candidate(effect, gain, looked_at)]


def _powers(view: View, rows: Array, size: int) -> tuple[Array, list[_Found]]:
    """Return the mean squares of blocks of whitened data, and the intervals that are found."""
    blocks = len(rows) // size
    white = rows[: blocks * size].reshape(blocks, size)
    power = np.mean(np.minimum(white**2, _CAP), axis=1)
    # Equal values by chance are no silence: what was rounded may have moved by a step.
    rounding = view.step**2 / 12 / float(np.median(view.spectrum.ordinates))
    power = np.maximum(power, min(rounding, 1.0) * np.median(power))
    found = _intervals(power, _freedom(power, size))
    edges = [0.0, float(blocks), *(edge / size for edge in _edges(view))]
    return power, [one for one in found if not _is_of_an_edge(one, edges)]


def _edges(view: View) -> Iterator[float]:
    """Generate the rows at which a level that was accepted jumps."""
    for effect in (
        c.effect for c in view.accepted if c.effect.is_piecewise and c.effect.located_by
    ):
        begin = float(getattr(effect, effect.located_by).value)
        duration = getattr(effect, "duration", None)
        yield view.row_at(begin)
        if duration is not None:
            yield view.row_at(begin + duration.value)


def _is_of_an_edge(found: _Found, edges: Iterable[float]) -> bool:
    """Return whether a short interval is what an end of the record, or a jump, leaves there."""
    _, first, last, _ = found
    return any(edge - _AT_THE_END <= first and last <= edge + _AT_THE_END for edge in edges)


def _until_an_end(found: _Found, blocks: int) -> bool:
    """Return whether a stretch that lasts begins or ends with the record."""
    _, first, last, _ = found
    at_an_end = first <= _AT_THE_END or last >= blocks - _AT_THE_END
    return at_an_end and last - first >= _LASTING * blocks


def _in_band(view: View, band: slice) -> Array:
    """Return the whitened data between two frequencies, of unit variance."""
    only = np.zeros_like(view.whitened)
    only[band] = view.whitened[band]
    return np.asarray(in_time(only) / np.sqrt(np.count_nonzero(only) / view.grid.n))


def _changed_band(view: View, found: _Found, size: int, blocks: int) -> slice | None:
    """Return the ordinates of the quarters of the band that changed; None where they are too few.

    They are neighbours and changed in one direction, by about as much.
    """
    if not _until_an_end(found, blocks):
        return None
    bounds, ratios, weights = _quarters(view, found, size)
    if len(ratios) < _QUARTERS:
        return None
    largest = ratios[int(np.abs(ratios).argmax())]
    changed = ratios * np.sign(largest) > _AS_MUCH * abs(largest)
    at = np.flatnonzero(changed & (np.abs(ratios) * np.sqrt(weights) > _CLEAR))
    if len(at) < _QUARTERS // 2 or np.any(np.diff(at) > 1):
        return None
    return slice(bounds[at[0]], bounds[at[-1] + 1])


def _at_all_frequencies(view: View, found: _Found, size: int) -> bool:
    """Return whether the quarters of the band agree: a tone that comes and goes is no noise."""
    _, ratios, weights = _quarters(view, found, size)
    if not len(ratios):
        return False  # too little is left to tell noise from a tone that comes and goes
    common = np.average(ratios, weights=weights)
    distance = float(np.sum(weights * (ratios - common) ** 2))
    # Heavy contrast need not be white to a per cent: a tenth of it may differ.
    room = float(np.sum(weights)) * (0.1 * common) ** 2
    return bool(chdtrc(max(len(ratios) - 1, 1), max(distance - room, 0.0)) > 1e-3)


def _quarters(view: View, found: _Found, size: int) -> tuple[list[int], Array, Array]:
    """Return the edges of the quarters, the logs of the ratios of their powers, and the weights.

    Without those of which too little was kept.
    """
    _, first, last, _ = found
    kept, white = view.spectrum.kept, view.whitened
    ratios, weights = [], []
    edges = [round(i * len(white) / _QUARTERS) for i in range(_QUARTERS + 1)]
    for part in (np.arange(a, b) for a, b in pairwise(edges)):
        if kept[part].mean() < _LEFT or not white[part].any():
            continue
        only = np.zeros_like(white)
        only[part] = white[part]
        power = in_time(only) ** 2
        inside = power[first * size : last * size].mean()
        outside = (power.sum() - inside * (last - first) * size) / (
            len(power) - (last - first) * size
        )
        ratios.append(np.log(inside / outside))
        weights.append((last - first) * size * kept[part].sum() / len(white) / 2)
    return edges, np.array(ratios), np.array(weights)


def log_alternatives(blocks: int) -> float:
    """Log of how many intervals there are: by simulation, 1 in 1000 clean records gains more."""
    return float(np.log(1.5 * blocks))


def _border(
    view: View, rows: Array, found: _Found, size: int, freedom: float, *, is_start: bool
) -> Estimate:
    """Return when an interval begins or ends, from the rows around: blocks tell it to a block."""
    _, first, last, ratio = found
    contrast = freedom * np.log(ratio) ** 2 / 2
    reach = int((1 + _REACH / max(contrast, 1e-3)) * size)
    first, last = first * size, last * size
    within = (last - first) // 2
    # An interval that is the whole record leaves nothing of the other level.
    if is_start:
        low, high = max(int(last == len(rows)), first - reach), first + min(reach, within)
    else:
        low, high = last - min(reach, within), min(len(rows) - int(first == 0), last + reach)
    total = np.concatenate([[0.0], np.cumsum(np.minimum(rows**2, _CAP))])
    border, weight = np.arange(low, high + 1, dtype=np.int64), freedom / size
    begin, end = (border, last) if is_start else (first, border)
    count, inside = np.asarray(end - begin, np.float64), total[end] - total[begin]
    loglik = loglik_of_level(count, inside, weight)
    loglik += loglik_of_level(len(rows) - count, total[-1] - inside, weight)
    return instant_of(rows_of_loglik(loglik), view.grid.rate_hz, view.time_at(low))


def _freedom(power: Array, size: int) -> float:
    """Return the degrees of freedom of the mean squares of blocks: their size, or less by tails."""
    spread = float(np.mean((np.diff(power)) ** 2)) / 2
    return float(np.clip(2 * np.median(power) ** 2 / spread, 1.0, size)) if spread else float(size)


def _intervals(power: Array, freedom: float) -> list[_Found]:
    """Find (gain, first, last, ratio) of intervals, strongest first."""
    power = power.copy()
    n = len(power)
    price = log_alternatives(n) - float(np.log(ALPHA))
    found: list[_Found] = []
    for _ in range(_MOST):
        gain, first, last = best_interval(power, freedom)
        if gain < price:
            break
        if last - first > n * _LONGEST:
            if first > 0 and last < n:
                break
            first, last = (last, n) if first == 0 else (0, first)  # the same seen from the rest
        inside = float(power[first:last].mean())
        outside = float((power.sum() - power[first:last].sum()) / (n - last + first))
        found.append((gain, first, last, inside / outside))
        power[first:last] *= outside / inside
    return found


def best_interval(power: Array, freedom: float) -> tuple[float, int, int]:
    """Return the gain of the most telling interval of another level, and its borders."""
    n = len(power)
    total = np.concatenate([[0.0], np.cumsum(power)])
    best = (0.0, 0, 1)
    width = 1
    while width <= n * _LONGEST:
        hop = max(1, width // 8)
        first = np.arange(0, n - width + 1, hop)
        best = max(best, _score(total, first, first + width, freedom))
        width = max(width + 1, int(width * 1.3))
    _, low, high = best
    reach = max(2, (high - low) // 4)
    for _ in range(3):  # refine both borders in turn
        first = np.arange(max(0, low - reach), min(high, low + reach + 1))
        best = max(best, _score(total, first, np.full_like(first, high), freedom))
        low = best[1]
        last = np.arange(max(low + 1, high - reach), min(n, high + reach) + 1)
        best = max(best, _score(total, np.full_like(last, low), last, freedom))
        _, low, high = best
    return best


def _score(
    total: Array, first: NDArray[np.int64], last: NDArray[np.int64], freedom: float
) -> tuple[float, int, int]:
    n = len(total) - 1
    count = (last - first).astype(float)
    good = (count > 0) & (count < n)
    first, last, count = first[good], last[good], count[good]
    if len(first) == 0:
        return 0.0, 0, 1
    inside = (total[last] - total[first]) / count
    outside = (total[-1] - total[last] + total[first]) / (n - count)
    mean = total[-1] / n
    gain = (
        0.5 * freedom * (n * np.log(mean) - count * np.log(inside) - (n - count) * np.log(outside))
    )
    k = int(np.argmax(gain))
    return float(gain[k]), int(first[k]), int(last[k])
