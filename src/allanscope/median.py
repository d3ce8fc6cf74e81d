"""The median of a row of numbers, as `numpy.median` has it, in a fraction of the time.

That one looks for numbers that are none, along any axis: it partitions for three places, and takes
25 us for a few numbers. A search asks for the medians of some thousand blocks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["median", "medians"]


def median(values: NDArray[Any]) -> float:
    """Return the median of an array of shape (n,), n > 0, in which no number is NaN.

    Examples
    --------
    >>> median(np.array([3.0, 1.0, 2.0])), median(np.array([4, 1, 3, 2]))
    (2.0, 2.5)
    """
    half = len(values) // 2
    parted = np.partition(values, half)
    if len(values) % 2:
        return float(parted[half])
    return float((parted[:half].max() + parted[half]) / 2)


def medians(rows: NDArray[Any]) -> NDArray[np.float64]:
    """Return the median of each row of an array of shape (k, n), in none of which is NaN.

    Examples
    --------
    >>> medians(np.array([[3.0, 1.0, 2.0, 9.0], [4.0, 4.0, 4.0, 5.0]])).tolist()
    [2.5, 4.0]
    """
    half = rows.shape[1] // 2
    parted = np.partition(rows, half, axis=1)
    if rows.shape[1] % 2:
        return np.asarray(parted[:, half], np.float64)
    return np.asarray((parted[:, :half].max(axis=1) + parted[:, half]) / 2)
