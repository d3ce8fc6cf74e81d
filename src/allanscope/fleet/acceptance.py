"""A lot against limits: which units are accepted, which are not, and how many could be either.

Limits are those of ``allanscope check``, and so is the judgement of a run: what was not detected
may be as large as its upper limit, or nothing. A unit is accepted when all of its runs are. Where a
limit lies within the 95 % interval of a run that decides, the run cannot tell on which side the
unit is; so many units are named as close (the guard band of ISO 14253-1). The interval of the yield
is that of Clopper and Pearson: exact, whatever the number of units.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.lot import Lot
from allanscope.fleet.verdict import Finding
from allanscope.pipeline import Limits
from allanscope.quantities import COEFFICIENTS, number, symbols
from allanscope.quantities import limit as upper_limit

__all__ = ["Acceptance", "LimitCount", "accept", "clopper_pearson"]

Truths = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LimitCount:
    """How many units meet one limit.

    Attributes
    ----------
    axis, quantity, limit : str
        E.g. ``gx``, ``N`` and ``max 0.004``.
    met, missed : int
        Units.
    close : int
        Of all, those whose runs cannot tell.
    """

    axis: str
    quantity: str
    limit: str
    met: int
    missed: int
    close: int


@dataclass(frozen=True, slots=True)
class Acceptance:
    """A lot against the limits of a specification.

    Attributes
    ----------
    counts : tuple of LimitCount
        One for each limit.
    units : int
        Of the lot.
    rejected : tuple of Finding
        Units that miss a limit, each limit a reason.
    """

    counts: tuple[LimitCount, ...]
    units: int
    rejected: tuple[Finding, ...]

    @property
    def names(self) -> set[str]:
        """Units that are not accepted."""
        return {one.unit for one in self.rejected}

    @property
    def words(self) -> str:
        """How many are accepted, with the 95 % interval of the yield."""
        good = self.units - len(self.names)
        low, high = (number(100.0 * one, 3) for one in clopper_pearson(good, self.units))
        share = number(100.0 * good / self.units, 3)
        return f"{good} of {self.units} units accepted: {share} % [{low}, {high}]"


def accept(lot: Lot, limits: Limits) -> Acceptance:
    """Return which units of a lot, read with ``limits=True``, meet the limits."""
    units = np.unique(lot.units)
    counts, rejected = [], []
    for axis, named in limits.items():
        runs = lot.of_axis(axis)
        absent = sorted(set(units.tolist()) - set(runs.units.tolist()))
        for name, bounds in named.items():
            missed, close, reasons = _missed(runs, name, bounds)
            failing = np.unique(runs.units[missed]).tolist()
            rejected += [Finding(unit, axis, f"{name} {reasons[unit]}", name) for unit in failing]
            rejected += [Finding(unit, axis, "no run has this axis", name) for unit in absent]
            bad = len(failing) + len(absent)
            doubtful = len(np.unique(runs.units[close]))
            counts.append(LimitCount(axis, name, _limit(bounds), len(units) - bad, bad, doubtful))
    return Acceptance(tuple(counts), len(units), tuple(rejected))


def clopper_pearson(good: int, units: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a share.

    Examples
    --------
    >>> [round(one, 3) for one in clopper_pearson(20, 20)]
    [0.832, 1.0]
    """
    from scipy.special import betaincinv

    low = betaincinv(good, units - good + 1, 0.025) if good else 0.0
    high = betaincinv(good + 1, units - good, 0.975) if good < units else 1.0
    return float(low), float(high)


def _missed(
    runs: Lot, name: str, bounds: dict[str, float]
) -> tuple[Truths, Truths, dict[str, str]]:
    """Return which runs miss a limit, which cannot tell, and of each unit the worst run's words."""
    value, lower, upper, detected = _measured(runs, name)
    most = np.where(detected, value, upper)
    least = np.where(detected, value, 0.0)
    unknown = ~np.isfinite(most)
    maximum, minimum = bounds.get("max", np.inf), bounds.get("min", 0.0)
    missed = unknown | (most > maximum) | (least < minimum)
    close = np.zeros(len(runs), np.bool_)
    for bound in bounds.values():
        close |= np.where(detected, lower <= bound, True) & (bound <= upper)
    reasons: dict[str, list[str]] = defaultdict(list)
    factor, unit = 1.0, ""
    if len(runs):
        reading = COEFFICIENTS[runs["sensor_unit"][0], name][0]
        factor, unit = reading.factor, symbols(reading.unit)
    for run in np.flatnonzero(missed):
        if unknown[run]:
            reason = "could not be measured"
        elif detected[run]:
            reason = f"is {number(factor * value[run])} {unit}"
        else:
            reason = f"is {upper_limit(factor * upper[run])} {unit}, not detected"
        reasons[str(runs.units[run])].append(reason)
    texts = {
        one: f"{words[0]}; {_limit(bounds, factor)}"
        + (f" (and in {len(words) - 1} more runs)" if len(words) > 1 else "")
        for one, words in reasons.items()
    }
    return missed, close, texts


def _measured(runs: Lot, name: str) -> tuple[NDArray[np.float64], ...]:
    """Return value, limits and whether it was detected; with what other axes bring, as `check`."""
    parts = ("value", "lower", "upper", "detected")
    now = [runs[f"{name}_{part}"] for part in parts]
    if name != "N":
        before = [runs[f"before_{name}_{part}"] for part in parts]
        leaked = runs["effects"].rows_with("source") & (before[0] > now[0])
        now = [np.where(leaked, old, new) for old, new in zip(before, now, strict=True)]
    return (*now[:3], now[3] == 1.0)


def _limit(bounds: dict[str, float], factor: float = 1.0) -> str:
    """Return limits as people read them."""
    return ", ".join(f"{key} {number(factor * bounds[key])}" for key in sorted(bounds))
