"""The Allan curve as evidence: how its points depend on each other, and how far off a model is.

Overlapping estimates at different averaging factors come from the same samples, and neighbours at
half an octave have correlations of 0.5 to 0.95. For Gaussian noise the covariance is exact. With
the transfer function D of the differences (real, about their centre), S the two-sided spectrum and
V = r mean(difference^2)::

    c12(h) = (1/pi) int_0^pi S D1 D2 cos(w h) dw
    Cov(V1, V2) = 2 r^2 / (M1 M2) sum_h w(h) c12(h)^2,    w(h) pairs of terms that are h apart

Where one of the windows is short compared with the run this tends to
(2 r^2 / n) (1/pi) int S^2 D1^2 D2^2 dw, which is what is computed there; where both are long, c12
is summed over lags. A model enters through its density alone, so any model will do.

Curves are compared in logarithms, whose errors hardly depend on the level. With nu degrees of
freedom the logarithm of an estimated variance is biased by psi(nu/2) - ln(nu/2) and has the
variance psi'(nu/2).

A hundred points of a curve hold the information of nine: a chi-square that ignores it calls one
right model in four wrong at the 5 % level. With their full covariance the chi-square is right. It
shares nothing with the likelihood of the spectrum: the second opinion. Half an octave between taus
is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft
from scipy.special import chdtrc, digamma, gammaln, polygamma

from allanscope.allan import Deviation
from allanscope.noise.model import NoiseModel

__all__ = [
    "LONGEST",
    "CurveResidual",
    "Family",
    "deviation_covariance",
    "family_of",
    "gls_chi2",
    "half_octaves",
    "log_bias",
    "log_covariance",
    "samples",
    "whitener",
]

Array = NDArray[np.float64]

_LONG = 64
"""A window is long when this many of them make less than the run."""
_STEPS = 16
"""Lags per shortest of the long windows."""
_PER_DECADE = 80
"""Frequencies a decade on which spectra are integrated."""
_RESOLVED = 35.0
"""m w beyond which the frequency grid does not resolve the oscillation and takes its mean."""
LONGEST = 3
"""Shortest run, in units of the longest window, of which a point is used."""
_SMALLEST = 1e-9
"""Eigenvalues of the correlation below this part of the largest carry no information."""


@dataclass(frozen=True, slots=True)
class Family:
    """What distinguishes the overlapping estimators here.

    Attributes
    ----------
    order : int
        Power of sin(m w / 2) in D.
    averages : int
        Power of 1 / (2 m sin(w / 2)) in D: how often m samples are averaged.
    norm : float
        r.
    span : int
        Samples in a term, in m.
    """

    order: int
    averages: int
    norm: float
    span: int

    def transfer(self, w: Array, m: Array) -> Array:
        """Return D without the oscillating sine power."""
        return np.asarray(2.0**self.order / (2 * m * np.sin(w / 2)) ** self.averages)

    def terms(self, m: Array, n: int) -> Array:
        """Return the number of terms in a run of n samples without gaps."""
        return np.asarray(n - self.span * m + 1, np.float64)


_FAMILIES = {
    "oadev": Family(2, 1, 1 / 2, 2),
    "ohdev": Family(3, 1, 1 / 6, 3),
    "mdev": Family(3, 2, 1 / 2, 3),
}
"""Differences of which each variance is made."""


def family_of(kind: str) -> Family:
    """Return the family of an estimator; ValueError for one whose covariance is not known here."""
    if kind not in _FAMILIES:
        raise ValueError(f"no covariance of {kind!r}; choose one of {', '.join(_FAMILIES)}")
    return _FAMILIES[kind]


def deviation_covariance(model: NoiseModel, kind: str, m: NDArray[np.int64], n: int) -> Array:
    """Return the covariance of the variances (squares of deviations) at several taus.

    Parameters
    ----------
    model : NoiseModel
        What the samples are made of.
    kind : {'oadev', 'ohdev', 'mdev'}
        Estimator.
    m : ndarray of int, shape (k,)
        Averaging factors, ascending.
    n : int
        Samples in the run.

    Returns
    -------
    ndarray, shape (k, k)

    Raises
    ------
    ValueError
        For another estimator, or noise that is steeper than a random walk in one but ohdev.
    """
    family, factors = family_of(kind), np.asarray(m, np.float64)
    if kind != "ohdev" and any(component.is_steep for component in model):
        raise ValueError(
            f"{kind} of noise steeper than a random walk (F, D) grows with the record and has no "
            "expectation; take ohdev"
        )
    covariance = _spectral(model, family, factors, n)
    long = np.flatnonzero(factors * _LONG > n)
    if len(long):
        covariance[np.ix_(long, long)] = _by_lags(model, family, factors[long], n)
    return covariance


def _spectrum(model: NoiseModel, w: Array) -> Array:
    return model.density(w / (2 * np.pi * model.dt)) / (2 * model.dt)


def _spectral(model: NoiseModel, family: Family, m: Array, n: int) -> Array:
    w, weight, passed, unresolved = _passed(family, tuple(m.tolist()))
    power = 2 * family.order
    weighted = weight * _spectrum(model, w) ** 2
    covariance = (passed * weighted) @ passed.T
    # A squared mean is not the mean of the square: the diagonal needs its own.
    excess = _mean_sine(2 * power) / _mean_sine(power) ** 2 - 1
    tail = unresolved @ weighted
    covariance[np.diag_indices_from(covariance)] += excess * tail
    for frequency, power_of_line in (line for part in model for line in part.lines):
        at = np.asarray(2 * np.pi * frequency * model.dt)
        seen = family.transfer(at, m) ** 2 * np.sin(m * at / 2) ** power
        covariance += 2 * power_of_line * float(_spectrum(model, at)) * np.outer(seen, seen)
    return np.asarray(2 * family.norm**2 / n * covariance)


@lru_cache(maxsize=2)  # all axes of a record, and the models before and after, have the same taus
def _passed(family: Family, factors: tuple[float, ...]) -> tuple[Array, Array, Array, Array]:
    """Return frequencies, their weights, what each tau passes of the power, and its square.

    The square is 0 where the sine is resolved.
    """
    m = np.array(factors)[:, np.newaxis]
    low = 0.02 / factors[-1]
    w = np.geomspace(low, np.pi, int(_PER_DECADE * np.log10(np.pi / low)))
    weight = np.log(w[1] / w[0]) * w / np.pi
    weight[[0, -1]] /= 2
    power = 2 * family.order
    resolved = m * w < _RESOLVED
    sine = np.where(resolved, np.sin(m * w / 2) ** power, _mean_sine(power))
    passed = family.transfer(w, m) ** 2 * sine
    return w, weight, passed, np.where(resolved, 0.0, passed**2)


def _by_lags(model: NoiseModel, family: Family, m: Array, n: int) -> Array:
    w, both, pairs, step = _lag_tables(family, tuple(m.tolist()), n)
    covariance = step * np.sum(pairs * (irfft(_spectrum(model, w) * both) / step) ** 2, axis=-1)
    whole = np.empty((len(m), len(m)))
    i, j = np.triu_indices(len(m))
    whole[i, j] = whole[j, i] = covariance
    return 2 * family.norm**2 * whole


@lru_cache(maxsize=2)  # likewise; some three megabytes
def _lag_tables(
    family: Family, factors: tuple[float, ...], n: int
) -> tuple[Array, Array, Array, float]:
    """Return frequencies, and for each pair of taus what both pass and the share of each lag.

    Returns
    -------
    w, both, share, step
        Frequencies, shape (f,); products of the transfer functions, shape (pairs, f); pairs of
        terms at each lag over all pairs of terms, shape (pairs, 2 f - 2), lag 0 first; the step
        of the lags.
    """
    m = np.array(factors)
    step = max(1.0, m[0] / _STEPS)
    size = 1 << int(np.ceil(np.log2(4 * n / step)))
    w = np.linspace(0.0, np.pi / step, size // 2 + 1)
    w[0] = 1e-3 * w[1]
    sines = family.transfer(w, m[:, np.newaxis]) * np.sin(m[:, np.newaxis] * w / 2) ** family.order
    lag = step * np.fft.fftfreq(size, 1 / size)
    terms, centre = family.terms(m, n), family.span * m / 2
    i, j = np.triu_indices(len(m))
    offset = lag + (centre[i] - centre[j])[:, np.newaxis]
    most = np.minimum(terms[i][:, np.newaxis], terms[j][:, np.newaxis] - offset)
    pairs = np.maximum(0.0, most - np.maximum(0.0, -offset))
    return w, sines[i] * sines[j], pairs / (terms[i] * terms[j])[:, np.newaxis], step


def _mean_sine(power: int) -> float:
    """Mean of an even power of the sine over a period."""
    return float(np.prod([(k - 1) / k for k in range(2, power + 1, 2)]))


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
