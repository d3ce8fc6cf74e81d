"""The residual of the data against the model, in every domain that is kept.

======================  =====================================================================
deviation curve         measured against model, with the full covariance between taus
whitened spectrum       mean of d_k^2 / lambda_k in log-spaced bands, 1 where the model holds
time series             the innovations, white and of unit variance where the model holds
marginal distribution   kurtosis of the innovations, 0 for a Gaussian
======================  =====================================================================

Before and after, the numbers speak of the same record. Before, the record as measured stands
against the textbook terms. After, what was accepted as deterministic (lines, steps, a warm-up) is
subtracted from it and the rest stands against the refitted terms with the stationary effects,
because a signal has no place in a variance model: that a line was subtracted rather than modelled
makes no difference to the taus it does not touch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank, Deviation
from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import ResidualError
from allanscope.explain.view import View
from allanscope.noise import NoiseFit, NoiseModel, gls_chi2
from allanscope.noise.components import Ramp

__all__ = [
    "Bands",
    "band_scores",
    "deviation_of",
    "error_of",
    "excess_kurtosis",
    "excess_skewness",
    "removes",
]

Array = NDArray[np.float64]

_BANDS = 60
_PER_OCTAVE = 2


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


def removes(view: View, candidate: Candidate) -> bool:
    """Tell whether most of the residual is gone where the candidate changes the spectrum most."""
    after = view.with_parts(*candidate.parts)
    bands = band_scores(view)
    later = band_scores(after)
    change = np.abs(np.log(after.spectrum.at(bands.frequency) / view.spectrum.at(bands.frequency)))
    weight = change * np.sqrt(bands.count)
    own = weight > 0.5 * weight.max()
    if not own.any():
        return False
    first = float(np.sqrt(np.mean(bands.z[own] ** 2)))
    second = float(np.sqrt(np.mean(later.z[own] ** 2)))
    return second < max(3.0, 0.5 * first)


def deviation_of(data: Array, rate_hz: float) -> Deviation:
    """Overlapping Allan deviation on a half-octave grid."""
    bank = AllanBank(rate_hz, axes=1, per_octave=_PER_OCTAVE)
    bank.update(data[:, np.newaxis])
    return bank.deviation("oadev").axis(0)


def error_of(view: View, model: NoiseModel, fit: NoiseFit | None) -> ResidualError:
    """Compare the data of a view with a model, up to a third of the record.

    Parameters
    ----------
    fit : NoiseFit or None
        Of that model: its whitened spectrum holds every frequency there is. None where no stretch
        was long enough; then that of the view is compared.
    """
    curve = deviation_of(view.data, view.grid.rate_hz)
    stride = view.grid.stride  # the model is one of samples
    curve = replace(curve, m=stride * curve.m)
    fitted = sum(
        model.number(f) > 0 for f in model.numbers if not isinstance(model.parts[f.part], Ramp)
    )
    residual = gls_chi2(curve, model, n=stride * view.grid.n, fitted=fitted)
    z = band_scores(view).z if fit is None else fit.bands.z
    return ResidualError(
        chi2_per_dof=residual.chi2 / residual.dof,
        p_value=residual.p_value,
        rms_percent=residual.rms_percent,
        expected_rms_percent=residual.expected_rms_percent,
        worst_band_z=float(z[np.argmax(np.abs(z))]),
    )
