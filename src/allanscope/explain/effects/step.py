r"""A step: the level jumps once and stays.

A step leaves D^2/(pi^2 k^2) in the spectrum, exactly like a random walk with K = D / sqrt(T): the
curve and the spectrum cannot tell the two apart, the phases can. The matched filter for every
instant is scanned at once (`StepScan`); the best few are fitted jointly with the noise, and the
instant is then refined to the sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, PlacedSignal
from allanscope.explain.effects.random_telegraph import RandomTelegraph
from allanscope.explain.noise_level_border import instant_of
from allanscope.explain.regression import joint_fit, step_ordinates
from allanscope.explain.spectrum import StepScan, ends_of, local_power_ratio
from allanscope.explain.view import View
from allanscope.noise.grid import Grid
from allanscope.noise.selection import calibrated_penalty

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_EDGE_S, _EDGE = 5.0, 0.1
"""Nearer to an end of the record, or of a short one nearer than this share of it, a jump is a
start-up transient, or nothing one could tell."""

NEAR_S = 5.0
"""Distance in time up to which two jumps are the same."""

_PROPOSALS = 3
"""Highest changes in the scan that are fitted in full, each without those before it."""
_PENALTY, _PENALTY_S = calibrated_penalty("step"), 1200.0
"""Nats that noise hardly gains by chance in so many seconds."""
_HOPS = 3.0
"""A hop is twice the amplitude; noise may make it look half as large again."""


def instant_before(row: int, ends: tuple[float, float], view: View) -> Estimate:
    """Return the instant of a jump of which the first row after it and the ends are known.

    Halfway between that row and the one before it, as any instant between is as likely.
    """
    middle = min(max(row - 0.5, ends[0]), ends[1])
    return instant_of((middle, *ends), view.grid.rate_hz, view.series.start_s)


def row_after(instant: float) -> int:
    """Return the first row after an instant in rows; a whole number is that row.

    >>> row_after(6.5), row_after(7.0), row_after(7.0 + 1e-12)
    (7, 7, 7)
    """
    return int(np.ceil(instant - 0.25))


def edge_of(grid: Grid) -> int:
    """Return how many rows from an end of a record a jump is at least."""
    return int(min(_EDGE_S * grid.rate_hz, _EDGE * grid.n))


@dataclass(frozen=True)
class Jump(EffectKind):
    """What begins with a jump of the level, at a time and by a size."""

    time: Estimate
    size: Estimate

    motion = "shift"
    acts_fast = False
    is_slow = True
    is_piecewise = True
    sized_by = "size"
    located_by = "time"
    shared_by = "time"
    excluded_by = frozenset({"high_pass"})  # no level lasts behind it

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another jump is the same hypothesis."""
        del grid
        return abs(self.time.value - other.time.value) < NEAR_S

    def from_end_s(self, view: View) -> float:
        """Return how far from an end of the record the jump is."""
        before = self.time.value - view.series.start_s
        return min(before, view.series.duration_s - before)

    def local_power(self, view: View) -> float:
        """Return the power of the noise around the jump over that of all."""
        row = self.row(view)
        return local_power_ratio(view.data, view.grid.rate_hz, row, row)

    @staticmethod
    def places(view: View) -> Ints:
        """Return the samples at which a jump is looked for."""
        n, edge = view.grid.n, edge_of(view.grid)
        return np.arange(edge, n - edge, max(1, n // view.grid.low))

    @staticmethod
    def looked_at(view: View) -> float:
        """Return the log of the number of alternatives to one of them."""
        length = max(view.series.duration_s / _PENALTY_S, 1.0)
        return _PENALTY + float(np.log(length) + np.log(ALPHA))

    def row(self, view: View) -> int:
        """Return the first row after the jump."""
        return row_after(view.row_at(self.time.value))


@dataclass(frozen=True)
class Step(Jump, PlacedSignal):
    """A jump of the level."""

    kind = "step"
    meaning = "the level jumps once and stays"
    phrase = "step at {event}, {size}"
    confused_with: ClassVar[Mapping[str, str]] = {
        "random_telegraph": "comes back",
        "warm_up": "bends; a step does not",
        "temperature": "the temperature jumps with it",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"the level jumps by {self.size.text} at {self.time.value:.1f} s"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Scan the whole record."""
        n = view.grid.n
        edge, at = edge_of(view.grid), cls.places(view)
        if len(at) == 0:
            return []
        statistic = view.scan.step(at)
        found: list[tuple[Candidate, int]] = []
        for _ in range(_PROPOSALS):
            k = int(np.argmax(statistic))
            if statistic[k] <= 1.0:
                break
            start = int(at[k])
            time = Estimate.exact(view.time_at(start), "s")
            found.append((cls._at(view, time), start))
            statistic[np.abs(at - start) < max(edge, n // 100)] = 0.0
        if not found:
            return []
        best, start = max(found, key=lambda one: one[0].gain)
        if _is_hop(view, best):
            return []
        best = replace(best, gain=best.gain / best.effect.local_power(view))
        return [cls._near(view, start) if best.excess > 0 else best]

    def refine(self, view: View) -> Candidate:
        """Estimate instant and size again."""
        return self._near(view, self.row(view))

    def form(self, view: View) -> Array:
        """Return a jump of 1."""
        return (np.arange(view.grid.n) >= self.row(view)).astype(np.float64)

    def columns(self, view: View) -> Array:
        """Return the ordinates of the jump."""
        return _column(view, self.row(view))

    @classmethod
    def _at(cls, view: View, time: Estimate, **placed: float) -> Candidate:
        """Fit the size of a jump at an instant."""
        step = cls(time, Estimate(1.0, unit=view.unit), **placed)
        return step.ranked(view, cls.looked_at(view))

    @classmethod
    def _near(cls, view: View, row: int) -> Candidate:
        """Fit a jump at the most likely row near one, under the noise of the joint fit."""
        grid, rate = view.grid, view.grid.rate_hz
        scan = StepScan(grid, view.ordinates, joint_fit(view, _column(view, row)).spectrum)
        reach, edge = int(max(20 * rate, 4 * grid.n / grid.low)), edge_of(grid)
        tried = np.arange(max(edge, row - reach), min(grid.n - edge, row + reach))
        place = scan.place_of_step(tried)
        first, last = ends_of(place.instants)
        early, late = view.series.gap_around(place.best)
        if early < late:  # where rows are missing it was at any time between those on both sides
            first, last = min(first, early - 1), max(last, late)
        time = instant_before(place.best, (first, last), view)
        return cls._at(view, time, shrinkage=place.shrinkage, scatter=place.scatter).finished()


def _column(view: View, row: int) -> Array:
    return np.asarray(step_ordinates(view.grid, row, view.grid.low)[np.newaxis])


def _is_hop(view: View, candidate: Candidate) -> bool:
    """Return whether a step is one of the hops of a telegraph signal that is already known."""
    signals = [c.effect for c in view.accepted if isinstance(c.effect, RandomTelegraph)]
    found = candidate.finished().effect if signals else candidate.effect
    return isinstance(found, Step) and any(
        abs(found.size.value) < _HOPS * one.amplitude.value for one in signals
    )
