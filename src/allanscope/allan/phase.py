"""What samples are taken, and the phase of them, on which every estimator works.

No digit is lost on the way.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "LARGEST",
    "DataKind",
    "checked_samples",
    "positive_rate",
    "to_phase",
    "to_phases",
]

DataKind = Literal["rate", "phase"]

LARGEST = 1e100
"""No float beyond is taken for a measurement: the squares of its sums would overflow."""

_LARGEST_INTEGER = 2**53
"""No integer beyond is taken: a double would not hold it."""

_ROOM = 2**62
"""Sums of integers below this fit in int64, with one bit to spare."""


def to_phase(data: ArrayLike, rate: float, data_kind: DataKind = "rate") -> NDArray[np.float64]:
    """Return the phase of a record, in units of data times samples, beginning with 0.

    Parameters
    ----------
    data : array_like of int or float, shape (n,) or, for phase, (n + 1,)
        Rates; or their integral over time in (unit of the rate) x s.
    rate : float
        Sample rate in Hz.
    data_kind : {'rate', 'phase'}
        What the data are.

    Returns
    -------
    ndarray of float64, shape (n + 1,)
        Less an offset of the rate that no estimator can see: for integers the rounded mean, taken
        off and summed in integers, so that nothing is rounded below 2^53; for floats the mean.
        Float phases keep theirs: taking it off would round them anew.

    Raises
    ------
    ValueError
        For a rate that is not positive, another kind, another shape, a sample that is no finite
        real number or beyond 1e100, or fewer than two rates (three phases).

    Examples
    --------
    >>> to_phase([7, 9, 8], rate=1.0)
    array([ 0., -1.,  0.,  0.])
    >>> to_phase([0.0, 0.5, 2.5], rate=2.0, data_kind="phase")
    array([0., 1., 5.])
    >>> to_phase([0, 10**15, 3 * 10**15], rate=1.0, data_kind="phase")
    array([ 0.e+00, -5.e+14,  0.e+00])
    """
    rate = positive_rate(rate)
    if data_kind not in ("rate", "phase"):
        raise ValueError(f"unknown data_kind {data_kind!r}; choose rate or phase")
    if np.ma.is_masked(data):
        raise ValueError("data has masked samples; cut the record at them")
    try:
        values = np.asarray(data)
    except (TypeError, ValueError) as error:
        raise ValueError(f"data is no array of numbers: {error}") from None
    if values.ndim != 1:
        raise ValueError(f"data must have one dimension, got shape {values.shape}")
    if values.dtype.kind not in "iuf":
        raise ValueError(f"data must be integers or floats, got {values.dtype}")
    fewest = 2 if data_kind == "rate" else 3
    if values.size < fewest:
        raise ValueError(f"need at least {fewest} samples of {data_kind}, got {values.size}")
    if values.dtype.kind == "f":
        return _from_floats(values.astype(np.float64), rate, data_kind)
    return _from_integers(values, rate, data_kind)


def to_phases(
    data: ArrayLike, rate: float, data_kind: DataKind = "rate"
) -> list[NDArray[np.float64]]:
    """Return the phase of each stretch of a record between its NaNs, which are gaps.

    Parameters and errors as in `to_phase`. All stretches of rates have the same offset taken off.

    Examples
    --------
    >>> to_phases([1.0, 3.0, np.nan, np.nan, 2.0, 6.0, np.nan], rate=1.0)
    [array([ 0., -2., -2.]), array([ 0., -1.,  2.])]
    """
    try:
        values = np.asarray(data)
    except (TypeError, ValueError):
        values = np.empty(0)
    missing = np.zeros(values.size, np.bool_)
    if values.dtype.kind == "f" and values.ndim == 1:
        missing = np.isnan(values)
    if np.ma.is_masked(data) or not missing.any():
        return [to_phase(data, rate, data_kind)]
    known = values[~missing].astype(np.float64)
    to_phase(known, rate, data_kind)  # what is wrong with the rest is said by the same words
    offset = known.mean() if data_kind == "rate" else 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[True], missing, [True]])))
    fewest = 1 if data_kind == "rate" else 2
    phases = []
    for start, stop in edges.reshape(-1, 2).tolist():
        if stop - start < fewest:
            continue
        piece = values[start:stop].astype(np.float64)
        whole = np.cumsum(piece - offset) if data_kind == "rate" else rate * (piece - piece[0])[1:]
        phases.append(np.append(0.0, whole))
    if not phases:
        raise ValueError("no two neighbouring samples of phase are without a gap between them")
    return phases


def positive_rate(rate: float) -> float:
    """Return a sample rate in Hz; ValueError for what is no positive, finite number."""
    number = isinstance(rate, Real) or (isinstance(rate, np.ndarray) and rate.ndim == 0)
    if not (number and math.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be positive and finite, got {rate!r} Hz")
    return float(rate)


def checked_samples(samples: ArrayLike, axes: int, taken: int) -> NDArray[Any]:
    """Return samples of shape (n, axes), all finite and of a type that doubles hold exactly.

    Parameters
    ----------
    samples : array_like, shape (n, axes), or (n,) for one axis
    axes, taken : int
        Columns there should be, and samples that came before, for what the message says.

    Raises
    ------
    ValueError
        For another shape or type, or a sample that is not finite, beyond 1e100, or an integer
        beyond 2^53.
    """
    if np.ma.is_masked(samples):
        raise ValueError("samples are masked; leave them out and call gap() instead")
    data = np.asarray(samples)
    if data.ndim == 1 and axes == 1:
        data = data[:, np.newaxis]
    if data.ndim != 2 or data.shape[1] != axes:
        raise ValueError(f"samples must have shape (n, {axes}), got {data.shape}")
    if not np.can_cast(data.dtype, np.float64, "safe") or data.dtype.kind not in "iuf":
        raise ValueError(f"samples must be integers or float64, got {data.dtype}")
    whole = data.dtype.kind != "f"
    if whole and data.dtype.itemsize < 8:
        return data
    if whole:
        least = -_LARGEST_INTEGER if data.dtype.kind == "i" else 0
        fit = (data <= _LARGEST_INTEGER) & (data >= least)
    else:
        fit = np.abs(data, dtype=np.float64) < LARGEST
    if not fit.all():
        row, column = np.argwhere(~fit)[0]
        remedy = (
            "beyond 2^53, which float64 does not hold; subtract an offset first"
            if whole
            else "leave it out and call gap() instead"
        )
        where = f"sample {taken + row} of axis {column} is {data[row, column]}"
        raise ValueError(f"{where}{', ' if whole else '; '}{remedy}")
    return data


def _from_floats(values: NDArray[np.float64], rate: float, data_kind: str) -> NDArray[np.float64]:
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        raise ValueError(f"sample {bad[0]} is {values[bad[0]]} (one of {bad.size} not finite)")
    if values.max(initial=0.0) > LARGEST or values.min(initial=0.0) < -LARGEST:
        far = int(np.argmax(np.abs(values)))
        raise ValueError(f"sample {far} is {values[far]}: too large to be squared")
    if data_kind == "phase":
        phase: NDArray[np.float64] = (values - values[0]) * rate
        return phase
    # Less the mean the sum stays small, and a constant leaves a straight line to the last digit.
    return np.append(0.0, np.cumsum(values - values.mean()))


def _from_integers(values: NDArray[np.generic], rate: float, data_kind: str) -> NDArray[np.float64]:
    least = int(values.min())
    span = int(values.max()) - least
    # From the least one up, modulo 2^64: no integer of any type is out of reach.
    from_least = values.astype(np.uint64) - np.uint64(least % 2**64)
    if span * (values.size if data_kind == "rate" else 2) >= _ROOM:
        return _from_floats(from_least.astype(np.float64), rate, data_kind)
    counts = from_least.astype(np.int64)
    if data_kind == "phase":
        mean_rate = (int(counts[-1]) - int(counts[0])) // (counts.size - 1)
        phase: NDArray[np.float64] = rate * (
            counts - counts[0] - mean_rate * np.arange(counts.size)
        )
        return phase
    offset = round(float(counts.mean()))
    return np.append(0, np.cumsum(counts - offset)).astype(np.float64)
