r"""An excursion: the level leaves and comes back once, minutes later.

Not in the first vocabulary; real recordings demanded it (somebody touched the table, a heater
switched on). Two steps of equal size
and opposite sign would describe it with one parameter more. All instants and a ladder of durations
are scanned at once (`StepScan`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import PlacedSignal
from allanscope.explain.effects.step import NEAR_S, instant_before, row_after
from allanscope.explain.regression import joint_fit, step_ordinates
from allanscope.explain.spectrum import StepScan, ends_of, local_power_ratio
from allanscope.explain.view import View
from allanscope.noise.grid import Grid
from allanscope.noise.selection import calibrated_penalty
from allanscope.quantities import moment

Array = NDArray[np.float64]
Span = tuple[float, float]

_SHORTEST_S, _SHORTEST_FOUND_S = 5.0, 2.0
"""Of what is scanned, and of what two steps are; a shorter one is a shock or an outlier."""
_LONGEST, _SHORT = 0.12, 1.6
"""Longest duration that is scanned, as a share of the record: beyond, its edges are found first
(`moves.fold`). In a short record, where few edges are far enough from its ends, in units of the
shortest."""
_BESIDE = 4
"""Part of its length for which the level is seen before and after it in a short record, at the
least; in any other its whole length."""
_PROPOSALS = 2
"""Of the highest in the scan, that are fitted in full."""
_PENALTY, _PENALTY_S = calibrated_penalty("excursion"), 1200.0
"""Nats that noise hardly gains by chance in so many seconds."""
_TURNS = 3
"""Most times that both edges are moved in turn."""
_BRIDGED = 0.5
"""Share of its rows that may be filling."""


@dataclass(frozen=True)
class Excursion(PlacedSignal):
    """A box."""

    time: Estimate
    duration: Estimate
    size: Estimate

    kind = "excursion"
    meaning = "the level shifts once and returns"
    phrase = "excursion at {event}, {size}"
    motion = "shift"
    acts_fast = False
    sized_by = "size"
    located_by = "time"
    is_piecewise = True
    excluded_by = frozenset({"random_telegraph", "gauss_markov"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "step": "does not return",
        "random_telegraph": "switches repeatedly by the same amount",
        "outliers": "last one sample",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        length = self.duration.value
        return (
            f"the level shifts by {self.size.text} at {moment(self.time.value, length)}"
            f" and returns after {moment(length, length)}"
        )

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another box is the same hypothesis."""
        del grid
        return abs(self.time.value - other.time.value) < NEAR_S

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Scan all instants for a ladder of durations."""
        boxes = _boxes(view)
        if not boxes:
            return []
        fits = [(cls._at(view, *rows), rows) for rows in boxes]
        best, rows = max(fits, key=lambda fit: fit[0].gain)
        best = replace(best, gain=best.gain / best.effect.local_power(view))
        return [(cls._near(view, *rows) or best) if best.excess > 0 else best]

    @classmethod
    def between(cls, view: View, one_s: float, other_s: float) -> Candidate | None:
        """Return the box between two instants; None where it is too short for one."""
        first, last = (row_after(view.row_at(t)) for t in sorted((one_s, other_s)))
        shortest = _SHORTEST_FOUND_S * view.grid.rate_hz
        return cls._near(view, first, last) if last - first >= shortest else None

    def refine(self, view: View) -> Candidate | None:
        """Estimate instant, duration and size again."""
        return self._near(view, *self._rows(view))

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse a second box from the same instant, left of a disturbance that is no box.

        The second of two that are there gains more than the first, which leaves the noise high.
        """
        del view
        box = other.effect
        same = isinstance(box, Excursion) and abs(self.time.value - box.time.value) < NEAR_S
        return "left of an excursion" if same and other.gain < known.gain else ""

    def is_resolved(self, view: View) -> bool:
        """Return whether it was measured: what bridges a long gap may be off, all of it alike."""
        first, last = self._rows(view)
        return float(view.series.bridged[first:last].mean()) < _BRIDGED

    def local_power(self, view: View) -> float:
        """Return the power of the noise around the box over that of all."""
        return local_power_ratio(view.data, view.grid.rate_hz, *self._rows(view))

    def from_end_s(self, view: View) -> float:
        """Return how far from an end of the record the box is."""
        before = self.time.value - view.series.start_s
        return min(before, view.series.duration_s - before - self.duration.value)

    def form(self, view: View) -> Array:
        """Return a box of height 1."""
        first, last = self._rows(view)
        signal = np.zeros(view.grid.n)
        signal[first:last] = 1.0
        return signal

    def columns(self, view: View) -> Array:
        """Return the ordinates of the box."""
        return _column(view, *self._rows(view))

    def _rows(self, view: View) -> tuple[int, int]:
        first = row_after(view.row_at(self.time.value))
        return first, first + round(self.duration.value * view.grid.rate_hz)

    @classmethod
    def _at(
        cls,
        view: View,
        first: int,
        last: int,
        begins: Span | None = None,
        lasts: Span | None = None,
        **placed: float,
    ) -> Candidate:
        """Fit the size of a box from a row to before another, with the intervals of its borders."""
        rate, rows = view.grid.rate_hz, last - first
        time = instant_before(first, begins or (first - 1.0, float(first)), view)
        shortest, longest = lasts or (rows - 1.0, rows + 1.0)
        duration = Estimate(rows / rate, shortest / rate, longest / rate, "s")
        length = max(view.series.duration_s / _PENALTY_S, 1.0)
        looked_at = _PENALTY + float(np.log(length) + np.log(ALPHA))
        size = Estimate(1.0, unit=view.unit)
        return cls(time, duration, size, **placed).ranked(view, looked_at)

    @classmethod
    def _near(cls, view: View, first: int, last: int) -> Candidate | None:
        """Move both borders in turn to where the gain is largest, bound them, and fit the size."""
        if not 0 < first < last < view.grid.n:
            return None
        noise = joint_fit(view, _column(view, first, last)).spectrum
        scan = StepScan(view.grid, view.ordinates, noise)
        for _ in range(_TURNS):
            before, reach = (first, last), (last - first) // 2
            tried = np.arange(max(1, first - reach), first + reach)
            begin = scan.place_of_box(tried, np.full_like(tried, last), tried)
            first = begin.best
            tried = np.arange(max(first + 2, last - reach), min(view.grid.n - 1, last + reach))
            end = scan.place_of_box(np.full_like(tried, first), tried, tried)
            last = end.best
            if (first, last) == before:
                break
        lasts = ends_of(np.subtract.outer(end.instants, begin.instants))
        lasts = min(lasts[0], last - first), max(lasts[1], last - first)
        begins = ends_of(begin.instants)
        shrinkage, scatter = begin.shrinkage * end.shrinkage, np.hypot(begin.scatter, end.scatter)
        placed = {"shrinkage": shrinkage, "scatter": float(scatter)}
        return cls._at(view, first, last, begins, lasts, **placed).finished()


def _column(view: View, first: int, last: int) -> Array:
    m = view.grid.low
    box = step_ordinates(view.grid, first, m) - step_ordinates(view.grid, last, m)
    return np.asarray(box[np.newaxis])


def _boxes(view: View) -> list[tuple[int, int]]:
    """First and last sample of the most telling boxes."""
    n, rate = view.grid.n, view.grid.rate_hz
    cell = max(1, n // view.grid.low)
    scan = view.scan
    width = max(2 * cell, int(_SHORTEST_S * rate))
    longest, is_short = int(_LONGEST * n), _LONGEST * n < width
    if is_short:
        longest = int(_SHORT * width)
    found = []
    while width <= longest:
        beside = width // _BESIDE if is_short else width
        first = range(beside, n - width - beside, cell)
        if first:
            gains = scan.boxes(first, width)
            j = int(np.argmax(gains))
            found.append((float(gains[j]), first[j], first[j] + width))
        width = int(width * 1.25) + 1
    found.sort(reverse=True)
    return [(a, b) for _, a, b in found[:_PROPOSALS]]
