"""Runs of one unit: what they say of its coefficient together, and by how much they differ.

A run that knows its coefficient well says so by a normal distribution of its logarithm. One that
hardly sees it, or not at all, says so by its likelihood, which is close to a normal one of the
coefficient itself: the square root of the loss of a profile is nearly linear in the amplitude, so
estimate and upper limit tell it all (`allanscope.noise.estimates`),

    -2 ln L(c) = ((c - value) / sigma)^2,    sigma = (upper - value) / 1.96,

where nothing was detected with value at or near zero. To leave such runs out would leave the large
estimates in and the small ones out.

Coefficients of noise are positive and scatter by factors, so their logarithms are taken. A repeat
differs from the one before because the unit did, or because a finite record does not tell better:
what the intervals of the single runs allow is put beside it. Repeats of one unit differ by more
than their errors by omega in the logarithm: what makes the weighted squares within units as large
as their degrees of freedom (Paule and Mandel, Journal of Research of the NBS 87, 1982). Whether
units differ at all is asked with the ratio of the mean squares of the one-way layout, runs weighted
by what is known of each; it has an F distribution with k - 1 and n - k degrees of freedom where
they do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.lot import Lot
from allanscope.optimise import root_between
from allanscope.quantities import TWO_SIDED_95

__all__ = [
    "Spread",
    "UnitEstimates",
    "excess_of_repeats",
    "log_sigma",
    "spread_of",
    "unit_estimates",
    "unit_means",
]

Floats = NDArray[np.float64]
Names = NDArray[np.str_]


_WELL_KNOWN = 0.15
"""Standard error of the logarithm up to which that is normal enough, however its interval lies."""


@dataclass(frozen=True, slots=True)
class UnitEstimates:
    """One coefficient of the units of a lot, shape (k,) each.

    Attributes
    ----------
    names : ndarray of str
        Units.
    value, sigma : ndarray
        Estimate, and its standard error as an amplitude.
    well_known : ndarray of bool
        Whether the logarithm is nearer normal than the value, with standard error sigma / value.
    omega : float
        Standard deviation of the logarithm between repeats, beside their errors.
    """

    names: Names
    value: Floats
    sigma: Floats
    well_known: NDArray[np.bool_]
    omega: float

    def where(self, mask: NDArray[np.bool_]) -> UnitEstimates:
        """Return some of the units."""
        return UnitEstimates(
            self.names[mask],
            self.value[mask],
            self.sigma[mask],
            self.well_known[mask],
            self.omega,
        )

    def logarithms(self, centre: float) -> tuple[Floats, Floats]:
        """Return logarithms and their standard errors where the coefficient is the lot's.

        A noisy run whose estimate is high by chance seems surer of itself than it is. What counts
        is how well it tells its estimate from the centre of the lot.
        """
        value = np.maximum(self.value, 1e-3 * self.sigma)
        logs, middle = np.log(value), np.log(centre)
        apart = np.abs(value - centre)
        far = apart > 1e-6 * centre
        with np.errstate(divide="ignore", invalid="ignore"):
            weak = np.where(far, np.abs(logs - middle) * self.sigma / apart, self.sigma / centre)
        return logs, np.where(self.well_known, self.sigma / value, weak)


def unit_estimates(lot: Lot, name: str) -> UnitEstimates | None:
    """Return what the rows of one axis say of a coefficient; None where they say nothing."""
    value, upper = lot[f"{name}_value"], lot[f"{name}_upper"]
    lower = lot[f"{name}_lower"]
    detected = (lot[f"{name}_detected"] == 1.0) & (value > 0.0)
    value = np.where(np.isfinite(value) & (value < upper), value, 0.0)
    usable = np.isfinite(upper) & (upper > 0.0) & (detected | (lot[f"{name}_detected"] == 0.0))
    # Without an interval nothing is known of the error; it is taken for none, as in a comparison
    # of bare numbers.
    bare = detected & ~(upper > lot[f"{name}_value"])
    usable |= bare & np.isfinite(lot[f"{name}_value"])
    value = np.where(bare, lot[f"{name}_value"], value)
    if not usable.any():
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        log_sigma = np.where(bare, 0.0, np.log(upper / lower) / (2.0 * TWO_SIDED_95))
        is_normal = (log_sigma < _WELL_KNOWN) | _is_even_in_log(value, lower, upper)
        known = usable & detected & is_normal
        sigma = np.where(
            known,
            log_sigma * value,
            np.where(
                detected, (upper - lower) / (2.0 * TWO_SIDED_95), (upper - value) / TWO_SIDED_95
            ),
        )
    units = lot.units
    omega = excess_of_repeats(np.log(value[known]), log_sigma[known], units[known])
    return _by_unit(value[usable], sigma[usable], known[usable], units[usable], omega)


def _is_even_in_log(value: Floats, lower: Floats, upper: Floats) -> NDArray[np.bool_]:
    """Return where an estimate is nearer the middle of its interval's logarithms than of itself.

    Then the likelihood is closer to a normal one of the logarithm than of the coefficient.
    """
    return np.asarray(2.0 * value < np.sqrt(lower * upper) + 0.5 * (lower + upper))


def excess_of_repeats(values: Floats, errors: Floats, units: Names) -> float:
    """Return by how much repeats of one unit differ beside their errors; 0 without repeats.

    Examples
    --------
    >>> units = np.array(["a", "a", "b", "b"])
    >>> round(excess_of_repeats(np.array([0.0, 2.0, 5.0, 7.0]), np.zeros(4), units), 3)
    1.414
    """
    if not len(values):
        return 0.0
    _, of, repeats = np.unique(units, return_inverse=True, return_counts=True)
    freedom = len(values) - len(repeats)
    largest = float(np.ptp(values))
    tiny = 1e-9 * largest
    if freedom == 0 or largest == 0.0:
        return 0.0

    def over(omega: float) -> float:
        weight = 1.0 / (errors**2 + omega**2 + tiny**2)
        mean = np.bincount(of, weight * values) / np.bincount(of, weight)
        return float(weight @ (values - mean[of]) ** 2) - freedom

    return root_between(over, 0.0, 2.0 * largest) if over(0.0) > 0.0 else 0.0


def unit_means(
    values: Floats, errors: Floats, units: Names, omega: float
) -> tuple[Names, Floats, Floats]:
    """Return the units, the weighted means of their runs, and the errors of those."""
    names, of = np.unique(units, return_inverse=True)
    smallest = np.finfo(np.float64).tiny ** 0.25
    weight = 1.0 / np.maximum(errors**2 + omega**2, smallest)
    total = np.bincount(of, weight)
    mean = np.bincount(of, weight * values) / total
    # Errors that are not known at all stay none.
    error = np.where(np.bincount(of, errors**2 + omega**2) > 0.0, total**-0.5, 0.0)
    return names, mean, error


def _by_unit(
    value: Floats, sigma: Floats, known: NDArray[np.bool_], units: Names, omega: float
) -> UnitEstimates:
    """Join the runs of each unit: by logarithms where all are well known, else by amplitudes."""
    names, of = np.unique(units, return_inverse=True)
    all_known = np.bincount(of, ~known) == 0
    typical = float(np.median(value[known])) if known.any() else 0.0
    _, amplitude, error = unit_means(value, np.hypot(sigma, omega * typical), units, 0.0)
    some = all_known[of]
    if some.any():
        logs, log_sigma = np.log(value[some]), sigma[some] / value[some]
        _, mean, log_error = unit_means(logs, log_sigma, units[some], omega)
        amplitude[all_known] = np.exp(mean)
        error[all_known] = log_error * np.exp(mean)
    well = all_known | (error < _WELL_KNOWN * amplitude)
    return UnitEstimates(names, amplitude, error, well, omega)


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
