"""The Cramer-Rao bound: how well a model's numbers can be known from a run of a given length.

The information about logarithms of numbers in n samples is 1/2 sum_k (d ln lambda_k / d ln theta)^2
over the DCT ordinates. N is known to 1 / sqrt(2 n); B and K depend on the length of the run alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import Component
from allanscope.noise.evidence import Ordinates
from allanscope.noise.grid import Grid
from allanscope.noise.likelihood import Fit, Likelihood, inverse
from allanscope.noise.model import NoiseModel

__all__ = ["relative_bounds", "wait_until"]

Array = NDArray[np.float64]

_LONGEST_FACTOR = 4096.0
"""Times the present length beyond which a wait is not said."""


def relative_bounds(
    model: NoiseModel | Iterable[Component], dt: float, duration: float
) -> dict[str, float]:
    """Return the least relative standard deviation of every number of a model.

    Parameters
    ----------
    model : NoiseModel or iterable of Component
        With the true numbers.
    dt : float
        Time between samples in s.
    duration : float
        Length of the run in s.

    Returns
    -------
    dict
        Name of each number (``N``, ``B``, ...) to its bound; infinite for a number at zero.

    Examples
    --------
    >>> from allanscope.noise.components import Flicker, RandomWalk, White
    >>> model = [White(4e-3), Flicker(1.255e-3), RandomWalk(1e-4)]
    >>> bounds = relative_bounds(model, 1 / 104, 3600.0)
    >>> {name: f"{100 * bound:.2g} %" for name, bound in bounds.items()}
    {'N': '0.12 %', 'B': '8.2 %', 'K': '33 %'}
    """
    return _bounds_of(model, dt)(duration)


def _bounds_of(
    model: NoiseModel | Iterable[Component], dt: float
) -> Callable[[float], dict[str, float]]:
    """Return what gives `relative_bounds` of a model for the length of a run."""
    whole = model if isinstance(model, NoiseModel) else NoiseModel(tuple(model), dt)
    unit = replace(whole, components=tuple(part.with_power(1.0) for part in whole))
    power = np.array([part.power for part in whole])
    known = np.array([part.has_amplitude for part in whole]) & (power > 0)
    part_of = {unit.quantity(free).name: free.part for free in unit.numbers}

    def bounds(duration: float) -> dict[str, float]:
        n = max(32, round(duration / dt))
        likelihood = _likelihood_of(n, dt)
        if unit.shapes:
            expected = likelihood.expected(whole)
            fit = Fit(likelihood, whole, likelihood.value(expected), frozenset(), True, expected)
            return dict(zip(fit.names, fit.relative_sd().tolist(), strict=True))
        parts = power[:, np.newaxis] * _columns_of(n, unit)
        parts *= np.sqrt(2 * likelihood.dof) / np.maximum(parts.sum(axis=0), likelihood.floor)
        variance = np.full(len(power), np.inf)
        variance[known] = np.diag(inverse(parts[known] @ parts[known].T))
        return {name: float(np.sqrt(max(variance[part], 0.0))) for name, part in part_of.items()}

    return bounds


@lru_cache(maxsize=128)  # likewise, of some kilobytes
def _columns_of(n: int, unit: NoiseModel) -> Array:
    """Return what each component of a model gives the bins of a run of so many samples."""
    likelihood = _likelihood_of(n, unit.dt)
    return np.array([likelihood.column(unit, part) for part in unit])


@lru_cache(maxsize=128)  # the waits for all numbers of all axes try the same lengths
def _likelihood_of(n: int, dt: float) -> Likelihood:
    """Return the likelihood of a run of so many samples."""
    grid = Grid(n, 1 / dt)
    return Likelihood([Ordinates(grid, np.ones_like(grid.count), grid.count)])


def wait_until(
    model: NoiseModel | Iterable[Component],
    dt: float,
    duration: float,
    name: str,
    known: float = 0.2,
) -> float | None:
    """Return how much longer to run until a number is known to a relative standard deviation.

    Parameters
    ----------
    duration : float
        Length of the run so far in s.
    name : str
        Of the number.
    known : float
        Relative standard deviation to reach.

    Returns
    -------
    float or None
        In s; 0 when it is known now, None when 4096 times the run would not do.
    """
    bounds = _bounds_of(model, dt)

    def bound(length: float) -> float:
        return bounds(length).get(name, np.inf)

    low, high, above, below = duration, duration, np.inf, bound(duration)
    if below <= known:
        return 0.0
    while below > known:
        low, high, above = high, 2 * high, below
        if high > _LONGEST_FACTOR * duration:
            return None
        below = bound(high)
    return _where_known(bound, known, (low, high), (above, below)) - duration


def _where_known(
    bound: Callable[[float], float],
    known: float,
    ends: tuple[float, float],
    bounds: tuple[float, float],
) -> float:
    """Return the first of 33 lengths from one end to the other at which a bound is low enough.

    A bound falls about as a power of the length: the length at which that is low enough is tried,
    and then the one before it.
    """
    lengths = np.array(ends)
    for _ in range(5):
        halved = np.empty(2 * len(lengths) - 1)
        halved[::2], halved[1::2] = lengths, np.sqrt(lengths[:-1] * lengths[1:])
        lengths = halved
    first, last = 0, len(lengths) - 1
    above, below = bounds
    while last - first > 1:
        share = np.log(above / known) / np.log(above / max(below, 1e-300))
        middle = int(np.clip(first + np.ceil(share * (last - first)), first + 1, last - 1))
        found = bound(float(lengths[middle]))
        if found > known:
            first, above = middle, found
        else:
            last, below = middle, found
    return float(lengths[last])
