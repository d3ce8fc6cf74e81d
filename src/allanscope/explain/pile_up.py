"""Values at which samples pile up: the end of a range, or a dead zone within it.

The frequencies of a signal with noise on it change smoothly from one value to the next, whatever
its distribution. Clipping collects all that lies beyond a limit on one value, a dead zone all
that lies within it. Counted are arrivals at a value: a bus that freezes stays, and is no pile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Pile", "piles"]

Array = NDArray[np.float64]

_FEWEST = 20
"""Arrivals that make a pile."""
_MORE, _SIGMAS = 1.2, 5.0
"""Ratio and deviations by which a pile exceeds the fuller of its neighbours."""
_MOST = 3
"""Values within; where there are more the lattice is uneven, as decimals of a binary step are."""
_FINEST = 0.7
"""Noise in steps from which the values vary smoothly; below, few codes say nothing."""
_NEAR = 0.5
"""Distance from the next value, in deviations, from which an extreme stands apart: no limit."""


@dataclass(frozen=True)
class Pile:
    """A value at which samples pile up.

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


def piles(samples: Array, step: float) -> tuple[Pile, ...]:
    """Return where samples pile up, in the order of the values.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        As measured.
    step : float
        Distance of the values that occur, 0 where they lie on no lattice.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=10_000)
    >>> piles(np.minimum(noise, 1.5), 0.0)
    (Pile(value=1.5, share=0.0642, side=1),)
    """
    if len(samples) < _FEWEST:
        return ()
    differences = np.diff(samples)
    moved = np.append(True, differences != 0)
    spread = float(np.std(differences[moved[1:]])) / np.sqrt(2) if moved[1:].any() else 0.0
    if spread <= _FINEST * step:
        return ()
    if step > 0:
        codes = np.round((samples - samples.min()) / step).astype(np.int64)
    else:
        codes = np.unique(samples, return_inverse=True)[1]
    values, arrivals = np.unique(codes[moved], return_counts=True)
    peak = 1.0 if step <= 0 else float(np.exp(0.5 * (step / spread) ** 2))
    full = arrivals >= _FEWEST
    found = []
    for i in np.flatnonzero(full).tolist():
        side = (-1 if i == 0 else 0) + (1 if i == len(values) - 1 else 0)
        # Of a value within, a Gaussian of this spread has so many more than of the next.
        usual = (peak if side == 0 else 1.0) * _beside(values, arrivals, int(i), step)
        if arrivals[i] < _MORE * usual + _SIGMAS * np.sqrt(max(usual, 1.0)):
            continue
        own = codes == values[i]
        value = float(samples[np.argmax(own)])
        if side and _gap(samples, own, value, side) > max(2 * step, _NEAR * spread):
            continue
        found.append(Pile(value, float(own.mean()), side))
    uneven = len([pile for pile in found if pile.side == 0]) > _MOST
    return tuple(pile for pile in found if pile.side or not uneven)


def _beside(values: NDArray[np.int64], arrivals: NDArray[np.int64], i: int, step: float) -> float:
    """Return the arrivals at the fuller one of the values beside one."""
    near = [j for j in (i - 1, i + 1) if 0 <= j < len(values)]
    if step > 0:
        near = [j for j in near if abs(values[j] - values[i]) == 1]
    return float(max((arrivals[j] for j in near), default=0))


def _gap(samples: Array, own: NDArray[np.bool_], value: float, side: int) -> float:
    rest = samples[~own]
    return float(value - rest.max() if side > 0 else rest.min() - value) if len(rest) else np.inf
