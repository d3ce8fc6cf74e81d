"""Which power law dominates at each averaging time.

The degrees of freedom of a variance, and the bias of the modified totals, depend on the kind of
noise. Ratios of variances that a stream keeps anyway tell it:

* at m = 1 the lag-1 autocorrelation of W. Riley and C. Greenhall ("Power law noise identification
  using the lag 1 autocorrelation", EFTF 2004). They difference the data until the autocorrelation
  ``r`` is small; then ``alpha = -2 (r / (1 + r) + d - 1)`` after d differences of the phase. No
  pass over the data is needed: for the rates ``r = 1 - AVAR / STDVAR`` (the B1 ratio of Barnes in
  another guise), for their first differences ``r = 1 - 1.5 HVAR / AVAR``.
* from m = 2 on the ratio ``R(n) = MVAR / AVAR`` (DT0064 and SP 1065 use it to part white from
  flicker PM, which AVAR cannot). It rises with every step from white PM to random run, scatters
  least of all ratios, and unlike the autocorrelation does not confuse white FM with flicker PM.
* where that says random walk or steeper, the growth of HVAR with tau: as tau, tau^2 and tau^3.

Labels are for the eye. Near a knee two noises share a variance, and beyond a 32nd of the run no
ratio tells them apart; but what the shorter times show goes on at the longer ones. Degrees of
freedom and biases therefore rest on levels of the five power laws from white PM to random walk FM
(`levels_of`): the sum of their variances, none negative, that is nearest to AVAR and to
MVAR / AVAR at all octaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.optimise import least_nonnegative

__all__ = [
    "ALPHAS",
    "LETTERS",
    "NAMES",
    "Family",
    "NoiseTypes",
    "alpha_named",
    "at_factors",
    "identify",
    "lagged_phase",
    "levels_of",
    "one_noise",
    "steep_levels",
    "unit_hadamard",
    "unit_variance",
    "without_drift",
]

Floats = NDArray[np.float64]
Family = Literal["avar", "mvar", "hvar"]

NAMES = {2: "WPM", 1: "FPM", 0: "WFM", -1: "FFM", -2: "RWFM", -3: "FWFM", -4: "RRFM"}
"""Names of the power laws of the rate, S_y(f) ~ f^alpha, by alpha."""

LETTERS = {2: "Q", 1: "P", 0: "N", -1: "B", -2: "K", -3: "F", -4: "D"}
"""Letter of the coefficient of each power law."""

ALPHAS = tuple(NAMES)
_ALPHA = np.array(ALPHAS)

_FEWEST_WINDOWS = 32
"""n / m from which on R(n) is right in at least four of five runs whatever the noise."""

_FEWEST_SAMPLES = 8


def alpha_named(noise: str) -> int:
    """Return alpha of a power law by its name; ValueError, with all names, when there is none.

    Examples
    --------
    >>> alpha_named("RWFM")
    -2
    """
    for alpha, name in NAMES.items():
        if name == str(noise).upper():
            return alpha
    raise ValueError(f"unknown noise type {noise!r}; choose one of {' '.join(NAMES.values())}")


def identify(
    m: ArrayLike,
    n: int,
    *,
    stdvar: ArrayLike,
    avar: ArrayLike,
    hvar: ArrayLike,
    mvar: ArrayLike,
    drift: ArrayLike = 0.0,
    drift_seen: tuple[ArrayLike, ArrayLike] | None = None,
) -> NDArray[np.int64]:
    """Return alpha at each averaging factor, from variances that a stream keeps anyway.

    Parameters
    ----------
    m : array_like of int, shape (k,)
        Averaging factors, ascending.
    n : int
        Number of rate samples.
    stdvar, avar, hvar, mvar : array_like, shape (k,) or (axes, k)
        Overlapping standard, Allan, Hadamard (1/6) and modified Allan variance at `m`, from the
        same run; NaN where there is none. `stdvar` counts at m = 1 only; the growth of `hvar` from
        the m before to the one after parts random walk, flicker walk and random run.
    drift : array_like, shape () or (axes,)
        Slope of the rate per sample, which is no noise: taken off `avar` and `mvar`; `hvar` does
        not have it, and in `stdvar` it only makes sure that the differences are asked.
    drift_seen : pair of array_like, shape (k,) or (axes, k), optional
        Mean second difference of the phase over m^2 in `avar` and in `mvar`: the slope as each of
        them has it, from `Archive.mean_second_differences`; `drift` if not given.

    Returns
    -------
    ndarray of int64, same shape as `avar`
        2 WPM, 1 FPM, 0 WFM, -1 FFM, -2 RWFM, -3 FWFM, -4 RRFM. Where there is too little data, the
        type of the next shorter tau that has one; WFM where none has.

    Examples
    --------
    Variances of white FM fall as 1/m, the modified one to half of the others:

    >>> m = np.array([1, 2, 4, 8])
    >>> identify(m, 1000, stdvar=1 / m, avar=1 / m, hvar=1 / m, mvar=(1 + 1 / m**2) / (2 * m))
    array([0, 0, 0, 0])
    """
    m = np.asarray(m, np.float64)
    allan, modified = without_drift(m, n, avar, mvar, drift, drift_seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_ratio = _from_growth(
            m, np.asarray(hvar, np.float64), _from_modified(m, modified / allan)
        )
        by_correlation = _from_correlation(
            n,
            1.0 - allan / np.asarray(stdvar, np.float64),
            1.0 - 1.5 * np.asarray(hvar, np.float64) / allan,
        )
    first = (m == 1) & (n >= _FEWEST_SAMPLES)
    alpha = np.where(first, by_correlation, np.where(m * _FEWEST_WINDOWS <= n, by_ratio, np.nan))
    return _hold(alpha).astype(np.int64)


def without_drift(
    m: ArrayLike,
    n: int,
    avar: ArrayLike,
    mvar: ArrayLike,
    drift: ArrayLike = 0.0,
    drift_seen: tuple[ArrayLike, ArrayLike] | None = None,
) -> tuple[Floats, Floats]:
    """Return AVAR and MVAR without a slope of the rate; arguments as for `identify`."""
    m = np.asarray(m, np.float64)
    slope = np.asarray(drift, np.float64)[..., np.newaxis]
    slope = slope if n >= _FEWEST_WINDOWS else np.zeros_like(slope)  # of few samples it is noise
    in_allan, in_modified = (slope, slope) if drift_seen is None else drift_seen
    # Of <(D - s m^2)^2> / (2 m^2), D being the second differences.
    allan = np.asarray(avar, np.float64) - m**2 * slope * (np.asarray(in_allan) - slope / 2.0)
    modified = np.asarray(mvar, np.float64) - m**2 * slope * (np.asarray(in_modified) - slope / 2.0)
    return allan, modified


def at_factors(wanted: ArrayLike, m: ArrayLike, alpha: ArrayLike) -> NDArray[np.int64]:
    """Return alpha at other averaging factors: that of the nearest `m` in logarithm.

    Parameters
    ----------
    wanted : array_like, shape (j,)
        Averaging factors, or averaging times in samples.
    m : array_like, shape (k,)
        Averaging factors at which alpha is known, ascending.
    alpha : array_like of int, shape (k,) or (axes, k)
        As from `identify`.

    Examples
    --------
    >>> at_factors([1, 5, 6, 100], [1, 4, 8], [2, 0, -1])
    array([ 2,  0, -1, -1])
    """
    known = np.log(np.asarray(m, np.float64))
    between = (known[1:] + known[:-1]) / 2.0
    nearest = np.searchsorted(between, np.log(np.asarray(wanted, np.float64)))
    return np.asarray(alpha, np.int64)[..., nearest]


def _from_modified(m: NDArray[np.float64], ratio: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return alpha from R(n): the power law whose expected ratio is nearest in logarithm.

    Expectations of discrete power-law noise, integrated over frequency; at large m they are 1/m,
    3.37 / (1.04 + 3 ln(pi m)), 1/2, 0.675, 0.825. For alpha < -2 both variances grow with the run,
    and the values are those of runs of 30 to 1000 windows.
    """
    log_m = np.log2(m)
    flicker_pm = 1.0 / np.interp(log_m, [0, 1, 2, 3, 4, 40], [1, 1.8, 2.60, 3.32, 3.98, 26.2])
    small = 1.0 / m**2
    level = np.ones_like(m)
    expected = np.stack(
        [
            1.0 / m,
            flicker_pm,
            0.5 + 0.5 * small,
            0.674 + 0.16 * small,
            0.825 + 0.03 * small,
            0.95 * level,
            level,
        ]
    )
    boundary = np.sqrt(expected[1:] * expected[:-1])
    steps = (ratio[..., np.newaxis, :] > boundary).sum(axis=-2)
    return np.where(ratio > 0, _ALPHA[steps], np.nan)


def _from_growth(m: Floats, hvar: Floats, alpha: Floats) -> Floats:
    """Return alpha with -2, -3 and -4 parted by HVAR, which grows as tau, tau^2 and tau^3.

    The slowest part of the run makes most of the AVAR and MVAR of steep noise: their ratio hardly
    differs.
    """
    size = np.log(hvar)
    place, last = np.arange(m.size), m.size - 1
    # Not from m = 1: there the growth of sampled noise is another one.
    after, before = np.clip(place + 1, 0, last), np.clip(place - 1, min(1, last), last)
    span = np.log(m[after] / m[before])
    growth = (size[..., after] - size[..., before]) / np.where(span > 0, span, np.nan)
    steep = np.clip(-1.0 - np.round(growth), -4.0, -2.0)
    return np.where((alpha <= -2) & np.isfinite(growth), steep, alpha)


def _from_correlation(
    n: int, rates: NDArray[np.float64], differences: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return alpha from the lag-1 autocorrelation of the rates and of their first differences."""
    # White FM has r = 0, flicker FM one that grows with the run: part them half way.
    stationary = rates < max(0.36 - 5.0 / n, 0.2)
    steps = [rates > edge for edge in (-3 / 7, -1 / 5)]
    steps_once_more = [differences > edge for edge in (-7 / 11, -5 / 9, -3 / 7, -1 / 5, 0.35, 0.93)]
    alpha = 2.0 - np.where(stationary, sum(steps), sum(steps_once_more))
    return np.where(np.isfinite(rates) & np.isfinite(differences), alpha, np.nan)


def _hold(alpha: NDArray[np.float64]) -> NDArray[np.float64]:
    """Replace each NaN by the value before it; by 0 at the beginning."""
    last = np.where(np.isfinite(alpha), np.arange(alpha.shape[-1]), -1)
    last = np.maximum.accumulate(last, axis=-1)
    held = np.take_along_axis(alpha, np.maximum(last, 0), axis=-1)
    return np.where(last >= 0, held, 0.0)


@dataclass(frozen=True, slots=True)
class NoiseTypes:
    """The noise of a record: a label at each averaging time, and levels that add up.

    Attributes
    ----------
    alpha : ndarray of int, shape (k,) or (axes, k)
        Label at each averaging time, as from `identify`.
    levels : ndarray, shape (5,) or (axes, 5), or None
        Level of white PM, flicker PM, white FM, flicker FM and random walk FM, in units of
        `unit_variance`; None where the labels are all that is known. An axis of zeros is one that
        has steeper noise, or no variances: its labels count.
    steep : ndarray, shape (7,) or (axes, 7), or None
        Level of every power law for an axis that has a random walk or steeper noise, zeros for
        others. AVAR and MVAR may have no expectation then, so it counts for HVAR alone.
    """

    alpha: NDArray[np.int64]
    levels: Floats | None = None
    steep: Floats | None = None

    def at(self, wanted: ArrayLike, tau: Floats) -> NoiseTypes:
        """Return the noise at other averaging times than the `tau` it was found at."""
        alpha = np.asarray(self.alpha)
        alpha = np.broadcast_to(alpha, (*alpha.shape[:-1], tau.size))
        return NoiseTypes(at_factors(wanted, tau, alpha), self.levels, self.steep)

    def shares(self, family: Family, tau: Floats) -> Floats:
        """Return which part of a variance each power law has, from alpha = 2 to -4.

        Parameters
        ----------
        family : {'avar', 'mvar', 'hvar'}
            Variance.
        tau : ndarray, shape (k,)
            Averaging times in samples.

        Returns
        -------
        ndarray, shape (k, 7) or (axes, k, 7)
        """
        shares = self.shares_of(_unit_at(family, tuple(tau.tolist())), tau.size)
        if family != "hvar" or self.steep is None:
            return shares
        powers = self.steep[..., np.newaxis, :] * unit_hadamard(tau).T
        total = powers.sum(axis=-1, keepdims=True)
        return np.where(total > 0, powers / np.where(total > 0, total, 1.0), shares)

    def shares_of(self, unit: Floats, count: int) -> Floats:
        """Return which part each power law has of a variance that is `unit` of unit level.

        Parameters
        ----------
        unit : ndarray, shape (count, 5)
            As from `unit_variance`, transposed.
        count : int
            Number of averaging times.
        """
        labelled = self._labelled(count)
        if self.levels is None:
            return labelled
        powers = self.levels[..., np.newaxis, :] * unit
        total = powers.sum(axis=-1, keepdims=True)
        mixed = np.zeros(labelled.shape)
        mixed[..., :_LEVELS] = powers / np.where(total > 0, total, 1.0)
        return np.where(total > 0, mixed, labelled)

    def _labelled(self, count: int) -> Floats:
        alpha = np.asarray(self.alpha)
        alpha = np.broadcast_to(alpha, (*alpha.shape[:-1], count))
        return np.asarray(alpha[..., np.newaxis] == _ALPHA, np.float64)


def one_noise(noise: str) -> NoiseTypes:
    """Return one noise type at every averaging time."""
    return NoiseTypes(np.array([alpha_named(noise)]))


def levels_of(m: ArrayLike, n: int, avar: ArrayLike, mvar: ArrayLike, alpha: ArrayLike) -> Floats:
    """Return the levels of the five power laws that together are nearest to a curve.

    Parameters
    ----------
    m : array_like of int, shape (k,)
        Averaging factors: octaves.
    n : int
        Number of rate samples.
    avar, mvar : array_like, shape (axes, k)
        Without drift; NaN where there is none.
    alpha : array_like of int, shape (axes, k)
        Labels: where one is steeper than a random walk there are no levels.

    Returns
    -------
    ndarray, shape (axes, 5)

    Examples
    --------
    >>> m = 2 ** np.arange(8)
    >>> white, walk = unit_variance("avar", m)[[2, 4]]
    >>> slow, fast = unit_variance("mvar", m)[[2, 4]]
    >>> alpha = np.zeros((1, 8), np.int64)
    >>> levels_of(m, 1024, [3 * white + 2 * walk], [3 * slow + 2 * fast], alpha).round(6).tolist()
    [[0.0, 0.0, 3.0, 0.0, 2.0]]
    """
    m = np.asarray(m, np.float64)
    plain, modified = (unit_variance(kind, m).T for kind in _FITTED)
    scale = plain.max(axis=0)
    found = np.zeros((len(np.atleast_2d(avar)), _LEVELS))
    for axis, (allan, smooth, label) in enumerate(
        zip(np.atleast_2d(avar), np.atleast_2d(mvar), np.atleast_2d(alpha), strict=True)
    ):
        use = (m * _FEWEST_SPANS <= n) & (allan > 0) & (smooth > 0)
        if use.sum() < _FEWEST_POINTS or label.min() < -2:
            continue
        size = allan[use].max()
        first, second = plain[use] / scale, modified[use] / scale
        measured, ratio = allan[use] / size, smooth[use] / allan[use]
        apart = m[use] > 1  # at m = 1 the two are the same
        sigma = np.sqrt(2.0 * m[use] / (_EDF * n))
        expected, averaged = measured, smooth[use] / size
        levels = np.zeros(_LEVELS)
        for _ in range(_ROUNDS):
            weight = 1.0 / (expected * sigma)
            of_ratio = (apart / (_RATIO * sigma * averaged))[:, np.newaxis]
            rows = [first * weight[:, np.newaxis]]
            rows.append((second - ratio[:, np.newaxis] * first) * of_ratio)
            wanted = np.append(measured * weight, np.zeros(int(use.sum())))
            try:
                levels = least_nonnegative(np.concatenate(rows), wanted)
            except RuntimeError:  # the columns are nearly dependent: those of the last round stand
                break
            if not levels.any():
                break
            expected, averaged = first @ levels, second @ levels
        found[axis] = levels / scale * size
    return found


_LEVELS = 5
_FITTED: tuple[Family, ...] = ("avar", "mvar")
_FEWEST_SPANS = 8
"""n / m from which on a variance has a say in the levels."""
_FEWEST_POINTS = 3
_EDF = 1.3
"""Degrees of freedom in n / m, roughly, of any noise."""
_RATIO = 0.4
"""Scatter of MVAR / AVAR in that of AVAR: both are of the same samples."""
_ROUNDS = 3
_SUMMED = 256
"""Averaging time up to which MVAR is the exact sum; flicker PM goes on as its limit."""


def steep_levels(m: ArrayLike, n: int, hvar: ArrayLike, alpha: ArrayLike) -> Floats:
    """Return the levels of seven power laws that together are nearest to HVAR.

    Parameters
    ----------
    m : array_like of int
        Averaging factors: octaves.
    n : int
        Number of rate samples.
    hvar : array_like, shape (axes, k)
        Hadamard variance (1/6); NaN where there is none.
    alpha : array_like of int, shape (axes, k)
        Labels: only where one is a random walk, or steeper, there are levels. What is steeper is
        often labelled a random walk before it is long enough to show.

    Returns
    -------
    ndarray, shape (axes, 7)

    Examples
    --------
    >>> m = 2 ** np.arange(8)
    >>> unit = unit_hadamard(m)
    >>> alpha = np.full((1, 8), -3)
    >>> steep_levels(m, 1024, [3 * unit[2] + unit[5]], alpha).round(6).tolist()
    [[0.0, 0.0, 3.0, 0.0, 0.0, 1.0, 0.0]]
    """
    m = np.asarray(m, np.float64)
    unit = unit_hadamard(m).T
    scale = unit.max(axis=0)
    variances, labels = np.atleast_2d(hvar), np.atleast_2d(alpha)
    found = np.zeros((len(variances), len(ALPHAS)))
    for axis in np.flatnonzero(labels.min(axis=-1) <= -2):
        use = (m * _FEWEST_SPANS <= n) & (variances[axis] > 0)
        if use.sum() < _FEWEST_POINTS:
            continue
        design, measured = unit[use] / scale, variances[axis][use]
        sigma = np.sqrt(2.0 * m[use] / (_EDF * n))
        expected, levels = measured, np.zeros(len(ALPHAS))
        for _ in range(_ROUNDS):
            # Steep noise spans many decades: columns of one length keep all of them in the fit.
            columns = design / (expected * sigma)[:, np.newaxis]
            length = np.linalg.norm(columns, axis=0)
            try:
                part = least_nonnegative(columns / length, measured / (expected * sigma))
            except RuntimeError:  # as in `levels_of`
                break
            if not part.any():
                break
            levels = part / length
            expected = design @ levels
        found[axis] = levels / scale
    return found


def unit_hadamard(tau: ArrayLike) -> Floats:
    """Return HVAR of each power law of unit level, from white PM to random run FM.

    Parameters
    ----------
    tau : array_like, shape (k,)
        Averaging times in samples.

    Returns
    -------
    ndarray, shape (7, k)

    Examples
    --------
    Random run grows as tau^3:

    >>> run = unit_hadamard([64, 128])[6]
    >>> round(float(run[1] / run[0]), 2)
    8.0
    """
    t = np.asarray(tau, np.float64)
    weights = (20.0, -30.0, 12.0, -2.0)
    third = [w * _phase_at(k * t) for k, w in enumerate(weights)]
    return np.asarray(np.sum(third, axis=0) / (6.0 * t**2))


def unit_variance(family: Family, tau: ArrayLike) -> Floats:
    """Return the variance of each power law of unit level, from white PM to random walk FM.

    Of discrete noise with the density |2 sin(pi f)|^alpha, up to a factor for each power law that
    all variances have in common.

    Parameters
    ----------
    family : {'avar', 'mvar', 'hvar'}
        Variance.
    tau : array_like, shape (k,)
        Averaging times in samples.

    Returns
    -------
    ndarray, shape (5, k)

    Examples
    --------
    >>> unit_variance("avar", [1, 2, 4])[2].tolist()
    [2.0, 1.0, 0.5]
    """
    t = np.asarray(tau, np.float64)
    if family == "hvar":
        return unit_hadamard(t)[:_LEVELS]
    allan = (6.0 * lagged_phase(0.0 * t) - 8.0 * lagged_phase(t) + 2.0 * lagged_phase(2.0 * t)) / (
        2.0 * t**2
    )
    if family == "avar":
        return allan
    ratio = np.stack([_modified_ratio(float(one)) for one in t.tolist()], axis=-1)
    return np.asarray(allan * ratio)


@lru_cache(maxsize=64)  # estimators of one family, and records of any length, ask the same
def _unit_at(family: Family, tau: tuple[float, ...]) -> Floats:
    return unit_variance(family, tau).T


def lagged_phase(j: Floats) -> Floats:
    """Return the covariance of the phase at a lag in samples, up to what differences remove.

    Of white PM to random walk FM: of steeper noise second differences do not remove the rest.
    """
    return _phase_at(j)[:_LEVELS]


def _phase_at(j: Floats) -> Floats:
    """Return the same of all seven power laws, whose third differences are those of HVAR."""
    from scipy.special import digamma

    odd = 0.5 * (digamma(j + 0.5) - digamma(0.5))
    spike = np.where(j == 0, 1.0, 0.0)
    even = j**2
    flicker_walk = -(even - 0.25) * (even - 2.25) * odd
    random_run = -j * (even - 1.0) * (even - 4.0)
    flicker_fm = (even / 2.0 - 0.125) * odd
    return np.stack([spike, -odd, -j, flicker_fm, j**3 - j, flicker_walk, random_run])


@lru_cache(maxsize=1024)
def _modified_ratio(tau: float) -> Floats:
    """Return MVAR / AVAR of each power law: a sum over pairs up to m = 32, its limit above."""
    if tau > _SUMMED:
        flicker_pm = 3.37 / (1.04 + 3.0 * np.log(np.pi * tau))
        return np.array([1.0 / tau, flicker_pm, *_modified_ratio(float(_SUMMED))[2:]])
    m = max(round(tau), 1)
    d = np.arange(1.0 - m, m)
    total = np.zeros(_LEVELS)
    for k, weight in ((0, 6.0), (1, -4.0), (-1, -4.0), (2, 1.0), (-2, 1.0)):
        total += weight * (lagged_phase(np.abs(d + k * m)) @ (m - np.abs(d)))
    modified = total / (2.0 * float(m) ** 4)
    ratio: Floats = modified / unit_variance("avar", [m])[:, 0]
    return ratio
