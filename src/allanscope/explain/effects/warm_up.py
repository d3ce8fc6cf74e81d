r"""A warm-up: after power-on the level relaxes exponentially, then stays.

In the curve it is a ramp below its time constant and falls beyond; N, B and K swallow most of it,
as K. Spotted by GLS for a bank of time constants, the noise refitted at each. It is anchored to
the start of the record and must vanish later: a slow drift that is anything else fits a few free
cosines better, which is why those compete (see `unexplained`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, is_alike
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import (
    Regression,
    exponential_ordinates,
    joint_fit,
    marginal_covariance,
)
from allanscope.explain.view import View
from allanscope.noise.grid import Grid
from allanscope.optimise import minimise, minimise_between

Array = NDArray[np.float64]

_SHORTEST_S = 5.0
"""Shortest time constant: what is faster is no matter of heat."""
_LONGEST = 0.6
"""Longest time constant, as a share of the record."""
_BANK = 14
"""Time constants tried, equally far apart in their logarithm; each is paid for."""
_STEP = 0.02
"""Of ln tau, over which derivatives are taken."""
_LEAP = 0.4
"""Most that ln tau moves in one step of a joint regression."""
_APART = 3.0
"""Factor between two time constants, at the least: nearer ones are hardly two."""
_LOOKED_AT = float(np.log(8))
"""Log of the number of time constants that a record can tell apart."""


@dataclass(frozen=True)
class WarmUp(EffectKind):
    """An exponential at the start."""

    time_constant: Estimate
    amplitude: Estimate

    kind = "warm_up"
    meaning = "the level relaxes exponentially from the start of the record"
    phrase = "warm-up, {amplitude}, time constant {time_constant}"
    is_counted = True
    acts_fast = False
    sized_by = "amplitude"
    shared_by = "time_constant"
    is_single = True
    is_slow = True
    is_drift = True
    is_thermal = True
    excluded_by = frozenset({"high_pass"})  # no level lasts behind it
    confused_with: ClassVar[Mapping[str, str]] = {
        "temperature": "the measured temperature explains it",
        "step": "does not bend",
        "ramp": "does not end",
        "unexplained": "another slow drift fits free cosines better",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return (
            f"the level relaxes by {self.amplitude.text}, time constant "
            f"{self.time_constant.value:.4g} s"
        )

    @property
    def relaxation(self) -> Estimate:
        """Time constant."""
        return self.time_constant

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another warm-up is the same hypothesis."""
        del grid
        return is_alike(self.time_constant, other.time_constant)

    def from_end_s(self, view: View) -> float:
        """Return for how long it moves the level from the start on."""
        del view
        return self.time_constant.value

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit a bank of time constants."""
        longest = _LONGEST * view.series.duration_s
        if longest < 2 * _SHORTEST_S:
            return []
        bank = np.geomspace(_SHORTEST_S, longest, _BANK)
        gains = [joint_fit(view, _column(view, tc), rounds=5).gain for tc in bank]
        best = int(np.argmax(gains))
        if gains[best] < 4.0:
            return []
        return [_candidate(view, bank[max(0, best - 1)], bank[min(_BANK - 1, best + 1)])]

    def refine(self, view: View) -> Candidate:
        """Estimate time constant and amplitude again."""
        tc = self.time_constant.value
        return _candidate(view, tc / 1.6, tc * 1.6)

    def signal(self, view: View) -> Array:
        """Return the exponential."""
        t = np.arange(view.grid.n) / view.grid.rate_hz
        return np.asarray(self.amplitude.value * np.exp(-t / self.time_constant.value))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Let the exponential go on."""
        return replace(candidate, signal=self.signal(view))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the amplitude by interleaved blocks."""
        del candidate
        column = _column(view, self.time_constant.value)
        return interleaved(view, joint_fit(view, column), column)

    def columns(self, view: View) -> Array:
        """Return the ordinates of the exponential, and what they change by with ln tau."""
        tc = self.time_constant.value
        return np.vstack([_column(view, tc), _derivative(view, tc)])

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return amplitude and time constant that a joint regression found."""
        size = float(amplitude[0])
        step = float(np.clip(amplitude[1] / size if size else 0.0, -_LEAP, _LEAP))
        longest = _LONGEST * view.series.duration_s
        tc = float(np.clip(self.time_constant.value * np.exp(step), _SHORTEST_S, longest))
        error, log_error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        log_error = log_error / max(abs(size), 1e-300)
        found = _warm_up(view, tc, size, float(error), float(log_error))
        return candidate.solved(found, partial(found.signal, view))


def two_warm_ups(view: View) -> list[Candidate]:
    """Return the two exponentials by which the level relaxes from the start on.

    A sensor warms up in minutes, the board and what it stands on in an hour. None of them where
    the record is too short for two.
    """
    longest = _LONGEST * view.series.duration_s
    if longest < _APART * _SHORTEST_S:
        return []

    def fit(point: Array) -> Regression:
        columns = [_column(view, tc) for tc in np.exp(point).tolist()]
        return joint_fit(view, np.vstack(columns), rounds=5)

    def loss(point: Array) -> float:
        fast, slow = np.exp(point).tolist()
        apart = _SHORTEST_S <= fast <= slow / _APART and slow <= longest
        return -fit(point).gain if apart else np.inf

    bank = np.log(np.geomspace(_SHORTEST_S, longest, _BANK))
    first = min((np.array(pair) for pair in combinations(bank, 2)), key=loss)
    found = minimise(loss, first, 0.3 * np.eye(2), x_within=0.02, within=0.05, turns=80)
    sizes = fit(found.x).amplitude.tolist()
    quick, slow = map(partial(_known, view), np.exp(found.x).tolist(), sizes)
    return [
        replace(one, held_out=one.effect.hold_out(view.accept(other), one))
        for one, other in ((quick, slow), (slow, quick))
    ]


def _known(view: View, tc: float, size: float) -> Candidate:
    effect = _warm_up(view, tc, size, np.inf, np.inf)
    return Candidate(effect, 0.0, _LOOKED_AT, signal=effect.signal(view))


def _column(view: View, tc: float) -> Array:
    return exponential_ordinates(view.grid, tc, view.grid.low)[np.newaxis]


def _derivative(view: View, tc: float) -> Array:
    """Return the derivative of the column by ln tau."""
    m = view.grid.low
    longer = exponential_ordinates(view.grid, tc * np.exp(_STEP), m)
    shorter = exponential_ordinates(view.grid, tc * np.exp(-_STEP), m)
    return np.asarray((longer - shorter) / (2 * _STEP))


def _candidate(view: View, low: float, high: float) -> Candidate:
    best, _ = minimise_between(
        lambda x: -joint_fit(view, _column(view, float(np.exp(x))), rounds=5).gain,
        float(np.log(low)),
        float(np.log(high)),
        within=0.01,
    )
    tc = float(np.exp(best))
    fit = joint_fit(view, _column(view, tc))
    amplitude = float(fit.amplitude[0])

    def finish() -> tuple[WarmUp, Array]:
        # Gauss-Newton errors of both numbers under the final noise
        spectrum, m = fit.spectrum, view.grid.low
        jacobian = np.vstack([_column(view, tc)[0], amplitude * _derivative(view, tc)])
        weight = spectrum.kept[:m] / spectrum.first(m)
        covariance = np.linalg.pinv((jacobian * weight) @ jacobian.T, hermitian=True)
        found = replace(fit, amplitude=np.array([amplitude, 0.0]), covariance=covariance)
        covariance = marginal_covariance(view, jacobian, found)
        error, log_error = np.sqrt(np.maximum(np.diag(covariance), 0))
        effect = _warm_up(view, tc, amplitude, float(error), float(log_error))
        return effect, effect.signal(view)

    effect = _warm_up(view, tc, amplitude, np.inf, np.inf)
    return Candidate(effect, fit.gain, _LOOKED_AT, finish=finish)


def _warm_up(view: View, tc: float, size: float, error: float, log_error: float) -> WarmUp:
    return WarmUp(Estimate.of_log(tc, log_error, "s"), Estimate.of(size, error, view.unit))
