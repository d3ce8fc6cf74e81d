"""Codes that collect samples, and codes that have none.

The frequencies of a signal with noise on it change smoothly from one value to the next, whatever
its distribution. Clipping collects all that lies beyond a limit on one value, a dead zone all that
lies within it. Counted are arrivals at a value: a bus that freezes stays, and is no crowded code.

No converter is even: of all its codes some are a little wider than their neighbours, and one may
never occur. A code is crowded within the range only where chance among all codes does not make it
so, where it holds twice what its neighbours hold, and where that is enough to matter. The last code
of a range beside one that is missing takes over what would have been there: it is no limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from allanscope.explain.values import counted

__all__ = ["CrowdedCode", "crowded_codes", "missing_codes"]

Array = NDArray[np.float64]

_FEWEST_ARRIVALS = 20
"""Arrivals that make a code crowded."""
_MORE, _SIGMAS = 1.2, 5.0
"""Ratio and deviations by which a crowded code at an end exceeds the value beside it."""
_SPREADS, _BENDS = 1.2, 1.3
"""Noise in steps from which a lacking tail is told, and how much more than that of Gaussian noise
its log-density may bend: its standard deviation is known to a seventh."""
_FALLING, _UNEVEN = 0.95, 0.05
"""Ratio of the two codes beside the end below which a tail falls there (that of a uniform
distribution does not), and scatter of the widths of codes."""
_COLLECTS = 1.15
"""Ratio of the last code to what a tail lets expect of it, beyond which it collects."""
_TWICE, _ALPHA, _MATTERS = 2.0, 1e-4, 0.01
"""Within: ratio to the fuller neighbour, chance of it among all codes, and share of all samples
beyond what the neighbours hold."""
_MOST_PILES = 3
"""Values within; where there are more the lattice is uneven, as decimals of a binary step are."""
_FINEST = 0.7
"""Noise in steps from which the values vary smoothly; below, few codes say nothing."""
_NEAR = 0.5
"""Distance from the next value, in deviations, from which an extreme stands apart: no limit."""
_NEARBY = 2.0
"""Deviations within which values without a step, or in clumps, are as frequent as one of them."""
_EXPECTED = 20.0
"""Arrivals that the codes on both sides let expect where there is none."""
_CROSSED = 0.02
"""Part of a code that the one beyond it holds at least: the noise spreads, and does not hop."""
_MOST_MISSING = 2
"""Missing codes that are named one by one: of more, it is the samples that lie apart."""


@dataclass(frozen=True)
class CrowdedCode:
    """A value at which samples collect.

    Attributes
    ----------
    value : float
        The value.
    share : float
        Part of all samples that has it.
    side : int
        1 and -1 at the upper and lower end of all values, 0 within.
    """

    value: float
    share: float
    side: int


def crowded_codes(samples: Array, step: float) -> tuple[CrowdedCode, ...]:
    """Return where samples collect, in the order of the values.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        As measured.
    step : float
        Distance of the values that occur, 0 where they lie on no lattice.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=10_000)
    >>> crowded_codes(np.minimum(noise, 1.5), 0.0)
    (CrowdedCode(value=1.5, share=0.0642, side=1),)
    """
    if len(samples) < _FEWEST_ARRIVALS:
        return ()
    differences = np.diff(samples)
    moved = np.append(True, differences != 0)
    spread = float(np.std(differences[moved[1:]])) / np.sqrt(2) if moved[1:].any() else 0.0
    if spread <= _FINEST * step:
        return ()
    codes = _codes(samples, step)
    values, arrivals = counted(codes[moved])
    # Of a value within, a Gaussian of this spread has so many more than of the next.
    peak = 1.0 if step <= 0 else float(np.exp(0.5 * (step / spread) ** 2))
    sizes: Array | None = None
    if step <= 0:
        sizes = np.unique(samples)
    elif _in_clumps(values, arrivals):
        sizes = step * values.astype(np.float64)
    found = []
    for i in np.flatnonzero(arrivals >= _FEWEST_ARRIVALS).tolist():
        side = (-1 if i == 0 else 0) + (1 if i == len(values) - 1 else 0)
        beside = _beside(values, arrivals, int(i), step)
        if not (
            _is_heaped(arrivals, i, max(peak * beside, _nearby(sizes, arrivals, i, spread)))
            if side == 0
            else arrivals[i] >= _MORE * beside + _SIGMAS * np.sqrt(max(beside, 1.0))
            or (step > 0 and _lacks_its_tail(values, arrivals, side, spread / step))
        ):
            continue
        own = codes == values[i]
        value = float(samples[np.argmax(own)])
        if side and _gap(samples, own, value, side) > max(2 * step, _NEAR * spread):
            continue
        found.append(CrowdedCode(value, float(own.mean()), side))
    uneven = len([crowded for crowded in found if crowded.side == 0]) > _MOST_PILES
    return tuple(crowded for crowded in found if crowded.side or not uneven)


def missing_codes(samples: Array, step: float) -> tuple[float, ...]:
    """Return values of the lattice that never occur though those on both sides are frequent.

    Noise that spreads over codes has a hump of a distribution: between two of its codes there are
    at least as many samples as in the geometric mean of both.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        As measured.
    step : float
        Distance of the values that occur, 0 where they lie on no lattice.

    Examples
    --------
    >>> rounded = np.round(np.random.default_rng(1).normal(size=10_000))
    >>> missing_codes(np.where(rounded == 2.0, 3.0, rounded), 1.0)
    (2.0,)
    """
    if step <= 0 or len(samples) < _FEWEST_ARRIVALS:
        return ()
    codes = _codes(samples, step)
    values, seen = counted(codes)
    counts = dict(zip(values.tolist(), seen.tolist(), strict=True))
    found = []
    for code in (values[:-1][np.diff(values) == 2] + 1).tolist():
        below, above = counts[code - 1], counts[code + 1]
        falls = counts.get(code - 2, 0) > _CROSSED * below
        rises = counts.get(code + 2, 0) > _CROSSED * above
        on_a_flank = (below > 2 * above and falls) or (above > 2 * below and rises)
        if below * above > _EXPECTED**2 and (on_a_flank or (falls and rises)):
            sides = [samples[int(np.argmax(codes == one))] for one in (code - 1, code + 1)]
            found.append(float(np.mean(sides)))
    return tuple(found) if len(found) <= _MOST_MISSING else ()


def _codes(samples: Array, step: float) -> NDArray[np.int64]:
    """Return the number of each sample's value, from 0 for the least."""
    if step > 0:
        return np.asarray(np.round((samples - samples.min()) / step).astype(np.int64))
    return np.asarray(np.unique(samples, return_inverse=True)[1])


def _in_clumps(values: NDArray[np.int64], arrivals: NDArray[np.int64]) -> bool:
    """Return whether most values of the lattice stay empty that noise over them would fill.

    A code of the converter which a correction spreads over some values leaves all between two codes
    empty.
    """
    low, high = np.searchsorted(np.cumsum(arrivals), np.array([0.25, 0.75]) * arrivals.sum())
    room = int(values[high] - values[low]) + 1
    occurring = int(high - low) + 1
    return 2 * occurring < room and int(arrivals[low : high + 1].sum()) > _EXPECTED * room


def _is_heaped(arrivals: NDArray[np.int64], i: int, usual: float) -> bool:
    """Return whether a code within holds more than chance and uneven codes give it."""
    excess = (arrivals[i] - usual) / arrivals.sum()
    if arrivals[i] < _TWICE * usual or excess < _MATTERS:
        return False
    return bool(pdtrc(arrivals[i] - 1, max(usual, 1.0)) * len(arrivals) < _ALPHA)


def _lacks_its_tail(
    values: NDArray[np.int64], arrivals: NDArray[np.int64], side: int, spread: float
) -> bool:
    """Return whether nothing lies beyond the last code though noise of this spread goes on.

    Whatever Gaussian noise of s steps is added to, its log-density bends by no more than 1 / s^2
    (the derivative of Tweedie's formula), so its slope beside the end, and what it holds beyond,
    have a lower bound that the codes further in tell. The last code has no say in it, but collects:
    it holds more than log-concave tails let it, or the distribution just ends (a uniform one does).
    """
    last = slice(None, None, -1) if side > 0 else slice(None)
    codes = values[last][:6]
    if spread < _SPREADS or len(codes) < 4 or np.any(np.abs(np.diff(codes)) != 1):
        return False
    end, *beside = arrivals[last][:6].tolist()
    counts = np.array(beside, float)
    usual, error = _at_the_end(counts)
    falls = counts[0] < _FALLING * counts[1]
    if not falls or end < max(_COLLECTS * usual, usual + 2 * error):
        return False
    # A fast line spreads more than noise does: the log-density of the codes bends visibly then.
    bends = -np.diff(np.log(counts), 2)
    errors = np.sqrt(np.convolve(1 / counts, [1, 4, 1], "valid"))
    bend = max(_BENDS / spread**2, *(bends - errors / 2))
    slopes = [
        (np.log(counts[0] / counts[m]) - 2 * np.sqrt(1 / counts[0] + 1 / counts[m])) / m
        - bend * (m - 1) / 2
        for m in range(1, len(counts))
    ]
    beyond = counts[0] * np.exp(2 * max(slopes) - 3 * bend)
    return bool(beyond >= _FEWEST_ARRIVALS)


def _at_the_end(counts: Array) -> tuple[float, float]:
    """Return what codes inwards of the last one let expect there, and its standard error.

    A parabola through their log-frequencies, and no more than a straight line through the nearest
    two: the tail of a hump bends down.
    """
    usual = counts[0] ** 2 / counts[1]
    relative = float(4 / counts[0] + 1 / counts[1])
    if len(counts) > 3:
        weight = 1 / np.sqrt(1 / counts + _UNEVEN**2)
        design = np.vander(np.arange(1.0, len(counts) + 1), 3, increasing=True)
        design *= weight[:, np.newaxis]
        variance = np.linalg.inv(design.T @ design)
        level = float(np.exp(variance[0] @ design.T @ (weight * np.log(counts))))
        if level < usual:
            usual, relative = level, float(variance[0, 0])
    return usual, float(np.sqrt(usual + usual**2 * relative))


def _beside(values: NDArray[np.int64], arrivals: NDArray[np.int64], i: int, step: float) -> float:
    """Return the arrivals at the fuller one of the values beside one, a missing code apart."""
    near = [j for j in (i - 1, i + 1) if 0 <= j < len(values)]
    if step > 0:
        near = [j for j in near if abs(values[j] - values[i]) <= 2]
    return float(max((arrivals[j] for j in near), default=0))


def _nearby(sizes: Array | None, arrivals: NDArray[np.int64], i: int, spread: float) -> float:
    """Return the arrivals at the fullest of the values near one, where no step is between all.

    Text has more digits near 0: what lies beside a code of a sensor may be rare values there.
    """
    if sizes is None:
        return 0.0
    near = np.abs(sizes - sizes[i]) < _NEARBY * spread
    near[i] = False
    return float(arrivals[near].max(initial=0))


def _gap(samples: Array, own: NDArray[np.bool_], value: float, side: int) -> float:
    rest = samples[~own]
    return float(value - rest.max() if side > 0 else rest.min() - value) if len(rest) else np.inf
