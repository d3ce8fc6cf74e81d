"""The residual of the data against the model, in every domain that is kept.

======================  =====================================================================
deviation curve         measured against model, with the full covariance between taus
whitened spectrum       mean of d_k^2 / lambda_k in log-spaced bands, 1 where the model holds
time series             the innovations, white and of unit variance where the model holds
marginal distribution   kurtosis of the innovations, 0 for a Gaussian
======================  =====================================================================
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.view import View

__all__ = ["Bands", "band_scores", "excess_kurtosis", "excess_skewness"]

Array = NDArray[np.float64]

_BANDS = 60


@dataclass(frozen=True)
class Bands:
    """The whitened spectrum in log-spaced bands.

    Attributes
    ----------
    frequency, low, high : ndarray, shape (b,)
        Centre and limits in Hz.
    count : ndarray, shape (b,)
        Ordinates in each.
    ratio : ndarray, shape (b,)
        Mean of measured over model.
    z : ndarray, shape (b,)
        (ratio - 1) sqrt(count / 2), in standard deviations; cube-root transformed where a band
        holds few ordinates, whose mean is far from Gaussian.
    """

    frequency: Array
    low: Array
    high: Array
    count: Array
    ratio: Array
    z: Array


def band_scores(view: View, bands: int = _BANDS) -> Bands:
    """Compare the spectrum with the model band by band."""
    grid = view.grid
    u = view.squares / view.spectrum.ordinates
    kept = view.spectrum.kept
    first = min(8, grid.n // 8 + 1)
    edges = np.unique(np.round(np.geomspace(first, grid.n - 1, bands)).astype(int))
    edges = np.concatenate([[0], edges[:-1]])
    count = np.add.reduceat(kept.astype(float), edges)
    ratio = np.add.reduceat(u * kept, edges) / np.maximum(count, 1.0)
    limits = np.append(edges, grid.n - 1)
    unit = grid.rate_hz / (2 * grid.n)
    nu = np.maximum(count, 1.0)
    # Wilson and Hilferty: the cube root of a chi-square is close to Gaussian.
    z = (np.cbrt(ratio) - (1 - 2 / (9 * nu))) / np.sqrt(2 / (9 * nu))
    z[count < 1] = 0.0
    low, high = (limits[:-1] + 0.5) * unit, (limits[1:] + 0.5) * unit
    return Bands(np.sqrt(low * high), low, high, count, ratio, z)


def excess_kurtosis(view: View) -> tuple[float, float]:
    """Kurtosis of the innovations beyond a Gaussian's, and its standard error."""
    squares = view.innovations**2
    variance = float(np.mean(squares))
    return float(np.mean(squares**2) / variance**2 - 3.0), float(np.sqrt(24 / len(squares)))


def excess_skewness(view: View) -> tuple[float, float]:
    """Skewness of the innovations, 0 for a Gaussian, and its standard error."""
    white = view.innovations - view.innovations.mean()
    skewness = float(np.mean(white**3)) / float(np.mean(white**2)) ** 1.5
    return skewness, float(np.sqrt(6 / len(white)))
