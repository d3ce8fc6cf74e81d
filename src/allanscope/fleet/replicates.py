"""Runs of one unit as replicates: an effect of one run, looked for in the others.

Within one record a step, a warm-up or a slow line cannot be held out: there is no second piece of
data that was not used to find it. Another run of the same board is such a piece. Its own search was
made in ignorance of the first, so an effect of the same kind on the same axis, at the same
frequency where it has one, is evidence that owes nothing to the record that suggested it. Sizes are
compared by their intervals.

A run without the effect speaks against it only as far as that run could have seen it: a shorter one
may not. So a missing replicate is reported as not found again, and not as refuted.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from allanscope.fleet.lot import Lot
from allanscope.fleet.shared import FoundEffect, alike

__all__ = ["Replication", "replications"]

_SIZES = ("amplitude", "sigma", "slope", "size", "relative", "cutoff", "time_constant", "dwell")
"""Parameters that should agree from run to run; times of events need not."""

_SIGMAS = 3.0
_TWO_SIDED_95 = 1.96


@dataclass(frozen=True, slots=True)
class Replication:
    """One effect of one unit and axis over the runs of that unit.

    Attributes
    ----------
    runs, found : int
        Runs of the unit that have the axis, and those that show the effect.
    agree : bool or None
        Whether its sizes agree within 3 standard errors; None where it was found once.
    """

    unit: str
    axis: str
    kind: str
    frequency_hz: float
    runs: int
    found: int
    agree: bool | None

    @property
    def replicated(self) -> bool:
        """Found in another run than the one that suggested it."""
        return self.found > 1


def replications(lot: Lot, effects: list[FoundEffect]) -> list[Replication]:
    """Return the effects of all units that have more than one run."""
    runs: dict[tuple[str, str], set[str]] = defaultdict(set)
    for unit, axis, recording in zip(lot["unit"], lot["axis"], lot["recording"], strict=True):
        runs[unit, axis].add(recording)
    by_place: dict[tuple[str, str, str], list[FoundEffect]] = defaultdict(list)
    for one in effects:
        if len(runs[one.unit, one.axis]) > 1:
            by_place[one.unit, one.axis, one.kind].append(one)
    found = []
    for (unit, axis, kind), several in sorted(by_place.items()):
        for group in _same(several):
            seen = {one.recording: one for one in group}
            frequency = float(np.median([one.frequency_hz for one in group]))
            agree = _agree(list(seen.values())) if len(seen) > 1 else None
            found.append(
                Replication(unit, axis, kind, frequency, len(runs[unit, axis]), len(seen), agree)
            )
    return found


def _same(effects: list[FoundEffect]) -> list[list[FoundEffect]]:
    """Part the effects of one kind, axis and unit by their frequencies."""
    groups: list[list[FoundEffect]] = []
    for one in effects:
        for group in groups:
            if alike(one, group[0]):
                group.append(one)
                break
        else:
            groups.append([one])
    return groups


def _agree(effects: list[FoundEffect]) -> bool:
    """Whether all sizes are within 3 standard errors of their weighted mean."""
    for name in _SIZES:
        known = [one.parameters[name] for one in effects if name in one.parameters]
        value, lower, upper = (np.array([one[i] for one in known], np.float64) for i in range(3))
        sigma = (upper - lower) / (2.0 * _TWO_SIDED_95)
        usable = np.isfinite(sigma) & (sigma > 0.0)
        if usable.sum() < 2:
            continue
        value, weight = value[usable], sigma[usable] ** -2.0
        mean = float(weight @ value) / float(weight.sum())
        if np.any(np.abs(value - mean) > _SIGMAS * sigma[usable]):
            return False
    return True
