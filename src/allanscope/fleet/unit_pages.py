"""A page for each unit that the report lists: its runs beside the lot, and why it is named.

Tables for all; a picture, which costs a hundred times as much, for the units that stand out.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from allanscope.analysis import Verdict, VerdictLine
from allanscope.fleet.effects import FoundEffect
from allanscope.fleet.lot import Lot
from allanscope.fleet.pictures import CurveBands, curves_picture
from allanscope.fleet.verdict import Finding, simulation_banner
from allanscope.labels import kind_name
from allanscope.quantities import (
    COEFFICIENTS,
    LEVEL,
    MAIN_LETTERS,
    SENSOR_NAMES,
    counted,
    duration,
    number,
    symbols,
)
from allanscope.report import template
from allanscope.samples import unit_of

__all__ = ["page_name", "unit_pages"]

MOST_PICTURES = 40
"""Of the units farthest out."""
MOST_RUNS = 600
"""Rows of a page: a hundred runs of six axes."""


def page_name(unit: str) -> str:
    """Return the file name of the page of a unit, whatever its name is made of.

    Examples
    --------
    >>> page_name("unit-07"), page_name("../a b")
    ('unit-07.html', 'a-b-2c2c791a.html')
    """
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", unit).strip("-")[:60]
    if plain != unit:
        plain = f"{plain}-{hashlib.sha256(unit.encode('utf-8', 'replace')).hexdigest()[:8]}"
    return f"{plain}.html"


def unit_pages(
    lot: Lot,
    units: Sequence[str],
    named: Sequence[Finding],
    effects: Sequence[FoundEffect],
    bands: Mapping[str, CurveBands],
) -> Iterator[tuple[str, str]]:
    """Yield file name and page of some units.

    Parameters
    ----------
    lot : Lot
        All of it.
    units : sequence of str
        That get a page.
    named : sequence of Finding
        Why units are named, those farthest out first.
    effects : sequence of FoundEffect
        Of the lot.
    bands : mapping
        Curves of each axis.
    """
    page = template("unit.html.j2")
    usual = {
        (axis, name): np.nanmedian(values) if np.isfinite(values).any() else math.nan
        for axis in lot.axes
        for name in MAIN_LETTERS
        for values in [lot.of_axis(axis).detected(name)[f"{name}_value"]]
    }
    own: dict[str, list[FoundEffect]] = {unit: [] for unit in units}
    for one in effects:
        if one.unit in own:
            own[one.unit].append(one)
    drawn = list(dict.fromkeys(one.unit for one in named))[:MOST_PICTURES]
    names = lot.units
    order = np.argsort(names, kind="stable")
    ends = [np.searchsorted(names[order], units, side) for side in ("left", "right")]
    for unit, first, stop in zip(units, *ends, strict=True):
        here = lot.where(order[first:stop])
        mine = [one for one in named if one.unit == unit]
        yield (
            page_name(unit),
            page.render(
                title=f"Unit {unit}",
                subtitle=_subtitle(here),
                verdict=_verdict(unit, mine, simulation_banner(here)),
                pictures=_pictures(bands, mine) if unit in drawn else [],
                sensors=[
                    {"name": SENSOR_NAMES[sensor], "rows": _rows(here, sensor, usual)}
                    for sensor in SENSOR_NAMES
                    if (here["sensor_unit"] == sensor).any()
                ],
                units=_heads(),
                effects=_effects(own[unit]),
                footer=f"allanscope {version('allanscope')}",
            ),
        )


def _subtitle(here: Lot) -> str:
    parts = sorted({str(part) for part in here["part"] if part})
    _, first = np.unique(here["recording"].astype(np.str_), return_index=True)
    total = duration(float(np.sum(here["duration_s"][first])))
    recordings = counted(len(first), "recording")
    return f"{', '.join(parts) or 'a sensor'}, {recordings}, {total} in all"


def _verdict(unit: str, mine: Sequence[Finding], banner: str) -> Verdict:
    if not mine:
        title = "does not stand out"
        return Verdict("good", title, (VerdictLine("good", unit, title),), banner=banner)
    lines = tuple(VerdictLine("bad", one.axis, one.reason) for one in mine)
    return Verdict("bad", "stands out", lines, banner=banner)


def _pictures(bands: Mapping[str, CurveBands], mine: Sequence[Finding]) -> list[str]:
    """Return the curves of a unit over those of the lot, for the sensors on which it stands out."""
    found = []
    for sensor in SENSOR_NAMES:
        some = [one for one in mine if one.axis != "all" and unit_of(one.axis) == sensor]
        picture = curves_picture(bands, sensor, some) if some else None
        if picture is not None:
            found.append(picture.svg())
    return found


def _heads() -> dict[str, list[str]]:
    return {
        SENSOR_NAMES[sensor]: [
            *(f"{name} ({symbols(COEFFICIENTS[sensor, name][0].unit)})" for name in MAIN_LETTERS),
            f"level ({symbols(LEVEL[sensor].unit)})",
        ]
        for sensor in SENSOR_NAMES
    }


def _rows(here: Lot, sensor: str, usual: Mapping[tuple[str, str], float]) -> list[dict[str, Any]]:
    """Return a row for each run and axis."""
    some = here.where(here["sensor_unit"] == sensor)
    order = np.lexsort((some["axis"].astype(np.str_), some["recording"].astype(np.str_)))
    rows = []
    for at in order[:MOST_RUNS].tolist():
        axis = some["axis"][at]
        ratio = some["N_value"][at] / usual[axis, "N"]
        level = some["level_mean"][at] * LEVEL[sensor].factor
        rows.append(
            {
                "run": some["recording"][at],
                "axis": axis,
                "cells": [
                    *(_coefficient(some, at, sensor, name) for name in MAIN_LETTERS),
                    _number(level),
                    _number(ratio),
                    _number(some["measured_hz"][at], 6),
                    number(float(np.nan_to_num(some["lost_samples"][at]))),
                ],
            }
        )
    return rows


def _coefficient(some: Lot, at: int, sensor: str, name: str) -> str:
    reading = COEFFICIENTS[sensor, name][0]
    value, lower, upper = (float(some[f"{name}_{p}"][at]) for p in ("value", "lower", "upper"))
    if some[f"{name}_detected"][at] == 1.0 and math.isfinite(value):
        return reading.interval(value, lower, upper)
    return reading.limit(upper) if math.isfinite(upper) else "–"


def _number(value: float, digits: int = 3) -> str:
    return number(float(value), digits) if math.isfinite(value) else "–"


def _effects(effects: Sequence[FoundEffect]) -> list[dict[str, str]]:
    return [
        {
            "run": one.recording,
            "axis": one.axis,
            "kind": kind_name(one.kind),
            "parameters": ", ".join(
                f"{name.replace('_', ' ')} {number(value)} {unit or ''}".strip()
                for name, (value, _, _, unit) in one.parameters.items()
            ),
        }
        for one in effects[:MOST_RUNS]
    ]
