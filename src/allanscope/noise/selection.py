"""Which model: the textbook's N B K, a low-pass in front of the white noise, or a Q beside it.

Nothing is assumed. The efficient score of Q^2 at zero, a single number z, says whether the spectrum
bends down or up at its upper end: below zero low-passes are offered, with one and with two poles,
started from the part's own cutoffs and from a grid; above zero a Q is offered. What is offered is
taken only if it gains enough nats *and* removes at least half of the misfit that called for it.
Otherwise the misfit stays visible in the residual, for an effect to explain: on a rate sensor a Q
is nearly always something else, and it needs the stronger evidence of the two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import (
    AngleQuantization,
    BandLimitedWhite,
    Component,
    Flicker,
    RandomWalk,
    Rounding,
    White,
)
from allanscope.noise.components.band_limit import Filter
from allanscope.noise.scoring import Free, WhittleFit
from allanscope.noise.whiteness import whitened
from allanscope.noise.whittle import Likelihood

__all__ = ["QuantizationScore", "quantization_score", "select", "start"]

Array = NDArray[np.float64]

_SUSPICIOUS = 3.5
"""Size of z from which something is offered."""
_LOW_PASS_GAIN = 7.6
"""Nats for a low-pass: fewer than one false one in 10^4 records."""
_Q_GAIN = 12.0
"""Nats for a Q: a false one in 10^6."""
_GRID = (0.03, 0.1, 0.3, 0.6, 1.5)
"""Cutoffs to start from as parts of the Nyquist frequency."""
_FILTERS: tuple[Filter, ...] = ("pole", "butterworth", "digital")


@dataclass(frozen=True)
class QuantizationScore:
    """What the data say about a Q^2 that is not in the model, to first order.

    Attributes
    ----------
    estimate : float
        One scoring step for Q^2 from zero; negative where the spectrum bends down.
    sd : float
        Its standard deviation, everything else fitted.
    """

    estimate: float
    sd: float

    @property
    def z(self) -> float:
        """Estimate over standard deviation."""
        return self.estimate / self.sd

    @property
    def value(self) -> float:
        """Q, zero where the estimate of its square is negative."""
        return float(np.sqrt(max(0.0, self.estimate)))

    @property
    def upper(self) -> float:
        """A Q of which 97.5 % of records would show more than this one does."""
        return float(np.sqrt(max(0.0, self.estimate) + 1.96 * self.sd))


def start(likelihood: Likelihood, lsb: float | None) -> tuple[Component, ...]:
    """Return N, B and K to start a search from, and the rounding where there is an LSB."""
    shapes: tuple[Callable[[float], Component], ...] = (White, Flicker, RandomWalk)
    # Each alone would explain the powers of a third of the bins, ordered by steepness.
    order = np.argsort(likelihood.column(RandomWalk(1.0)), kind="stable")
    thirds = np.array_split(order, 3)
    found = [
        shape(float(np.sqrt(np.mean((likelihood.power / likelihood.column(shape(1.0)))[third]))))
        for shape, third in zip(shapes, thirds, strict=True)
    ]
    return (*found, *((Rounding(lsb),) if lsb else ()))


def select(
    likelihood: Likelihood, fit: WhittleFit, cutoffs: Iterable[float], nyquist: float
) -> WhittleFit:
    """Return the fit with whatever the data demand beside N, B and K.

    Parameters
    ----------
    likelihood : Likelihood
        Of the evidence.
    fit : WhittleFit
        Of the textbook model.
    cutoffs : iterable of float
        What the part's filters may be set to, in Hz.
    nyquist : float
        Half the sample rate in Hz.
    """
    if quantization_score(likelihood, fit).z < -_SUSPICIOUS:
        grid = sorted({*cutoffs, *(share * nyquist for share in _GRID)})
        offers = [
            _low_passed(likelihood, fit, cutoff, kind) for cutoff in grid for kind in _FILTERS
        ]
        fit = _best(likelihood, fit, offers, _LOW_PASS_GAIN)
    score = quantization_score(likelihood, fit)
    if score.z > _SUSPICIOUS:
        fit = _best(likelihood, fit, [(*fit.components, AngleQuantization(score.value))], _Q_GAIN)
    return fit


def quantization_score(likelihood: Likelihood, fit: WhittleFit) -> QuantizationScore:
    """Return what the data say about a Q beside a fitted model."""
    expected, jacobian = likelihood.derivatives(fit.components, fit.free)
    column = likelihood.column(AngleQuantization(1.0))
    weight = likelihood.dof / (2 * expected**2)
    active = jacobian[:, np.any(jacobian != 0, axis=0)]
    scaled = active / np.sqrt(np.sum(weight[:, np.newaxis] * active**2, axis=0))
    block = (scaled * weight[:, np.newaxis]).T @ scaled
    cross = scaled.T @ (weight * column)
    information = float(np.sum(weight * column**2) - cross @ np.linalg.lstsq(block, cross)[0])
    score = float(np.sum(weight * (likelihood.power - expected) * column))
    information = max(information, 1e-12 * float(np.sum(weight * column**2)))
    return QuantizationScore(score / information, information**-0.5)


def _low_passed(
    likelihood: Likelihood, fit: WhittleFit, cutoff: float, kind: Filter
) -> tuple[Component, ...]:
    """Return the model with a low-pass, its powers fitted and its cutoff not yet."""
    column = likelihood.column(BandLimitedWhite(1.0, cutoff, kind))
    level = float(np.sqrt(np.quantile(likelihood.power / column, 0.3)))
    offer = tuple(
        BandLimitedWhite(level, cutoff, kind) if isinstance(c, White) else c for c in fit.components
    )
    index = next(i for i, c in enumerate(offer) if isinstance(c, BandLimitedWhite))
    return likelihood.maximise(offer, held={Free(index, 1)}).components


def _best(
    likelihood: Likelihood,
    fit: WhittleFit,
    offers: list[tuple[Component, ...]],
    least_gain: float,
) -> WhittleFit:
    """Return the best offer if it gains enough and repairs enough, else the fit as it was."""
    tried = sorted(offers, key=likelihood.of, reverse=True)[:2]
    best = max((likelihood.maximise(offer) for offer in tried), key=lambda f: f.log_likelihood)
    enough = best.log_likelihood - fit.log_likelihood > least_gain
    before, after = (whitened(likelihood.evidence, f.expected) for f in (fit, best))
    repaired = after.chi2 - len(after.z) <= 0.5 * max(before.chi2 - len(before.z), 0.0)
    return best if enough and (repaired or abs(after.worst) < _SUSPICIOUS) else fit
