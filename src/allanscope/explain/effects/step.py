r"""A step: the level jumps once and stays.

A step leaves D^2/(pi^2 k^2) in the spectrum, exactly like a random walk with K = D / sqrt(T): the
curve and the spectrum cannot tell the two apart, the phases can. The matched filter for every
instant is scanned at once (`StepScan`); the best few are fitted jointly with the noise, and the
instant is then refined to the sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.base import EffectKind, estimate, is_near, rescaled
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import joint_fit, marginal_covariance, step_ordinates
from allanscope.explain.stepscan import StepScan
from allanscope.explain.unevenness import loudness
from allanscope.explain.view import View
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]

_NEAR_S = 5.0
"""Distance in time up to which two jumps are the same."""

_PROPOSALS = 3
_PRICE, _PRICED_S = 12.0, 1200.0
"""Nats that by chance 1 of 900 clean axes of so many seconds gains (of 2700 simulated, three)."""
_HOPS = 3.0
"""A hop is twice the amplitude; noise may make it look half as large again."""
_EDGE_S = 5.0
"""Nearer to an end of the record a step is a start-up transient, or nothing one could tell."""
_INTERVAL_NATS = 3.68
"""Drop of the likelihood that covers the instant of a change with 95 % (Hansen 2000)."""


class Step(EffectKind):
    """A jump of the level."""

    kind = "step"
    meaning = "the level jumps once and stays"
    located_by = "time"
    is_slow = True
    is_piecewise = True
    is_shared = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "random_telegraph": "comes back",
        "warm_up": "bends; a step does not",
        "temperature": "the temperature jumps with it",
    }

    def is_same(self, first: Candidate, second: Candidate, grid: Grid) -> bool:
        """Tell whether two candidates are one hypothesis."""
        return is_near(first, second, _NEAR_S * grid.rate_hz)

    def propose(self, view: View) -> Iterable[Candidate]:
        """Scan the whole record."""
        n, rate = view.grid.n, view.grid.rate_hz
        edge = int(_EDGE_S * rate)
        at = np.arange(edge, n - edge, max(1, n // view.grid.low))
        if len(at) == 0:
            return []
        statistic = view.scan.step(at)
        best: Candidate | None = None
        for _ in range(_PROPOSALS):
            k = int(np.argmax(statistic))
            if statistic[k] <= 1.0:
                break
            candidate = _candidate(view, int(at[k]))
            if best is None or candidate.gain > best.gain:
                best = candidate
            statistic[np.abs(at - at[k]) < max(edge, n // 100)] = 0.0
        if best is None or _is_hop(view, best):
            return []
        uneven = loudness(view.data, rate, int(best.shape[0]), int(best.shape[0]))
        best = replace(best, gain=best.gain / uneven)
        return [_refined(view, best) if best.excess > 0 else best]

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate instant and size again."""
        return _refined(view, _candidate(view, int(candidate.shape[0])))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the size by interleaved blocks."""
        column = step_ordinates(view.grid, int(candidate.shape[0]), view.grid.low)[np.newaxis]
        return interleaved(view, joint_fit(view, column), column)

    def columns(self, view: View, candidate: Candidate) -> Array:
        """Return the ordinates of the jump."""
        return step_ordinates(view.grid, int(candidate.shape[0]), view.grid.low)[np.newaxis]

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the size that a joint regression found."""
        del view
        return rescaled(candidate, "size", float(amplitude[0]), float(np.sqrt(covariance[0, 0])))


def _is_hop(view: View, candidate: Candidate) -> bool:
    """Tell whether a step is one of the hops of a telegraph signal that is already known."""
    size = abs(candidate.number("size"))
    hops = [c.number("amplitude") for c in view.accepted if c.kind == "random_telegraph"]
    return any(size < _HOPS * amplitude for amplitude in hops)


def _candidate(view: View, at: int) -> Candidate:
    column = step_ordinates(view.grid, at, view.grid.low)[np.newaxis]
    fit = joint_fit(view, column)
    covariance = marginal_covariance(view, column, fit)
    size, error = float(fit.amplitude[0]), float(np.sqrt(covariance[0, 0]))
    seconds = at / view.grid.rate_hz
    signal = np.zeros(view.grid.n)
    signal[at:] = size
    return Candidate(
        kind="step",
        parameters={
            "time": Parameter(seconds, seconds, seconds, "s"),
            "size": estimate(size, error, view.unit),
        },
        gain=fit.gain,
        price=_PRICE + float(np.log(max(view.series.duration_s / _PRICED_S, 1.0))),
        signal=signal,
        shape=(float(at),),
        words=f"the level jumps by {size:.3g} {view.unit} at {seconds:.1f} s",
    )


def _refined(view: View, candidate: Candidate) -> Candidate:
    """Move the instant to the most likely sample, under the noise of the joint fit."""
    grid = view.grid
    at = int(candidate.shape[0])
    column = step_ordinates(grid, at, grid.low)[np.newaxis]
    scan = StepScan(grid, view.ordinates, joint_fit(view, column).spectrum)
    reach = int(max(20 * grid.rate_hz, 4 * grid.n / grid.low))
    edge = int(_EDGE_S * grid.rate_hz)
    tried = np.arange(max(edge, at - reach), min(grid.n - edge, at + reach))
    gains = scan.step(tried)
    best = int(np.argmax(gains))
    near = tried[gains > gains[best] - _INTERVAL_NATS]
    refined = _candidate(view, int(tried[best]))
    time = Parameter(
        float(tried[best] / grid.rate_hz),
        float((near[0] - 1) / grid.rate_hz),  # after the last sample of the old level
        float((near[-1] + 0.5) / grid.rate_hz),
        "s",
    )
    return replace(refined, parameters={**refined.parameters, "time": time})
