"""Which power law dominates at each averaging time."""

from __future__ import annotations

from numpy.typing import ArrayLike, NDArray

import numpy as np

__all__ = ["NAMES", "identify", "at_factors"]

NAMES = {2: "WPM", 1: "FPM", 0: "WFM", -1: "FFM", -2: "RWFM", -3: "FWFM", -4: "RRFM"}


def identify(
    m: ArrayLike,
    n: int,
    stdvar: ArrayLike,
    avar: ArrayLike,
    hvar: ArrayLike,
    mvar: ArrayLike,
    drift: ArrayLike = 0.0,
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
        same run; NaN where there is none.
    drift : array_like, shape () or (axes,)
        Slope of the rate per sample, which is no noise: taken off stdvar and avar.

    Returns
    -------
    ndarray of int64, same shape as `avar`
        2 WPM, 1 FPM, 0 WFM, -1 FFM, -2 RWFM, -3 FWFM, -4 RRFM. Where there is too little data the
        type of the next shorter tau that has one.
    """
    raise NotImplementedError


def at_factors(wanted: ArrayLike, m: ArrayLike, alpha: ArrayLike) -> NDArray[np.int64]:
    """Return alpha at other averaging factors: that of the nearest `m` in logarithm."""
    raise NotImplementedError
