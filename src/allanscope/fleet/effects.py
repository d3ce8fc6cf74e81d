"""Effects of a lot: which many units show, and which another run of the same unit shows again.

What a whole rack shows is the rack's and no board's. A line is the same line in two boards when its
frequencies agree within their intervals, or within two parts in a thousand: that is as far as the
mains wander and the drive of a chamber slips. Boards of one nominal rate sample at rates that
differ by per cents, so a line at its own frequency agrees in Hz, while one above Nyquist folds to a
place of its own in each and is found as many.

Runs of one unit are replicates. Within one record a step, a warm-up or a slow line cannot be held
out: there is no second piece of data that was not used to find it. Another run of the same board is
such a piece. Its own search was made in ignorance of the first, so an effect of the same kind on
the same axis, at the same frequency where it has one, is evidence that owes nothing to the record
that suggested it. Sizes are compared by their intervals. A run without the effect speaks against it
only as far as that run could have seen it: a shorter one may not. So a missing replicate is
reported as not found again, and not as refuted.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from allanscope.fleet.lot import EffectColumn, Lot
from allanscope.quantities import TWO_SIDED_95

__all__ = [
    "SIZES",
    "FoundEffect",
    "Replication",
    "SharedEffect",
    "alike",
    "effects_in",
    "replications",
    "shared_effects",
]

ALIKE = 2e-3
MANY = 1.0 / 3.0
"""Share of the units from which on a line is called the rack's."""

SIZES = ("amplitude", "sigma", "slope", "size", "relative", "cutoff", "time_constant", "dwell")
"""Parameters that should agree from run to run; times of events need not."""

_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """One effect of one recording and axis.

    Attributes
    ----------
    frequency_hz : float
        Where it is in the spectrum; NaN for what has no frequency.
    width_hz : float
        How far from there it may be: its 95 % interval to one side.
    """

    unit: str
    recording: str
    axis: str
    kind: str
    frequency_hz: float
    width_hz: float
    _column: EffectColumn
    _number: int

    @property
    def parameters(self) -> dict[str, tuple[float, float, float, str]]:
        """Name to (value, lower, upper, unit), numbers only; limits may be NaN."""
        return self._column.parameters(self._number)

    @property
    def has_frequency(self) -> bool:
        """Whether it sits at one place of the spectrum."""
        return not math.isnan(self.frequency_hz)


@dataclass(frozen=True, slots=True)
class SharedEffect:
    """One effect and the units that show it.

    Attributes
    ----------
    frequency_hz : float
        Median, NaN for what has no frequency.
    units : tuple of str
        That show it, on any axis.
    axes : tuple of str
        On which it was seen.
    of_rack : bool
        True for a frequency that so many units show that it cannot be theirs.
    """

    kind: str
    frequency_hz: float
    units: tuple[str, ...]
    axes: tuple[str, ...]
    of_rack: bool


def effects_in(lot: Lot) -> list[FoundEffect]:
    """Return all effects of a lot."""
    column: EffectColumn = lot["effects"]
    keys = zip(lot["unit"], lot["recording"], lot["axis"], column.of_rows(), strict=True)
    found = []
    for unit, recording, axis, effects in keys:
        for number in effects:
            place = column.parameters(number).get("frequency", (np.nan, np.nan, np.nan, ""))
            value, lower, upper, _ = place
            wide = max(upper - value, value - lower)
            width = 0.0 if math.isnan(wide) else wide
            kind = column.kind[number]
            found.append(FoundEffect(unit, recording, axis, kind, value, width, column, number))
    return found


def shared_effects(effects: list[FoundEffect], units: int) -> list[SharedEffect]:
    """Return the effects that at least two units show, those of most units first.

    Parameters
    ----------
    effects : list
        Of the lot.
    units : int
        Units in the lot.
    """
    found = []
    for kind in sorted({one.kind for one in effects}):
        for group in _groups([one for one in effects if one.kind == kind]):
            names = tuple(sorted({one.unit for one in group}))
            frequency = float(np.median([one.frequency_hz for one in group]))
            if len(names) > 1:
                axes = tuple(sorted({one.axis for one in group}, key=_axis_order))
                rack = bool(np.isfinite(frequency)) and len(names) >= max(2.0, MANY * units)
                found.append(SharedEffect(kind, frequency, names, axes, rack))
    return sorted(found, key=lambda one: (-len(one.units), one.kind, one.frequency_hz))


def _groups(effects: list[FoundEffect]) -> list[list[FoundEffect]]:
    """Part effects of one kind where there is a gap between their frequencies."""
    groups: list[list[FoundEffect]] = []
    for one in sorted(effects, key=lambda one: (one.has_frequency, one.frequency_hz)):
        last = groups[-1][-1] if groups else None
        if last is not None and alike(last, one):
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups


def alike(one: FoundEffect, other: FoundEffect) -> bool:
    """Whether two effects of one kind are the same: at one frequency, or both without any."""
    if not (one.has_frequency and other.has_frequency):
        return one.has_frequency == other.has_frequency
    apart = abs(one.frequency_hz - other.frequency_hz)
    return apart <= max(one.width_hz + other.width_hz, ALIKE * other.frequency_hz)


def _axis_order(axis: str) -> tuple[bool, str]:
    return (axis.startswith("a"), axis)


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
    for name in SIZES:
        known = [one.parameters[name] for one in effects if name in one.parameters]
        value, lower, upper = (np.array([one[i] for one in known], np.float64) for i in range(3))
        sigma = (upper - lower) / (2.0 * TWO_SIDED_95)
        usable = np.isfinite(sigma) & (sigma > 0.0)
        if usable.sum() < 2:
            continue
        value, weight = value[usable], sigma[usable] ** -2.0
        mean = float(weight @ value) / float(weight.sum())
        if np.any(np.abs(value - mean) > _SIGMAS * sigma[usable]):
            return False
    return True
