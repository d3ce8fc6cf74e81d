"""Units that do not belong to the lot, when some are known better than others.

Coefficients are compared as logarithms, levels and rates as they are. The level is 1 % for the
whole lot, shared among all that is compared.

The value y_i of unit i is the lot's centre, a deviation of its own and an error of known size:

    y_i = mu + u_i + e_i,    u_i ~ N(0, tau^2),    e_i ~ N(0, s_i^2)

the random-effects model of meta-analysis (Viechtbauer and Cheung, Research Synthesis Methods 1,
2010, for outliers in it). Each unit is held against all others: its distance from their weighted
mean over the standard deviation that tau, its own error and that of the mean allow. What the others
leave open of tau is integrated over, with their restricted likelihood (that of REML) and Jeffreys'
prior as weights. With equal errors that is Student's t with k - 2 degrees of freedom, exactly.

Outliers that hide each other are found as by Rosner (Technometrics 25, 1983): the farthest is taken
away, all is formed anew, and so on; the largest number whose last one is significant are outliers.
With equal errors it is his test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.repeats import UnitEstimates
from allanscope.optimise import minimise_between

__all__ = [
    "FALSE_ALARMS",
    "FEWEST_UNITS",
    "Extreme",
    "Outlier",
    "deviation_errors",
    "extremes",
    "outlying_units",
    "outlying_values",
    "reml",
]

Floats = NDArray[np.float64]
Names = NDArray[np.str_]

_LARGEST_SHARE = 4
"""At most a quarter of the units can be outliers: beyond, there are two lots."""

_MOST = 200
"""Nor more than this: the list must stay readable."""

_CANDIDATES = 24
"""So many of the farthest by a quick measure are judged by the exact one."""

_POINTS = 120
_NATS = 30.0
"""Less likely by more than this is left out of integrals."""

FEWEST_UNITS = 6
"""With fewer there is no saying what is usual."""

FALSE_ALARMS = 0.01
"""Probability of a false name in a lot without outliers, all comparisons together."""


@dataclass(frozen=True, slots=True)
class Extreme:
    """A unit that is too far out.

    Attributes
    ----------
    index : int
        Which.
    p_value : float
        Probability of so far a unit where there is no outlier, units of the lot considered.
    """

    index: int
    p_value: float


def extremes(values: Floats, errors: Floats, level: float) -> list[Extreme]:
    """Return the units that are too far from the rest, the farthest first.

    Parameters
    ----------
    values, errors : ndarray, shape (k,)
        Finite values and their standard errors.
    level : float
        Probability of a false one in a lot without any.

    Examples
    --------
    >>> values = np.array([0.0, 0.1, -0.1, 0.05, -0.05, 0.02, -0.03, 2.0])
    >>> [(one.index, one.p_value < 1e-5) for one in extremes(values, np.zeros(8), 0.01)]
    [(7, True)]

    The same distance of a unit of which little is known:

    >>> extremes(values, np.array([0, 0, 0, 0, 0, 0, 0, 1.0]), 0.01)
    []
    """
    if len(values) == 0 or np.ptp(values) == 0.0:
        return []
    others = _LeaveOneOut(values - np.median(values), errors)
    removed: list[int] = []
    p_values: list[float] = []
    significant = 0
    for _ in range(min(len(values) // _LARGEST_SHARE, _MOST)):
        index, p_value = others.farthest()
        p_values.append(min(p_value * len(others.left), 1.0))
        removed.append(index)
        others.remove(index)
        if p_values[-1] < level:
            significant = len(removed)
    # One that another hid is as significant as the step that showed both.
    together = np.minimum.accumulate(p_values[:significant][::-1])[::-1]
    found = zip(removed[:significant], together, strict=True)
    return [Extreme(index, float(p)) for index, p in found]


def reml(values: Floats, errors: Floats) -> tuple[float, float]:
    """Return the centre and the scatter between units, by restricted maximum likelihood.

    Examples
    --------
    >>> centre, scatter = reml(np.array([0.0, 1.0, 2.0]), np.zeros(3))
    >>> round(centre, 3), round(scatter, 3)
    (1.0, 1.0)
    """
    if len(values) < 2 or np.ptp(values) == 0.0:
        return float(np.mean(values)), 0.0
    middle = float(np.median(values))
    others = _LeaveOneOut(values - middle, errors)

    def lost(x: float) -> float:
        return -float(others.sums(others.tau2(np.array([x]))).log_likelihood()[0])

    best, _ = minimise_between(lost, *others.bounds, within=1e-6)
    tau2 = others.tau2(np.array([best]))
    return middle + float(others.sums(tau2).mean[0]), float(np.sqrt(tau2[0]))


@dataclass(slots=True)
class _Sums:
    """Sums over units with weights 1 / (s^2 + tau^2), shape (..., g) for g values of tau^2."""

    weight: Floats
    first: Floats
    second: Floats
    logs: Floats
    squares: Floats

    @property
    def mean(self) -> Floats:
        return np.asarray(self.first / self.weight)

    def without(self, weight: Floats, value: Floats) -> _Sums:
        """Leave units out, one for each row."""
        return _Sums(
            self.weight - weight,
            self.first - weight * value,
            self.second - weight * value**2,
            self.logs - np.log(weight),
            np.maximum(self.squares - weight**2, np.finfo(np.float64).tiny),
        )

    def log_likelihood(self) -> Floats:
        """Return the restricted log-likelihood of tau."""
        residual = np.maximum(self.second - self.first**2 / self.weight, 0.0)
        return np.asarray(0.5 * (self.logs - np.log(self.weight) - residual))


class _LeaveOneOut:
    """Units, each to be held against the others.

    Attributes
    ----------
    left : ndarray of int
        Those that have not been removed.
    """

    def __init__(self, values: Floats, errors: Floats) -> None:
        self.values = values
        self.variances = errors**2
        self.left = np.arange(len(values))
        spread = max(float(np.ptp(values)), np.finfo(np.float64).tiny ** 0.25)
        # tau^2 + floor runs evenly in its logarithm: from nothing beside the errors, or beside the
        # spread where there are none, to far more than any unit is away.
        self.floor = max(float(self.variances.min()), (1e-6 * spread) ** 2)
        top = self.floor + (100.0 * spread) ** 2 + float(self.variances.max())
        self.bounds = float(np.log(self.floor)), float(np.log(top))
        self._grid = np.linspace(*self.bounds, _POINTS)
        self._all = self.sums(self.tau2(self._grid))
        self._is_fine = False

    def sums(self, tau2: Floats) -> _Sums:
        """Return the sums over all that are left."""
        weight = 1.0 / (self.variances[self.left, np.newaxis] + tau2)
        value = self.values[self.left, np.newaxis]
        return _Sums(
            weight.sum(axis=0),
            (weight * value).sum(axis=0),
            (weight * value**2).sum(axis=0),
            np.log(weight).sum(axis=0),
            (weight**2).sum(axis=0),
        )

    def tau2(self, grid: Floats) -> Floats:
        """Return tau^2 by the logarithm of tau^2 + floor."""
        return np.maximum(np.exp(grid) - self.floor, 1e-9 * self.floor)

    def remove(self, index: int) -> None:
        """Take a unit away."""
        self.left = self.left[self.left != index]
        weight = 1.0 / (self.variances[index] + self.tau2(self._grid))
        self._all = self._all.without(weight, self.values[index])

    def farthest(self) -> tuple[int, float]:
        """Return the unit that the others allow least, and the probability that they do."""
        if np.ptp(self.values[self.left]) == 0.0:
            return int(self.left[0]), 1.0
        if not self._is_fine:
            self._refine_grid()
        candidates = self._candidates()
        p_value, weight = self._p_values(candidates)
        likely = weight > weight.max(axis=1, keepdims=True) - _NATS
        if (likely[:, 0].any() and self._grid[0] > self.bounds[0]) or likely[:, -1].any():
            self._refine_grid()
            p_value, _ = self._p_values(candidates)
        best = int(p_value.argmin())
        return int(candidates[best]), float(p_value[best])

    def _refine_grid(self) -> None:
        """Put the grid where the likelihood is, whichever candidate is left out."""
        self._grid = np.linspace(*self.bounds, _POINTS)
        self._all = self.sums(self.tau2(self._grid))
        _, weight = self._p_values(self._candidates())
        likely = (weight > weight.max(axis=1, keepdims=True) - 2.0 * _NATS).any(axis=0)
        near = np.flatnonzero(likely)
        low, high = max(near[0] - 1, 0), min(near[-1] + 1, _POINTS - 1)
        self._grid = np.linspace(self._grid[low], self._grid[high], _POINTS)
        self._all = self.sums(self.tau2(self._grid))
        self._is_fine = True

    def _candidates(self) -> NDArray[np.intp]:
        """Return the units that are farthest by the most likely tau of all."""
        at = int(self._log_weight(self._all).argmax())
        tau2 = self.tau2(self._grid[at : at + 1])
        distance = np.abs(self.values[self.left] - self._all.mean[at])
        quick = distance / np.sqrt(self.variances[self.left] + tau2)
        return np.asarray(self.left[np.argsort(-quick)[:_CANDIDATES]])

    def _p_values(self, candidates: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return the probability of each candidate by the others, and the weights of the grid."""
        from scipy.special import logsumexp, ndtr

        own = self.variances[candidates, np.newaxis] + self.tau2(self._grid)
        value = self.values[candidates, np.newaxis]
        others = self._all.without(1.0 / own, value)
        weight = self._log_weight(others)
        share = np.exp(weight - logsumexp(weight, axis=1, keepdims=True))
        distance = np.abs(value - others.mean) / np.sqrt(own + 1.0 / others.weight)
        return np.asarray((share * 2.0 * ndtr(-distance)).sum(axis=1)), weight

    def _log_weight(self, sums: _Sums) -> Floats:
        """Return likelihood times Jeffreys' prior of tau^2 for each step of the grid."""
        return np.asarray(sums.log_likelihood() + 0.5 * np.log(sums.squares) + self._grid)


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


def outlying_units(units: UnitEstimates, comparisons: int) -> list[Outlier]:
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
    >>> [one] = outlying_units(units, 1)
    >>> one.unit, round(one.value / one.usual, 1), one.p_value < 1e-4
    ('h', 4.0, True)
    """
    if len(units.names) < FEWEST_UNITS or not (units.value > 0.0).any():
        return []
    centre = _weighted_median(units.value, units.sigma)
    if centre <= 0.0:  # most have only a limit: what they tell apart is the size of their errors
        centre = _weighted_median(np.maximum(units.value, units.sigma), units.sigma)
    logs, errors = units.logarithms(centre)
    found = outlying_values(logs, errors, units.names, comparisons)
    return [
        Outlier(
            one.unit, float(np.exp(one.value)), float(np.exp(one.usual)), one.score, one.p_value
        )
        for one in found
    ]


def outlying_values(
    values: Floats, errors: Floats, names: Names, comparisons: int
) -> list[Outlier]:
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
    return reml(np.delete(values, without), np.delete(errors, without))


def deviation_errors(logs: Floats, edf: Floats) -> Floats:
    """Return standard errors of logarithms of deviations, as far from their centre as they are.

    A variance with few degrees of freedom nu is often low and seldom high, and so is its logarithm.
    Its cube root is nearly normal, with variance 2 / (9 nu) (Wilson and Hilferty, PNAS 17, 1931).
    With x two thirds of the distance of a logarithm from the centre, that root is expm1(x) away.

    Parameters
    ----------
    logs, edf : ndarray, shape (k,)
        Logarithms, up to a constant, and equivalent degrees of freedom.

    Examples
    --------
    >>> deviation_errors(np.array([0.0, 0.0, 0.0, -1.0]), np.full(4, 50.0)).round(3).tolist()
    [0.1, 0.1, 0.1, 0.137]
    """
    error = np.sqrt(0.5 / edf)
    x = 2.0 / 3.0 * (logs - _weighted_median(logs, error))
    with np.errstate(invalid="ignore"):
        return np.asarray(error * np.where(x == 0.0, 1.0, x / np.expm1(x)))


def _weighted_median(values: Floats, errors: Floats) -> float:
    """Return the median by what is known: many poor ones must not move it."""
    order = np.argsort(values)
    smallest = 1e-3 * (float(errors.max()) or 1.0)
    weight = np.cumsum(np.hypot(errors, smallest)[order] ** -2.0)
    return float(values[order][np.searchsorted(weight, 0.5 * weight[-1])])
