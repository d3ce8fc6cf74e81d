"""Repeats of one unit: by how much they differ, and whether units differ by more.

Coefficients of noise are positive and scatter by factors, so their logarithms are taken. A repeat
differs from the one before because the unit did, or because a finite record does not tell better:
what the intervals of the single runs allow is put beside it. Whether units differ at all is asked
with the ratio of the mean squares of the one-way layout, runs weighted by what is known of each; it
has an F distribution with k - 1 and n - k degrees of freedom where they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.unit_estimates import TWO_SIDED_95, excess_of_repeats

__all__ = ["Spread", "log_sigma", "spread_of"]

Floats = NDArray[np.float64]
Names = NDArray[np.str_]


@dataclass(frozen=True, slots=True)
class Spread:
    """How the runs of a lot scatter that show one coefficient.

    Attributes
    ----------
    within : float
        Standard deviation of the logarithm between repeats of one unit; NaN without repeats.
    p_alike : float
        Probability that repeats of units that are all alike differ by unit as much as these; NaN
        without repeats.
    sampling : float
        Rms standard error of the logarithm of single runs.
    """

    within: float
    p_alike: float
    sampling: float


def log_sigma(lower: Floats, upper: Floats) -> Floats:
    """Return the standard error of the logarithm that 95 % intervals stand for; NaN if none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        sigma = np.log(upper / lower) / (2.0 * TWO_SIDED_95)
    return np.where(np.isfinite(sigma), sigma, np.nan)


def spread_of(values: Floats, sigma: Floats, units: Names) -> Spread | None:
    """Return the spread of the values of some runs, shape (n,); None if there are none.

    Examples
    --------
    Two units a factor e apart, whose repeats agree to a part in a thousand:

    >>> units = np.array(["a", "a", "b", "b"])
    >>> one = spread_of(np.exp([0.0, 0.001, 1.0, 1.001]), np.full(4, 0.01), units)
    >>> round(one.within, 5), one.p_alike < 1e-5
    (0.00071, True)
    """
    if len(values) == 0:
        return None
    logs = np.log(values)
    known = sigma[np.isfinite(sigma)]
    sampling = float(np.sqrt(np.mean(known**2))) if len(known) else np.nan
    _, of, repeats = np.unique(units, return_inverse=True, return_counts=True)
    means = np.bincount(of, logs) / repeats
    freedom = len(logs) - len(repeats)
    within = float(np.sqrt(np.sum((logs - means[of]) ** 2) / freedom)) if freedom else np.nan
    return Spread(within, _p_alike(logs, np.nan_to_num(sigma), units), sampling)


def _p_alike(logs: Floats, errors: Floats, units: Names) -> float:
    from scipy.stats import f

    _, of = np.unique(units, return_inverse=True)
    k, n = int(of.max()) + 1, len(logs)
    variance = errors**2 + excess_of_repeats(logs, errors, units) ** 2
    if k < 2 or n == k or not (variance > 0.0).all():
        return np.nan
    weight = 1.0 / variance
    total = np.bincount(of, weight)
    means = np.bincount(of, weight * logs) / total
    within = float(weight @ (logs - means[of]) ** 2) / (n - k)
    centre = float(total @ means) / float(total.sum())
    between = float(total @ (means - centre) ** 2) / (k - 1)
    return float(f.sf(between / within, k - 1, n - k)) if within > 0.0 else np.nan
