"""What is to be said of a lot first, and of each unit that does not belong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.analysis.verdict import Verdict, VerdictLine
from allanscope.fleet.lot import Lot
from allanscope.fleet.outliers import FALSE_ALARMS, far_units
from allanscope.fleet.shared import SharedEffect
from allanscope.fleet.spread import log_sigma
from allanscope.quantities import number

__all__ = ["NAMES", "Finding", "findings", "lot_verdict", "reservations"]

NAMES = ("N", "B", "K")

MODEL_LEVEL = 0.01
"""Probability at which a single run says that the model does not explain it."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Why a unit is named; `quantity` is the coefficient that is far from the others'."""

    unit: str
    axis: str
    reason: str
    quantity: str = ""


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
                far.append((abs(one.score), Finding(one.unit, axis, reason, name)))
    ordered = [found for _, found in sorted(far, key=lambda pair: -pair[0])]
    dead = "no noise could be fitted: dead, saturated or too short"
    return [*ordered, *_in_runs(lot, ~np.isfinite(lot["N_value"]), dead)]


def reservations(lot: Lot) -> list[Finding]:
    """Return what single runs have against a unit, which need not set it apart from the others.

    Each axis of each run is held against its model at 1 %. Of a hundred good ones one is refused,
    so here it takes a probability that the whole lot reaches once in a hundred times.
    """
    noisy = "noise density above the datasheet's"
    by_chance = lot["residual_after_p_value"] * len(lot) > FALSE_ALARMS
    refused = (lot["explained"] == 0.0) & np.isfinite(lot["residual_after_chi2_per_dof"])
    unexplained = "the model does not explain all of the data"
    return [
        *_in_runs(lot, lot["datasheet_verdict"] == "worse", noisy),
        *_in_runs(lot, refused & ~by_chance, unexplained),
    ]


def _in_runs(lot: Lot, mask: NDArray[np.bool_], reason: str) -> list[Finding]:
    """Return which units and axes are meant, and in how many of their runs."""
    runs = Counter(_pairs(lot))
    found = Counter(_pairs(lot.where(mask)))
    return [
        Finding(unit, axis, f"{reason}, in {count} of {runs[unit, axis]} runs")
        for (unit, axis), count in sorted(found.items())
    ]


def _pairs(lot: Lot) -> list[tuple[str, str]]:
    return list(zip(lot["unit"].tolist(), lot["axis"].tolist(), strict=True))


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
        *_run_lines(lot),
        *_rack_lines(shared, units),
    ]
    if failures:
        lines.append(VerdictLine("bad", "no result", f"{len(failures)} of the recordings"))
    title = f"{len(bad)} of {units} units stand out" if bad else f"No unit of {units} stands out"
    return Verdict("bad" if bad or failures else "good", title, tuple(lines))


def _run_lines(lot: Lot) -> list[VerdictLine]:
    """Return how many axes of runs are noisier than the datasheet, and how many unexplained."""
    lines = []
    worse = int(np.count_nonzero(lot["datasheet_verdict"] == "worse"))
    compared = sum(one is not None for one in lot["datasheet_verdict"].tolist())
    if worse:
        text = f"{worse} of {compared} axes of runs are noisier than the typical density there"
        lines.append(VerdictLine("note", "datasheet", text))
    asked = np.isfinite(lot["residual_after_p_value"])
    refused = int(np.count_nonzero(asked & (lot["explained"] == 0.0)))
    if refused:
        usual = number(MODEL_LEVEL * np.count_nonzero(asked), 2)
        text = (
            f"{refused} of {np.count_nonzero(asked)} axes of runs are not explained at 1 %; "
            f"chance alone gives {usual}"
        )
        lines.append(VerdictLine("note", "model", text))
    return lines


def _rack_lines(shared: list[SharedEffect], units: int) -> list[VerdictLine]:
    return [
        VerdictLine(
            "note",
            "shared",
            f"{one.kind.replace('_', ' ')} at {number(one.frequency_hz, 5)} Hz on "
            f"{len(one.units)} of {units} units: look for it where they stand, not in them",
        )
        for one in shared
        if one.of_rack
    ]


def _some(names: list[str], most: int = 8) -> str:
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
