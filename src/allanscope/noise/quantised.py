"""Records that the step of the numbers limits, not the sensor.

Stock firmware truncates accelerations to 1 mg, and a gyro at 2000 dps has steps of 70 mdps, more
than its noise. Such a record shows a few codes or a constant, and its Allan curve can be anything
from 25 times the truth to zero, depending on where the mean lies between two codes. While the noise
before rounding is at least half a step, rounding only adds step^2 / 12 to the variance; below, the
error itself depends on the noise (Widrow and Kollar, Quantization Noise, 2008, chapter 4).

That addition is white only where samples change enough from one to the next. Behind a low-pass far
below the sample rate several samples in turn have nearly the same error (`rounding_correlation`).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.parts import ACCEL_SCALES, GYRO_SCALES, full_scale_of
from allanscope.quantities import LEVEL

__all__ = [
    "LEAST_NOISE",
    "LIMIT",
    "find_step",
    "on_lattice",
    "resolution_advice",
    "rounding_correlation",
]

Array = NDArray[np.float64]

LIMIT = 0.5
"""Noise before rounding, in steps, from which rounding only adds step^2 / 12."""
_OFF = 0.01
"""Distance from a lattice, in steps, that numbers printed with few digits may have."""
_LOOKED_AT = 1 << 16
"""Samples from which the lattice is read."""
_FEWEST = 4
"""Fewest samples a value that make a lattice of printed numbers."""
_APART = 100.0
"""Distance of two codes over that of the values of one, which the last digits make."""
_TURNS = 3
"""Most times that the step is found again from the samples that lie on its lattice."""
_PRINTED = 0.3
"""Distance from the lattice, in steps, that printing to few digits may leave."""
_WHITE = 0.01
"""Correlation of neighbouring rounding errors below which they are white: as much of q^2/12."""
LEAST_NOISE = 0.4
"""Noise in steps from which the equation of the correlation holds: where the mean lies between two
codes then changes it by exp(-2 pi^2 0.16), 4 %, at most."""
_MOST_LAGS = 1024
"""Samples apart at which they are looked at."""
_WAVES = np.arange(1, 400)
"""Terms of the series of the correlation; the rest is less than 0.0016."""
_CHANGES = np.concatenate([[0.0], np.geomspace(1e-6, 3.0, 400)])
"""Mean squared changes, in squared steps, between which it is interpolated."""


def on_lattice(values: ArrayLike, step: float) -> bool:
    """Return whether all values are multiples of a step (or sums of such).

    >>> on_lattice([0.07, 0.14, -0.21], 0.07), on_lattice([0.07, 0.15], 0.07)
    (True, False)
    """
    if not step > 0:
        return False
    samples = _some(np.asarray(values, np.float64).ravel())
    in_steps = samples / step
    tolerance = np.maximum(_OFF, 1e-9 * np.abs(in_steps))
    return bool(np.all(np.abs(in_steps - np.round(in_steps)) <= tolerance))


def find_step(values: ArrayLike) -> float:
    """Return the step of a lattice that the values lie on; 0 where there is none, or one value.

    The smallest distance of two distinct values is the step, or a multiple of it, if all distances
    are multiples of a common one. Where the values were printed with few digits none of that is
    exact: the step is then the slope of a straight line through the codes that occur. Values that
    were computed in more than one way differ in their last digits, of which text has more near 0.

    >>> round(find_step([0.0, 0.14, 0.21, -0.07]), 9)
    0.07
    >>> round(find_step([0.07, 0.14, 1e-10, -3e-10, -0.07]), 9)
    0.07
    """
    samples = _some(np.asarray(values, np.float64).ravel())
    distinct = _codes(np.unique(samples))
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * float(np.max(np.abs(distinct), initial=0.0))]
    if len(gaps) == 0:
        return 0.0
    smallest = float(gaps.min())
    for divisor in (1, 2, 3):
        step = smallest / divisor
        if on_lattice(distinct - distinct[0], step):
            multiples = np.round((distinct - distinct[0]) / step)
            exact = float(np.dot(multiples, distinct - distinct[0]) / np.dot(multiples, multiples))
            # Values without a lattice have gaps far smaller than their scatter.
            return exact if np.ptp(multiples) < 1e6 else 0.0
    return _printed_step(distinct) if len(distinct) <= len(samples) / _FEWEST else 0.0


def rounding_correlation(values: ArrayLike, step: float) -> tuple[float, ...]:
    r"""Return the correlation of the rounding errors of samples 1, 2, ... apart; empty if white.

    Where the noise before rounding is at least 0.4 steps wide, errors k samples apart have

    .. math:: r_k = \frac{6}{\pi^2} \sum_{m \ge 1} \frac{1}{m^2} e^{-2 \pi^2 m^2 D_k / q^2}

    with the mean squared change :math:`D_k` of what is rounded (the characteristic function of a
    Gaussian change; Widrow and Kollar, chapter 9). The changes of the rounded values are
    :math:`D_k + q^2 (1 - r_k) / 6`, which gives :math:`D_k`. At :math:`D_1 > 0.23 q^2`, as of white
    noise above a third of a step, neighbours have less than 1 % in common.

    Parameters
    ----------
    values : array_like, shape (n,)
        Rounded samples.
    step : float
        q.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(10_000)
    >>> rounding_correlation(np.round(noise), 1.0)
    ()
    >>> slow = np.convolve(noise, np.ones(50) / 50**0.5, "valid")
    >>> [round(r, 2) for r in rounding_correlation(np.round(slow), 1.0)[:3]]
    [0.28, 0.13, 0.06]
    """
    samples = np.asarray(values, np.float64)
    if not step > 0 or len(samples) < 4:
        return ()
    variance = float(samples.var()) - step**2 / 12
    beside = _correlation_at(np.mean(np.diff(samples) ** 2) / step**2)
    if variance < (LEAST_NOISE * step) ** 2 or beside < _WHITE:
        return ()
    changes = _mean_squared_changes(samples, min(_MOST_LAGS, len(samples) // 2))
    correlation = _correlation_at(changes / step**2)
    last = int(np.argmax(correlation < _WHITE)) if correlation.min() < _WHITE else len(correlation)
    return tuple(correlation[: last + 1].tolist())


def _correlation_at(changes: ArrayLike) -> Array:
    """Return r of rounding errors by the mean squared changes of rounded values, in steps^2."""
    return np.asarray(np.interp(np.asarray(changes), *_correlations()))


@cache
def _correlations() -> tuple[Array, Array]:
    """Return mean squared changes of rounded values, and the correlation at each."""
    known = 6 / np.pi**2 * (np.exp(-2 * np.pi**2 * np.outer(_CHANGES, _WAVES**2)) @ _WAVES**-2.0)
    return _CHANGES + (1 - known) / 6, known


def _mean_squared_changes(samples: Array, lags: int) -> Array:
    """Return the mean of (x[t + k] - x[t])^2 for 0 < k < lags, by one transform for all.

    Examples
    --------
    >>> _mean_squared_changes(np.array([0.0, 1.0, 3.0, 7.0]), 3).round(9).tolist()
    [7.0, 22.5]
    """
    x = samples - samples.mean()
    n, k = len(x), np.arange(1, lags)
    size = 1 << (n + lags - 1).bit_length()
    products = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[1:lags]
    squares = np.concatenate([[0.0], np.cumsum(x**2)])
    changes = squares[n - k] + squares[n] - squares[k] - 2 * products
    return np.asarray(np.maximum(changes, 0.0) / (n - k))


def _codes(distinct: Array) -> Array:
    """Return the means of groups of sorted values that lie far closer together than these do."""
    apart = np.diff(distinct)
    ascending = np.sort(apart)
    if len(apart) < 2:
        return distinct
    jumps = ascending[1:] / ascending[:-1]
    widest = int(np.argmax(jumps))
    starts = np.concatenate([[0], np.flatnonzero(apart > ascending[widest]) + 1])
    widths = np.append(distinct[starts[1:] - 1], distinct[-1]) - distinct[starts]
    if jumps[widest] < _APART or np.max(widths) > _OFF * ascending[widest + 1]:
        return distinct
    counts = np.diff(np.append(starts, len(distinct)))
    return np.asarray(np.add.reduceat(distinct, starts) / counts)


def _printed_step(distinct: Array) -> float:
    """Return the step of sorted values, each printed to some digits; 0 where there is none."""
    apart = np.diff(distinct)
    same = apart < 1e-3 * np.quantile(apart, 0.9)  # one code, computed in two ways
    codes = distinct[np.concatenate([[True], ~same])]
    slope = float(np.diff(codes).min())
    for _ in range(_TURNS):
        index = np.concatenate([[0.0], np.cumsum(np.round(np.diff(codes) / slope))])
        slope, start = (float(x) for x in np.polyfit(index, codes, 1))
    rest = codes - start - slope * index
    return slope if np.max(np.abs(rest)) < _PRINTED * slope else 0.0


def _some(values: Array) -> Array:
    """Return evenly chosen blocks of a long record."""
    if len(values) <= _LOOKED_AT:
        return values
    blocks = np.array_split(values, 16)
    return np.concatenate([block[: _LOOKED_AT // 16] for block in blocks])


def resolution_advice(unit: str, step: float = 0.0, *, constant: bool = False) -> str:
    """Return what to do about a step that is too coarse, in one sentence.

    Parameters
    ----------
    unit : {'dps', 'g'}
        Of the axis.
    step : float
        Distance of neighbouring values; 0 where it is not known.
    constant : bool
        True when there is only one value.

    Examples
    --------
    >>> resolution_advice("dps", 0.07, constant=True)
    "no noise to measure; choose a smaller full scale, such as 125 or 250 dps, to see the sensor's
    own noise"
    >>> resolution_advice("g", 1e-3)
    "the noise is below half a step of 1 mg, which is no step of the sensor: use a firmware that
    sends raw counts to see the sensor's own noise"
    """
    reading = LEVEL[unit]
    size = f" of {step * reading.factor:.4g} {reading.unit}" if step else ""
    what = "no noise to measure" if constant else f"the noise is below half a step{size}"
    scales = ACCEL_SCALES if unit == "g" else GYRO_SCALES
    full_scale = full_scale_of("ax" if unit == "g" else "gx", step) if step else None
    if step and full_scale is None:
        what += ", which is no step of the sensor"
        remedy = "use a firmware that sends raw counts"
    elif full_scale == min(scales):
        remedy = "this is the smallest full scale, let the part sample faster and average"
    else:
        smaller = [f"{scale:g}" for scale in sorted(scales) if not full_scale or scale < full_scale]
        remedy = f"choose a smaller full scale, such as {' or '.join(smaller[:2])} {unit},"
    return f"{what}{';' if constant else ':'} {remedy} to see the sensor's own noise"
