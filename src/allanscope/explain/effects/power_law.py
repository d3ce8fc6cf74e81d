r"""Noise of a slope that is none of the textbook's: density f^-a, 0 < a < 2.

Traps with times that are not evenly distributed, surfaces, a reference that ages: flicker is one
case of many. N, B and K together imitate it, over a decade or two to a few per cent, which is why
it is looked for beside all three: what it must gain is what they lose. Spotted by the Whittle
likelihood profiled over the exponent. A single process of one correlation time bends within a
decade where this goes straight on, and must do worse: if by little, it is named beside it. The
coefficients stay those of what is left beside it, so B or K may vanish with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import SIMILAR, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.band_limit import BandLimit, low_pass_instead
from allanscope.explain.effects.gauss_markov import GaussMarkov, profile_intervals
from allanscope.explain.effects.unexplained import lasting
from allanscope.explain.spectrum import Spectrum
from allanscope.explain.view import View
from allanscope.noise.components import PowerLaw as Process
from allanscope.noise.filters import LowPass
from allanscope.noise.grid import Grid
from allanscope.optimise import least_nonnegative, minimise_between
from allanscope.quantities import CHI_SQUARE_95

Array = NDArray[np.float64]

_BANK = np.array([0.25, 0.4, 0.6, 0.75, 1.25, 1.4, 1.6, 1.75])
"""Exponents tried: those between the textbook's 0, 1 and 2."""
_PRICE = float(np.log(len(_BANK)))
_WORTH_A_LOOK = 6.0
"""Nats below which nothing is compared with it."""
_LEAST = 0.15
"""Exponent below which it is white noise that something else bends, and N would vanish with it."""
_UNALIASED = 2 / np.pi
"""Of a density that falls as 1/f, at Nyquist, over that which a sum has there."""
_AT_THE_END = 1.05
"""Factor on the least exponent within which a fit has run into it."""
_MOVE, _ERRORS = 0.01, 1000
"""Of the exponent, over which a derivative is taken; and errors that are drawn."""


@dataclass(frozen=True)
class PowerLaw(EffectKind):
    """Noise of a free slope.

    Attributes
    ----------
    exponent : Estimate
        The density falls as f to minus this.
    density : Estimate
        Square root of the two-sided density at 1 Hz, as N is.
    """

    exponent: Estimate
    density: Estimate

    kind = "power_law"
    meaning = "noise whose density falls with a slope between those of N, B and K"
    phrase = "power-law noise, f^-{exponent}, {density} at 1 Hz"
    as_cause = "power-law noise, f^-{exponent}"
    # Not `sized_by`: as of a `gauss_markov`, what it gains goes by how far its shape is from N, B
    # and K, and where that is detected the density is no larger.
    is_process = True
    is_single = True
    excluded_by = frozenset({"quantization"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "gauss_markov": "bends once, at its correlation time",
        "band_limit": "bends downwards at high frequencies",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return (
            f"noise of density f^-{self.exponent.value:.3g}, {self.density.text} at 1 Hz, "
            "beside N, B and K"
        )

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Profile the likelihood over the exponent."""
        gains = [view.loglik_with(Process(1.0, float(a))) - view.spectrum.loglik for a in _BANK]
        best = int(np.argmax(gains))
        if gains[best] < _WORTH_A_LOOK:
            return []
        ends = _BANK[best - 1] if best else _LEAST, _BANK[min(len(_BANK) - 1, best + 1)]
        found = _candidate(view, *ends)
        return [found] if found.gain > _bent(view) - SIMILAR else []

    def refine(self, view: View) -> Candidate:
        """Estimate exponent and size again."""
        return _candidate(view, self.exponent.value - 0.2, self.exponent.value + 0.2)

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where it slopes, removes its part of the residual and is there all along.

        Where it leaves no white noise it is a low-pass. What bends does worse: if it does better,
        this is only its rival.
        """
        if candidate.gain <= _bent(view):
            return None
        low_pass = low_pass_instead(view, candidate)
        if low_pass is not None:
            return low_pass
        if self.exponent.value < _AT_THE_END * _LEAST:
            return None
        if (self.exponent.lower or 0.0) <= Process.quantities[1].lower:  # it may be white noise
            return None
        return lasting(view, candidate)

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse a low-pass that takes no more than the way noise without a corner is sampled.

        Cut off at Nyquist, f^-a has no aliases there: (2 / pi)^a of the density of the sums.
        """
        del known
        low_pass, (part, *_) = other.effect, other.parts or (None,)
        if not isinstance(low_pass, BandLimit) or not isinstance(part, LowPass):
            return ""
        nyquist = view.grid.rate_hz / 2
        if low_pass.cutoff.upper and part.values:
            part = part.with_values([low_pass.cutoff.upper, *part.values[1:]])
        top = part.response(np.array([nyquist]), view.grid.dt)[0]
        is_top = low_pass.cutoff.value > nyquist or top > _UNALIASED**self.exponent.value
        return "the top of a power law" if is_top else ""

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another slope is the same hypothesis: it always is."""
        del other, grid
        return True


def _bent(view: View) -> float:
    """Return the gain of a process of one correlation time."""
    return max((c.gain for c in GaussMarkov.proposed(view)), default=0.0)


def _candidate(view: View, low: float, high: float) -> Candidate:
    _, shape = Process.quantities
    low, high = max(low, _LEAST), min(max(high, 2 * _LEAST), shape.upper)
    exponent, _ = minimise_between(
        lambda a: -view.loglik_with(Process(1.0, a)), low, high, within=2e-3
    )
    fit = view.spectrum_with(Process(1.0, exponent))
    density = float(np.sqrt(fit.model.components[-1].power))
    effect = PowerLaw(Estimate(exponent), Estimate(density, unit=f"{view.unit}/sqrt(Hz)"))
    is_there = density > 0
    ended = exponent < _AT_THE_END * _LEAST or not is_there
    gain = 0.0 if ended else fit.loglik - view.spectrum.loglik
    return Candidate(
        effect,
        gain,
        _PRICE,
        parts=(Process(1.0, exponent),),
        finish=(lambda: (_with_intervals(view, fit, effect), None)) if is_there else None,
    )


def _with_intervals(view: View, fit: Spectrum, effect: PowerLaw) -> PowerLaw:
    """Return it with the intervals of both numbers."""
    _, shape = Process.quantities
    exponent, density = effect.exponent.value, effect.density.value
    moves, sizes = profile_intervals(
        view,
        fit,
        density,
        lambda x: Process(1.0, float(np.clip(exponent + x, shape.lower, shape.upper))),
        (shape.lower - exponent, shape.upper - exponent),
        (_allowed(view, exponent), CHI_SQUARE_95 / 2),
    )
    return replace(
        effect,
        exponent=replace(effect.exponent, lower=exponent + moves[0], upper=exponent + moves[1]),
        density=replace(effect.density, lower=density * sizes[0], upper=density * sizes[1]),
    )


def _allowed(view: View, exponent: float) -> float:
    """Return by how many nats the exponents of an interval of 95 % are less likely than the best.

    N, B, K and the size cannot be negative, so that the likelihood ratio at the true exponent is
    less than chi-square (Self and Liang, JASA 82, 605, 1987). How it is distributed is told by many
    normal errors with the information of the fit: one that would make a power negative is fitted
    again, by least squares with none negative, with the exponent free and with it held.
    """
    fitter = view.fitter.plus(Process(1.0, exponent))
    columns, (powers, _) = fitter.basis.columns, fitter.powers(view.power)
    least, most = (
        view.fitter.plus(Process(1.0, exponent + move)).basis.columns[-1]
        for move in (-_MOVE, _MOVE)
    )
    slopes = np.vstack([columns, powers[-1] * (most - least) / (2 * _MOVE)])
    slopes *= np.sqrt(fitter.dof / 2) / (fitter.basis.fixed + powers @ columns)
    units = np.linalg.norm(slopes, axis=1)
    root = np.linalg.qr((slopes / units[:, np.newaxis]).T)[1]
    held, along = root[:, :-1], root[:, -1] / np.linalg.norm(root[:, -1])
    apart = np.eye(len(root)) - np.outer(along, along)
    errors = np.random.default_rng(0).standard_normal((_ERRORS, len(root)))
    errors += held @ (powers * units[:-1])
    ratios = [_left(held, one) - _left(apart @ held, apart @ one) for one in errors]
    return float(np.quantile(ratios, 0.95)) / 2


def _left(design: Array, wanted: Array) -> float:
    """Return the sum of squares that least squares with none negative leave."""
    return float(np.sum((wanted - design @ least_nonnegative(design, wanted)) ** 2))
