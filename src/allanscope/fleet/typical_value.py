"""The value of a coefficient that is typical of a lot, with runs that give only an upper limit.

The logarithms of the units' coefficients are normal about the lot's with standard deviation tau. A
unit's likelihood is averaged over that distribution (a normal logarithm in closed form, a normal
amplitude by Gauss-Hermite quadrature), which is a Tobit model with soft limits: a unit that does
not show the term speaks against large values, as far as it could have seen them.

Centre and tau are judged together on a grid, with a flat prior for the centre and Jeffreys' for
tau^2. With equal errors the interval of the centre is that of Student's t with k - 1 degrees of
freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.outliers import reml
from allanscope.fleet.repeats import UnitEstimates
from allanscope.quantities import TWO_SIDED_95

__all__ = ["Typical", "typical_of"]

Floats = NDArray[np.float64]

_CENTRES, _SCATTERS, _NODES = 40, 20, 16
_NATS = 12.0
_LOOKS = 6
_NARROWEST = 0.6
"""A grid of which so much is likely is left as it is."""
_SMALLER = 1.92
"""Nats, of a 95 % interval: with fewer against next to nothing, there is only an upper limit."""
_WIDEST = 2.0
"""No lot scatters by more, in the logarithm."""
_LIMITS = (0.025, 0.5, 0.975)
_MOST_POOR = 400
"""So many of the units that hardly show the term stand for more of them."""
_BLOCK = 256
"""Units at a time: so much memory."""


@dataclass(frozen=True, slots=True)
class Typical:
    """What is typical of the units of a lot.

    Attributes
    ----------
    value, lower, upper : float
        Median over units and its 95 % interval; `lower` is 0 and `value` NaN where no unit, and
        not all together, tell it from nothing.
    scatter : float
        Standard deviation of the logarithm between units, the most likely one.
    """

    value: float
    lower: float
    upper: float
    scatter: float


def typical_of(units: UnitEstimates) -> Typical:
    """Return the typical value of some units.

    Examples
    --------
    >>> names = np.array(list("abcd"))
    >>> value, sigma = np.array([1.0, 1.1, 0.9, 1.0]), np.full(4, 0.05)
    >>> one = typical_of(UnitEstimates(names, value, sigma, np.full(4, True), 0.0))
    >>> round(one.value, 2), one.lower < 0.95, one.upper > 1.05
    (1.0, True, True)
    """
    if len(units.names) == 1:
        return _alone(units)
    guess = max(float(np.median(units.value)), 1e-3 * float(np.median(units.sigma)))
    spread = float(np.std(np.log(np.maximum(units.value, 1e-3 * guess))))
    error = units.sigma / np.maximum(units.value, guess)
    floor = max(float(error.min()) ** 2, (1e-4 * spread) ** 2, 1e-16)
    wide = 3.0 * spread + float(np.median(error)) + 1e-6
    centres = np.log(guess) + np.linspace(-wide, wide, _CENTRES)
    scatters = np.linspace(np.log(floor), np.log(floor + 4.0 * wide**2), _SCATTERS)
    lowest = np.log(1e-2 * float(np.min(np.maximum(units.value, units.sigma))))
    highest = np.log(2.0 * float(np.max(units.value + 6.0 * units.sigma)))
    for _ in range(_LOOKS):
        weight = _log_weight(units, error, centres, scatters, floor)
        likely = weight > weight.max() - _NATS
        rows, columns = np.flatnonzero(likely.any(axis=1)), np.flatnonzero(likely.any(axis=0))
        widths = np.ptp(centres), np.ptp(scatters)
        centres = _around(centres, rows, lowest, highest)
        scatters = _around(scatters, columns, np.log(floor), np.log(floor + _WIDEST**2))
        ratios = np.ptp(centres) / widths[0], np.ptp(scatters) / widths[1]
        if min(ratios) > _NARROWEST and max(ratios) < 1.0 + 1e-9:
            break
    weight = _log_weight(units, error, centres, scatters, floor)
    if weight[0].max() > weight.max() - _SMALLER:
        return Typical(np.nan, 0.0, _upper_limit(weight, centres), np.nan)
    share = np.exp(weight - weight.max())
    over = np.cumsum(share.sum(axis=1))
    over = (over - 0.5 * share.sum(axis=1)) / over[-1]
    lower, value, upper = np.exp(np.interp(_LIMITS, over, centres))
    # REML's scatter is the most likely one, the centre averaged over and without the prior.
    marginal = share.sum(axis=0) / _prior(error, scatters, floor)
    scatter = float(np.sqrt(max(np.exp(scatters[marginal.argmax()]) - floor, 0.0)))
    if units.well_known.all():
        scatter = reml(np.log(units.value), units.sigma / units.value)[1]
    return Typical(float(value), float(lower), float(upper), scatter)


def _alone(units: UnitEstimates) -> Typical:
    value, sigma = float(units.value[0]), float(units.sigma[0])
    if units.well_known[0]:
        factor = np.exp(TWO_SIDED_95 * sigma / value)
        return Typical(value, value / factor, value * factor, np.nan)
    lower = value - TWO_SIDED_95 * sigma
    return Typical(
        value if lower > 0.0 else np.nan, max(lower, 0.0), value + TWO_SIDED_95 * sigma, np.nan
    )


def _upper_limit(weight: Floats, centres: Floats) -> float:
    """Return where the likelihood, whatever the scatter, is no longer near its largest."""
    near = weight.max(axis=1) > weight.max() - _SMALLER
    return float(np.exp(centres[np.flatnonzero(near)[-1]]))


def _around(grid: Floats, likely: NDArray[np.intp], lowest: float, highest: float) -> Floats:
    """Return a grid over the likely part: narrower, or farther where that goes beyond the end."""
    step = grid[1] - grid[0]
    reach = len(grid) * step / 2.0
    low = grid[likely[0]] - (reach if likely[0] == 0 else step)
    high = grid[likely[-1]] + (reach if likely[-1] == len(grid) - 1 else step)
    return np.linspace(max(low, lowest), min(high, highest), len(grid))


def _log_weight(
    units: UnitEstimates, error: Floats, centres: Floats, scatters: Floats, floor: float
) -> Floats:
    """Return log-likelihood and log-prior, shape (centres, scatters)."""
    tau2 = np.maximum(np.exp(scatters) - floor, 0.0)
    total = np.broadcast_to(np.log(_prior(error, scatters, floor)), (len(centres), len(tau2)))
    total = total.copy()
    known = np.flatnonzero(units.well_known)
    for some in _blocks(known):
        logs = np.log(units.value[some])
        variance = (units.sigma[some] / units.value[some])[:, None] ** 2 + tau2
        variance = np.maximum(variance, 1e-3 * floor)
        weight = 1.0 / variance
        first, second = logs @ weight, logs**2 @ weight
        squares = second - 2.0 * np.outer(centres, first) + np.outer(centres**2, weight.sum(axis=0))
        total -= 0.5 * (squares + np.log(variance).sum(axis=0))
    node, share = np.polynomial.hermite_e.hermegauss(_NODES)
    places = np.exp(np.minimum(centres[:, None, None] + np.sqrt(tau2)[:, None] * node, 300.0))
    poor = np.flatnonzero(~units.well_known)
    some = poor[np.linspace(0, len(poor) - 1, min(len(poor), _MOST_POOR)).astype(int)]
    for index in some:
        z = np.minimum(np.abs(places - units.value[index]) / units.sigma[index], 37.0)
        total += len(poor) / len(some) * np.log(np.exp(-0.5 * z**2) @ share)
    return total


def _prior(error: Floats, scatters: Floats, floor: float) -> Floats:
    """Return Jeffreys' prior of tau^2 for each step of the grid of log(tau^2 + floor)."""
    tau2 = np.maximum(np.exp(scatters) - floor, 0.0)
    information = sum(
        np.sum((error[some, None] ** 2 + tau2 + 1e-3 * floor) ** -2.0, axis=0)
        for some in _blocks(np.arange(len(error)))
    )
    return np.asarray(np.sqrt(information) * np.exp(scatters))


def _blocks(indices: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    return [indices[start : start + _BLOCK] for start in range(0, len(indices), _BLOCK)]
