"""What is to be said of a lot first, and of each unit that does not belong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from allanscope.analysis.verdict import Verdict, VerdictLine
from allanscope.fleet.lot import Lot
from allanscope.fleet.outliers import far_units
from allanscope.fleet.shared import SharedEffect
from allanscope.fleet.spread import log_sigma
from allanscope.quantities import number

__all__ = ["NAMES", "Finding", "findings", "lot_verdict"]

NAMES = ("N", "B", "K")


@dataclass(frozen=True, slots=True)
class Finding:
    """Why a unit is named."""

    unit: str
    axis: str
    reason: str


def findings(lot: Lot) -> list[Finding]:
    """Return the units that stand out, each with the reason, those farthest out first."""
    comparisons = len(lot.axes) * len(NAMES)
    far = []
    for axis in lot.axes:
        for name in NAMES:
            here = lot.of_axis(axis).detected(name)
            sigma = log_sigma(here[f"{name}_lower"], here[f"{name}_upper"])
            for one in far_units(here[f"{name}_value"], sigma, here.units, comparisons):
                reason = (
                    f"{name} is {number(one.ratio)} times the median of the others, "
                    f"{number(abs(one.score))} standard deviations of the lot away"
                )
                far.append((abs(one.score), Finding(one.unit, axis, reason)))
    ordered = [found for _, found in sorted(far, key=lambda pair: -pair[0])]
    return [*ordered, *_flaws(lot)]


def _flaws(lot: Lot) -> list[Finding]:
    """Return what single runs have to say against a unit."""
    found = []
    worse = lot.where(lot["datasheet_verdict"] == "worse")
    for unit, axis in _pairs(worse):
        found.append(Finding(unit, axis, "noise density above the datasheet's"))
    dead = lot.where(~np.isfinite(lot["N_value"]))
    for unit, axis in _pairs(dead):
        found.append(Finding(unit, axis, "no noise could be fitted: dead, saturated or too short"))
    left = lot.where((lot["explained"] == 0.0) & np.isfinite(lot["residual_after_chi2_per_dof"]))
    for unit, axis in _pairs(left):
        found.append(Finding(unit, axis, "the model does not explain all of the data"))
    return found


def lot_verdict(
    lot: Lot, named: list[Finding], shared: list[SharedEffect], failures: Mapping[str, str]
) -> Verdict:
    """Return the verdict that the report begins with."""
    units = len(np.unique(lot.units))
    runs = len(set(lot["recording"].tolist()))
    bad = sorted({one.unit for one in named})
    lines = [
        VerdictLine("note", "lot", f"{units} units, {runs} recordings, {len(lot.axes)} axes"),
        VerdictLine(
            "bad" if bad else "good",
            "units",
            f"{len(bad)} of {units} stand out: {_some(bad)}" if bad else "none stands out",
        ),
    ]
    for one in shared:
        if one.of_rack:
            text = (
                f"{one.kind.replace('_', ' ')} at {number(one.frequency_hz, 5)} Hz on "
                f"{len(one.units)} of {units} units: look for it where they stand, not in them"
            )
            lines.append(VerdictLine("note", "shared", text))
    if failures:
        lines.append(VerdictLine("bad", "no result", f"{len(failures)} of the recordings"))
    title = f"{len(bad)} of {units} units stand out" if bad else f"No unit of {units} stands out"
    return Verdict("bad" if bad or failures else "good", title, tuple(lines))


def _pairs(lot: Lot) -> list[tuple[str, str]]:
    return sorted(set(zip(lot["unit"].tolist(), lot["axis"].tolist(), strict=True)))


def _some(names: list[str], most: int = 8) -> str:
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
