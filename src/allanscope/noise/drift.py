"""The ramp R: a regressor on the ordinates, estimated together with the noise.

A steady drift of slope R is deterministic, and rows t contribute R X_k to ordinate k with

    X_k = -s dt sqrt(2 / n) cos x / (2 sin^2 x)   for odd k,  x = pi k / 2n,   0 for even k.

Generalised least squares in this diagonal domain is a weighted sum. What makes ramps hard is that a
random walk looks like one: a fit of the noise alone puts a ramp into K, which hides it. So the
noise is fitted again with the ramp taken out, and the two likelihoods are compared; K is never
given what a ramp explains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.evidence import Evidence, Ordinates
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.quantities import CHI_SQUARE_95, TWO_SIDED_95

__all__ = ["Drift", "fit_drift", "ramp_pattern"]

Array = NDArray[np.float64]

_ROUNDS = 4
"""Times that ramp and noise are found from each other."""
_LEAST_VARIANCE = 1e-200
"""Far below that of any noise, and what is divided by it is still finite."""
_FIRST = 4096
"""Ordinates from which a ramp is taken out."""
_LIMIT = 1.1 * CHI_SQUARE_95
"""Twice the log-likelihood that the slope of 95 % of records has lost, by simulation of 460 in
white noise, flicker and a random walk: the noise is known from few ordinates."""
_TURNS, _SETTLED, _FARTHEST = 12, 0.02, 30.0
"""Most looks at the profile, how close to the limit is there, and its end in standard errors."""
_POWER = 0.7
"""Of the ratio in a step: between the root, for a parabola, and one, for a straight fall."""


@dataclass(frozen=True)
class Drift:
    """A ramp and the noise that is left without it.

    Attributes
    ----------
    slope : float
        In unit/s, signed.
    half_width : float
        Of its 95 % interval, from the profile of the likelihood.
    gain : float
        Nats gained over the noise alone; twice that is chi-square with one degree of freedom where
        there is no ramp.
    evidence : tuple of Evidence
        With the ramp subtracted.
    fit : Fit
        Of the noise to that evidence.
    """

    slope: float
    half_width: float
    gain: float
    evidence: tuple[Evidence, ...]
    fit: Fit

    @property
    def interval(self) -> tuple[float, float]:
        """Limits of the slope without its sign; the lower one is 0 where the sign is not known."""
        size = abs(self.slope)
        return max(0.0, size - self.half_width), size + self.half_width


def ramp_pattern(ordinates: Ordinates) -> Array:
    """Return the first ordinates of a ramp of slope 1, shape (n - 1,) or (4096,).

    They fall as 1 / k^2, so that the rest is nothing beside any noise.

    Examples
    --------
    >>> rows = 0.25 * np.arange(32.0)
    >>> ordinates = Ordinates.of(rows, dt=1.0)
    >>> bool(np.allclose(ordinates.raw[0], 0.25 * ramp_pattern(ordinates)))
    True
    """
    grid = ordinates.grid
    k = np.arange(1, min(grid.n, _FIRST + 1))
    half = np.pi * k / (2 * grid.n)
    shape = np.cos(half) / (2 * np.sin(half) ** 2) * np.sqrt(2 / grid.n)
    return np.where(k % 2 == 1, -shape / grid.rate_hz, 0.0)


def fit_drift(fit: Fit) -> Drift | None:
    """Estimate the ramp and the noise together, starting from a fit of the noise alone.

    Its shapes are held.

    Returns None where the evidence has no ordinates, or all slow ones are left out.
    """
    likelihood = fit.likelihood
    ramp = _Ramp(likelihood)
    if not ramp.patterns or not np.isfinite(ramp.regress(fit.expected)[1]):
        return None
    slope, joint, evidence = 0.0, fit, likelihood.evidence
    basis = likelihood.basis(fit.model, fit.held | fit.model.shapes)
    for _ in range(_ROUNDS):
        before = slope
        slope, sd = ramp.regress(joint.expected)
        evidence = ramp.removed(slope)
        joint = Likelihood(evidence).maximum(basis)
        if abs(slope - before) < 0.02 * sd:
            break
    sd = ramp.regress(joint.expected)[1]

    def fallen(distance: float) -> float:
        beside = Likelihood(ramp.removed(slope + distance * sd))
        return 2 * (joint.loglik - beside.largest(basis))

    gain = joint.loglik - fit.loglik
    return Drift(slope, sd * _half_width(fallen), gain, evidence, joint)


class _Ramp:
    """Regression on a ramp of everything that has ordinates."""

    def __init__(self, likelihood: Likelihood) -> None:
        self.evidence = likelihood.evidence
        sizes = np.cumsum([0, *(len(part.power) for part in self.evidence)])
        self.bins = [slice(a, b) for a, b in pairwise(sizes.tolist())]
        self.patterns = {
            i: ramp_pattern(part)
            for i, part in enumerate(self.evidence)
            if isinstance(part, Ordinates)
        }

    def regress(self, expected: Array) -> tuple[float, float]:
        """Return the slope and its standard error for given expected powers."""
        weight, projection = 0.0, 0.0
        for i, pattern in self.patterns.items():
            part = self.evidence[i]
            assert isinstance(part, Ordinates)
            # Of the bins that hold one ordinate; a ramp has next to nothing beyond them.
            single = int(np.argmin(np.append(part.grid.count[: len(part.dof)] == 1, False)))
            # Of an axis that is constant but for a sample or two next to nothing is expected.
            variance = np.maximum(expected[self.bins[i]][:single], _LEAST_VARIANCE)
            low = pattern[:single] * (part.dof[:single] > 0)
            weight += len(part.raw) * float(np.sum(low**2 / variance))
            projection += float(np.sum(part.raw[:, : len(low)] * low / variance))
        return (projection / weight, weight**-0.5) if weight > 0 else (0.0, np.inf)

    def removed(self, slope: float) -> tuple[Evidence, ...]:
        """Return the evidence without a ramp."""
        return tuple(
            part.less(slope * self.patterns[i]) if isinstance(part, Ordinates) else part
            for i, part in enumerate(self.evidence)
        )


def _half_width(fallen: Callable[[float], float]) -> float:
    """Return where the profile has fallen to the 95 % limit, in standard errors.

    It falls as a parabola near the estimate and ever slower beyond, because the noise that is
    fitted beside takes in what the ramp leaves; so it is followed to the limit. `fallen` is twice
    the log-likelihood lost at a distance.
    """
    distance = TWO_SIDED_95
    for _ in range(_TURNS):
        ratio = _LIMIT / max(fallen(distance), 1e-3)
        distance = min(distance * ratio**_POWER, _FARTHEST)
        if abs(ratio - 1) < _SETTLED or distance == _FARTHEST:
            break
    return distance
