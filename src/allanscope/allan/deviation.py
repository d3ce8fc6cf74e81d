"""The result of every estimator: a deviation curve with its intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Deviation"]


@dataclass(frozen=True, slots=True)
class Deviation:
    """Deviation against averaging time, with everything needed to judge it.

    Arrays are ``(k,)`` for one axis or ``(axes, k)`` for several; `tau` is always ``(k,)``.

    Attributes
    ----------
    kind : str
        Estimator, e.g. ``"oadev"``.
    tau : ndarray, shape (k,)
        Averaging time in s, ascending: m / rate (0.75 m / rate for the Theo family).
    m : ndarray of int, shape (k,)
        Averaging factor in samples.
    deviation : ndarray
        The estimate in the unit of the data (times s for the time deviations).
    lower, upper : ndarray
        Chi-square limits of `deviation` at confidence `level`.
    edf : ndarray
        Equivalent degrees of freedom.
    terms : ndarray of int
        Number of squared differences in the estimate.
    noise : ndarray of str
        Power law identified at this tau: ``WPM FPM WFM FFM RWFM FWFM RRFM``, or ``""``.
    level : float
        Two-sided confidence of `lower` and `upper`.
    trusted : ndarray of bool, shape (k,)
        False beyond the part of the run up to which DT0064 trusts this estimator.
    """

    kind: str
    tau: NDArray[np.float64]
    m: NDArray[np.int64]
    deviation: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    edf: NDArray[np.float64]
    terms: NDArray[np.int64]
    noise: NDArray[np.str_]
    level: float
    trusted: NDArray[np.bool_]

    def simple_limits(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the limits of DT0064: deviation -+ deviation / sqrt(terms).

        One standard deviation if the terms were independent, which those of overlapping estimators
        are not: at long tau it is far too narrow. Kept for comparison with figures made that way.
        """
        error = self.deviation / np.sqrt(self.terms)
        return self.deviation - error, self.deviation + error

    def axis(self, column: int) -> Deviation:
        """Return the curve of one axis, without the taus at which it has no value."""
        if self.deviation.ndim == 1:
            return self
        keep = np.isfinite(self.deviation[column])
        return Deviation(
            kind=self.kind,
            tau=self.tau[keep],
            m=self.m[keep],
            deviation=self.deviation[column, keep],
            lower=self.lower[column, keep],
            upper=self.upper[column, keep],
            edf=self.edf[column, keep],
            terms=self.terms[column, keep],
            noise=self.noise[column, keep],
            level=self.level,
            trusted=self.trusted[keep],
        )
