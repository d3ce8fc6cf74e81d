"""Which power law dominates at each averaging time.

The degrees of freedom of a variance, and the bias of the modified totals, depend on the kind of
noise. Two ratios of variances that a stream keeps anyway tell it:

* at m = 1 the lag-1 autocorrelation of W. Riley and C. Greenhall ("Power law noise identification
  using the lag 1 autocorrelation", EFTF 2004). They difference the data until the autocorrelation
  ``r`` is small; then ``alpha = -2 (r / (1 + r) + d - 1)`` after d differences of the phase. No
  pass over the data is needed: for the rates ``r = 1 - AVAR / STDVAR`` (the B1 ratio of Barnes in
  another guise), for their first differences ``r = 1 - 1.5 HVAR / AVAR``.
* from m = 2 on the ratio ``R(n) = MVAR / AVAR`` (DT0064 and SP 1065 use it to part white from
  flicker PM, which AVAR cannot). It rises with every step from white PM to random run, scatters
  least of all ratios, and unlike the autocorrelation does not confuse white FM with flicker PM.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["NAMES", "alpha_named", "at_factors", "identify"]

NAMES = {2: "WPM", 1: "FPM", 0: "WFM", -1: "FFM", -2: "RWFM", -3: "FWFM", -4: "RRFM"}
"""Names of the power laws of the rate, S_y(f) ~ f^alpha, by alpha."""

_ALPHA = np.array([2, 1, 0, -1, -2, -3, -4])

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
        same run; NaN where there is none. `stdvar` and `hvar` count at m = 1 only.
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
    slope = np.asarray(drift, np.float64)[..., np.newaxis]
    slope = slope if n >= _FEWEST_WINDOWS else np.zeros_like(slope)  # of few samples it is noise
    in_allan, in_modified = (slope, slope) if drift_seen is None else drift_seen
    # Of <(D - s m^2)^2> / (2 m^2), D being the second differences.
    allan = np.asarray(avar, np.float64) - m**2 * slope * (np.asarray(in_allan) - slope / 2.0)
    modified = np.asarray(mvar, np.float64) - m**2 * slope * (np.asarray(in_modified) - slope / 2.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_ratio = _from_modified(m, modified / allan)
        by_correlation = _from_correlation(
            n,
            1.0 - allan / np.asarray(stdvar, np.float64),
            1.0 - 1.5 * np.asarray(hvar, np.float64) / allan,
        )
    first = (m == 1) & (n >= _FEWEST_SAMPLES)
    alpha = np.where(first, by_correlation, np.where(m * _FEWEST_WINDOWS <= n, by_ratio, np.nan))
    return _hold(alpha).astype(np.int64)


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
