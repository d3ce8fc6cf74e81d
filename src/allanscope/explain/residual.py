r"""The residual of the data against the model, in every domain that is kept.

======================  =====================================================================
deviation curve         measured against model, with the full covariance between taus
whitened spectrum       mean of d_k^2 / lambda_k in log-spaced bands, 1 where the model holds
time series             the innovations, white and of unit variance where the model holds
marginal distribution   kurtosis of the innovations, 0 for a Gaussian
======================  =====================================================================

Before and after, the numbers speak of the same record, the same ordinates and the same averaging
times. Before, the record as measured stands against the textbook terms. After, what was accepted as
deterministic (lines, steps, a warm-up) is subtracted from it and the rest stands against the
refitted terms with the stationary effects, because a signal has no place in a variance model: that
a line was subtracted rather than modelled makes no difference to the taus it does not touch.

What the textbook lacks is the log-likelihood that could be gained over it until nothing but
sampling error is left (`shares_of`). All of it is named, nameless or left: with the log-likelihoods
l of the textbook, of the named effects, and of these with everything that has no name,

.. math:: E = (l_{named} - l_{textbook}) + (l_{all} - l_{named}) + \tfrac12 (D - D_{95}),

where D is the deviance of all bins from the final model and :math:`D_{95}` what sampling alone
exceeds in one record of twenty. No term is less than 0. What shows in time or in the distribution
of the samples and not in their spectrum (a change of the white level, heavy tails) adds the
log-likelihood that it gains there. Within what is named each effect has its part in proportion to
the log-likelihood that it gains beside the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.special import digamma, ndtri, polygamma

from allanscope.allan import Deviation
from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import ResidualError, Shares
from allanscope.explain.series import block_means, deviation_of
from allanscope.explain.stationarity import reach_in
from allanscope.explain.view import View
from allanscope.noise import NoiseFit, NoiseModel, gls_chi2
from allanscope.noise.components import LineProfile, Ramp
from allanscope.noise.evidence import DensityBands, Evidence, Ordinates
from allanscope.noise.filters import Remainder
from allanscope.noise.likelihood import Likelihood
from allanscope.noise.whiteness import whitened
from allanscope.quantities import CHI_SQUARE_MEDIAN

__all__ = [
    "Bands",
    "band_scores",
    "error_of",
    "excess_kurtosis",
    "excess_skewness",
    "quartile_deviation",
    "quiet_innovations",
    "removes",
    "same_ordinates",
    "shares_of",
]

Array = NDArray[np.float64]

_BANDS = 60
"""Bands of the whitened spectrum, equally wide in log f, whose worst is reported."""
_PARTS = 64
"""Parts of the record whose powers tell whether it is louder at times."""
_SURELY = 1.645
"""Standard deviations that sampling alone exceeds in one record of twenty."""
_CLASSES = 64
"""Classes of equal probability in which the distribution of the innovations is compared."""
_MISSHAPEN, _COUNTED, _TWICE = 0.35, 32, 2.0
"""Logarithm of measured over model in the median band, of those with so many ordinates, from which
a process has not the form of the spectrum; standard errors that are taken off it."""
_ENDS = 16
"""Rows at each end of the record in which whitening leaves the end of a strong tone."""
_FEWEST, _QUIET = 1000, 0.1
"""Rows, and share of the rows, from which they tell what the distribution of all is."""
_NOTHING = 1.0
"""Nats below which there is no excess to be shared out."""


@dataclass(frozen=True)
class Bands:
    """The whitened spectrum in log-spaced bands.

    Attributes
    ----------
    frequency, low, high : ndarray, shape (b,)
        Centre and limits in Hz.
    first : ndarray, shape (b,)
        Index of the first ordinate.
    count : ndarray, shape (b,)
        Ordinates in each.
    ratio : ndarray, shape (b,)
        Mean of measured over model.
    z : ndarray, shape (b,)
        (ratio - 1) sqrt(count / 2), in standard deviations; cube-root transformed where a band
        holds few ordinates, whose mean is far from Gaussian. Of noise that is louder at times the
        count is that of independent ordinates.
    """

    frequency: Array
    low: Array
    high: Array
    first: NDArray[np.int64]
    count: Array
    ratio: Array
    z: Array

    def means(self, ordinates: Array) -> Array:
        """Return the mean of something in each band, shape (b,)."""
        count = np.diff(self.first, append=len(ordinates))
        return np.asarray(np.add.reduceat(ordinates, self.first) / count)


def band_scores(view: View) -> Bands:
    """Compare the spectrum with the model band by band."""
    grid = view.grid
    u = view.squares / view.spectrum.ordinates
    kept = view.spectrum.outside_zeros
    first = min(8, grid.n // 8 + 1)
    edges = np.unique(np.round(np.geomspace(first, grid.n - 1, _BANDS)).astype(int))
    edges = np.concatenate([[0], edges[:-1]])
    count = np.add.reduceat(kept.astype(float), edges)
    ratio = np.add.reduceat(u * kept, edges) / np.maximum(count, 1.0)
    limits = np.append(edges, grid.n - 1)
    unit = grid.rate_hz / (2 * grid.n)
    nu = _independent(np.maximum(count, 1.0), view.innovations)
    # Wilson and Hilferty: the cube root of a chi-square is close to Gaussian.
    z = (np.cbrt(ratio) - (1 - 2 / (9 * nu))) / np.sqrt(2 / (9 * nu))
    z[count < 1] = 0.0
    low, high = (limits[:-1] + 0.5) * unit, (limits[1:] + 0.5) * unit
    return Bands(np.sqrt(low * high), low, high, edges, count, ratio, z)


def _independent(count: Array, innovations: Array) -> Array:
    r"""Return as how many independent ordinates so many neighbours scatter.

    Where the power of the noise changes with time, ordinates j apart have the correlation
    :math:`\rho_j` that is the cosine transform of the power, and the mean of the squares of m has
    the variance :math:`(2/m) [1 + 2 \sum_j (1 - j/m) \rho_j^2]`.
    """
    power = block_means(innovations**2, _PARTS)
    lag = np.arange(1, len(power))
    mean, *swings = dct(power)
    squares = (np.array(swings) / mean) ** 2
    shares = np.maximum(1 - lag / count[:, np.newaxis], 0.0)
    return np.asarray(count / (1 + 2 * shares @ squares))


def quiet_innovations(view: View) -> Array:
    """Return the innovations of rows in which nothing is there that comes and goes.

    A machine that is switched on and off begins and ends at once, which no spectrum describes. All
    of them where machines take turns and leave too few.
    """
    spans = [span for c in view.accepted for span in c.effect.spans]
    white, quiet = view.innovations[_ENDS:-_ENDS], ~view.rows_within(spans)[_ENDS:-_ENDS]
    enough = max(_FEWEST, _QUIET * len(white))
    return white[quiet] if np.count_nonzero(quiet) > enough else white


def excess_kurtosis(view: View, stretches: int = 1) -> tuple[float, float]:
    """Kurtosis of the innovations beyond a Gaussian's, and its standard error.

    Of several stretches it is the mean of theirs, each with a variance of its own.
    """
    squares = quiet_innovations(view) ** 2
    length = len(squares) // stretches
    squares = squares[: length * stretches].reshape(stretches, length)
    variance = np.maximum(np.mean(squares, axis=1), 1e-300)
    kurtosis = np.mean(squares**2, axis=1) / variance**2 - 3.0
    return float(np.mean(kurtosis)), float(np.sqrt(24 / squares.size))


def quartile_deviation(values: Array) -> float:
    """Return the standard deviation of a Gaussian with the quartiles of some numbers.

    A few that are far from the others leave it as it is.

    Examples
    --------
    >>> round(quartile_deviation(np.append(np.random.default_rng(1).standard_normal(9999), 1e9)), 2)
    1.0
    """
    apart = float(np.ptp(np.quantile(values, (0.25, 0.75))))
    return apart / (2 * math.sqrt(CHI_SQUARE_MEDIAN))


def excess_skewness(view: View) -> tuple[float, float]:
    """Skewness of the innovations, 0 for a Gaussian, and its standard error."""
    white = quiet_innovations(view)
    white = white - white.mean()
    skewness = float(np.mean(white * white**2)) / float(np.mean(white**2)) ** 1.5
    return skewness, float(np.sqrt(6 / len(white)))


def removes(view: View, candidate: Candidate) -> bool:
    """Return whether most of the residual is gone where the candidate changes the spectrum most.

    And whether it has the form of the spectrum there: beside a loud tone that moves, a low-pass or
    correlated noise takes most of the power away and describes none of it.
    """
    after = view.with_parts(*candidate.parts)
    bands = band_scores(view)
    later = band_scores(after)
    change = bands.means(np.abs(np.log(after.spectrum.ordinates / view.spectrum.ordinates)))
    low, high = reach_in(after, candidate)
    change[(bands.high < low) | (bands.low > high)] = 0.0  # there the others have made room
    weight = change * np.sqrt(bands.count)
    own = weight > 0.5 * weight.max()
    if not own.any():
        return False
    known = own & (later.count > _COUNTED)
    apart = np.abs(np.log(later.ratio[known])) - _TWICE * np.sqrt(2 / later.count[known])
    if known.any() and np.median(apart) > _MISSHAPEN:
        return False
    first = float(np.sqrt(np.mean(bands.z[own] ** 2)))
    second = float(np.sqrt(np.mean(later.z[own] ** 2)))
    return second < max(3.0, 0.5 * first)


def error_of(
    view: View,
    model: NoiseModel,
    fit: NoiseFit | None,
    evidence: tuple[Evidence, ...] = (),
    curve: Deviation | None = None,
) -> ResidualError:
    """Compare the data of a view with a model, up to a third of the record.

    Parameters
    ----------
    fit : NoiseFit or None
        Of that model: its whitened spectrum holds every frequency there is. None where no stretch
        was long enough; then that of the view is compared.
    evidence : tuple of Evidence
        Ordinates of which the bands are made; those of the fit when not given.
    curve : Deviation, optional
        That of the data of the view, where it is known.
    """
    curve = curve or deviation_of(view.data[:, np.newaxis], view.grid.rate_hz).axis(0)
    stride = view.grid.stride  # the model is one of samples
    curve = replace(curve, m=stride * curve.m)
    fitted = sum(
        model.number(f) > 0 for f in model.numbers if not isinstance(model.parts[f.part], Ramp)
    )
    residual = gls_chi2(curve, model, n=stride * view.grid.n, fitted=fitted)
    if fit is None:
        z = band_scores(view).z
    else:
        evidence = evidence or fit.evidence
        z = whitened(evidence, Likelihood(evidence).expected(fit.fit.model)).z
    return ResidualError(
        chi2_per_dof=residual.chi2 / residual.dof,
        p_value=residual.p_value,
        rms_percent=residual.rms_percent,
        expected_rms_percent=residual.expected_rms_percent,
        worst_band_z=float(z[np.argmax(np.abs(z))]),
    )


def same_ordinates(first: NoiseFit, second: NoiseFit) -> tuple[Evidence, ...]:
    """Return the evidence of one fit at the frequencies that another was fitted to."""
    return tuple(map(_restricted, first.evidence, second.evidence))


def _restricted(one: Evidence, other: Evidence) -> Evidence:
    if isinstance(one, Ordinates) and isinstance(other, Ordinates):
        return one.without(tuple(r for r in other.excluded if r not in one.excluded))
    if isinstance(one, DensityBands) and isinstance(other, DensityBands):
        return replace(one, dof=np.where(other.dof > 0, one.dof, 0.0))
    return one


def shares_of(view: View, before: NoiseFit, after: NoiseFit) -> tuple[Shares, tuple[float, ...]]:
    """Return what of the excess over sampling error is named, nameless and left.

    Returns
    -------
    Shares, tuple of float
        The whole, and the part of each accepted effect; NaN where there is no excess.
    """
    nameless = [c for c in view.accepted if not c.effect.is_named]
    likelihood = Likelihood(after.evidence)
    model = after.fit.model
    bands = {(one.low, one.high) for c in nameless for one in c.profiles}
    components = tuple(
        one for one in model if not (isinstance(one, LineProfile) and (one.low, one.high) in bands)
    )
    filters = tuple(one for one in model.filters if not isinstance(one, Remainder))
    textbook = Likelihood(same_ordinates(before, after)).amplitudes(before.fit.model).loglik
    named = likelihood.amplitudes(NoiseModel(components, model.dt, filters)).loglik
    gains = np.array([_gain_of(view, c) for c in view.accepted])
    is_named = np.array([c.effect.is_named for c in view.accepted], bool)
    seen = np.array([c.changes_model for c in view.accepted], bool)
    nats = np.zeros(len(gains))
    spectrum = max(named - textbook, 0.0)
    for these, whole in (
        (is_named & seen, spectrum),
        (is_named & ~seen, float(gains[is_named & ~seen].sum())),
    ):
        if these.any() and gains[these].sum() > 0:
            nats[these] = whole * gains[these] / gains[these].sum()
    # What a drift without a name has taken out of the lowest ordinates shows in its gain alone.
    aside = np.array([c.signal is not None or not c.changes_model for c in view.accepted], bool)
    nats[~is_named & aside] = gains[~is_named & aside]
    rest = max(likelihood.of(model) - max(named, textbook), 0.0)
    within = ~is_named & ~aside
    if within.any() and gains[within].sum() > 0:
        nats[within] = rest * gains[within] / gains[within].sum()
        rest = 0.0
    parts = np.array([nats[is_named].sum(), nats[~is_named].sum() + rest, _left(after)])
    excess = float(parts.sum())
    if excess < _NOTHING:
        return Shares.none(), (float("nan"),) * len(gains)
    return Shares(excess, *(parts / excess).tolist()), tuple((nats / excess).tolist())


def _gain_of(view: View, candidate: Candidate) -> float:
    """Return the log-likelihood that an effect gains on its axis.

    Nought for what is read off the values, for the clock, which is of the stream, and for Q and R,
    which the textbook model before has as well.
    """
    if candidate.effect.of_the_stream or candidate.effect.is_coefficient:
        return 0.0
    if candidate.effect.shows_in_distribution:
        return _gain_of_distribution(view)
    return max(float(candidate.gain), 0.0) if np.isfinite(candidate.gain) else 0.0


def _gain_of_distribution(view: View) -> float:
    """Return what the distribution of the innovations gains over a Gaussian's, in nats.

    Coarse values leave lumps in it, a step apart: dither of two steps makes it smooth again.
    """
    step = view.step / view.series.stride * float(np.mean(1 / np.sqrt(view.spectrum.ordinates)))
    dither = np.random.default_rng(0).triangular(-1.0, 0.0, 1.0, len(view.innovations))
    dithered = view.innovations + step * dither
    white = dithered / np.std(dithered)
    limits = ndtri(np.arange(1, _CLASSES) / _CLASSES)
    count = np.bincount(np.searchsorted(limits, white), minlength=_CLASSES)
    seen = count[count > 0]
    gain = float(np.sum(seen * np.log(seen * _CLASSES / len(white))))
    return max(gain - (_CLASSES - 1) / 2, 0.0)


def _left(fit: NoiseFit) -> float:
    """Return the nats by which the bins are farther from the fitted model than sampling allows."""
    likelihood = Likelihood(fit.evidence)
    used = likelihood.dof > 0
    shape = likelihood.dof[used] / 2
    ratio = likelihood.power[used] / likelihood.expected(fit.fit.model)[used]
    ratio = np.maximum(ratio, 1e-300)
    deviance = float(np.sum(2 * shape * (ratio - 1 - np.log(ratio))))
    mean = float(np.sum(2 * shape * (np.log(shape) - digamma(shape))))
    spread = float(np.sqrt(np.sum(4 * shape**2 * (polygamma(1, shape) - 1 / shape))))
    return max((deviance - mean - _SURELY * spread) / 2, 0.0)
