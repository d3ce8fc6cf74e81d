"""One lot against another: by which factor typical values differ, and whether chance does it.

Of N, B and K the typical values are compared as logarithms, of gyros' levels and of rates the means
of units; a unit that stands out in its own lot is left out. Errors are those of the means over
units, so what is compared are the lots and not their boards. With few units each mean has Student's
t distribution, and their difference that of Welch. Probabilities are adjusted for all that is
compared (Holm, Scandinavian Journal of Statistics 6, 1979): one lot in a hundred that is like the
other is reported to differ in anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.lot import Lot
from allanscope.fleet.outliers import outlying_units, outlying_values
from allanscope.fleet.repeats import unit_estimates
from allanscope.fleet.typical_value import typical_of
from allanscope.fleet.verdict import levels_of_units, rates_of_units
from allanscope.quantities import MAIN_LETTERS

__all__ = ["LEVEL_OF_TEST", "Difference", "differences"]

Floats = NDArray[np.float64]

LEVEL_OF_TEST = 0.01
FEWEST = 3
"""Units of a lot whose mean has an error."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One quantity of two lots.

    Attributes
    ----------
    axis, quantity : str
        ``N``, ``B``, ``K``, ``level`` or ``rate``; the axis of a rate is ``all``.
    value, other : float
        Typical value of this lot and of the other.
    change, lower, upper : float
        Ratio less one of N, B, K and the rate, difference of a level; with its 95 % interval.
    p_value : float
        Probability of such a difference between lots that are alike, all comparisons considered.
    """

    axis: str
    quantity: str
    value: float
    other: float
    change: float
    lower: float
    upper: float
    p_value: float

    @property
    def is_significant(self) -> bool:
        """Whether the lots differ at 1 % for all that is compared."""
        return self.p_value < LEVEL_OF_TEST


def differences(lot: Lot, other: Lot) -> list[Difference]:
    """Return all that can be compared, what differs most surely first."""
    found = sorted(_compared(lot, other), key=lambda one: one.p_value)
    adjusted, least = [], 0.0
    for place, one in enumerate(found):
        least = max(least, min(one.p_value * (len(found) - place), 1.0))
        adjusted.append(replace(one, p_value=least))
    return adjusted


def _compared(lot: Lot, other: Lot) -> Iterator[Difference]:
    quantities = len(lot.axes) * (len(MAIN_LETTERS) + 1) + 1
    for axis in lot.axes:
        lots = lot.of_axis(axis), other.of_axis(axis)
        for name in MAIN_LETTERS:
            known = [_typical(one, name, quantities) for one in lots]
            if known[0] is not None and known[1] is not None:
                yield _welch(axis, name, known[0], known[1], is_log=True)
        if axis.startswith("g"):
            means = [_mean(*levels_of_units(one), quantities) for one in lots]
            if means[0] is not None and means[1] is not None:
                yield _welch(axis, "level", means[0], means[1])
    rates = [_mean(*rates_of_units(one), quantities, np.log) for one in (lot, other)]
    if rates[0] is not None and rates[1] is not None:
        yield _welch("all", "rate", rates[0], rates[1], is_log=True)


class Mean(NamedTuple):
    """Mean over units, its standard error, and the degrees of freedom of that."""

    value: float
    error: float
    freedom: int


def _typical(lot: Lot, name: str, quantities: int) -> Mean | None:
    """Return the logarithm of what is typical; None where few units show it."""
    from scipy.special import stdtrit

    units = unit_estimates(lot, name) if len(lot) else None
    if units is None:
        return None
    far = [one.unit for one in outlying_units(units, quantities)]
    units = units.where(~np.isin(units.names, far))
    if len(units.names) < FEWEST:
        return None
    one = typical_of(units)
    if not (np.isfinite(one.value) and one.lower > 0.0):
        return None
    freedom = len(units.names) - 1
    wide = float(np.log(one.upper / one.lower)) / (2.0 * float(stdtrit(freedom, 0.975)))
    return Mean(float(np.log(one.value)), wide, freedom)


def _mean(
    values: Floats,
    errors: Floats,
    names: NDArray[np.str_],
    quantities: int,
    scale: Callable[[Floats], Floats] = np.asarray,
) -> Mean | None:
    """Return the mean over units; None where there are few."""
    far = [one.unit for one in outlying_values(values, errors, names, quantities)]
    usual = scale(values[~np.isin(names, far)])
    if len(usual) < FEWEST:
        return None
    error = float(np.std(usual, ddof=1)) / np.sqrt(len(usual))
    return Mean(float(np.mean(usual)), error, len(usual) - 1)


def _welch(axis: str, name: str, one: Mean, other: Mean, is_log: bool = False) -> Difference:
    from scipy.special import stdtr, stdtrit

    difference = one.value - other.value
    squares = one.error**2, other.error**2
    size = max(abs(one.value), abs(other.value), 1.0)
    error = max(float(np.sqrt(sum(squares))), 1e-12 * size)
    parts = squares[0] ** 2 / one.freedom + squares[1] ** 2 / other.freedom
    freedom = sum(squares) ** 2 / parts if parts > 0.0 else float(one.freedom + other.freedom)
    reach = float(stdtrit(freedom, 0.975)) * error
    p_value = 2.0 * float(stdtr(freedom, -abs(difference) / error))
    limits = np.array([difference, difference - reach, difference + reach])
    change, lower, upper = (np.expm1(limits) if is_log else limits).tolist()
    scale = np.exp if is_log else np.asarray
    value, reference = scale([one.value, other.value]).tolist()
    return Difference(axis, name, value, reference, change, lower, upper, p_value)
