r"""A relaxation: the level jumps once and then creeps back, all of the way or a part of it.

A cable that was pulled, a screw that was tightened, a supply that was switched: the jump D at t0
becomes L + (D - L) exp(-(t - t0) / tau). One step leaves the creeping, which looks like more steps
and a large K. Both amplitudes are fitted with the noise at the most telling instants, for a bank of
time constants; then the instant is moved to the row and the time constant to the maximum.

The likelihood of a time constant is no parabola, and flicker and the random walk, which imitate the
creeping, are known from few ordinates: its interval is that of its restricted likelihood (Harville,
Biometrika 61, 1974), the noise fitted again at each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.step import Jump, Step, edge_of, instant_before
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import (
    joint_fit,
    likely_time,
    marginal_covariance,
    relaxing_ordinates,
    restricted_loglik,
    step_ordinates,
)
from allanscope.explain.spectrum import ends_of, instants_before
from allanscope.explain.view import View
from allanscope.optimise import minimise_between

Array = NDArray[np.float64]

_SHORTEST_S = 3.0
"""Shortest time constant: what is faster is the ringing of a shock."""
_LONGEST = 0.3
"""Longest time constant, as a share of the record."""
_BANK = 10
"""Time constants tried, equally far apart in their logarithm; each is paid for."""
_LEAST_STEP = 10.0
"""Gain of a bare step, in nats, below which no instant is worth a time constant."""
_TURNS = 3
"""Of instant and time constant."""
_PLACES = 41
"""Rows tried in a turn."""
_REACH = 20
"""Rows to each side of the best, at the least: so far every row is one of them."""
_UNBENT = 0.02
"""Of ln tau: as near to its least value the likelihood has no maximum."""
_STEP, _LEAP = 0.02, 0.4
"""Of ln tau: over which derivatives are taken, and the most that it moves in one turn."""
_CREEPS = 3.5
"""Standard errors that the creeping part is at least: else it is a step."""


@dataclass(frozen=True)
class Relaxation(Jump):
    """A jump that relaxes exponentially."""

    time_constant: Estimate
    lasting: Estimate

    kind = "relaxation"
    meaning = "the level jumps once and relaxes exponentially"
    phrase = "jump at {event}, {size}, relaxing with {time_constant}"
    confused_with: ClassVar[Mapping[str, str]] = {
        "step": "does not bend",
        "excursion": "comes back at once",
        "warm_up": "begins with the record",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return (
            f"the level jumps by {self.size.text} at {self.time.value:.1f} s and relaxes to "
            f"{self.lasting.text}, time constant {self.time_constant.value:.4g} s"
        )

    @property
    def relaxation(self) -> Estimate:
        """Time constant."""
        return self.time_constant

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Scan the whole record for a step, and give it time constants."""
        at, longest = cls.places(view), _LONGEST * view.series.duration_s
        if len(at) == 0 or longest < 2 * _SHORTEST_S:
            return []
        statistic = view.scan.step(at)
        row = int(at[int(np.argmax(statistic))])
        if joint_fit(view, step_ordinates(view.grid, row, view.grid.low)).gain < _LEAST_STEP:
            return []
        bank = np.geomspace(_SHORTEST_S, longest, _BANK)
        gains = [joint_fit(view, _pair(view, row, tc), rounds=5).gain for tc in bank.tolist()]
        found = cls._near(view, row, float(bank[int(np.argmax(gains))]))
        if found is None:
            return []
        weaker = replace(found, gain=found.gain / found.effect.local_power(view))
        return [found if weaker.excess > 0 else weaker]

    def refine(self, view: View) -> Candidate | None:
        """Estimate instant, sizes and time constant again."""
        return self._near(view, self.row(view), self.time_constant.value)

    def signal(self, view: View) -> Array:
        """Return the jump and its relaxation."""
        row, signal = max(self.row(view), 0), np.zeros(view.grid.n)
        since = (np.arange(row, view.grid.n) - self.row(view)) / view.grid.rate_hz
        creep = self.size.value - self.lasting.value
        signal[row:] = self.lasting.value + creep * np.exp(-since / self.time_constant.value)
        return signal

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Let the level stay as it relaxed."""
        return replace(candidate, signal=self.signal(view))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge both amplitudes by interleaved blocks."""
        del candidate
        columns = _pair(view, self.row(view), self.time_constant.value)
        return interleaved(view, joint_fit(view, columns), columns, slow=True)

    def columns(self, view: View) -> Array:
        """Return the ordinates of step and exponential, and what the latter changes by ln tau."""
        return _columns(view, self.row(view), self.time_constant.value)

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return sizes and time constant that a joint regression found; a step if none creeps."""
        lasting, creep, bend = amplitude.tolist()
        move = float(np.clip(bend / creep if creep else 0.0, -_LEAP, _LEAP))
        longest = _LONGEST * view.series.duration_s
        tc = float(np.clip(self.time_constant.value * np.exp(move), _SHORTEST_S, longest))
        error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if abs(creep) <= _CREEPS * error[1]:
            step = Step(self.time, self.size)
            return step.solved(view, candidate, amplitude[:1], covariance[:1, :1])
        both = covariance[0, 0] + covariance[1, 1] + 2.0 * covariance[0, 1]
        found = replace(
            self,
            size=Estimate.of(lasting + creep, float(np.sqrt(max(both, 0.0))), view.unit),
            time_constant=Estimate.of_log(tc, float(error[2]) / max(abs(creep), 1e-300), "s"),
            lasting=Estimate.of(lasting, float(error[0]), view.unit),
        )
        return candidate.solved(found, partial(found.signal, view))

    @classmethod
    def _near(cls, view: View, row: int, tc: float) -> Candidate | None:
        """Fit instant and time constant in turn near given ones; None where nothing creeps."""
        grid, rate = view.grid, view.grid.rate_hz
        longest = _LONGEST * view.series.duration_s
        reach = int(max(2 * rate, 4 * grid.n / grid.low))
        for _ in range(_TURNS):
            row, ends = _place(view, row, tc, reach)
            reach = int(max(_REACH, ends[1] - ends[0]))
            best, _ = minimise_between(
                partial(_loss, view, row),
                float(np.log(max(tc / 2.0, _SHORTEST_S))),
                float(np.log(min(tc * 2.0, longest))),
                within=_UNBENT / 2,
            )
            tc = float(np.exp(best))
        if tc < _SHORTEST_S * np.exp(_UNBENT):  # shorter would be likelier
            return None
        columns = _columns(view, row, tc)
        fit = joint_fit(view, columns[:2])
        covariance = marginal_covariance(view, columns, joint_fit(view, columns))
        amplitude = np.append(fit.amplitude, 0.0)
        if abs(amplitude[1]) <= _CREEPS * float(np.sqrt(covariance[1, 1])):  # 0, too
            return None
        time = instant_before(row, ends, view)
        searched = cls.looked_at(view) + float(np.log(_BANK))
        none = Estimate(1.0, unit=view.unit)
        bare = Candidate(cls(time, none, Estimate(tc, unit="s"), none), fit.gain, searched)
        found = bare.effect.solved(view, bare, amplitude, covariance)
        effect = found.effect
        if not isinstance(effect, cls):  # a step
            return found
        error = float(np.sqrt(covariance[2, 2])) / abs(float(amplitude[1]))
        return replace(
            found, finish=lambda: (effect.with_interval(view, error), effect.signal(view))
        )

    def with_interval(self, view: View, error: float) -> Self:
        """Return it with the interval that holds 95 % of its time constants.

        Each weighs by its restricted likelihood. `error` is that of ln tau on a straight line, from
        which half and twice a time constant are far.
        """
        row = self.row(view)
        likely = likely_time(
            self.time_constant, lambda tc: restricted_loglik(view, _pair(view, row, tc)), error
        )
        return replace(self, time_constant=likely)


def _loss(view: View, row: int, log_tc: float) -> float:
    return -joint_fit(view, _pair(view, row, float(np.exp(log_tc))), rounds=5).gain


def _pair(view: View, row: int, tc: float) -> Array:
    step = step_ordinates(view.grid, row, view.grid.low)
    return np.vstack([step, _exponential(view, row, tc)])


def _exponential(view: View, row: int, tc: float) -> Array:
    return relaxing_ordinates(view.grid, row, tc, view.grid.low)


def _columns(view: View, row: int, tc: float) -> Array:
    longer, shorter = (_exponential(view, row, tc * np.exp(s)) for s in (_STEP, -_STEP))
    return np.vstack([_pair(view, row, tc), (longer - shorter) / (2.0 * _STEP)])


def _place(view: View, row: int, tc: float, reach: int) -> tuple[int, tuple[float, float]]:
    """Return the most telling row near one, and the interval of the instant before it, in rows."""
    grid = view.grid
    fit = joint_fit(view, _pair(view, row, tc))
    m = grid.low
    weight = fit.spectrum.kept[:m] / fit.spectrum.first(m)
    edge = edge_of(grid)
    tried = np.unique(
        np.linspace(max(edge, row - reach), min(grid.n - edge, row + reach), _PLACES, dtype=int)
    )
    gains = np.empty(len(tried))
    for i, at in enumerate(tried.tolist()):
        columns = _pair(view, at, tc)
        weighted = columns * weight
        normal, projected = weighted @ columns.T, weighted @ view.ordinates[:m]
        gains[i] = 0.5 * projected @ np.linalg.pinv(normal, hermitian=True) @ projected
    return int(tried[int(np.argmax(gains))]), ends_of(instants_before(tried, gains))
