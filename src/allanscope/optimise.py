"""Where a function is least, where it is zero, and least squares without negative numbers.

The algorithms are those of `scipy.optimize`, step for step, for the few problems that a search
solves thousands of: of one to seven numbers. That package loads linear programming, sparse matrices
and what these need: as long as ten of these problems take, and 20 MB of memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

__all__ = ["Minimum", "least_nonnegative", "minimise", "minimise_between", "root_between"]

Array = NDArray[np.float64]

_GOLDEN = float(0.5 * (3.0 - np.sqrt(5.0)))
_RELATIVE = float(np.sqrt(2.2e-16))
_PERTURBED, _FROM_ZERO = 1.05, 0.00025


@dataclass(frozen=True, slots=True)
class Minimum:
    """Where a function is least, what it is there, and whether the search came to its end."""

    x: Array
    value: float
    converged: bool


def minimise(
    loss: Callable[[Array], float],
    first: Array,
    steps: Array | None = None,
    *,
    x_within: float = 1e-4,
    within: float = 1e-4,
    turns: int | None = None,
) -> Minimum:
    """Find a minimum without derivatives (Nelder and Mead, Computer Journal 7, 1965).

    Parameters
    ----------
    loss : callable
        Of an array, shape (k,).
    first : ndarray, shape (k,)
        Where to begin.
    steps : ndarray, shape (k, k), optional
        From there to the other corners of the first simplex; a twentieth of each number by default.
    x_within, within : float
        Distance of the corners, and difference of the losses there, at which it ends.
    turns : int, optional
        Most of them; 200 k by default.

    Examples
    --------
    >>> found = minimise(lambda p: (p[0] - 1) ** 2 + (p[1] + 2) ** 2, np.zeros(2), np.eye(2))
    >>> found.x.round(3).tolist(), found.converged
    ([1.0, -2.0], True)
    """
    first = np.asarray(first, np.float64)
    size = len(first)
    if steps is None:
        steps = np.diag(np.where(first != 0, (_PERTURBED - 1.0) * first, _FROM_ZERO))
    corners = [first, *(first + step for step in steps)]
    values = [loss(corner) for corner in corners]
    for turn in count(1):
        order = sorted(range(size + 1), key=values.__getitem__)
        corners, values = [corners[i] for i in order], [values[i] for i in order]
        best, worst = corners[0], corners[-1]
        spread = max(abs(values[0] - values[1]), abs(values[-1] - values[0]))
        if spread <= within and np.abs(np.array(corners[1:]) - best).max() <= x_within:
            return Minimum(best, values[0], True)
        if turn >= (turns or 200 * size):
            break
        middle = np.add.reduce(corners[:-1], 0) / size

        def at(share: float, middle: Array = middle, worst: Array = worst) -> tuple[Array, float]:
            point = (1 + share) * middle - share * worst
            return point, loss(point)

        point, value = at(1.0)
        if value < values[0]:
            farther = at(2.0)
            point, value = farther if farther[1] < value else (point, value)
        elif not value < values[-2]:
            outside = value < values[-1]
            limit = value if outside else values[-1]
            nearer = at(0.5 if outside else -0.5)
            if not (nearer[1] <= limit if outside else nearer[1] < limit):
                corners = [best, *(best + 0.5 * (corner - best) for corner in corners[1:])]
                values = [values[0], *map(loss, corners[1:])]
                continue
            point, value = nearer
        corners[-1], values[-1] = point, value
    return Minimum(corners[0], values[0], False)


def minimise_between(
    loss: Callable[[float], float], low: float, high: float, within: float = 1e-5
) -> tuple[float, float]:
    """Find the minimum of a function of one number between two bounds, and what it is there.

    Parameters
    ----------
    within : float
        Error of the number that is allowed.

    Notes
    -----
    Brent's parabolas and golden sections (*Algorithms for Minimization Without Derivatives*, 1973,
    chapter 5).

    Examples
    --------
    >>> minimise_between(lambda x: (x - 0.3) ** 2, 0.0, 1.0)[0]
    0.3
    """
    x = second = third = low + _GOLDEN * (high - low)
    value = at_second = at_third = loss(x)
    step = before = 0.0
    while True:
        middle = 0.5 * (low + high)
        near = _RELATIVE * abs(x) + within / 3.0
        if abs(x - middle) <= 2.0 * near - 0.5 * (high - low):
            return x, value
        golden = True
        if abs(before) > near:
            r = (x - second) * (value - at_third)
            q = (x - third) * (value - at_second)
            p = (x - third) * q - (x - second) * r
            q = 2.0 * (q - r)
            p, q = (-p, q) if q > 0.0 else (p, -q)
            former, before = before, step
            if abs(p) < abs(0.5 * q * former) and q * (low - x) < p < q * (high - x):
                golden, step = False, p / q
                if min(x + step - low, high - (x + step)) < 2.0 * near:
                    step = near if middle >= x else -near
        if golden:
            before = low - x if x >= middle else high - x
            step = _GOLDEN * before
        moved = max(abs(step), near)
        tried = x + (moved if step >= 0 else -moved)
        other = loss(tried)
        if other <= value:
            low, high = (x, high) if tried >= x else (low, x)
            third, at_third, second, at_second = second, at_second, x, value
            x, value = tried, other
        else:
            low, high = (tried, high) if tried < x else (low, tried)
            if other <= at_second or second == x:
                third, at_third, second, at_second = second, at_second, tried, other
            elif other <= at_third or third in (x, second):
                third, at_third = tried, other


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Find where a function is zero whose signs differ at two bounds.

    Halves the range until the bounds are neighbours among numbers, by the secant where that is
    quicker (Anderson and Bjorck, BIT 13, 1973).

    Examples
    --------
    >>> round(root_between(lambda x: x * x - 2.0, 0.0, 2.0), 12)
    1.414213562373
    """
    at_low, at_high = function(low), function(high)
    if at_low == 0.0 or at_high == 0.0:
        return low if at_low == 0.0 else high
    if (at_low > 0.0) == (at_high > 0.0):
        raise ValueError("the function has the same sign at both bounds")
    for turn in count():
        near = 4.0 * float(np.spacing(max(abs(low), abs(high)))) + 1e-300
        if abs(high - low) <= near:
            break
        middle = 0.5 * (low + high)
        x = high - at_high * (high - low) / (at_high - at_low)
        if turn % 3 == 2 or not min(low, high) < x < max(low, high):
            x = middle
        value = function(x)
        if value == 0.0:
            return x
        if (value > 0.0) == (at_high > 0.0):
            left = 1.0 - value / at_high
            at_low *= left if left > 0.0 else 0.5
        else:
            low, at_low = high, at_high
        high, at_high = x, value
    return high


def least_nonnegative(design: Array, wanted: Array) -> Array:
    """Return the numbers, none of them negative, with the least sum of squared differences.

    Parameters
    ----------
    design : ndarray, shape (n, p)
    wanted : ndarray, shape (n,)

    Raises
    ------
    RuntimeError
        When the columns are so nearly dependent that it goes round.

    Notes
    -----
    The active sets of Lawson and Hanson (*Solving Least Squares Problems*, 1974, chapter 23).

    Examples
    --------
    >>> design = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    >>> least_nonnegative(design, np.array([2.0, 1.0, -1.0]))
    array([1.5, 0. ])
    """
    number = design.shape[1]
    x, free = np.zeros(number), np.zeros(number, bool)
    for _ in range(3 * number + 1):
        slope = design.T @ (wanted - design @ x)
        slope[free] = -np.inf
        best = int(np.argmax(slope))
        if slope[best] <= 0.0:
            return x
        free[best] = True
        while True:
            trial = np.zeros(number)
            trial[free] = np.linalg.lstsq(design[:, free], wanted, rcond=None)[0]
            if trial[best] <= 0.0 and x[best] == 0.0:
                # What the slope promised is rounding.
                free[best] = False
                return x
            falls = free & (trial <= 0.0)
            if not falls.any():
                break
            x = x + float(np.min(x[falls] / (x[falls] - trial[falls]))) * (trial - x)
            free &= x > 1e-15 * x.max()
            x[~free] = 0.0
        x = trial
    raise RuntimeError("the columns are nearly dependent")
