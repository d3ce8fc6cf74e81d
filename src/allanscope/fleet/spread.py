"""Spread between units against spread between repeats of one unit.

Coefficients of noise are positive and scatter by factors, so their logarithms are taken. The value
of run j of unit i is

    ln c_ij = mu + u_i + e_ij,

with variances of u (between units) and e (between repeats) from the mean squares of the one-way
layout; unequal numbers of repeats enter by n0 = (N - sum n_i^2 / N) / (k - 1) (Searle, Casella and
McCulloch, Variance Components, 1992, section 3.6). A repeat differs from the one before because the
unit did, or because a finite record does not tell better: what the intervals of the single runs
allow is put beside it. Whether the units differ at all is asked with the ratio of the mean squares,
which has an F distribution with k - 1 and N - k degrees of freedom where they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Spread", "log_sigma", "spread_of"]

Floats = NDArray[np.float64]
Names = NDArray[np.str_]

TWO_SIDED_95 = 1.959964


@dataclass(frozen=True, slots=True)
class Spread:
    """The distribution of one coefficient over a lot.

    Attributes
    ----------
    median, low, high : float
        Median, 5th and 95th percentile of the runs, in the unit of the coefficient.
    between, within : float
        Standard deviation of the logarithm between units and between repeats of one unit; NaN
        where nothing tells: `within` without repeats, `between` with one unit.
    p_alike : float
        Probability that repeats of units that are all alike differ by unit as much as these; NaN
        without repeats.
    sampling : float
        Rms standard error of the logarithm of single runs.
    runs, units : int
        That the term was detected in.
    """

    median: float
    low: float
    high: float
    between: float
    within: float
    p_alike: float
    sampling: float
    runs: int
    units: int


def log_sigma(lower: Floats, upper: Floats) -> Floats:
    """Return the standard error of the logarithm that 95 % intervals stand for; NaN if none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.log(upper / lower) / (2.0 * TWO_SIDED_95)
    return np.where(np.isfinite(sigma), sigma, np.nan)


def spread_of(values: Floats, sigma: Floats, units: Names) -> Spread | None:
    """Return the spread of the values of some runs, shape (n,); None if there are none.

    Examples
    --------
    Two units a factor e apart, whose repeats agree:

    >>> units = np.array(["a", "a", "b", "b"])
    >>> one = spread_of(np.exp([0.0, 0.0, 1.0, 1.0]), np.full(4, 0.01), units)
    >>> round(one.between, 3), one.within, one.units
    (0.707, 0.0, 2)
    """
    if len(values) == 0:
        return None
    logs = np.log(values)
    low, median, high = np.percentile(values, [5.0, 50.0, 95.0])
    between, within, p_alike = _components(logs, units)
    known = sigma[np.isfinite(sigma)]
    sampling = float(np.sqrt(np.mean(known**2))) if len(known) else np.nan
    if np.isnan(within) and np.isfinite(between):
        # Without repeats the scatter of single runs is part of what units seem to differ by.
        between = float(np.sqrt(max(between**2 - np.nan_to_num(sampling) ** 2, 0.0)))
    return Spread(
        median=float(median),
        low=float(low),
        high=float(high),
        between=between,
        within=within,
        p_alike=p_alike,
        sampling=sampling,
        runs=len(values),
        units=len(np.unique(units)),
    )


def _components(logs: Floats, units: Names) -> tuple[float, float, float]:
    """Return the standard deviations between and within units, and how likely they are alike."""
    from scipy.stats import f

    _, of, repeats = np.unique(units, return_inverse=True, return_counts=True)
    means = np.bincount(of, logs) / repeats
    n, k = len(logs), len(repeats)
    within = float(np.sum((logs - means[of]) ** 2)) / (n - k) if n > k else np.nan
    if k < 2:
        return np.nan, float(np.sqrt(within)), np.nan
    mean_square = float(repeats @ (means - logs.mean()) ** 2) / (k - 1)
    each = (n - float(repeats @ repeats) / n) / (k - 1)
    between = (mean_square - np.nan_to_num(within)) / each
    p_alike = float(f.sf(mean_square / within, k - 1, n - k)) if within > 0.0 else np.nan
    return float(np.sqrt(max(between, 0.0))), float(np.sqrt(within)), p_alike
