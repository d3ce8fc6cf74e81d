r"""The maximum of a Whittle likelihood that is linear in variances, none of them negative.

A search fits the same few columns thousands of times, so this must cost a fraction of a
millisecond and must not hold the interpreter: axes are searched side by side. Each Fisher step is
the weighted least-squares problem

.. math:: \min_{\theta \ge 0} \; \sum_b \frac{\nu_b}{2 \lambda_b^2}
          \left(p_b - r_b - \sum_j \theta_j a_{jb}\right)^2, \qquad
          \lambda_b = r_b + \sum_j \theta_j a_{jb}

with :math:`\lambda` of the step before. It is reduced to a triangle by orthogonalisation (normal
equations would square the condition of flicker beside a random walk), and the triangle is solved
by the active sets of Lawson and Hanson (*Solving Least Squares Problems*, 1974, chapter 23).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.compiled import njit

__all__ = ["maximise"]

Array = NDArray[np.float64]

_SCORING_STEPS = 40
_GAIN = 1e-6
"""Nats below which a step is the last one."""
_SHORTEST = 1e-3
_DEPENDENT = 1e-13
"""Part of a column that the ones before it leave over, below which it adds nothing to them."""


def maximise(
    columns: Array, power: Array, count: Array, fixed: Array, start: Array | None = None
) -> tuple[Array, float, Array]:
    """Return the variances at the maximum, the log-likelihood there, and the power of every bin.

    Parameters
    ----------
    columns : ndarray, shape (p, bins)
        Power in every bin for a unit variance of each term.
    power, count : ndarray, shape (bins,)
        Mean square of the ordinates in a bin, and how many they are.
    fixed : ndarray, shape (bins,)
        Power in every bin that is known beforehand.
    start : ndarray, shape (p,), optional
        Where to begin; by default where the squares are least, relative to the power.

    Examples
    --------
    >>> columns = np.array([[1.0, 1.0, 1.0], [4.0, 1.0, 0.25]])
    >>> count = np.array([10.0, 100.0, 1000.0])
    >>> theta, *_ = maximise(columns, 2.0 * columns[0] + 3.0 * columns[1], count, np.zeros(3))
    >>> theta.round(6).tolist()
    [2.0, 3.0]
    """
    middle = len(power) // 2
    smallest = 1e-9 * float(np.partition(power, middle)[middle]) + 1e-300
    known = start is not None and len(start) == len(columns)
    theta, loglik, expected = _maximise(
        np.ascontiguousarray(columns),
        np.ascontiguousarray(power),
        np.ascontiguousarray(count),
        np.ascontiguousarray(fixed),
        smallest,
        np.array(start) if known else np.full(len(columns), -1.0),
        known,
    )
    return theta, float(loglik), expected


@njit(cache=True, nogil=True)
def _maximise(
    columns: Array,
    power: Array,
    count: Array,
    fixed: Array,
    smallest: float,
    theta: Array,
    known: bool,
) -> tuple[Array, float, Array]:
    variance, tried = np.empty(power.size), np.empty(power.size)
    target = power - fixed
    if not known:
        theta = _least_squares(columns, target, count, np.maximum(power, 1e-300))
    value = _loglik(columns, power, count, fixed, smallest, theta, variance)
    for _ in range(_SCORING_STEPS):
        step = _least_squares(columns, target, count, variance) - theta
        size = 1.0
        trial = theta + step
        gained = _loglik(columns, power, count, fixed, smallest, trial, tried)
        while gained < value and size > _SHORTEST:
            size /= 2
            trial = theta + size * step
            gained = _loglik(columns, power, count, fixed, smallest, trial, tried)
        if gained <= value + _GAIN:
            break
        theta, value = trial, gained
        variance, tried = tried, variance
    return theta, value, variance


@njit(cache=True, nogil=True)
def _loglik(
    columns: Array,
    power: Array,
    count: Array,
    fixed: Array,
    smallest: float,
    theta: Array,
    variance: Array,
) -> float:
    """Fill in the variances and return the log-likelihood."""
    variance[:] = fixed
    for j in range(theta.size):
        if theta[j] != 0.0:
            for b in range(power.size):
                variance[b] += theta[j] * columns[j, b]
    total = 0.0
    for b in range(power.size):
        variance[b] = max(variance[b], smallest)
        total += count[b] * (np.log(variance[b]) + power[b] / variance[b])
    return -0.5 * total


@njit(cache=True, nogil=True)
def _least_squares(columns: Array, target: Array, count: Array, variance: Array) -> Array:
    """Return the non-negative variances nearest to the target, weighted by its own variance."""
    weight = np.sqrt(count / 2) / variance
    scaled, size = np.empty_like(columns), np.ones(len(columns))
    for j in range(len(columns)):
        for b in range(weight.size):
            scaled[j, b] = columns[j, b] * weight[b]
        length = np.sqrt(np.dot(scaled[j], scaled[j]))
        if length > 0.0:
            size[j] = length
            for b in range(weight.size):
                scaled[j, b] /= length
    triangle, right = _triangle(scaled, target * weight)
    solution: Array = _nonnegative(triangle, right) / size
    return solution


@njit(cache=True, nogil=True)
def _triangle(columns: Array, target: Array) -> tuple[Array, Array]:
    """Orthogonalise columns one after the other (modified Gram-Schmidt), and the target by them.

    Taken as one more column, the target makes least squares as stable as Householder's reflections
    do (Bjorck 1967). Both arguments are overwritten.
    """
    p = columns.shape[0]
    triangle, right = np.zeros((p, p)), np.zeros(p)
    for j in range(p):
        before = 0.0
        for i in range(j):
            before += triangle[i, j] ** 2
        rest = np.dot(columns[j], columns[j])
        if rest <= _DEPENDENT**2 * (before + rest):
            continue
        triangle[j, j] = np.sqrt(rest)
        unit = columns[j] / triangle[j, j]
        for k in range(j + 1, p):
            triangle[j, k] = np.dot(unit, columns[k])
            for b in range(target.size):
                columns[k, b] -= triangle[j, k] * unit[b]
        right[j] = np.dot(unit, target)
        for b in range(target.size):
            target[b] -= right[j] * unit[b]
    return triangle, right


@njit(cache=True, nogil=True)
def _nonnegative(triangle: Array, right: Array) -> Array:
    """Solve a triangular least-squares problem with no unknown below zero."""
    p = right.size
    solution, passive = np.zeros(p), np.zeros(p, np.bool_)
    slope = triangle.T @ right
    for _ in range(3 * p):
        entering, steepest = -1, 1e-13 * np.sqrt(np.dot(right, right))
        for j in range(p):
            if not passive[j] and slope[j] > steepest:
                entering, steepest = j, slope[j]
        if entering < 0:
            break
        passive[entering] = True
        wanted = _among(triangle, right, passive)
        if wanted[entering] <= 0.0:  # its slope was rounding
            passive[entering], slope[entering] = False, 0.0
            continue
        while True:
            blocking, share = -1, 1.0
            for j in range(p):
                if passive[j] and wanted[j] < 0.0:
                    reach = solution[j] / (solution[j] - wanted[j])
                    if reach < share:
                        blocking, share = j, reach
            if blocking < 0:
                break
            for j in range(p):
                if passive[j]:
                    solution[j] += share * (wanted[j] - solution[j])
            passive[blocking], solution[blocking] = False, 0.0
            wanted = _among(triangle, right, passive)
        solution = wanted
        slope = triangle.T @ (right - triangle @ solution)
    return solution


@njit(cache=True, nogil=True)
def _among(triangle: Array, right: Array, passive: NDArray[np.bool_]) -> Array:
    """Solve for some of the unknowns, all others zero."""
    p = right.size
    chosen = np.flatnonzero(passive)
    reduced, along = _triangle(triangle.T[chosen].copy(), right.copy())
    solution = np.zeros(p)
    for j in range(chosen.size - 1, -1, -1):
        if reduced[j, j] == 0.0:
            continue
        rest = along[j]
        for k in range(j + 1, chosen.size):
            rest -= reduced[j, k] * solution[chosen[k]]
        solution[chosen[j]] = rest / reduced[j, j]
    return solution
