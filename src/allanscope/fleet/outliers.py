"""Units that do not belong to the lot.

Coefficients are compared as logarithms, levels and rates as they are. The level is 1 % for the
whole lot, shared among all that is compared (`random_effects` for the test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.random_effects import Extreme, extremes, restricted
from allanscope.fleet.unit_estimates import UnitEstimates

__all__ = ["FALSE_ALARMS", "FEWEST_UNITS", "Outlier", "far_units", "far_values"]

Floats = NDArray[np.float64]
Names = NDArray[np.str_]

FEWEST_UNITS = 6
"""With fewer there is no saying what is usual."""

FALSE_ALARMS = 0.01
"""Probability of a false name in a lot without outliers, all comparisons together."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """One unit that stands out in one quantity.

    Attributes
    ----------
    unit : str
        Its name.
    value, usual : float
        Of the unit, and the centre of the others.
    score : float
        Distance in the standard deviations that scatter and its own error allow.
    p_value : float
        Probability of any such unit in a lot without outliers, all comparisons considered.
    """

    unit: str
    value: float
    usual: float
    score: float
    p_value: float


def far_units(units: UnitEstimates, comparisons: int) -> list[Outlier]:
    """Return the units whose coefficient is far from the others', the farthest first.

    Parameters
    ----------
    units : UnitEstimates
        One coefficient of a lot.
    comparisons : int
        Quantities that are looked at in the whole lot.

    Examples
    --------
    >>> value = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 1.02, 0.97, 4.0])
    >>> units = UnitEstimates(np.array(list("abcdefgh")), value, 0.02 * value, value > 0, 0.0)
    >>> [one] = far_units(units, 1)
    >>> one.unit, round(one.value / one.usual, 1), one.p_value < 1e-4
    ('h', 4.0, True)
    """
    if len(units.names) < FEWEST_UNITS or not (units.value > 0.0).any():
        return []
    logs, errors = units.logarithms(_weighted_median(units.value, units.sigma))
    found = far_values(logs, errors, units.names, comparisons)
    return [
        Outlier(
            one.unit, float(np.exp(one.value)), float(np.exp(one.usual)), one.score, one.p_value
        )
        for one in found
    ]


def far_values(values: Floats, errors: Floats, names: Names, comparisons: int) -> list[Outlier]:
    """Return the units whose values with these standard errors are far from the others'."""
    if len(values) < FEWEST_UNITS:
        return []
    far = extremes(values, errors, FALSE_ALARMS / comparisons)
    usual, scatter = _usual(values, errors, far)
    found = [
        Outlier(
            str(names[one.index]),
            float(values[one.index]),
            usual,
            float((values[one.index] - usual) / max(np.hypot(scatter, errors[one.index]), 1e-12)),
            min(one.p_value * comparisons, 1.0),
        )
        for one in far
    ]
    return sorted(found, key=lambda one: -abs(one.score))


def _usual(values: Floats, errors: Floats, far: Sequence[Extreme]) -> tuple[float, float]:
    without = [one.index for one in far]
    return restricted(np.delete(values, without), np.delete(errors, without))


def _weighted_median(values: Floats, errors: Floats) -> float:
    """Return the median by what is known: many poor ones must not move it."""
    order = np.argsort(values)
    smallest = 1e-3 * (float(errors.max()) or 1.0)
    weight = np.cumsum(np.hypot(errors, smallest)[order] ** -2.0)
    return float(values[order][np.searchsorted(weight, 0.5 * weight[-1])])
