r"""Isolated samples that the rest does not allow: bit errors, knocks, discharges.

The curve shows them as white noise. Each sample is compared with the mean of its neighbourhood in
units of the noise there (so that a noisy stretch is not a crowd of outliers); with n samples the
limit is the normal quantile of 1 - alpha/(2 n), about six. If the kurtosis of the others is more
than a Gaussian's, the whole distribution has heavy tails, and only samples that stand apart from
these are to blame. The largest of a tail that falls as :math:`x^{-\nu}` are apart by chance:
all :math:`k \ln(x_k / x_{k+1})` are exponential with the mean :math:`1/\nu` (Renyi), which is that
of the smaller ones. Many that stand alone are to blame where they are more than Student's t lets
expect beyond the limit that fits the core: knocks and bit errors leave the core as it is, heavy
tails do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.special import gammaincc, log_ndtr, ndtri, pdtrc, stdtr

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.view import View
from allanscope.median import median
from allanscope.noise.grid import Grid
from allanscope.quantities import counted

Array = NDArray[np.float64]

_NEIGHBOURS = 25
"""Samples on each side that give the level."""
_BLOCK = 1024
"""Samples over which the scale of the noise is taken."""
_BULK = 3.5
"""Sigma from which a sample is far out, of which a Gaussian has one in 2000."""
_HEAVY = 3.0
"""Standard errors of the kurtosis from which tails are heavy."""
_OWN = 0.6
"""Share of its distance from the mean around it that a sample must be away from both its sides."""
_FEWEST_IN_TAIL, _MOST_APART = 20, 10
"""Samples that tell how a tail falls at the least, and most apart from it: more are a tail."""
_BINS, _SCALES, _TAILS = 40, np.linspace(0.7, 1.1, 41), np.linspace(1e-3, 1.0, 41)
"""Bins of the core up to `_BULK`; scales and inverse degrees of freedom of Student's t there."""
_WITHIN_NATS = 4.5
"""Of the likeliest, which these may lose: three standard errors."""
_TIMES = 8.0
"""Times as many as expected: no tail is Student's t to the last digit, least of all beside white
noise."""
_COARSE = 0.6
"""Half a step in deviations from which the core of a distribution is not seen."""
_BESIDE, _QUIET, _MOSTLY = 8, 3.0, 0.8
"""Rows on each side of a sample that stands alone, their mean square at the most, and the share of
all samples beyond the limit that stands alone: others are bursts of noise."""
_FAR, _LARGEST = 20.0, 64
"""Deviations from which outliers are looked at by their size, and most of them: what is not as far
out may be of tails that a core tells too little of, and does little to N."""
_NO_NOISE = 2.0
"""Power with which the tail of no noise falls, or more slowly: it would have no variance."""
_SPIKE = 3
"""Most rows on which a filter leaves one spike, beside what it leaves before and after them."""
_RARELY = 0.1
"""Of what rounding scatters: noise that hardly ever leaves its code."""
_NEARLY = 0.9
"""Share of many outliers that are found again in other noise."""
_MOST = 0.02
"""More than this share of outliers is a distribution. Of up to it, none was named in samples of
Student's t with 2 to 8 degrees of freedom, Laplace's, or noise of log-normal amplitude."""


@dataclass(frozen=True)
class Outliers(EffectKind):
    """Isolated samples."""

    count: Estimate
    largest_deviations: float

    kind = "outliers"
    meaning = "isolated samples far outside the distribution of the rest"
    phrase = "isolated outliers ({count})"
    as_cause = "outliers"
    needs = frozenset({"samples"})
    stage = 1
    is_single = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "variance_change": "is confined to one stretch",
        "unexplained": "heavy tails fill the range between, outliers leave it empty",
        "step": "stays",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        how_many = counted(round(self.count.value), "isolated outlier")
        most = f"{self.largest_deviations:.1f} standard deviations from the mean"
        return f"{how_many}, up to {most}"

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether other outliers are the same, but for a few that other noise makes."""
        del grid
        fewer, more = sorted([self.count.value, other.count.value])
        return fewer > _NEARLY * more

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """List the samples beyond the limit."""
        if len(view.data) < 4 * _NEIGHBOURS:
            return []
        n = len(view.data)
        limit = -float(ndtri(ALPHA / (2 * n)))
        least = view.step / np.sqrt(12 * view.series.stride)  # rounding alone scatters so much
        z, level = deviations(view.data, least)
        usual = max(median(np.abs(view.data - level)) * 1.48, _RARELY * least, 1e-300)
        rounding = 0.5 * view.step / usual
        at = np.flatnonzero(np.abs(z) > limit + rounding)
        at = at[_isolated(view.data, level, at)]
        if len(at) == 0:
            return []
        at, z, level = _on_their_own(view.data, at, z, limit + rounding, least)
        others = np.delete(z, at) ** 2
        if np.mean(others**2) > (3.0 + _HEAVY * np.sqrt(24 / n)) * np.mean(others) ** 2:
            apart = at[_apart_from_tails(np.abs(z), at, rounding)]
            is_seen = rounding < _COARSE and not view.crowded_codes
            has_core = is_seen and not len(apart)
            at = _beyond_the_core(z, at, limit + rounding) if has_core else apart
        if len(at) == 0 or len(at) > _MOST * n:
            return []
        signal = np.zeros(n)
        signal[at] = view.data[at] - level[at]
        close = int(np.count_nonzero(np.abs(z[at]) < limit + 1.0))
        sizes = np.abs(z[at])
        gain = float(-np.sum(np.log(2 * n) + log_ndtr(rounding - sizes)))
        count = Estimate(float(len(at)), float(len(at)), float(len(at) + 2 * close + 1))
        return [Candidate(cls(count, float(sizes.max())), gain, signal=signal)]


def _apart_from_tails(sizes: Array, at: NDArray[np.int64], rounding: float) -> NDArray[np.bool_]:
    """Tell which of the samples lie beyond a gap that a heavy tail leaves too rarely.

    Parameters
    ----------
    sizes : ndarray, shape (n,)
        Distances of all samples in deviations.
    at : ndarray of int
        Those beyond the limit.
    rounding : float
        By how much a distance may be off, as the values have a step.
    """
    tail, most = np.sort(sizes)[::-1], min(len(at), _MOST_APART)
    count = max(most + _FEWEST_IN_TAIL, int(np.count_nonzero(tail > _BULK)))
    bulk = max(float(tail[count]), rounding)
    tail = np.maximum(tail[:count], bulk)
    logs, k = np.log(tail / bulk), np.arange(1, most + 1)
    others = len(tail) - k
    mean = np.maximum((np.cumsum(logs[::-1])[::-1][k] + k * logs[k]) / others, 1e-12)
    gap = k * np.log(np.maximum((tail[k - 1] - rounding) / (tail[k] + rounding), 1.0))
    apart = k[others * np.log1p(gap / mean / others) > np.log(most / ALPHA)]
    return sizes[at] >= (tail[apart[-1] - 1] if len(apart) else np.inf)


def _beyond_the_core(z: Array, at: NDArray[np.int64], limit: float) -> NDArray[np.int64]:
    """Return the samples that stand alone and are too many, or too large, for tails of the core.

    Parameters
    ----------
    z : ndarray, shape (n,)
        Distances of all samples in deviations.
    at : ndarray of int
        Those beyond the limit.
    limit : float
        In deviations.
    """
    squares = np.minimum(z**2, limit**2)
    squares[at] = 1.0
    for group in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
        if 1 < len(group) <= _SPIKE:
            beside = np.clip([group[0] - 1, group[-1] + 1], 0, len(z) - 1)
            squares[beside] = np.minimum(squares[beside], 1.0)
    alone = at[uniform_filter1d(squares, 2 * _BESIDE + 1)[at] < _QUIET]
    if len(alone) <= _MOSTLY * len(at):
        return at[:0]
    edges = np.linspace(0.0, _BULK, _BINS + 1)
    counts = np.histogram(np.abs(z), edges)[0]
    freedom, scale = np.broadcast_arrays(1 / _TAILS[:, np.newaxis], _SCALES)
    chance = np.diff(2 * stdtr(freedom[..., np.newaxis], edges / scale[..., np.newaxis]), axis=2)
    within = chance.sum(axis=2)
    loglik = np.log(chance / within[:, :, np.newaxis]) @ counts
    tails = loglik > loglik.max() - _WITHIN_NATS
    # Of the largest, the two largest, and so on, where no noise falls as slowly, and of all.
    sizes = np.sort(np.abs(z[alone]))[::-1]
    is_slow = gammaincc(len(sizes), _NO_NOISE * np.log(sizes / limit).sum()) < ALPHA
    far = min(int(np.count_nonzero(sizes > _FAR)), _LARGEST) if is_slow else 0
    number = np.append(np.arange(1, far + 1), len(alone))
    size = np.append(sizes[:far] - _COARSE, limit)
    beyond = 2 * stdtr(freedom[tails, np.newaxis], -size / scale[tails, np.newaxis])
    expected = (beyond / within[tails, np.newaxis]).max(axis=0) * (_TIMES * counts.sum())
    are_more = np.flatnonzero(pdtrc(number - 1, expected) < ALPHA)
    if len(are_more) == 0:
        return at[:0]
    last = are_more[-1]
    return at if last == len(number) - 1 else at[np.abs(z[at]) >= sizes[number[last] - 1]]


def _on_their_own(
    data: Array, at: NDArray[np.int64], z: Array, limit: float, least: float
) -> tuple[NDArray[np.int64], Array, Array]:
    """Return which of the samples are beyond the limit of a mean that none of them draws.

    One sample a thousand deviations away moves the mean around its neighbours so far that they seem
    to be away from it, all of them: the largest is taken out before the others are judged.

    Returns
    -------
    at : ndarray of int
        The samples.
    z, level : ndarray, shape (n,)
        Deviations and means as in `deviations`, without them.
    """
    quiet, taken, waiting = data.copy(), np.zeros(len(data), bool), at
    while True:
        size = np.zeros(len(data))
        size[waiting] = np.abs(z[waiting])
        largest = waiting[size[waiting] == maximum_filter1d(size, 2 * _NEIGHBOURS + 1)[waiting]]
        taken[largest] = True
        for k in largest:
            around = slice(max(0, k - _NEIGHBOURS), k + _NEIGHBOURS + 1)
            quiet[k] = np.median(data[around][~taken[around]])
        rest, level, scale = _compared(quiet, least)
        z = rest / scale
        waiting = waiting[~taken[waiting] & (np.abs(z[waiting]) > limit)]
        if len(waiting) == 0:
            break
    found = np.flatnonzero(taken)
    z[found] = (data[found] - level[found]) / scale[found]
    return found, z, level


def deviations(data: Array, least: float = 0.0) -> tuple[Array, Array]:
    """Return every sample's distance from its neighbours in local deviations, and their mean.

    No deviation is less than `least`.
    """
    rest, level, scale = _compared(data, least)
    return rest / scale, level


def _compared(data: Array, least: float) -> tuple[Array, Array, Array]:
    """Return every sample's distance from its neighbours, their mean, and the deviation there."""
    width = 2 * _NEIGHBOURS + 1
    level = (uniform_filter1d(data, width, mode="reflect") * width - data) / (width - 1)
    rest = data - level
    blocks = max(1, len(data) // _BLOCK)
    edges = np.linspace(0, len(data), blocks + 1).astype(int)
    scale = np.empty(blocks)
    for b in range(blocks):
        part = np.abs(rest[edges[b] : edges[b + 1]])
        # The mean of what is below 3 medians: exact to a per cent on a lattice too.
        core = part[part <= 4.5 * max(median(part), 1e-300)]
        scale[b] = np.sqrt(np.mean(core**2)) * 1.009
    scale = np.maximum(scale, max(0.2 * np.median(scale), least, 1e-300))
    smooth = np.interp(np.arange(len(data)), 0.5 * (edges[:-1] + edges[1:]), scale)
    return rest, level, smooth


def _isolated(data: Array, level: Array, at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which of the samples stand alone: back on the level of both sides at once.

    Within a neighbourhood of a jump the mean is on neither level, and every sample is far from it.
    """
    keep = np.ones(len(at), bool)
    for i, k in enumerate(at):
        left = data[max(0, k - 12) : max(0, k - 1)]
        right = data[k + 2 : k + 13]
        if len(left) < 4 or len(right) < 4:
            continue
        jump = abs(np.median(right) - np.median(left))
        size = abs(data[k] - 0.5 * (np.median(left) + np.median(right)))
        keep[i] = size > 1.5 * jump and size > _OWN * abs(data[k] - level[k])
    return keep
