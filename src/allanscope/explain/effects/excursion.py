r"""An excursion: the level leaves and comes back once, minutes later.

Not in the first vocabulary; real recordings demanded it (somebody touched the table, a heater
switched on). Two steps of equal size
and opposite sign would describe it with one parameter more. All instants and a ladder of durations
are scanned at once (`StepScan`).
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

_SHORTEST_S = 5.0
_LONGEST = 0.12
"""Longest duration as a share of the record: beyond, it is two steps."""
_PROPOSALS = 2
_PRICE, _PRICED_S = 15.0, 1200.0
"""Nats that by chance 1 of 900 clean axes of so many seconds gains (of 2700 simulated, three)."""
_TURNS = 3
_INTERVAL_NATS = 3.68


class Excursion(EffectKind):
    """A box."""

    kind = "excursion"
    meaning = "the level leaves once and comes back"
    located_by = "time"
    is_slow = True
    is_piecewise = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "step": "does not come back",
        "random_telegraph": "leaves again and again by the same amount",
        "outliers": "last one sample",
    }

    def is_same(self, first: Candidate, second: Candidate, grid: Grid) -> bool:
        """Tell whether two candidates are one hypothesis."""
        return is_near(first, second, _NEAR_S * grid.rate_hz)

    def propose(self, view: View) -> Iterable[Candidate]:
        """Scan all instants for a ladder of durations."""
        if view.has("random_telegraph") or view.has("gauss_markov"):
            return []
        best: Candidate | None = None
        for first, last in _boxes(view):
            candidate = _candidate(view, first, last)
            if candidate is not None and (best is None or candidate.gain > best.gain):
                best = candidate
        if best is None:
            return []
        first, last = (int(x) for x in best.shape)
        uneven = loudness(view.data, view.grid.rate_hz, first, last)
        best = replace(best, gain=best.gain / uneven)
        return [_refined(view, best) if best.excess > 0 else best]

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate instant, duration and size again."""
        first, last = (int(x) for x in candidate.shape)
        again = _candidate(view, first, last)
        return _refined(view, again) if again is not None else candidate

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the size by interleaved blocks."""
        column = _column(view, int(candidate.shape[0]), int(candidate.shape[1]))
        return interleaved(view, joint_fit(view, column), column)

    def columns(self, view: View, candidate: Candidate) -> Array:
        """Return the ordinates of the jump."""
        return _column(view, int(candidate.shape[0]), int(candidate.shape[1]))

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the size that a joint regression found."""
        del view
        return rescaled(candidate, "size", float(amplitude[0]), float(np.sqrt(covariance[0, 0])))


def _column(view: View, first: int, last: int) -> Array:
    m = view.grid.low
    box = step_ordinates(view.grid, first, m) - step_ordinates(view.grid, last, m)
    return np.asarray(box[np.newaxis])


def _boxes(view: View) -> list[tuple[int, int]]:
    """First and last sample of the most telling boxes."""
    n, rate = view.grid.n, view.grid.rate_hz
    cell = max(1, n // view.grid.low)
    scan = view.scan
    width, longest = max(2 * cell, int(_SHORTEST_S * rate)), int(_LONGEST * n)
    found = []
    while width <= longest:
        first = np.arange(width, n - 2 * width, cell)
        if len(first):
            gains = scan.box(first, first + width)
            j = int(np.argmax(gains))
            found.append((float(gains[j]), int(first[j]), int(first[j] + width)))
        width = int(width * 1.25) + 1
    found.sort(reverse=True)
    return [(a, b) for _, a, b in found[:_PROPOSALS]]


def _candidate(view: View, first: int, last: int) -> Candidate | None:
    if not 0 < first < last < view.grid.n:
        return None
    column = _column(view, first, last)
    fit = joint_fit(view, column)
    covariance = marginal_covariance(view, column, fit)
    size, error = float(fit.amplitude[0]), float(np.sqrt(covariance[0, 0]))
    rate = view.grid.rate_hz
    signal = np.zeros(view.grid.n)
    signal[first:last] = size
    return Candidate(
        kind="excursion",
        parameters={
            "time": Parameter(first / rate, first / rate, first / rate, "s"),
            "duration": Parameter((last - first) / rate, 0.0, 0.0, "s"),
            "size": estimate(size, error, view.unit),
        },
        gain=fit.gain,
        price=_PRICE + float(np.log(max(view.series.duration_s / _PRICED_S, 1.0))),
        signal=signal,
        shape=(float(first), float(last)),
        words=(
            f"the level leaves by {size:.3g} {view.unit} at {first / rate:.0f} s and comes back "
            f"after {(last - first) / rate:.0f} s"
        ),
    )


def _refined(view: View, candidate: Candidate) -> Candidate:
    """Move both borders in turn to where the gain is largest, and bound them."""
    first, last = (int(x) for x in candidate.shape)
    noise = joint_fit(view, _column(view, first, last)).spectrum
    scan = StepScan(view.grid, view.ordinates, noise)
    n, rate = view.grid.n, view.grid.rate_hz
    (a0, a1), (b0, b1) = (first, first), (last, last)
    for _ in range(_TURNS):
        reach = (last - first) // 2
        tried = np.arange(max(1, first - reach), first + reach)
        first, a0, a1 = _best(tried, scan.box(tried, np.full_like(tried, last)))
        tried = np.arange(max(first + 2, last - reach), min(n - 1, last + reach))
        last, b0, b1 = _best(tried, scan.box(np.full_like(tried, first), tried))
    again = _candidate(view, first, last) or candidate
    parameters = {
        **again.parameters,
        "time": Parameter(first / rate, a0 / rate, a1 / rate, "s"),
        "duration": Parameter((last - first) / rate, (b0 - a1) / rate, (b1 - a0) / rate, "s"),
    }
    return replace(again, parameters=parameters)


def _best(tried: NDArray[np.int64], gains: Array) -> tuple[int, int, int]:
    """Return the most likely sample and the range that covers the jump before it with 95 %."""
    top = int(np.argmax(gains))
    near = tried[gains > gains[top] - _INTERVAL_NATS]
    return int(tried[top]), int(near[0]) - 1, int(near[-1])
