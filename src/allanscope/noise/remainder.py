r"""The nameless remainder: what a fitted model leaves over in the spectrum, as a smooth factor.

No vocabulary is complete. What it lacks must neither bend the coefficients nor be cut out of the
fit, so it stands in the model as a factor exp(s(f)) of the density, fitted last and without a name.
The logarithm s is a penalised spline over the logarithm of the frequency: Gaussian with independent
increments between nodes, for edges, or with a curvature of some length, for bumps. Powers with
:math:`\nu_b` degrees of freedom have the log-likelihood

.. math:: -\tfrac12 \sum_b \nu_b (s_b + r_b e^{-s_b}), \qquad r_b = p_b / \lambda_b ,

whose maximum under the penalty is found by Newton's method (`compiled/remainder.c`). Sizes and
lengths are weighted with their marginal likelihood in Laplace's approximation, as REML is for a
spline: where the named parts leave nothing the best size is zero and there is no remainder. Where
there is one, it is mostly in one place: priors whose size follows that of a first estimate,
smoothed, are weighted beside the others, so that a bump in one octave does not cost the error of a
bump in every octave.
Source: Littenberg and Cornish, BayesLine (arXiv 1410.3852), for the idea of a smooth part below the
named lines; Wood, Generalized Additive Models (2017), section 6.6, for the marginal likelihood.

A level of its own would compete with N. So s is zero where N is read: half of the ordinates below a
fifth of the Nyquist frequency, weighted with the share of white noise in them, lie above it and
half below; none of a range that was left out of the fit and is far louder. A floor that rises
towards the top, as vibration makes it, leaves N alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from allanscope.compiled import Pointer, kernel
from allanscope.noise.components import Component, LineProfile, White
from allanscope.noise.evidence import Evidence
from allanscope.noise.filters import Remainder
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.model import NoiseModel

__all__ = ["Smooth", "smooth_log_ratio", "with_remainder"]

Array = NDArray[np.float64]

_IN, _OUT = Pointer(np.float64, 1), Pointer(np.float64, 1, written=True)
_maximum = kernel(
    *("smooth_maximum", Pointer(np.int64, 1), _IN, _IN, _IN, Pointer(np.float64, 2)),
    *(int, int, int, _OUT, _OUT),
    returns=float,
)

_PER_OCTAVE = 12
"""Nodes: narrower features are lines, and have a component of their own."""
_SIZES = np.geomspace(0.005, 3.0, 11)
"""Standard deviations of s over an octave that are tried."""
_LENGTHS, _LEVELS = (0.2, 0.4, 0.8, 1.6), np.geomspace(0.01, 1.0, 7)
"""Lengths in octaves over which s bends, and standard deviations of its level, that are tried."""
_LOCAL_LENGTHS = (0.1, *_LENGTHS)
"""The same where the size is not the same everywhere."""
_AROUND, _LEAST_LOCAL, _LOCAL_ROUNDS = 0.4, 0.1, 2
"""Octaves over which the size of s is averaged, its least relative size, and rounds."""
_TO_ZERO = 0.3
"""Standard deviation of the level of s at a node, relative to its change over an octave."""
_GAIN = 3.0
"""Log of the marginal likelihood ratio from which there is a remainder: on 1,080 clean records of
9 mixes of N, B and K and three lengths it stayed below 2.8, and but for one below 0.9."""
_SHORT, _FAR_LOUDER = 0.2, np.log(2.5)
"""Part of the Nyquist frequency below which N is read, and logarithm of the power in a range that
was left out over that elsewhere from which it is not read there."""
_ROUNDS = 3
"""Times that the correction and the rest of the model are found from each other."""


@dataclass(frozen=True)
class Smooth:
    """A smooth log-ratio.

    Attributes
    ----------
    frequency : ndarray, shape (k,)
        Nodes in Hz.
    value : ndarray, shape (k,)
        The logarithm of measured over expected power at each.
    gain : float
        Log of the marginal likelihood ratio against none, all sizes and lengths as likely.
    """

    frequency: Array
    value: Array
    gain: float


def with_remainder(fit: Fit, evidence: Sequence[Evidence]) -> Fit:
    """Return a fit with what its model leaves over beside it, its amplitudes fitted again.

    The fit itself where nothing is left over.

    Parameters
    ----------
    fit : Fit
        With every named part, perhaps beside ranges that they do not describe.
    evidence : sequence of Evidence
        With those ranges.
    """
    likelihood = Likelihood(evidence)
    bare, found, trusted = fit, None, fit.likelihood.dof
    fit = replace(fit, likelihood=likelihood, expected=likelihood.expected(fit.model))
    for _ in range(_ROUNDS):
        power, dof, frequency, expected = _evidence(fit, found)
        smooth = smooth_log_ratio(frequency, power / expected, dof)
        if smooth is None or smooth.gain < _GAIN:
            return bare if found is None else fit
        level, error = _level(smooth, fit, frequency, dof, trusted)
        gain = smooth.value - level
        found = Remainder(tuple(smooth.frequency.tolist()), tuple(gain.tolist()), error)
        fit = likelihood.amplitudes(_remeasured(fit.model, bare.model, found))
    return fit


def _remeasured(model: NoiseModel, bare: NoiseModel, found: Remainder) -> NoiseModel:
    """Return the bare model with a remainder, and its measured lines beside that.

    A line has the power that was measured over the noise in its band. Where the remainder is there
    is more noise, or less, so that the line is what is left of as much as there was.
    """
    line = LineProfile.symbol
    noise, beside = bare.without(line), model.without(line, found.symbol).plus(found)

    def measured(component: Component) -> Component:
        if not isinstance(component, LineProfile):
            return component
        centre = (component.edges[:-1] + component.edges[1:]) / 2
        return component.with_more(noise.density(centre) - beside.density(centre))

    return replace(bare, components=tuple(map(measured, bare))).plus(found)


def _level(
    smooth: Smooth, fit: Fit, frequency: Array, dof: Array, trusted: Array
) -> tuple[float, float]:
    """Return the median of s where N is read, weighted with the share of white noise.

    Its error is that of a median of the logarithms of independent ordinates. Where nothing was
    fitted, `trusted` is 0: what is far louder there than where something was lies on no floor.
    """
    white = fit.model.get("N")
    if not isinstance(white, White) or white.power == 0.0:
        return 0.0, 0.0
    weight = dof * fit.likelihood.column(fit.model, white) / fit.expected
    weight = np.where(frequency < _SHORT * 0.5 / fit.model.dt, weight, 0.0)
    value = np.interp(
        np.log2(np.maximum(frequency, 1e-300)), np.log2(smooth.frequency), smooth.value
    )
    fitted = np.where(trusted > 0, weight, 0.0)
    if fitted.any():
        is_far_louder = value > _median(value, fitted) + _FAR_LOUDER
        weight = np.where(is_far_louder & (trusted == 0), 0.0, weight)
    if not weight.any():
        return 0.0, 0.0
    return _median(value, weight), float(np.sqrt(np.pi / np.sum(weight)))


def _median(values: Array, weight: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def smooth_log_ratio(frequency: Array, ratio: Array, dof: Array) -> Smooth | None:
    """Find the smooth logarithm of power ratios.

    Parameters
    ----------
    frequency, ratio, dof : ndarray, shape (b,)
        Centre in Hz, measured over expected power, and degrees of freedom of each bin.

    Returns
    -------
    Smooth or None
        None where there are too few bins.
    """
    used = (dof > 0) & (frequency > 0)
    if np.count_nonzero(used) < 8:
        return None
    x = np.log2(frequency[used])
    first, last = float(x.min()), float(x.max())
    nodes = np.linspace(first, last, max(4, int((last - first) * _PER_OCTAVE) + 1))
    spacing = float(nodes[1] - nodes[0])
    left = np.clip(((x - first) / spacing).astype(np.int64), 0, len(nodes) - 2)
    right_share = (x - nodes[left]) / spacing
    problem = _Problem(left, right_share, ratio[used], dof[used] / 2)
    priors = [_rough(len(nodes), spacing, size) for size in _SIZES]
    priors += [_bent(len(nodes), spacing, a, level) for a in _LENGTHS for level in _LEVELS]
    tried = [problem.at(prior) for prior in priors]
    mean, gain = _averaged(tried)
    if gain >= _GAIN:
        bent = [_bent(len(nodes), spacing, a, v) for a in _LOCAL_LENGTHS for v in _LEVELS]
        for _ in range(_LOCAL_ROUNDS):
            local = _local(mean, spacing)
            mean, _ = _averaged(tried + [problem.at(_scaled(prior, local)) for prior in bent])
    return Smooth(2.0**nodes, mean, gain)


def _averaged(tried: Sequence[tuple[Array, float]]) -> tuple[Array, float]:
    """Return the mean over what sizes and lengths are likely, and the log of their mean likelihood.

    It does better on other data than the likeliest.
    """
    values, gains = zip(*tried, strict=True)
    weights = np.exp(np.array(gains) - max(gains))
    mean = np.average(values, axis=0, weights=weights)
    return mean, max(gains) + float(np.log(weights.mean()))


def _local(s: Array, spacing: float) -> Array:
    """Return the size that s has around each node, relative to its largest."""
    size = np.sqrt(gaussian_filter1d((s - np.median(s)) ** 2, _AROUND / spacing, mode="nearest"))
    return np.maximum(size / max(float(size.max()), 1e-300), _LEAST_LOCAL)


@dataclass(frozen=True)
class _Problem:
    """The penalised likelihood of one set of ratios, which lie between nodes.

    Attributes
    ----------
    left : ndarray of int64, shape (b,)
        Node on the left of each ratio.
    share : ndarray, shape (b,)
        How far it is towards the next one.
    ratio, half : ndarray, shape (b,)
        The ratio, and half of its degrees of freedom.
    """

    left: NDArray[np.int64]
    share: Array
    ratio: Array
    half: Array

    def at(self, prior: Array) -> tuple[Array, float]:
        """Return s at the nodes and the gain in marginal likelihood for one precision of s.

        The precision is banded, (bands, k). Raises LinAlgError where it is not positive.
        """
        (bands, k), bins = prior.shape, len(self.ratio)
        s = np.empty(k)
        gain = _maximum(
            *(self.left, self.share, self.ratio, self.half, prior),
            *(bins, bands, k, s, np.empty(k * (2 * bands + 4) + bins)),
        )
        if np.isnan(gain):
            raise np.linalg.LinAlgError("the precision of a smooth remainder is not positive")
        return s, float(gain)


def _rough(k: int, spacing: float, size: float) -> Array:
    """Return the precision of s, (2, k): independent increments, and a weak pull to zero."""
    increment = 1 / (size**2 * spacing)
    prior = np.zeros((2, k))
    prior[0] = 2 * increment
    prior[0, [0, -1]] = increment
    prior[1, :-1] = -increment
    prior[0] += spacing / (size / _TO_ZERO) ** 2
    return prior


def _bent(k: int, spacing: float, length: float, level: float) -> Array:
    """Return the precision of s, (3, k): second differences over a length, and a level.

    That of a stationary process whose spectrum falls as 1 / (1 + (omega length)^4).
    """
    second = (length / spacing) ** 4
    prior = np.zeros((3, k))
    prior[0] = 1.0
    for first, weight in enumerate((1.0, -2.0, 1.0)):
        for other, beside in enumerate((1.0, -2.0, 1.0)[first:]):
            prior[other, first : k - 2 + first] += second * weight * beside
    return np.asarray(prior * (spacing / (2 * np.sqrt(2) * length * level**2)))


def _scaled(prior: Array, size: Array) -> Array:
    """Return the precision of s times a size at each node."""
    scaled = np.zeros_like(prior)
    for j, band in enumerate(prior):
        stop = prior.shape[1] - j
        scaled[j, :stop] = band[:stop] / (size[:stop] * size[j:])
    return scaled


def _evidence(fit: Fit, found: Remainder | None) -> tuple[Array, Array, Array, Array]:
    """Return powers, degrees of freedom, frequencies and what the named parts expect there.

    A line takes its bins with it: its own power is no chi-square of many degrees of freedom.
    """
    likelihood, model = fit.likelihood, fit.model
    named = model.without(found.symbol) if found is not None else model
    lines = [c for c in named if c.is_line]
    expected = likelihood.expected(named)
    dof = likelihood.dof.copy()
    for line in lines:
        dof[likelihood.column(named, line) > 0.05 * expected] = 0.0
    frequency = np.concatenate([part.frequency for part in likelihood.evidence])
    return likelihood.power, dof, frequency, expected
