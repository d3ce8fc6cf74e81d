"""What values say of themselves: at rest an accelerometer shows gravity, whatever the unit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import ACCEL_SCALES

__all__ = ["accel_comes_first", "unit_by_gravity"]

_GRAVITY = {"m/s2": 9.80665, "g": 1.0, "mg": 1000.0}
"""Size of gravity in the units that accelerations come in. Whole numbers of size 1 are counts,
and so are those of size 1000 of a single axis."""
_OFF = 0.05
"""Scale and offset errors of these parts at rest: 40 mg of zero-g level, and a tilted part adds."""
_STEADY = 0.02
"""Relative scatter of the norm from row to row below which it may be gravity."""


def unit_by_gravity(values: NDArray[Any], *, counts: bool = False) -> str:
    """Return the unit in which the rows of an accelerometer have the size of gravity, '' for none.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        Some rows of its one, two or three axes.
    counts : bool
        Whether whole numbers of a size that a full scale of these parts would have count as well.

    Examples
    --------
    >>> unit_by_gravity(np.array([[0.1, -0.2, 9.79], [0.1, -0.2, 9.80]]))
    'm/s2'
    >>> unit_by_gravity(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.01]]))
    ''
    """
    rows = np.asarray(values, np.float64)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) == 0:
        return ""
    with np.errstate(over="ignore"):  # a damaged number may be of any size
        norm = np.sqrt((rows**2).sum(axis=1))
    size = float(np.median(norm))
    if not np.isfinite(size) or size <= 0.0:
        return ""
    if float(np.median(np.abs(norm - size))) > _STEADY * size:
        return ""
    whole, complete = bool((rows == np.trunc(rows)).all()), rows.shape[1] == 3
    for unit, gravity in _GRAVITY.items():
        if abs(size / gravity - 1.0) < _OFF and (not whole or (unit == "mg" and complete)):
            return unit
    if counts and whole and any(abs(size * s - 1.0) < _OFF for s in ACCEL_SCALES.values()):
        return "lsb"
    return ""


def accel_comes_first(values: NDArray[Any]) -> bool:
    """Return whether columns without names are rather an accelerometer than a gyroscope in front.

    Parameters
    ----------
    values : ndarray, shape (n, 6)
        Some rows; NaN in the last three columns where there are only three.

    Examples
    --------
    >>> accel_comes_first(np.array([[0.01, 0.02, 9.81, 0.1, 0.2, 0.3]] * 5))
    True
    >>> accel_comes_first(np.array([[0.1, 0.2, 0.3, 0.01, 0.02, 1.0]] * 5))
    False
    """
    front, behind = values[:, :3], values[:, 3:6]
    if not unit_by_gravity(front, counts=True):
        return False
    return not unit_by_gravity(behind, counts=True)
