"""Optimisers that a search calls thousands of times.

Those of scipy do the same steps: to load them costs 0.15 s and 16 MB, and each step there takes
longer than many of the functions here. Only what is seldom needed is left to scipy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel

__all__ = ["Minimum", "least_nonnegative", "minimise", "minimise_between", "root_between"]

Array = NDArray[np.float64]


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
    if steps is None:
        steps = np.diag(np.where(first != 0, 0.05 * first, 0.00025))
    begin: list[float] = first.tolist()
    corners = [begin] + [[x + d for x, d in zip(begin, row, strict=True)] for row in steps.tolist()]
    simplex = sorted([(float(loss(np.array(x))), x) for x in corners], key=_loss_of)
    most, turn = turns or 200 * len(first), 1
    while turn < most and not _is_small(simplex, x_within, within):
        _improve(simplex, loss)
        simplex.sort(key=_loss_of)
        turn += 1
    value, x = simplex[0]
    return Minimum(np.array(x), value, turn < most)


_Corner = tuple[float, list[float]]


def _loss_of(corner: _Corner) -> float:
    return corner[0]


def _is_small(simplex: list[_Corner], x_within: float, within: float) -> bool:
    """Return whether all corners are as near to the best one as is asked."""
    (value, best), rest = simplex[0], simplex[1:]
    return all(abs(value - other) <= within for other, _ in rest) and all(
        abs(a - b) <= x_within for _, x in rest for a, b in zip(x, best, strict=True)
    )


def _improve(simplex: list[_Corner], loss: Callable[[Array], float]) -> None:
    """Move the worst corner of a sorted simplex through the others, or shrink it to the best."""
    *others, (highest, worst) = simplex
    size = len(others)
    middle = [sum(x[k] for _, x in others) / size for k in range(size)]

    def at(along: float) -> _Corner:
        """Return the corner that lies so far beyond the middle, in distances of the worst."""
        x = [(1 + along) * m - along * w for m, w in zip(middle, worst, strict=True)]
        return float(loss(np.array(x))), x

    reflected = at(1.0)
    if reflected[0] < simplex[0][0]:
        simplex[-1] = min(reflected, at(2.0), key=_loss_of)
        return
    if reflected[0] < others[-1][0]:
        simplex[-1] = reflected
        return
    if reflected[0] < highest:
        contracted = at(0.5)
        found = contracted[0] <= reflected[0]
    else:
        contracted = at(-0.5)
        found = contracted[0] < highest
    if found:
        simplex[-1] = contracted
        return
    best = simplex[0][1]
    for k, (_, x) in enumerate(simplex[1:], 1):
        nearer = [b + 0.5 * (own - b) for b, own in zip(best, x, strict=True)]
        simplex[k] = float(loss(np.array(nearer))), nearer


def minimise_between(
    loss: Callable[[float], float], low: float, high: float, within: float = 1e-5
) -> tuple[float, float]:
    """Find the minimum of a function of one number between two bounds, and what it is there.

    Golden sections and parabolas (Brent, *Algorithms for Minimization*, 1973, chapter 5). `within`
    is the error of the number that is allowed.

    Examples
    --------
    >>> round(minimise_between(lambda x: (x - 0.3) ** 2, 0.0, 1.0)[0], 6)
    0.3
    """
    best = second = third = low + _GOLDEN * (high - low)
    value = at_second = at_third = float(loss(best))
    step = before = 0.0
    for _ in range(_LOOKS):
        middle, least = 0.5 * (low + high), _RESOLVED * abs(best) + within / 3
        if abs(best - middle) <= 2 * least - 0.5 * (high - low):
            break
        is_parabola = False
        if abs(before) > least:
            # The minimum of the parabola through the three best: best + p / q.
            r = (best - second) * (value - at_third)
            q = (best - third) * (value - at_second)
            p = (best - third) * q - (best - second) * r
            q = 2 * (q - r)
            p, q = (-p if q > 0 else p), abs(q)
            inside = q * (low - best) < p < q * (high - best)
            is_parabola = inside and abs(p) < abs(0.5 * q * before)
            before = step
            if is_parabola:
                step = p / q
                if best + step - low < 2 * least or high - best - step < 2 * least:
                    step = least if middle >= best else -least
        if not is_parabola:
            before = (low if best >= middle else high) - best
            step = _GOLDEN * before
        x = best + max(abs(step), least) * (1.0 if step >= 0 else -1.0)
        there = float(loss(x))
        if there <= value:
            low, high = (best, high) if x >= best else (low, best)
            third, at_third, second, at_second = second, at_second, best, value
            best, value = x, there
        else:
            low, high = (x, high) if x < best else (low, x)
            if there <= at_second or second == best:
                third, at_third, second, at_second = second, at_second, x, there
            elif there <= at_third or third in (best, second):
                third, at_third = x, there
    return best, value


_GOLDEN = 0.5 * (3 - 5**0.5)
_RESOLVED = 2.2e-16**0.5
"""Of a number, below which a parabola is flat in double precision."""
_LOOKS = 499
"""Most evaluations after the first."""


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Find where a function is zero whose signs differ at two bounds.

    Examples
    --------
    >>> round(root_between(lambda x: x * x - 2.0, 0.0, 2.0), 12)
    1.414213562373
    """
    from scipy.optimize import brentq

    return float(brentq(function, low, high))


def least_nonnegative(design: Array, wanted: Array) -> Array:
    """Return the numbers, none of them negative, with the least sum of squared differences.

    `design` has shape (n, p), `wanted` (n,). By the active sets of Lawson and Hanson, as in
    `noise.amplitudes`.

    Examples
    --------
    >>> design = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    >>> least_nonnegative(design, np.array([2.0, 1.0, -1.0])).round(12)
    array([1.5, 0. ])
    """
    p = design.shape[1]
    sizes = np.linalg.norm(design, axis=0)
    sizes[sizes == 0.0] = 1.0
    columns, target = np.ascontiguousarray((design / sizes).T), np.array(wanted, np.float64)
    triangle, right, found = np.empty((p, p)), np.empty(p), np.empty(p)
    _triangulate(columns, target, p, len(target), triangle, right)
    _nonnegative(triangle, right, p, np.empty(2 * p * (p + 5)), found)
    return np.asarray(found / sizes)


_VECTOR, _MATRIX = Pointer(np.float64, 1), Pointer(np.float64, 2)
_VECTOR_OUT, _MATRIX_OUT = (Pointer(np.float64, d, written=True) for d in (1, 2))
_triangulate = kernel("triangulate", _MATRIX_OUT, _VECTOR_OUT, int, int, _MATRIX_OUT, _VECTOR_OUT)
_nonnegative = kernel("nonnegative", _MATRIX, _VECTOR, int, _VECTOR_OUT, _VECTOR_OUT)
