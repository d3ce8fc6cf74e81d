"""An Allan curve against a model, by generalised least squares on its logarithm.

The points of a curve are so correlated that a hundred of them hold the information of nine: a
chi-square that ignores it calls one right model in four wrong at the 5 % level. With their full
covariance the chi-square is right. It shares nothing with the likelihood of the spectrum: the
second opinion. Half an octave between taus is enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaln

from allanscope.allan import Deviation
from allanscope.noise.covariance import (
    LONGEST,
    half_octaves,
    log_bias,
    log_covariance,
    samples,
    whitener,
)
from allanscope.noise.model import NoiseModel

__all__ = ["CurveResidual", "gls_chi2"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CurveResidual:
    """How far a curve is from a model.

    Attributes
    ----------
    chi2, dof, p_value : float, int, float
        Of the log-deviation residual with the full covariance.
    rms_percent : float
        Of measured / model - 1 over the taus, in per cent.
    expected_rms_percent : float
        What sampling alone leaves of it, after a fit of the amplitudes.
    m : ndarray of int, shape (k,)
        Averaging factors that were compared.
    log_ratio : ndarray, shape (k,)
        ln(measured variance / model) less its expectation.
    z : ndarray, shape (k,)
        The same over its standard deviation; correlated between neighbours.
    """

    chi2: float
    dof: int
    p_value: float
    rms_percent: float
    expected_rms_percent: float
    m: NDArray[np.int64]
    log_ratio: Array
    z: Array


def gls_chi2(
    deviation: Deviation, model: NoiseModel, *, n: int | None = None, fitted: int | None = None
) -> CurveResidual:
    """Compare a curve with a model.

    Parameters
    ----------
    deviation : Deviation
        One axis; ``oadev``, ``ohdev`` or ``mdev``.
    model : NoiseModel
        Any model.
    n : int, optional
        Samples in the run; from the number of terms at the shortest tau when not given.
    fitted : int, optional
        Numbers of the model that were fitted to the same data; all that are not zero when not
        given.

    Raises
    ------
    ValueError
        If the curve has several axes, is of another kind, or has no tau shorter than a third of
        the run.

    Examples
    --------
    >>> from allanscope.noise.components import White
    >>> m = np.array([1, 2, 4, 8])
    >>> none = np.full(4, np.nan)
    >>> curve = Deviation("oadev", m / 10, m, 1.01 * (10 / m) ** 0.5, none, none, none,
    ...                   10_001 - 2 * m, np.full(4, ""), 0.95, m > 0)
    >>> residual = gls_chi2(curve, NoiseModel((White(1.0),), dt=0.1), fitted=0)
    >>> round(residual.rms_percent, 2), residual.dof, round(residual.chi2, 2)
    (1.0, 4, 1.95)
    """
    if deviation.deviation.ndim != 1:
        raise ValueError("compare one axis at a time: take deviation.axis(column)")
    n = n or samples(deviation)
    pick = half_octaves(deviation.m, n // LONGEST)
    pick = pick[np.isfinite(deviation.deviation[pick]) & (deviation.deviation[pick] > 0)]
    if len(pick) == 0:
        raise ValueError("the curve has no tau below a third of the run")
    m = deviation.m[pick]
    expected = model.variance(deviation.kind, m)
    correlated, edf = log_covariance(model, deviation.kind, m, n, expected)
    ratio = deviation.deviation[pick] ** 2 / expected
    residual = np.log(ratio) - log_bias(edf)
    whiten, rank = whitener(correlated)
    chi2 = float(np.sum((whiten @ residual) ** 2))
    if fitted is None:
        fitted = sum(value > 0 for part in model for value in part.values)
    dof = max(1, rank - fitted)
    spread = 2 - 2 * np.sqrt(2 / edf) * np.exp(gammaln((edf + 1) / 2) - gammaln(edf / 2))
    if fitted:
        spread = spread * _left_over(model, deviation.kind, m, expected, correlated)
    return CurveResidual(
        chi2=chi2,
        dof=dof,
        p_value=float(chdtrc(dof, chi2)),
        rms_percent=100 * float(np.sqrt(np.mean((np.sqrt(ratio) - 1) ** 2))),
        expected_rms_percent=100 * float(np.sqrt(np.mean(spread))),
        m=m,
        log_ratio=residual,
        z=residual / np.sqrt(np.diag(correlated)),
    )


def _left_over(
    model: NoiseModel, kind: str, m: NDArray[np.int64], expected: Array, covariance: Array
) -> Array:
    """Return the part of each variance that a fit of the amplitudes leaves in the residual."""
    shares = [part / expected for part in model.components_at(kind, m)]
    basis = np.column_stack([share for share in shares if np.any(share > 0)])
    whiten, _ = whitener(covariance)
    absorbed = basis @ np.linalg.pinv(whiten @ basis) @ whiten @ covariance
    return np.asarray(np.clip(1 - np.diag(absorbed) / np.diag(covariance), 0.0, 1.0))
