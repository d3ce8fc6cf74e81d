"""Several sessions on one page: overlaid curves, a table, and the spread between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from allanscope.analysis import Analysis, AxisAnalysis, Separation, separate_units, verdict
from allanscope.quantities import (
    COEFFICIENTS,
    DEVIATION,
    MAIN_LETTERS,
    TWO_SIDED_95,
    duration,
    number,
    symbols,
)
from allanscope.report import axis_text, coefficient_table
from allanscope.report.curve_pictures import compare_picture
from allanscope.report.page import template
from allanscope.report.picture import Picture
from allanscope.report.stability_tables import StabilityTable
from allanscope.samples import unit_of

__all__ = ["comparing_pictures", "render_comparison"]

_HAT = 3
"""Units from which the noise of each can be told from that of the others."""


def render_comparison(
    sessions: Mapping[str, Analysis], drawn: Mapping[str, Picture] | None = None
) -> str:
    """Return the page that compares sessions.

    Parameters
    ----------
    sessions : mapping
        Name of each session, as it is to be shown, to its result.
    drawn : mapping, optional
        Their pictures, where somebody has them already.
    """
    svgs = {k: one.svg() for k, one in (drawn or comparing_pictures(sessions)).items()}
    return template("compare.html.j2").render(
        title=f"{len(sessions)} sessions compared",
        subtitle="",
        sessions=[
            {
                "name": name,
                "facts": f"{duration(one.duration_s)} of {one.part or 'a sensor'}, "
                f"{one.version and f'allanscope {one.version}'}",
                "hash": one.input.get("sha256", ""),
                "verdict": verdict(one),
            }
            for name, one in sessions.items()
        ],
        axes=[_axis(name, sessions, svgs) for name in _axes(sessions)],
        apart=_separation_tables(sessions),
        footer=f"allanscope {next(iter(sessions.values())).version}",
    )


def comparing_pictures(sessions: Mapping[str, Analysis]) -> dict[str, Picture]:
    """Return one picture for each axis, with the curves of all sessions that have it."""
    found = {}
    for name in _axes(sessions):
        here = {label: one.axes[name] for label, one in sessions.items() if name in one.axes}
        curves = {k: axis.curves["oadev"] for k, axis in here.items() if "oadev" in axis.curves}
        if curves:
            found[f"{name}-comparison"] = compare_picture(curves, next(iter(here.values())).unit)
    return found


def _separation_tables(sessions: Mapping[str, Analysis]) -> list[StabilityTable]:
    """Return what three units or more share that were recorded at once, and what each has alone."""
    if len(sessions) < _HAT or not _overlap(sessions.values()):
        return []
    try:
        _, axes, _ = separate_units(list(sessions.values()), list(sessions))
    except ValueError:  # no samples, or copies of one recording
        return []
    return [_separation_table(name, one, sessions) for name, one in axes.items() if one.tau.size]


def _overlap(sessions: Iterable[Analysis]) -> bool:
    """Return whether all say when they began, and the last did before the first had ended."""
    try:
        begins = [(datetime.fromisoformat(s.input["started"]), s.duration_s) for s in sessions]
        ends = [begin + timedelta(seconds=length) for begin, length in begins]
        return max(begin for begin, _ in begins) < min(ends)
    except (KeyError, ValueError, TypeError):
        return False


def _separation_table(
    axis: str, one: Separation, sessions: Mapping[str, Analysis]
) -> StabilityTable:
    reading = DEVIATION[unit_of(axis)]
    rows = []
    for i in range(0, one.tau.size, 2):
        common = number(reading.factor * one.common[i])
        own = [
            reading.interval(*(float(x[i]) for x in (unit.deviation, unit.lower, unit.upper)))
            if math.isfinite(unit.deviation[i])
            else reading.limit(float(unit.upper[i]))
            for unit in one.own
        ]
        rows.append([number(one.tau[i]), common, *own])
    caption = f"{axis}: Allan deviation in {symbols(reading.unit)}, with 95 % intervals"
    return StabilityTable(caption, ["τ, s", "common", *(f"{k} alone" for k in sessions)], rows)


def _axes(sessions: Mapping[str, Analysis]) -> list[str]:
    return list(dict.fromkeys(name for one in sessions.values() for name in one.axes))


def _axis(name: str, sessions: Mapping[str, Analysis], svgs: Mapping[str, str]) -> dict[str, Any]:
    here = {label: one.axes[name] for label, one in sessions.items() if name in one.axes}
    unit = next(iter(here.values())).unit
    return {
        "name": name,
        "svg": svgs.get(f"{name}-comparison", ""),
        "heads": [f"{k}, {symbols(COEFFICIENTS[unit, k][0].unit)}" for k in MAIN_LETTERS],
        "rows": [
            {
                "name": label,
                "cells": [
                    *(
                        coefficient_table.coefficient_cell(a.coefficients.get(k), k, unit)
                        for k in MAIN_LETTERS
                    ),
                    axis_text.sheet_cell(a),
                ],
            }
            for label, a in here.items()
        ],
        "spread": [_spread(list(here.values()), k) for k in MAIN_LETTERS],
    }


def _spread(axes: Sequence[AxisAnalysis], letter: str) -> str:
    """Return the standard deviation over the mean where all detected it, in per cent.

    Beside it stands what the intervals alone would make of equal sensors: a spread that is not
    larger is no difference between them.
    """
    found = [a.coefficients[letter] for a in axes if letter in a.coefficients]
    known = [one for one in found if one.detected]
    if len(known) < 2:
        return "–"
    mean = math.fsum(one.value for one in known) / len(known)
    variance = math.fsum((one.value - mean) ** 2 for one in known) / (len(known) - 1)
    errors = [(one.upper - one.lower) / (2 * TWO_SIDED_95) for one in known]
    expected = math.sqrt(math.fsum(error**2 for error in errors) / len(errors))
    text = f"{number(100 * math.sqrt(variance) / mean, 2)} %"
    return f"{text} (by chance {number(100 * expected / mean, 2)} %)"
