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
    here, there : float
        Typical value of this lot and of the other.
    change, lower, upper : float
        Ratio less one of N, B, K and the rate, difference of a level; with its 95 % interval.
    p_value : float
        Probability of such a difference between lots that are alike, all comparisons considered.
    """

    axis: str
    quantity: str
    here: float
    there: float
    change: float
    lower: float
    upper: float
    p_value: float

    @property
    def is_seen(self) -> bool:
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
        here, there = lot.of_axis(axis), other.of_axis(axis)
        for name in MAIN_LETTERS:
            known = [_typical(one, name, quantities) for one in (here, there)]
            if known[0] is not None and known[1] is not None:
                yield _welch(axis, name, known[0], known[1], is_log=True)
        if axis.startswith("g"):
            means = [_mean(*levels_of_units(one), quantities) for one in (here, there)]
            if means[0] is not None and means[1] is not None:
                yield _welch(axis, "level", means[0], means[1])
    rates = [_mean(*rates_of_units(one), quantities, np.log) for one in (lot, other)]
    if rates[0] is not None and rates[1] is not None:
        yield _welch("all", "rate", rates[0], rates[1], is_log=True)


Mean = tuple[float, float, int]
"""Mean over units, its standard error, degrees of freedom of that."""


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
    return float(np.log(one.value)), wide, freedom


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
    return float(np.mean(usual)), error, len(usual) - 1


def _welch(axis: str, name: str, here: Mean, there: Mean, is_log: bool = False) -> Difference:
    from scipy.special import stdtr, stdtrit

    apart = here[0] - there[0]
    squares = here[1] ** 2, there[1] ** 2
    error = max(float(np.sqrt(sum(squares))), 1e-12 * max(abs(here[0]), abs(there[0]), 1.0))
    parts = sum(s**2 / k for s, k in zip(squares, (here[2], there[2]), strict=True))
    freedom = sum(squares) ** 2 / parts if parts > 0.0 else float(here[2] + there[2])
    reach = float(stdtrit(freedom, 0.975)) * error
    p_value = 2.0 * float(stdtr(freedom, -abs(apart) / error))
    told = np.array([apart, apart - reach, apart + reach])
    change, lower, upper = (np.expm1(told) if is_log else told).tolist()
    ours, theirs = np.exp([here[0], there[0]]).tolist() if is_log else (here[0], there[0])
    return Difference(axis, name, ours, theirs, change, lower, upper, p_value)
