r"""First-order Gauss-Markov noise: a bias that forgets itself after a correlation time.

Spotted by the Whittle likelihood profiled over the correlation time, N, B and K refitted at each:
flicker, white noise and a random walk together imitate up to nine tenths of it. The sampled
process has an ordinate variance, with :math:`\phi = e^{-1/(f_s T_c)}`,

.. math:: \sigma^2 (1 - \phi^2) / (1 - 2 \phi \cos 2 \pi f / f_s + \phi^2)

A random telegraph signal has the same spectrum; only its two levels tell them apart.

The likelihood of sigma is no parabola: flicker and the random walk, which imitate the process, are
mostly 0 beside it and can only grow. The interval of either number is where its profile likelihood,
the other one, N, B and K refitted, has fallen by 1.92 nats.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, is_alike
from allanscope.explain.effects.band_limit import low_pass_instead
from allanscope.explain.effects.unexplained import lasting
from allanscope.explain.spectrum import Spectrum
from allanscope.explain.view import View
from allanscope.noise.components import Component
from allanscope.noise.components import GaussMarkov as Process
from allanscope.noise.grid import Grid
from allanscope.optimise import minimise_between, root_between
from allanscope.quantities import CHI_SQUARE_95

Array = NDArray[np.float64]

_PER_DECADE = 5
"""Correlation times tried a decade: half a step off, the likelihood has lost next to nothing."""
_TELLING = 25.0
"""Ratio of the process to the noise within a dwell above which two levels would be seen."""
_SHORTEST, _AT_THE_END = 1.5, 1.05
"""Shortest correlation time looked for, in rows: a shorter one bends white noise over the whole
band, as a low-pass does, and cannot be told from it. What is likeliest there is no process."""
_FIRST, _FARTHEST = 0.05, 3.0
"""First distance at which an end of an interval is looked for, of a shape or of ln size, and the
farthest of a logarithm."""
_CLOSE, _SHARE = 2e-3, 0.01
"""Within which it is found; and the likeliest shape of a size, as a share of where it is sought."""
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
        return low_pass_instead(view, candidate) or lasting(view, candidate)


def _shortest(view: View) -> float:
    return _SHORTEST / view.grid.rate_hz


def loglik_beside(view: View, power: float, process: Component, start: Array) -> float:
    """Return the log-likelihood with a process of a given power, N, B and K refitted.

    `process` is that of power 1; the refit begins at `start`.
    """
    basis, fitter = view.fitter.plus(process).basis, view.fitter
    fixed = fitter.basis.fixed + power * basis.columns[-1]
    return replace(fitter, basis=replace(fitter.basis, fixed=fixed)).loglik(view.power, start)


def _candidate(view: View, low: float, high: float) -> Candidate:
    best, _ = minimise_between(
        lambda x: -view.loglik_with(Process(1.0, float(np.exp(x)))),
        float(np.log(low)),
        float(np.log(high)),
        within=0.01,
    )
    tc = float(np.exp(best))
    fit = view.spectrum_with(Process(1.0, tc))
    sigma = float(np.sqrt(fit.model.components[-1].power))
    # Without a process the refit may still find a better mixture of N, B and K: not its gain.
    gain = fit.loglik - view.spectrum.loglik if sigma > 0 else 0.0
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
        finish=(lambda: (_with_intervals(view, fit, effect), None)) if sigma > 0 else None,
    )


def _with_intervals(view: View, fit: Spectrum, effect: GaussMarkov) -> GaussMarkov:
    """Return it with the intervals of both numbers."""
    sigma, tc = effect.sigma.value, effect.correlation_time.value
    times, sizes = profile_intervals(
        view, fit, sigma, lambda x: Process(1.0, tc * float(np.exp(x))), (-_FARTHEST, _FARTHEST)
    )
    return GaussMarkov(
        Estimate(sigma, sigma * sizes[0], sigma * sizes[1], view.unit),
        Estimate(tc, tc * float(np.exp(times[0])), tc * float(np.exp(times[1])), "s"),
    )


def profile_intervals(
    view: View,
    fit: Spectrum,
    size: float,
    process: Callable[[float], Component],
    farthest: tuple[float, float],
    allowed: tuple[float, float] = (CHI_SQUARE_95 / 2, CHI_SQUARE_95 / 2),
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how far the shape of a process may move, and by which factors its size.

    To where the profile likelihood has fallen by what is allowed. Curvature would take N, B or K
    for known where they came out as 0. Every refit begins at the likeliest: where a spectrum falls
    steeply, the powers may have a second maximum, and that of the noise alone leads there.

    Parameters
    ----------
    fit : Spectrum
        The likeliest.
    size : float
        Root of the power of the process in it.
    process : callable
        The process, of power 1, whose shape is moved by so much.
    farthest : tuple of float
        Least and largest move.
    allowed : tuple of float
        Nats by which that of a shape, and that of a size, may be less.
    """

    def moved(x: float) -> float:
        return fit.loglik - view.fitter.loglik_beside(process(x), view.power, fit.powers)

    down = _reach(lambda x: moved(-x), -farthest[0], allowed[0])
    up = _reach(moved, farthest[1], allowed[0])
    low, high = max(-2 * down, farthest[0]), min(2 * up, farthest[1])

    def sized(log_factor: float) -> float:
        power = (size * np.exp(log_factor)) ** 2

        def loss(x: float) -> float:
            return -loglik_beside(view, power, process(x), fit.powers[:-1])

        _, least = minimise_between(loss, low, high, within=_SHARE * (high - low))
        return fit.loglik + min(least, loss(0.0))  # of several valleys it may find another

    smaller = _reach(lambda x: sized(-x), _FARTHEST, allowed[1])
    larger = _reach(sized, _FARTHEST, allowed[1])
    return (-down, up), (float(np.exp(-smaller)), float(np.exp(larger)))


def _reach(drop: Callable[[float], float], farthest: float, allowed: float) -> float:
    """Return how far one may go until a likelihood has fallen by what is allowed."""
    far = min(_FIRST, farthest)
    while drop(far) < allowed:
        if far == farthest:
            return farthest
        far = min(2 * far, farthest)
    return root_between(lambda x: drop(x) - allowed, 0.0, far, within=_CLOSE)
