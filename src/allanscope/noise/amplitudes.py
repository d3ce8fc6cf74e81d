r"""The maximum of a Whittle likelihood that is linear in variances, none of them negative.

A search fits the same few columns thousands of times, so this must cost a fraction of a
millisecond and must not hold the interpreter: axes are searched side by side. It is compiled
(`compiled/amplitudes.c`). Each Fisher step is the weighted least-squares problem

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

from allanscope.compiled import Pointer, kernel

__all__ = ["least_power", "maximise"]

Array = NDArray[np.float64]

_IN, _MATRIX = Pointer(np.float64, 1), Pointer(np.float64, 2)
_OUT = Pointer(np.float64, 1, written=True)
_maximise = kernel(
    "maximise", _MATRIX, _IN, _IN, _IN, int, int, float, int, _OUT, _OUT, _OUT, returns=float
)


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
    smallest = least_power(power)
    p, bins = columns.shape
    known = start is not None and len(start) == p
    theta = np.array(start, np.float64) if known else np.empty(p)
    if np.shape(fixed) != (bins,):
        fixed = np.broadcast_to(fixed, bins)
    expected = np.empty(bins)
    loglik = _maximise(
        np.ascontiguousarray(columns, np.float64),
        np.ascontiguousarray(power, np.float64),
        np.ascontiguousarray(count, np.float64),
        np.ascontiguousarray(fixed, np.float64),
        *(p, bins, smallest, known, theta, expected),
        np.empty(bins * (p + 4) + 3 * p * (p + 6)),
    )
    return theta, float(loglik), expected


def least_power(power: Array) -> float:
    """Return what no bin is expected to hold less of, so that every likelihood is finite."""
    middle = len(power) // 2
    return 1e-9 * float(np.partition(power, middle)[middle]) + 1e-300
