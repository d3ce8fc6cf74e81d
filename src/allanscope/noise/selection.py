"""Which model: the textbook's N B K, a low-pass in front of the white noise, or a Q beside it.

Nothing is assumed. The efficient score of Q^2 at zero, a single number z, says whether the spectrum
bends down or up at its upper end: below zero low-passes are offered, with one and with two poles,
started from the part's own cutoffs and from a grid; above zero a Q is offered. What is offered is
taken only if it gains enough nats *and* removes at least half of the misfit that called for it.
Otherwise the misfit stays visible in the residual, for an effect to explain: on a rate sensor a Q
is nearly always something else, and it needs the stronger evidence of the two.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.components import (
    AngleQuantization,
    Flicker,
    RandomWalk,
    Rounding,
    White,
)
from allanscope.noise.filters import AnalogueLowPass, Butterworth, LowPass, OnePole
from allanscope.noise.likelihood import Fit
from allanscope.noise.model import NoiseModel
from allanscope.noise.whiteness import whitened
from allanscope.quantities import TWO_SIDED_95

__all__ = [
    "LOW_PASS_PENALTY",
    "Q_PENALTY",
    "QuantizationScore",
    "calibrated_penalty",
    "quantization_score",
    "select",
    "textbook",
]

Array = NDArray[np.float64]

_SUSPICIOUS = 3.5
"""Size of z from which something is offered."""
LOW_PASS_PENALTY = math.log(12 / 1e-3)
"""Gain that a low-pass must have, in nats: a dozen cutoffs are tried."""
Q_PENALTY = math.log(2 / 1e-3)
"""Gain that a Q must have, in nats."""
_GRID = (0.03, 0.1, 0.3, 0.6, 1.5)
"""Cutoffs to start from as parts of the Nyquist frequency."""
_FILTERS: tuple[type[LowPass], ...] = (OnePole, AnalogueLowPass, Butterworth)


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
        return float(np.sqrt(max(0.0, self.estimate) + TWO_SIDED_95 * self.sd))


def calibrated_penalty(kind: str) -> float:
    """Return the gain in nats that a kind of effect must have, where no equation tells it.

    It comes from `calibration.toml`, beside what `benchmarks/calibrate.py` measured for it.

    >>> calibrated_penalty("step")
    12.0
    """
    table = tomllib.loads(files(__package__).joinpath("calibration.toml").read_text("utf-8"))
    return float(table[kind]["penalty"])


def textbook(dt: float, rounding: Rounding | None) -> NoiseModel:
    """Return N, B and K of unit size, and the rounding where there is any."""
    known = (rounding,) if rounding else ()
    return NoiseModel((White(1.0), Flicker(1.0), RandomWalk(1.0), *known), dt)


def select(fit: Fit, cutoffs: Iterable[float]) -> Fit:
    """Return the fit with whatever the data demand beside N, B and K.

    Parameters
    ----------
    fit : Fit
        Of the textbook model.
    cutoffs : iterable of float
        What the part's filters may be set to, in Hz.
    """
    nyquist = 0.5 / fit.model.dt
    if quantization_score(fit).z < -_SUSPICIOUS:
        grid = sorted({*cutoffs, *(share * nyquist for share in _GRID)})
        offers = [fit.model.plus(kind(cutoff)) for cutoff in grid for kind in _FILTERS]
        fit = _best(fit, offers, LOW_PASS_PENALTY)
    score = quantization_score(fit)
    if score.z > _SUSPICIOUS:
        fit = _best(fit, [fit.model.plus(AngleQuantization(score.value))], Q_PENALTY)
    return fit


def quantization_score(fit: Fit) -> QuantizationScore:
    """Return what the data say about a Q beside a fitted model."""
    likelihood, expected = fit.likelihood, fit.expected
    column = likelihood.column(fit.model, AngleQuantization(1.0))
    weight = likelihood.dof / (2 * expected**2)
    jacobian = fit.jacobian * expected[:, np.newaxis]
    active = jacobian[:, np.any(jacobian != 0, axis=0)]
    scaled = active / np.sqrt(np.sum(weight[:, np.newaxis] * active**2, axis=0))
    block = (scaled * weight[:, np.newaxis]).T @ scaled
    cross = scaled.T @ (weight * column)
    information = float(np.sum(weight * column**2) - cross @ np.linalg.lstsq(block, cross)[0])
    score = float(np.sum(weight * (likelihood.power - expected) * column))
    information = max(information, 1e-12 * float(np.sum(weight * column**2)))
    return QuantizationScore(score / information, information**-0.5)


def _best(fit: Fit, offers: list[NoiseModel], least_gain: float) -> Fit:
    """Return the best offer if it gains enough and repairs enough, else the fit as it was."""
    likelihood = fit.likelihood
    tried = sorted((likelihood.amplitudes(offer) for offer in offers), key=lambda f: -f.loglik)[:2]
    best = max((likelihood.maximise(one.model) for one in tried), key=lambda f: f.loglik)
    enough = best.loglik - fit.loglik > least_gain
    before, after = (whitened(likelihood.evidence, f.expected) for f in (fit, best))
    repaired = after.chi2 - len(after.z) <= 0.5 * max(before.chi2 - len(before.z), 0.0)
    return best if enough and (repaired or abs(after.worst) < _SUSPICIOUS) else fit
