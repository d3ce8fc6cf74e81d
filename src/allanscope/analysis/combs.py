"""Combs: lines at whole multiples of a low frequency at which nothing is seen.

A logger that empties its buffer every ten seconds, or a receiver that computes once a second, makes
pulses at equal distances: lines at multiples of a fundamental, of which the lowest are beneath the
noise or not there, as pulses that are bursts have power where the bursts have. Each of them looks
like a line of its own.

Any line is a multiple of many low frequencies. A comb is accepted only where the number of combs
with as many lines to be expected by chance, among all fundamentals that were tried, is small.
"""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
from numpy.typing import NDArray

__all__ = ["fundamental_of"]

Array = NDArray[np.float64]

_HIGHEST = 100
"""Highest multiple that the line has from which a fundamental is taken."""
_FEWEST = 4
"""Fewest lines of a comb."""
_CHANCE = 0.01
"""Expected number of combs by chance."""
_EXACT = 1e-6
"""Least relative error of a frequency."""
_VAGUE = 0.25
"""Part of the distance between multiples from which a line is near one of them in any case."""


def fundamental_of(frequencies: Array, errors: Array) -> tuple[float, tuple[int, ...]] | None:
    """Return the fundamental of a comb in Hz, and which of the lines are its; None without one.

    Parameters
    ----------
    frequencies : ndarray, shape (m,)
        Of lines in Hz, each once and none a harmonic of another.
    errors : ndarray, shape (m,)
        How far in Hz each may be off: where it is a multiple, it is as near to it.

    Examples
    --------
    >>> lines = np.array([1.4, 1.8, 2.9, 3.3, 4.77])
    >>> fundamental_of(lines, np.full(5, 1e-4))
    (0.1, (0, 1, 2, 3))
    >>> fundamental_of(lines, np.full(5, 1e-3)) is None
    True
    """
    if len(frequencies) < _FEWEST:
        return None
    errors = np.maximum(errors, _EXACT * frequencies)
    tried = len(frequencies) * _HIGHEST
    best: tuple[float, Array, NDArray[np.bool_]] | None = None
    for line, multiple in product(range(len(frequencies)), range(1, _HIGHEST + 1)):
        fundamental = frequencies[line] / multiple
        orders = np.maximum(np.round(frequencies / fundamental), 1.0)
        room = orders * (errors[line] / multiple) + errors
        chance = 2 * room / fundamental
        is_telling = chance < _VAGUE
        is_of_it = is_telling & (np.abs(frequencies - orders * fundamental) <= room)
        if not is_of_it[line] or np.count_nonzero(is_of_it) < _FEWEST:
            continue
        # The line that has given the fundamental is a multiple of it in any case.
        others = is_of_it & (np.arange(len(frequencies)) != line)
        ways = comb(np.count_nonzero(is_telling) - 1, np.count_nonzero(others))
        expected = tried * ways * float(np.prod(chance[others]))
        if expected < _CHANCE and (best is None or expected < best[0]):
            best = expected, orders, is_of_it
    if best is None:
        return None
    _, orders, is_of_it = best
    weight = np.where(is_of_it, orders / errors**2, 0.0)
    fitted = float(weight @ frequencies / (weight @ orders))
    return fitted, tuple(np.flatnonzero(is_of_it).tolist())
