"""An Allan curve in logarithms: which points, their bias, and how they hang together.

The errors of log-deviations hardly depend on the level. With nu degrees of freedom the logarithm of
an estimated variance is biased by psi(nu/2) - ln(nu/2) and has the variance psi'(nu/2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from allanscope.allan.deviation import Deviation
from allanscope.noise.covariance import deviation_covariance, family_of
from allanscope.noise.model import NoiseModel

__all__ = ["LONGEST", "half_octaves", "log_bias", "log_covariance", "samples", "whitener"]

Array = NDArray[np.float64]

LONGEST = 3
"""Shortest run, in units of the longest window, of which a point is used."""
_SMALLEST = 1e-9
"""Eigenvalues of the correlation below this part of the largest carry no information."""


def half_octaves(m: NDArray[np.int64], longest: int) -> NDArray[np.int64]:
    """Return the indices of the averaging factors nearest to half octaves, up to `longest`.

    >>> half_octaves(np.array([1, 2, 3, 4, 5, 6, 7, 8, 16, 100]), 50)
    array([0, 1, 2, 3, 5, 7, 8])
    """
    if len(m) == 0 or longest < m[0]:
        return np.empty(0, np.int64)
    wanted = 2.0 ** (np.arange(0, 2 * np.log2(longest) + 1e-9) / 2)
    nearest = np.abs(np.log(m)[:, np.newaxis] - np.log(wanted)).argmin(axis=0)
    close = np.abs(np.log2(m[nearest] / wanted)) < 0.25
    picked = np.unique(nearest[close])
    return np.asarray(picked[m[picked] <= longest], np.int64)


def samples(deviation: Deviation) -> int:
    """Return the samples in the run, from the terms at the shortest tau."""
    span = family_of(deviation.kind).span
    return int(deviation.terms[0] + span * deviation.m[0] - 1)


def log_covariance(
    model: NoiseModel, kind: str, m: NDArray[np.int64], n: int, expected: Array
) -> tuple[Array, Array]:
    """Return the covariance of log-variances, and the degrees of freedom of each.

    Parameters
    ----------
    expected : ndarray, shape (k,)
        Variances under the model.
    """
    relative = deviation_covariance(model, kind, m, n) / np.outer(expected, expected)
    edf = 2 / np.diag(relative)
    scale = np.sqrt(polygamma(1, edf / 2) * edf / 2)
    return relative * np.outer(scale, scale), edf


def log_bias(edf: Array) -> Array:
    """Return what the logarithm of a variance is too small by, on average (negative)."""
    return np.asarray(digamma(edf / 2) - np.log(edf / 2))


def whitener(covariance: Array) -> tuple[Array, int]:
    """Return a matrix that makes residuals independent and of unit variance, and its rank."""
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    keep = values > _SMALLEST * values[-1]
    rows = (vectors[:, keep] / np.sqrt(values[keep])).T / sd
    return rows, int(np.count_nonzero(keep))
