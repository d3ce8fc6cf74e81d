r"""N, B and K as they are read off the curves, without a model of all the noise.

What an engineer does with a ruler, with the errors of what the ruler is put on:

- **N** is the level of the flat band of the density, :math:`\sqrt{S/2}` since N is two-sided.
- **N at 1 s** is the overlapping Allan deviation at 1 s times :math:`\sqrt{1\,\mathrm s}`.
- **B** is the least deviation over 0.664.
- **K** is :math:`\sigma(\tau)\sqrt{3/\tau}` where the curve rises as :math:`\tau^{1/2}`; where it
  does not there is none.

The flat band is the widest range of the logarithm of the frequency in which no test rejects that
the density is one level: one of the scatter, and three of a trend, by f, log f and 1/f. Bands that
stick out of their neighbours, as lines do, are left out first. A range without a trend that can be
seen still has one that biases its mean, as flicker noise has everywhere. So the level is what is
left beside a part that falls as 1/f, and its interval is wider for that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammainc, gammaincinv, polygamma

from allanscope.allan import Deviation
from allanscope.analysis.result import Reading
from allanscope.noise import find_best_averaging
from allanscope.noise.evidence import Evidence, Ordinates
from allanscope.quantities import TWO_SIDED_95
from allanscope.spectrum import Density

__all__ = ["density_of", "flat_band", "read_axis", "tells_flat"]

Array = NDArray[np.float64]

_FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Least deviation of flicker noise over B: 0.664."""
_REJECTED = 3.0
"""Standard deviations from which a range is not flat."""
_NEIGHBOURS = 7
"""Bands to either side whose median a band is compared with."""
_OUTLIER = 1e-5
"""Probability of a band as far from its neighbours, on either side."""
_NARROWEST = 2.0
"""Highest over lowest frequency of a flat band."""
_FEWEST = 6
"""Bands in it."""
_SLOPE_KNOWN = 0.1
"""Standard error of the slope of a range beyond which it is not flat."""
_CLEAR = 2.0
"""Ratio of frequencies left free at an end beyond which the density is another: what bends there
begins within."""
_BELOW = 10.0
"""How far below the flat band what falls towards it is measured."""
_ROUNDS = 6
_SEARCHED = 1.08
"""What the search for the band adds to the error, by simulation of white, flicker and walk."""
_AT_A_TIME = 32
"""Bands with which ranges begin that are looked at together."""
_WIDE = 10.0
"""Highest over lowest frequency of a band of which that much can be spared."""
_SURE = 3.0
"""Standard errors by which the deviation must rise to be called rising."""
_LONG_ENOUGH = math.log(8.0)
"""Least logarithm of the longest over the shortest averaging time of a rise."""
_SLOPE = (0.45, 0.6)
"""Slope of the deviation that is read as a random walk."""


def read_axis(density: Density | None, curve: Deviation | None, unit: str) -> dict[str, Reading]:
    """Return what can be read of one axis: ``N``, ``N_1s``, ``B``, ``K``, those that there are.

    Parameters
    ----------
    density : Density or None
        As measured.
    curve : Deviation or None
        Overlapping Allan deviation of the axis.
    unit : str
        Of the axis.
    """
    found: dict[str, Reading | None] = {}
    if density is not None and len(density.frequency):
        found["N"] = _from_density(density, unit)
    if curve is not None and len(curve.tau):
        found["N_1s"] = _at_one_second(curve, unit)
        found["B"] = _from_floor(curve, unit)
        found["K"] = _from_rise(curve, unit)
    return {name: one for name, one in found.items() if one is not None}


def density_of(evidence: Sequence[Evidence]) -> Density | None:
    """Return the density of the longest rows that a fit was made to; None where they are means."""
    rows = max(
        (one for one in evidence if isinstance(one, Ordinates) and one.grid.stride == 1),
        key=lambda one: one.grid.n,
        default=None,
    )
    if rows is None:
        return None
    used = rows.dof > 0
    grid = rows.grid
    width = grid.count[: len(used)] * grid.rate_hz / (2 * grid.n)
    power = 2 * rows.power / grid.rate_hz
    return Density(rows.frequency[used], width[used], power[used], rows.dof[used] / 2)


def flat_band(density: Density) -> tuple[NDArray[np.bool_], bool, bool] | None:
    """Return which bands are the flat ones, and whether the density goes on below and above them.

    Returns
    -------
    (ndarray, bool, bool) or None
        Shape (k,); bands that stick out are not among them. None where nothing is flat.
    """
    known = (density.density > 0) & np.isfinite(density.density)
    kept = known & ~_outliers(density, known)
    index = np.flatnonzero(kept)
    if len(index) < _FEWEST:
        return None
    frequency = density.frequency[index]
    ranges = _Ranges(frequency, density.density[index], density.averages[index])
    k, widest, low, high = len(index), -1.0, 0, 0
    # Some ranges at a time: what fits in the cache of the processor takes half of the time.
    for begin in range(0, k, _AT_A_TIME):
        if np.log(frequency[-1] / frequency[begin]) <= widest:
            break  # none of the others can be wider
        ends = np.arange(begin, k)
        first, last = np.meshgrid(ends[:_AT_A_TIME], ends, indexing="ij")
        rejected, slope_error = ranges.distances(begin)
        allowed = (
            (last - first >= _FEWEST - 1)
            & (frequency[last] >= _NARROWEST * frequency[first])
            & (slope_error < _SLOPE_KNOWN)
            & (rejected < _REJECTED)
        )
        width = np.where(allowed, np.log(frequency[last] / frequency[first]), -1.0)
        if width.max() > widest:
            at = int(np.argmax(width))
            widest, low, high = float(width.flat[at]), int(first.flat[at]), int(last.flat[at])
    if widest < 0.0:
        return None
    flat = np.zeros(len(density.frequency), np.bool_)
    flat[index[low : high + 1]] = True
    return flat, low > 0, high < k - 1


def tells_flat(density: Density | None) -> bool:
    """Return whether a density that is flat all along would be seen to be.

    Examples
    --------
    >>> frequency = np.arange(1.0, 51.0)
    >>> def density(averages: float) -> Density:
    ...     return Density(frequency, *(np.full(50, value) for value in (1.0, 1e-6, averages)))
    >>> tells_flat(density(1000.0)), tells_flat(density(1.0))
    (True, False)
    """
    if density is None or len(density.frequency) < _FEWEST:
        return False
    ends = density.frequency[[0, -1]]
    x, shape = np.log(density.frequency), density.averages
    spread = float(np.sum(shape * (x - np.average(x, weights=shape)) ** 2))
    return bool(ends[1] >= _NARROWEST * ends[0] and spread * _SLOPE_KNOWN**2 > 1)


def _outliers(density: Density, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which bands stick out of their neighbours by more than chance allows.

    A band is compared with the median of its neighbours on either side, each divided by what the
    median of its distribution is of its mean.
    """
    index = np.flatnonzero(known)
    out = np.zeros(len(known), np.bool_)
    if len(index) < 2 * _NEIGHBOURS + 1:
        return out
    power, shape = density.density[index], density.averages[index]
    level = np.log(power * shape / gammaincinv(shape, 0.5))
    padded = np.pad(level, _NEIGHBOURS, mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
    expected = np.exp(np.median(np.delete(windows, _NEIGHBOURS, axis=1), axis=1))
    below = gammainc(shape, shape * power / expected)
    # The median of a few neighbours is uncertain itself: a band must stick out by a part too.
    aside = np.abs(power / expected - 1) > 0.1 + 4 / np.sqrt(shape * 2 * _NEIGHBOURS)
    out[index] = aside & ((below > 1 - _OUTLIER) | (below < _OUTLIER))
    return out


class _Ranges:
    """All ranges of bands: how far each is from one level, in standard deviations.

    The largest of four: the deviance of gamma variables about their mean, of which mean and
    variance are known exactly, and the trends by f, 1/f and log f.
    """

    def __init__(self, frequency: Array, power: Array, shape: Array) -> None:
        x = power / float(np.median(power))
        self._shape = _running(shape)
        self._power = _running(shape * x)
        self._deviance = _running(shape * np.log(x))
        self._expected, self._variance = map(_running, _deviance(shape))
        self._trends = tuple(
            (_running(shape * f), _running(shape * f**2), _running(shape * x * f))
            for f in (frequency / frequency[-1], frequency[0] / frequency, np.log(frequency))
        )

    def distances(self, begin: int) -> tuple[Array, Array]:
        """Return the distances, and the errors of the slope, shape (ranges, k - begin).

        Of the ranges that begin with the band `begin` or one of the next ones.
        """

        def sums(running: Array) -> Array:
            before = running[begin:-1][:_AT_A_TIME, np.newaxis]
            return np.asarray(running[np.newaxis, begin + 1 :] - before)

        with np.errstate(all="ignore"):
            weight = sums(self._shape)
            mean = sums(self._power) / weight
            deviance = 2 * (weight * np.log(mean) - sums(self._deviance))
            worst = (deviance - sums(self._expected)) / np.sqrt(sums(self._variance))
            for regressor, square, product in self._trends:
                centre = sums(regressor) / weight
                spread = sums(square) - weight * centre**2
                trend = sums(product) / mean - weight * centre
                worst = np.fmax(worst, np.abs(trend) / np.sqrt(np.maximum(spread, 1e-300)))
            slope_error = 1 / np.sqrt(np.maximum(spread, 1e-300))  # of the last of the three
        return np.where(np.isfinite(worst), worst, np.inf), slope_error


def _running(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def _from_density(density: Density, unit: str) -> Reading | None:
    """Read N off the flat band."""
    found = flat_band(density)
    if found is None:
        return None
    flat, below, above = found
    frequency = density.frequency[flat]
    lowest, highest = float(frequency[0]), float(frequency[-1])
    if highest > _WIDE * lowest:
        lowest, highest = (
            lowest * (_CLEAR if below else 1.0),
            highest / (_CLEAR if above else 1.0),
        )
        flat = flat & (density.frequency >= lowest) & (density.frequency <= highest)
        frequency = density.frequency[flat]
    level = _level(density, flat)
    if level is None:
        return None
    power, relative = level
    value, half = math.sqrt(power / 2), _SEARCHED * TWO_SIDED_95 * relative / 2
    band = (float(frequency[0]), float(frequency[-1]))
    low, high = value * math.exp(-half), value * math.exp(half)
    return Reading(value, low, high, f"{unit}/sqrt(Hz)", band_hz=band)


def _level(density: Density, flat: NDArray[np.bool_]) -> tuple[float, float] | None:
    """Return the level of the flat band, and its relative standard deviation.

    What falls as 1/f and 1/f^2 is measured from a decade below the band up. Only where that is no
    description, within the band alone: there it was found to be small, so it is taken too small.
    """
    lowest = float(density.frequency[flat][0])
    highest = float(density.frequency[flat][-1])
    inside = (density.frequency >= lowest / _BELOW) & (density.frequency <= highest)
    known = (density.density > 0) & np.isfinite(density.density)
    wider = flat | (inside & known & (density.frequency < lowest) & ~_outliers(density, known))
    rate_hz = 2 * float(density.frequency[-1] + density.width[-1] / 2)  # it ends at half of it
    for chosen, powers in ((wider, 2), (flat, 1)):
        shape = density.averages[chosen]
        falling = np.sin(np.pi * density.frequency[chosen] / rate_hz)
        columns = (falling[0] / falling)[:, np.newaxis] ** np.arange(powers + 1)
        found = _regression(columns, density.density[chosen], shape)
        if found is not None and (chosen is flat or found[2] < _REJECTED):
            return found[:2]
    return None


def _regression(columns: Array, power: Array, shape: Array) -> tuple[float, float, float] | None:
    """Fit gamma variables; return the first number, its relative error, and the excess deviance.

    The last in standard deviations of what is expected.
    """
    expected = np.full(len(power), float(np.average(power, weights=shape)))
    for _ in range(_ROUNDS):
        weight = shape / expected**2
        scale = np.sqrt(np.sum(columns**2 * weight[:, np.newaxis], axis=0))
        scaled = columns / scale
        information = scaled.T @ (scaled * weight[:, np.newaxis])
        covariance = np.linalg.pinv(information, hermitian=True)
        numbers = covariance @ (scaled.T @ (weight * power))
        expected = np.maximum(scaled @ numbers, 0.3 * expected)
    level, error = numbers[0] / scale[0], math.sqrt(covariance[0, 0]) / scale[0]
    if not level > 0:
        return None
    ratio = power / expected
    deviance = float(np.sum(2 * shape * (ratio - 1 - np.log(ratio))))
    mean, variance = _deviance(shape)
    return level, error / level, float((deviance - mean.sum()) / math.sqrt(variance.sum()))


def _deviance(shape: Array) -> tuple[Array, Array]:
    """Return mean and variance of the deviance of gamma variables from what is expected of them."""
    mean = 2 * shape * (np.log(shape) - digamma(shape))
    return np.asarray(mean), np.asarray(4 * shape**2 * (polygamma(1, shape) - 1 / shape))


def _at_one_second(curve: Deviation, unit: str) -> Reading | None:
    """Read the deviation at 1 s, between the averaging times beside it where there is none."""
    usable = np.flatnonzero(curve.trusted & np.isfinite(curve.deviation) & (curve.deviation > 0))
    tau = curve.tau[usable]
    if len(usable) < 2 or not tau[0] <= 1.0 <= tau[-1]:
        return None
    value, low, high = (
        float(np.exp(np.interp(0.0, np.log(tau), np.log(np.maximum(limit[usable], 1e-300)))))
        for limit in (curve.deviation, curve.lower, curve.upper)
    )
    return Reading(value, low, high, f"{unit}/sqrt(Hz)", tau_s=1.0)


def _from_floor(curve: Deviation, unit: str) -> Reading | None:
    """Read B off the least deviation; an upper limit where the curve has not risen from it."""
    best = find_best_averaging(curve)
    if best is None or not best.deviation > 0:
        return None
    low = 0.0 if best.at_end else best.lower / _FLOOR
    return Reading(best.deviation / _FLOOR, low, best.upper / _FLOOR, unit, tau_s=best.tau)


def _slopes_to_the_end(x: Array, y: Array, weight: Array) -> Array:
    """Return the slope of the line through each point and all after it; of the last one, NaN."""

    def rest(values: Array) -> Array:
        return np.asarray(np.cumsum(values[::-1])[::-1])

    x, y, total = x - x[-1:], y - y[-1:], rest(weight)
    centre = rest(weight * x) / total
    spread = rest(weight * x**2) - total * centre**2
    both = rest(weight * x * y) - rest(weight * y) * centre
    return np.divide(both, spread, out=np.full_like(x, np.nan), where=spread > 0)


def _from_rise(curve: Deviation, unit: str) -> Reading | None:
    """Read K in the middle of the longest range that ends the curve and rises as the root of tau.

    The middle, because short of it other noise adds, and beyond it there are few terms. What other
    noise may add there by the slope is in the lower limit.
    """
    usable = np.flatnonzero(curve.trusted & np.isfinite(curve.deviation) & (curve.deviation > 0))
    tau, edf = curve.tau[usable], np.maximum(curve.edf[usable], 1.0)
    log_tau = np.log(tau)
    slopes = _slopes_to_the_end(log_tau, np.log(curve.deviation[usable]), edf)
    for first, slope in enumerate(slopes.tolist()):
        x = log_tau[first:]
        if x[-1] - x[0] < _LONG_ENOUGH:
            return None
        # The deviations are correlated, which makes the slope better known than this.
        error = math.sqrt(0.5 / edf[first] + 0.5 / edf[-1]) / (x[-1] - x[0])
        if _SLOPE[0] < slope < _SLOPE[1] and slope > _SURE * error:
            at = first + int(np.argmin(np.abs(x - (x[0] + x[-1]) / 2)))
            factor = math.sqrt(3 / tau[at])
            value, low, high = (
                float(limit[usable[at]]) * factor
                for limit in (curve.deviation, curve.lower, curve.upper)
            )
            # White noise that lowers the slope by d has d of the variance, flicker noise 2 d.
            others = float(np.clip(0.5 - (slope - error), 0.0, 0.9))
            low *= math.sqrt(1 - others)
            return Reading(value, low, high, f"{unit}/sqrt(s)", tau_s=float(tau[at]))
    return None
