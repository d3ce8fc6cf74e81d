r"""The white level is not one level: a noisy stretch, a neighbour that runs for an hour.

The Allan variance sees only the mean of the variance, so a curve that looks perfect can hide this.
The data are whitened; over blocks of half a second the mean squares are chi-square, and every
interval on a ladder of lengths is tested against the rest,

.. math:: G = \tfrac12 [n \ln \bar s - n_1 \ln s_1 - n_2 \ln s_2].

Tails heavier than a Gaussian's raise the scatter of the squares, and the gain is divided by that.
The borders of the most telling interval are then placed to the row (`noise_level_border`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import idct
from scipy.special import chdtrc

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.noise_level_border import instant_of, rows_of_border
from allanscope.explain.view import View

Array = NDArray[np.float64]

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
_LONGEST = 0.5
"""Longest stretch as a share of the record: beyond, the rest is the one that changed."""
_REACH = 22.0
"""Blocks beside a border among which it is looked for, times the squared contrast of a block: twice
as far as it is off in one of twenty."""


@dataclass(frozen=True)
class VarianceChange(EffectKind):
    """Intervals of another white level."""

    intervals: Estimate
    start: Estimate
    stop: Estimate
    ratio: Estimate
    blocks: int

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
        return (
            f"between {self.start.value:.0f} s and {self.stop.value:.0f} s the white noise is "
            f"{self.ratio.value:.3g} times that of the rest"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look for intervals whose mean square differs from the rest's."""
        size = max(8, int(_BLOCK_S * view.grid.rate_hz))
        blocks = len(view.innovations) // size
        if blocks < 16:
            return []
        white = view.innovations[: blocks * size].reshape(blocks, size)
        power = np.mean(np.minimum(white**2, _CAP), axis=1)
        # Equal values by chance are no silence: what was rounded may have moved by a step.
        rounding = view.step**2 / 12 / float(np.median(view.spectrum.ordinates))
        power = np.maximum(power, min(rounding, 1.0) * np.median(power))
        found = _intervals(power, _freedom(power, size))
        if not found or not _at_all_frequencies(view, max(found), size):
            return []
        best = max(found)
        for _, first, last, times in found:
            power[first:last] /= times  # loud blocks scatter more: at one level tails are seen
        freedom = _freedom(power, size)
        ratio, inside = float(np.sqrt(best[3])), best[2] - best[1]
        gain, looked_at = float(sum(g for g, *_ in found)), log_alternatives(blocks)
        count = float(len(found))
        weak = float(sum(g < 2 * (looked_at - np.log(ALPHA)) for g, *_ in found))
        effect = cls(
            intervals=Estimate(count, count - weak, count + weak),
            start=_border(view, best, size, freedom, is_start=True),
            stop=_border(view, best, size, freedom, is_start=False),
            ratio=Estimate.of(ratio, ratio / np.sqrt(2 * freedom * inside)),
            blocks=blocks,
        )
        return [Candidate(effect, gain, looked_at)]


def _at_all_frequencies(view: View, found: tuple[float, int, int, float], size: int) -> bool:
    """Return whether the quarters of the band agree: a tone that comes and goes is no noise."""
    _, first, last, _ = found
    kept = view.spectrum.kept
    white = view.ordinates / np.sqrt(view.spectrum.ordinates) * kept
    ratios, weights = [], []
    for part in np.array_split(np.arange(len(white)), _QUARTERS):
        if kept[part].mean() < _LEFT or not white[part].any():
            continue
        only = np.zeros(len(white) + 1)
        only[1 + part] = white[part]
        power = np.asarray(idct(only, norm="ortho")) ** 2
        inside = power[first * size : last * size].mean()
        outside = (power.sum() - inside * (last - first) * size) / (
            len(power) - (last - first) * size
        )
        ratios.append(np.log(inside / outside))
        weights.append((last - first) * size * kept[part].sum() / len(white) / 2)
    if not ratios:
        return False  # too little is left to tell noise from a tone that comes and goes
    common = np.average(ratios, weights=weights)
    distance = float(np.sum(np.array(weights) * (np.array(ratios) - common) ** 2))
    # Heavy contrast need not be white to a per cent: a tenth of it may differ.
    room = float(np.sum(weights)) * (0.1 * common) ** 2
    return bool(chdtrc(max(len(ratios) - 1, 1), max(distance - room, 0.0)) > 1e-3)


def log_alternatives(blocks: int) -> float:
    """Log of how many intervals there are: by simulation, 1 in 1000 clean records gains more."""
    return float(np.log(1.5 * blocks))


def _border(
    view: View, found: tuple[float, int, int, float], size: int, freedom: float, *, is_start: bool
) -> Estimate:
    """Return when an interval begins or ends, from the rows around: blocks tell it to a block."""
    _, first, last, ratio = found
    contrast = freedom * np.log(ratio) ** 2 / 2
    reach = int((1 + _REACH / max(contrast, 1e-3)) * size)
    first, last = first * size, last * size
    within = (last - first) // 2
    if is_start:
        low, high = max(0, first - reach), first + min(reach, within)
    else:
        low, high = last - min(reach, within), min(len(view.innovations), last + reach)
    squares = np.minimum(view.innovations**2, _CAP)
    inside = float(squares[first:last].mean())
    levels = (inside / ratio, inside) if is_start else (inside, inside / ratio)
    rows = rows_of_border(squares[low:high], *levels, weight=freedom / size)
    return instant_of(rows, view.grid.rate_hz, low / view.grid.rate_hz)


def _freedom(power: Array, size: int) -> float:
    """Return the degrees of freedom of the mean squares of blocks: their size, or less by tails."""
    spread = float(np.mean((np.diff(power)) ** 2)) / 2
    return float(np.clip(2 / spread * np.median(power) ** 2, 1.0, size))


def _intervals(power: Array, freedom: float) -> list[tuple[float, int, int, float]]:
    """Find (gain, first, last, ratio) of intervals, strongest first."""
    power = power.copy()
    n = len(power)
    price = log_alternatives(n) - float(np.log(ALPHA))
    found: list[tuple[float, int, int, float]] = []
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
