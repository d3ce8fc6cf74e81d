"""Units that do not belong to the lot, each with the reason.

A unit's value is the mean logarithm of its runs. Whether some units are too far from the rest is
asked with Rosner's generalised extreme studentised deviate (Technometrics 25, 1983): the farthest
is taken away, mean and scatter are formed anew, and so on; the largest number of units whose last
one is significant are outliers, so that two bad boards cannot hide each other. The level is 1 % for
the whole lot, shared among all that is compared. A unit must also be far by its own standard error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FALSE_ALARMS", "FEWEST_UNITS", "Outlier", "far_units"]

Floats = NDArray[np.float64]

FEWEST_UNITS = 6
"""With fewer there is no saying what is usual."""

FALSE_ALARMS = 0.01
"""Probability of a false name in a lot without outliers, all comparisons together."""

_LARGEST_SHARE = 4
"""At most a quarter of the units can be outliers: beyond, there are two lots."""

_MOST = 200
"""Nor more than this, which nobody would read."""

_OWN_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Outlier:
    """One unit that stands out in one quantity.

    Attributes
    ----------
    unit : str
        Its name.
    ratio : float
        Its value over the median of the others.
    score : float
        Distance in standard deviations of the lot.
    """

    unit: str
    ratio: float
    score: float


def far_units(
    values: Floats, sigma: Floats, units: NDArray[np.str_], comparisons: int
) -> list[Outlier]:
    """Return the units that stand out, the farthest first.

    Parameters
    ----------
    values, sigma : ndarray, shape (n,)
        Positive values of the runs and standard errors of their logarithms.
    units : ndarray of str, shape (n,)
        Of which unit each run is.
    comparisons : int
        Quantities that are looked at in the whole lot.

    Examples
    --------
    >>> values = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.97, 4.0])
    >>> [one] = far_units(values, np.full(8, 0.02), np.array(list("abcdefgh")), 1)
    >>> one.unit, round(one.ratio, 1)
    ('h', 4.0)
    """
    names, of, repeats = np.unique(units, return_inverse=True, return_counts=True)
    if len(names) < FEWEST_UNITS:
        return []
    means = np.bincount(of, np.log(values)) / repeats
    error = np.sqrt(np.bincount(of, np.nan_to_num(sigma) ** 2)) / repeats
    far = _extreme(means, FALSE_ALARMS / comparisons)
    usual = np.delete(means, far)
    centre, scatter = float(np.median(usual)), float(usual.std(ddof=1))
    found = [
        Outlier(
            str(names[index]),
            float(np.exp(means[index] - centre)),
            float((means[index] - centre) / max(scatter, 1e-12)),
        )
        for index in far
        if abs(means[index] - centre) > _OWN_SIGMAS * error[index]
    ]
    return sorted(found, key=lambda one: -abs(one.score))


def _extreme(values: Floats, level: float) -> list[int]:
    """Return the places of the values that are too far from the rest."""
    from scipy.stats import t

    left = list(range(len(values)))
    removed: list[int] = []
    significant = 0
    most = min(len(values) // _LARGEST_SHARE, _MOST)
    for n in range(len(values), len(values) - most, -1):
        rest = values[left]
        scatter = rest.std(ddof=1)
        distance = np.abs(rest - rest.mean())
        at = int(distance.argmax())
        quantile = float(t.isf(level / (2 * n), n - 2))
        critical = (n - 1) * quantile / np.sqrt((n - 2 + quantile**2) * n)
        removed.append(left.pop(at))
        if distance[at] > critical * scatter > 0.0:
            significant = len(removed)
    return removed[:significant]
