"""The averaging factors at which a curve is evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.estimators import Estimator

__all__ = ["Taus", "choose_factors"]

Taus = Literal["octave", "all"] | int | Sequence[float] | NDArray[np.float64]


def choose_factors(estimator: Estimator, taus: Taus, n: int, rate: float) -> NDArray[np.int64]:
    """Return the averaging factors that `taus` asks for and a run of `n` samples can give.

    Parameters
    ----------
    estimator : Estimator
        It sets which factors exist and how much data each one needs.
    taus : {'octave', 'all'}, int or sequence of float
        Powers of two; every factor; so many in each octave; or m / rate in s, for the Theo family
        too, whose own averaging time is three quarters of that.
    n : int
        Number of rate samples.
    rate : float
        Sample rate in Hz.

    Returns
    -------
    ndarray of int64, ascending

    Raises
    ------
    ValueError
        When `taus` is none of these, when a time in s is not a whole factor or needs a longer run,
        or when the run is too short for any factor.

    Examples
    --------
    >>> from allanscope.allan.estimators import REGISTRY
    >>> choose_factors(REGISTRY["oadev"], "octave", 100, 10.0)
    array([ 1,  2,  4,  8, 16, 32])
    >>> choose_factors(REGISTRY["theo1"], [2.0, 4.0], 100, 10.0)
    array([20, 40])
    """
    if isinstance(taus, str):
        if taus == "octave":
            return _available(estimator, _spaced(1, n), n)
        if taus == "all":
            return _available(estimator, np.arange(1, n + 1), n)
        raise ValueError(f"unknown taus {taus!r}; choose octave, all, a number or times in s")
    if np.ndim(taus) == 0:
        if not isinstance(taus, int | np.integer) or isinstance(taus, bool) or taus < 1:
            raise ValueError(
                f"taus as a number is how many in each octave, got {taus!r}; "
                "give averaging times in s as a sequence"
            )
        return _available(estimator, _spaced(int(taus), n), n)
    return _from_seconds(estimator, np.asarray(taus, np.float64).ravel(), n, rate)


def _spaced(per_octave: int, n: int) -> NDArray[np.int64]:
    steps = np.arange(int(np.log2(n) * per_octave) + 1)
    return np.unique(np.round(2.0 ** (steps / per_octave)).astype(np.int64))


def _available(estimator: Estimator, candidates: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    if estimator.even and estimator.admits(2, n):
        candidates = np.unique(2 * ((candidates + 1) // 2))
    factors = [
        m for m in candidates.tolist() if estimator.admits(m, n) and estimator.needed(m) <= n
    ]
    if not factors:
        least = estimator.needed(2 if estimator.even else 1)
        raise ValueError(f"{estimator.name} needs at least {least} samples, got {n}")
    return np.array(factors, np.int64)


def _from_seconds(
    estimator: Estimator, seconds: NDArray[np.float64], n: int, rate: float
) -> NDArray[np.int64]:
    if seconds.size == 0:
        raise ValueError("taus is empty")
    return np.unique([_factor(estimator, float(tau), n, rate) for tau in seconds])


def _factor(estimator: Estimator, tau: float, n: int, rate: float) -> int:
    if not (np.isfinite(tau) and tau > 0):
        raise ValueError(f"tau must be positive and finite, got {tau!r} s")
    exact = tau * rate
    m = round(exact)
    if abs(exact - m) > 1e-9 * exact + 1e-6:
        raise ValueError(
            f"tau {tau:g} s is {exact:g} samples at {rate:g} Hz; "
            f"{estimator.name} needs a whole number of them"
        )
    if not estimator.admits(m, n):
        raise ValueError(
            f"{estimator.name} has no window of {m} samples (tau {tau:g} s at {rate:g} Hz) in {n} "
            "samples; windows of the Theo family are even"
        )
    if estimator.needed(m) > n:
        more = estimator.needed(m) - n
        raise ValueError(
            f"{estimator.name} at tau {tau:g} s needs {more} samples ({more / rate:g} s) more "
            f"than the {n} there are"
        )
    return m
