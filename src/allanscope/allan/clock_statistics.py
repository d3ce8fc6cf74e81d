"""What other stability programs have beside the deviations: clocks compared, time errors, slopes.

* `gcodev` and `three_cornered_hat`: the noise of each of three instruments that are only seen
  against each other, from covariances (Groslambert 1981) or from the variances of the three pairs
  (Gray and Allan 1974).
* `mtie` and `tierms`: the largest and the rms error of a time scale within tau (NIST SP 1065).
* `avlr`: Allan variance linear regression, a coefficient from the level of a straight line of
  known slope through some points of a curve (Guerrier and others 2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.deviation import Deviation
from allanscope.allan.phase import to_phase

__all__ = ["SlopeFit", "avlr", "gcodev", "mtie", "three_cornered_hat", "tierms"]

Floats = NDArray[np.float64]

_LINES = {
    "Q": (-2, 3.0),
    "N": (-1, 1.0),
    "B": (0, 2.0 * np.log(2.0) / np.pi),
    "K": (1, 1.0 / 3.0),
    "R": (2, 0.5),
}
"""Letter of a coefficient to the power of tau in AVAR and the factor of its square."""


def gcodev(first: ArrayLike, second: ArrayLike, rate: float, m: Sequence[int]) -> Floats:
    """Return the Groslambert codeviation of two records at averaging factors.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        Rates of two pairs that share one instrument: A - B and A - C gives the deviation of A.
    rate : float
        Samples per second.
    m : sequence of int
        Averaging factors.

    Returns
    -------
    ndarray, shape (k,)
        The root of the covariance of overlapping Allan terms, with its sign; in the unit of the
        records. A negative one says that the common instrument is lost in the others' noise.

    Raises
    ------
    ValueError
        For records of different lengths, or a factor beyond a half of them.
    """
    one, other = to_phase(first, rate), to_phase(second, rate)
    if one.size != other.size:
        raise ValueError(f"records differ in length: {one.size - 1} and {other.size - 1} samples")
    found = []
    for k in m:
        if not k >= 1 or 2 * k >= one.size:
            raise ValueError(f"no term of m = {k} in {one.size - 1} samples")
        terms, others = (x[2 * k :] - 2.0 * x[k:-k] + x[: -2 * k] for x in (one, other))
        covariance = float(np.mean(terms * others)) / (2.0 * k**2)
        found.append(np.sign(covariance) * np.sqrt(abs(covariance)))
    return np.array(found)


def three_cornered_hat(ab: ArrayLike, bc: ArrayLike, ca: ArrayLike) -> tuple[Floats, ...]:
    """Return the variances of three instruments from those of their three differences.

    Parameters
    ----------
    ab, bc, ca : array_like
        Variances of A - B, B - C and C - A at the same taus, of any estimator.

    Returns
    -------
    a, b, c : ndarray
        Variances; negative where the noise of the others hides an instrument.

    Examples
    --------
    >>> [float(v[0]) for v in three_cornered_hat([5.0], [13.0], [10.0])]
    [1.0, 4.0, 9.0]
    """
    x, y, z = (np.asarray(v, np.float64) for v in (ab, bc, ca))
    return (x + z - y) / 2.0, (x + y - z) / 2.0, (y + z - x) / 2.0


def mtie(phase: ArrayLike, m: Sequence[int]) -> Floats:
    """Return the largest difference of phases within any window of m + 1, at each m.

    Parameters
    ----------
    phase : array_like, shape (n + 1,)
        Time error, or the integral of a rate: an angle.
    m : sequence of int
        Window lengths in samples, ascending or not.

    Notes
    -----
    Extremes of windows of a power of two are found from those of half the length; any window is
    covered by two of them, so the effort is n log(n) and not n m.

    Examples
    --------
    >>> mtie([0.0, 1.0, 3.0, 2.0, 2.0], [1, 2, 4]).tolist()
    [2.0, 3.0, 3.0]
    """
    x = _checked(phase, m)
    low, high, span = x, x, 1
    known: dict[int, tuple[Floats, Floats]] = {1: (low, high)}
    while 2 * span <= x.size:
        low, high = (
            np.minimum(low[:-span], low[span:]),
            np.maximum(high[:-span], high[span:]),
        )
        span *= 2
        known[span] = low, high
    found = []
    for k in m:
        window = k + 1
        part = 1 << (window.bit_length() - 1)
        low, high = known[part]
        rest = window - part
        if rest:
            low, high = np.minimum(low[:-rest], low[rest:]), np.maximum(high[:-rest], high[rest:])
        found.append(float(np.max(high - low)))
    return np.array(found)


def tierms(phase: ArrayLike, m: Sequence[int]) -> Floats:
    """Return the rms of ``x[i + m] - x[i]`` at each m; arguments as in `mtie`.

    Examples
    --------
    >>> tierms([0.0, 1.0, 3.0, 2.0, 2.0], [1, 4]).round(3).tolist()
    [1.225, 2.0]
    """
    x = _checked(phase, m)
    return np.array([float(np.sqrt(np.mean((x[k:] - x[:-k]) ** 2))) for k in m])


def _checked(phase: ArrayLike, m: Sequence[int]) -> Floats:
    x = np.asarray(phase, np.float64)
    if x.ndim != 1 or not np.isfinite(x).all():
        raise ValueError("phase must be a row of finite numbers")
    for k in m:
        if not 1 <= k < x.size:
            raise ValueError(f"no window of {k} samples in {x.size} phases")
    return x


@dataclass(frozen=True, slots=True)
class SlopeFit:
    """A coefficient from points of a curve.

    Attributes
    ----------
    value, lower, upper : float
        With the limits of the curve's confidence.
    chi2, points : float, int
        Weighted squares of what the line leaves in log variance, and points it goes through: far
        more than ``points - 1`` says that the points lie on no line of this slope. Neighbours
        share their data, so the limits take them for one measurement that is as good as the best.
    """

    value: float
    lower: float
    upper: float
    chi2: float
    points: int


def avlr(curve: Deviation, letter: str, low: float, high: float) -> SlopeFit:
    """Return Q, N, B, K or R from the points of an Allan curve between two taus.

    Parameters
    ----------
    curve : Deviation
        Of one axis, ADEV or OADEV.
    letter : {'Q', 'N', 'B', 'K', 'R'}
        The slope of log ADEV is -1, -1/2, 0, 1/2 and 1.
    low, high : float
        Range of tau in s.

    Raises
    ------
    ValueError
        For another letter or curve, or a range without a point.

    Examples
    --------
    >>> from allanscope.allan import deviation
    >>> white = np.random.default_rng(6).normal(size=20_000)
    >>> found = avlr(deviation(white, rate=100.0), "N", 0.01, 1.0)
    >>> found.lower < 0.1 < found.upper, found.points
    (True, 7)
    """
    if letter not in _LINES:
        raise ValueError(f"no coefficient {letter!r}; choose one of {' '.join(_LINES)}")
    if curve.kind not in ("adev", "oadev") or curve.deviation.ndim != 1:
        raise ValueError(f"need the Allan deviation of one axis, got {curve.kind}")
    inside = (curve.tau >= low) & (curve.tau <= high) & (curve.deviation > 0)
    if not inside.any():
        raise ValueError(f"the curve has no point between {low:g} and {high:g} s")
    power, factor = _LINES[letter]
    line = factor * curve.tau[inside] ** power
    squares = curve.deviation[inside] ** 2 / line
    weight = curve.edf[inside] / 2.0  # of a log variance
    level = float(np.exp(np.sum(weight * np.log(squares)) / weight.sum()))
    best = int(np.argmax(weight))
    ratio = [
        float(side[inside][best] / curve.deviation[inside][best])
        for side in (curve.lower, curve.upper)
    ]
    chi2 = float(np.sum(weight * np.log(squares / level) ** 2))
    value = float(np.sqrt(level))
    return SlopeFit(value, value * ratio[0], value * ratio[1], chi2, int(inside.sum()))
