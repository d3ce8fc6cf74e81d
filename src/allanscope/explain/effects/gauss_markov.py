r"""First-order Gauss-Markov noise: a bias that forgets itself after a correlation time.

Spotted by the Whittle likelihood profiled over the correlation time, N, B and K refitted at each:
flicker, white noise and a random walk together imitate up to nine tenths of it. The sampled
process has an ordinate variance, with :math:`\phi = e^{-1/(f_s T_c)}`,

.. math:: \sigma^2 (1 - \phi^2) / (1 - 2 \phi \cos 2 \pi f / f_s + \phi^2)

A random telegraph signal has the same spectrum; only its two levels tell them apart.

The likelihood of sigma is no parabola: flicker and the random walk, which imitate the process, are
mostly 0 beside it and can only grow. Its interval is where the likelihood, N, B and K refitted, has
fallen by 1.92 nats, along the line on which the likeliest correlation time goes with sigma.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, is_alike
from allanscope.explain.effects.band_limit import low_pass_instead
from allanscope.explain.effects.unexplained import lasting
from allanscope.explain.regression import reach_at_95
from allanscope.explain.spectrum import Spectrum
from allanscope.explain.stationarity import UNSTEADY
from allanscope.explain.view import View
from allanscope.noise.components import GaussMarkov as Process
from allanscope.noise.grid import Grid
from allanscope.noise.part import Part
from allanscope.optimise import minimise_between

Array = NDArray[np.float64]

_PER_DECADE = 5
"""Correlation times tried a decade: half a step off, the likelihood has lost next to nothing."""
_TELLING = 25.0
"""Ratio of the process to the noise within a dwell above which two levels would be seen."""
_SHORTEST, _AT_THE_END = 1.5, 1.05
"""Shortest correlation time looked for, in rows: a shorter one bends white noise over the whole
band, as a low-pass does, and cannot be told from it. What is likeliest there is no process."""
_VAGUE = 5.0
"""Standard error of ln sigma beyond which it is not known at all."""
_FARTHEST = 3.0
"""Logarithm of the largest factor by which the correlation time goes with sigma."""
_LONGEST = 0.15
"""Longest correlation time looked for, as a share of the record: beyond, it is a random walk."""


@dataclass(frozen=True)
class GaussMarkov(EffectKind):
    """First-order Gauss-Markov noise."""

    sigma: Estimate
    correlation_time: Estimate

    kind = "gauss_markov"
    meaning = "a stationary, exponentially correlated bias"
    phrase = "correlated noise, {sigma} rms, correlation time {correlation_time}"
    as_cause = "Gauss-Markov noise with a correlation time of {correlation_time} s"
    # Not `sized_by`: what it gains goes by how far its shape is from flicker, and where that is
    # detected sigma is no larger.
    is_process = True
    resembles_bend = True
    excluded_by = frozenset({"quantization"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "random_telegraph": "same spectrum; two levels instead of a Gaussian",
        "step": "happens once",
        "band_limit": "an excess at low frequencies against a deficit at high ones",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        tc = self.correlation_time.value
        return f"correlated noise with a correlation time of {tc:.3g} s, beside N, B and K"

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another process is the same hypothesis."""
        del grid
        return is_alike(self.correlation_time, other.correlation_time)

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Profile the likelihood over the correlation time."""
        shortest, longest = _shortest(view), _LONGEST * view.series.duration_s
        if longest < 2 * shortest:
            return []
        bank = np.geomspace(shortest, longest, 2 + int(_PER_DECADE * np.log10(longest / shortest)))
        gains = [view.loglik_with(Process(1.0, float(tc))) for tc in bank]
        best = int(np.argmax(gains))
        found = _candidate(view, bank[max(0, best - 1)], bank[min(len(bank) - 1, best + 1)])
        effect = found.effect
        assert isinstance(effect, cls)
        return [found] if effect.correlation_time.value > _AT_THE_END * shortest else []

    def refine(self, view: View) -> Candidate:
        """Estimate correlation time and size again."""
        tc = max(self.correlation_time.value, 2 * _shortest(view))
        return _candidate(view, tc / 2, tc * 2)

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where it removes its part of the residual and is there all along.

        Where it leaves no white noise it is a low-pass.
        """
        return low_pass_instead(view, candidate) or lasting(view, candidate, UNSTEADY)


def _shortest(view: View) -> float:
    return _SHORTEST / view.grid.rate_hz


def _sigma(fit: Spectrum) -> float:
    """Return the standard deviation of the process of a fit."""
    return float(np.sqrt(fit.model.components[-1].power))


def _amplitude_error(fit: Spectrum) -> float:
    """Return the standard error of that, from the information about all powers."""
    basis = [fit.fit.likelihood.column(fit.model, c.with_power(1.0)) for c in fit.model]
    free = [b for b, c in zip(basis, fit.model, strict=True) if c.has_amplitude]
    scaled = np.array(free) * (np.sqrt(fit.fit.likelihood.dof / 2) / fit.fit.expected)
    variance = np.linalg.pinv(scaled @ scaled.T, hermitian=True)[-1, -1]
    return float(np.sqrt(max(variance, 0.0))) / (2 * max(_sigma(fit), 1e-300))


def loglik_beside(view: View, power: float, process: Part) -> float:
    """Return the log-likelihood with a process of a given power, N, B and K refitted.

    `process` is that of power 1.
    """
    basis, fitter = view.fitter.plus(process).basis, view.fitter
    fixed = fitter.basis.fixed + power * basis.columns[-1]
    return replace(fitter, basis=replace(fitter.basis, fixed=fixed)).loglik(
        view.power, view.spectrum.powers
    )


def _candidate(view: View, low: float, high: float) -> Candidate:
    best, _ = minimise_between(
        lambda x: -view.loglik_with(Process(1.0, float(np.exp(x)))),
        float(np.log(low)),
        float(np.log(high)),
        within=0.01,
    )
    tc = float(np.exp(best))
    fit = view.spectrum_with(Process(1.0, tc))
    sigma, gain = _sigma(fit), fit.loglik - view.spectrum.loglik
    # Two levels can be told from a bell only where a dwell stands out of the noise within it.
    noise = fit.model.value("N") ** 2 + fit.model.value("B") ** 2 * tc
    signal = 2 * tc * sigma**2 / max(noise, 1e-300)
    effect = GaussMarkov(Estimate(sigma, unit=view.unit), Estimate(tc, unit="s"))
    return Candidate(
        effect,
        gain,
        float(np.log(12)),
        parts=(Process(1.0, tc),),
        rivals={"random_telegraph": gain} if signal < _TELLING else {},
        finish=lambda: (_with_intervals(view, fit, effect), None),
    )


def _with_intervals(view: View, fit: Spectrum, effect: GaussMarkov) -> GaussMarkov:
    """Return it with the intervals of both numbers."""
    sigma, tc, h = effect.sigma.value, effect.correlation_time.value, 0.1
    after, before = (view.spectrum_with(Process(1.0, tc * np.exp(s))) for s in (h, -h))
    curvature = (2 * fit.loglik - after.loglik - before.loglik) / h**2
    error = 1 / np.sqrt(max(curvature, 1e-2))
    # The profile over Tc refits sigma; seen the other way round, Tc moves with sigma.
    turn = (_sigma(after) - _sigma(before)) / (2 * h * max(sigma, 1e-300))
    alone = _amplitude_error(fit) / max(sigma, 1e-300)
    spread = min(float(np.hypot(alone, turn * error)), _VAGUE)
    slope = turn * error**2 / max(spread**2, 1e-300)

    def drop(side: float, distance: float) -> float:
        x = side * spread * distance
        along = float(np.clip(slope * x, -_FARTHEST, _FARTHEST))
        moved = Process(1.0, tc * np.exp(along))
        return fit.loglik - loglik_beside(view, (sigma * np.exp(x)) ** 2, moved)

    lower, upper = (
        sigma * np.exp(side * spread * reach_at_95(partial(drop, side))) for side in (-1.0, 1.0)
    )
    return GaussMarkov(
        Estimate(sigma, float(lower), float(upper), view.unit),
        Estimate.of_log(tc, min(error, 10.0), "s"),
    )
