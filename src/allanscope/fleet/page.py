"""The report of a lot, as one self-contained HTML page in the style of a single session's."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from importlib.metadata import version
from typing import Any

import numpy as np

from allanscope.analysis import Grade, VerdictLine
from allanscope.fleet.acceptance import Acceptance
from allanscope.fleet.comparison import Difference, differences
from allanscope.fleet.drift import Drift, drifts_of
from allanscope.fleet.effects import (
    Replication,
    SharedEffect,
    effects_in,
    replications,
    shared_effects,
)
from allanscope.fleet.lot import Lot
from allanscope.fleet.pictures import (
    CurveBands,
    curve_bands,
    curves_picture,
    distribution_picture,
    history_picture,
)
from allanscope.fleet.repeats import Spread, log_sigma, spread_of, unit_estimates
from allanscope.fleet.typical_value import Typical, typical_of
from allanscope.fleet.unit_pages import page_name, unit_pages
from allanscope.fleet.verdict import (
    AverageLimits,
    Finding,
    average_limits,
    findings,
    lot_verdict,
    run_remarks,
    units_named,
)
from allanscope.labels import kind_name
from allanscope.quantities import (
    COEFFICIENTS,
    LEVEL,
    MAIN_LETTERS,
    SENSOR_NAMES,
    Reading,
    compact,
    counted,
    duration,
    interval,
    number,
    symbols,
)
from allanscope.report import template
from allanscope.samples import AXES

__all__ = ["STAGES", "render_lot"]

MOST_ROWS = 500
"""Lines of a list; the table has them all."""

_NINETY_PERCENT = 1.644854
"""Standard deviations to either side that hold 90 % of the units."""


STAGES = 12
"""Times that `render_lot` says that it has done a part."""


def render_lot(
    lot: Lot,
    failures: Mapping[str, str],
    copies: Mapping[str, str] | None = None,
    *,
    acceptance: Acceptance | None = None,
    other: Lot | None = None,
    other_name: str = "",
    put_page: Callable[[str, str], None] | None = None,
    advance: Callable[[float], None] = lambda _: None,
) -> str:
    """Return the page.

    Parameters
    ----------
    lot : Lot
        At least one row.
    failures : mapping
        Recordings without a result, and why.
    copies : mapping, optional
        Recordings that are left out, and the ones that they are copies of.
    acceptance : Acceptance, optional
        The lot against limits.
    other : Lot, optional
        A lot to compare with, called `other_name`.
    put_page : callable, optional
        Takes file name and text of the page of each unit that is listed; no pages without.
    advance : callable
        Told 1 for each of `STAGES` parts that is done.
    """

    def done(part: Any) -> Any:
        advance(1.0)
        return part

    effects = done(effects_in(lot))
    units = np.unique(lot.units)
    shared = done(shared_effects(effects, len(units)))
    named = done(findings(lot))
    compared = done(differences(lot, other) if other is not None else [])
    rejected = list(acceptance.rejected) if acceptance is not None else []
    bands = done(curve_bands(lot) if "curve" in lot.columns else {})
    sensors = [
        done(_sensor(lot, unit, named, bands))
        for unit in SENSOR_NAMES
        if (lot["sensor_unit"] == unit).any()
    ]
    listed = done(_units(lot, units.tolist(), [*rejected, *named]))
    limit_lines = _limit_lines(acceptance, compared, other_name)
    page = template("lot.html.j2").render(
        title=f"Lot of {counted(len(units), 'unit')}",
        subtitle=_subtitle(lot),
        verdict=lot_verdict(lot, named, shared, failures, limit_lines),
        sensors=sensors,
        outliers=[_linked(one, put_page) for one in named[:MOST_ROWS]],
        acceptance=acceptance,
        rejected=[_linked(one, put_page) for one in rejected[:MOST_ROWS]],
        other_name=other_name,
        differences=[_difference(lot, one) for one in compared],
        limits=done([_limits(lot, one) for one in average_limits(lot)]),
        run_remarks=run_remarks(lot)[:MOST_ROWS],
        shared=[_shared(one, len(units)) for one in shared[:MOST_ROWS]],
        replicates=done(_replicates(replications(lot, effects))),
        drifts=done(_drifts(lot)),
        repeated=_repeated(lot),
        units=[{**row, "page": _page_of(row["name"], put_page)} for row in listed],
        orders=ORDERS,
        failures=sorted(failures.values()),
        copies=sorted((copies or {}).items()),
        footer=f"allanscope {version('allanscope')}",
    )
    if put_page is not None:
        names = [row["name"] for row in listed]
        for name, text in unit_pages(lot, names, [*rejected, *named], effects, bands):
            put_page(name, text)
    advance(1.0)
    return page


def _page_of(unit: str, put_page: object) -> str:
    """Return where the page of a unit is; nothing where there are none."""
    return "" if put_page is None else f"units/{page_name(unit)}"


def _linked(one: Finding, put_page: object) -> dict[str, str]:
    return {
        "unit": one.unit,
        "axis": one.axis,
        "reason": one.reason,
        "page": _page_of(one.unit, put_page),
    }


def _limit_lines(
    acceptance: Acceptance | None, compared: list[Difference], other_name: str
) -> list[VerdictLine]:
    """Return the lines of the verdict about limits, and about another lot."""
    lines = []
    if acceptance is not None:
        grade: Grade = "bad" if acceptance.rejected else "good"
        lines.append(VerdictLine(grade, "limits", acceptance.words))
    if compared:
        seen = [f"{one.quantity} of {one.axis}" for one in compared if one.is_significant]
        text = f"{', '.join(seen[:8])}{' …' * (len(seen) > 8)} differ" if seen else "no difference"
        text += f"; {len(compared)} quantities compared at 1 % in all"
        lines.append(VerdictLine("note" if seen else "good", f"against {other_name}", text))
    return lines


def _difference(lot: Lot, one: Difference) -> dict[str, Any]:
    if one.quantity == "rate":
        factor, unit, per = 1.0, "Hz", 1e6
    else:
        sensor = lot.of_axis(one.axis)["sensor_unit"][0]
        is_level = one.quantity == "level"
        reading = LEVEL[sensor] if is_level else COEFFICIENTS[sensor, one.quantity][0]
        factor, unit = reading.factor, symbols(reading.unit)
        per = factor if is_level else 100.0
    change = interval(per * one.change, per * one.lower, per * one.upper)
    of = {"rate": "ppm", "level": unit}.get(one.quantity, "%")
    return {
        "axis": one.axis,
        "name": f"{one.quantity} ({unit})",
        "here": number(factor * one.value, 6 if one.quantity == "rate" else 3),
        "there": number(factor * one.other, 6 if one.quantity == "rate" else 3),
        "change": f"{change} {of}",
        "chance": _probability(one.p_value),
        "seen": "differs" if one.is_significant else "",
    }


def _subtitle(lot: Lot) -> str:
    parts = sorted({str(part) for part in lot["part"] if part}) or ["a sensor"]
    _, first = np.unique(lot["recording"].astype(np.str_), return_index=True)
    total_s = float(np.sum(lot["duration_s"][first]))
    recordings = counted(len(first), "recording")
    return f"{recordings} of {', '.join(parts)}, {duration(total_s)} in all"


def _repeated(lot: Lot) -> int:
    """Return how many units have more than one run."""
    pairs = set(zip(lot["unit"].tolist(), lot["recording"].tolist(), strict=True))
    _, runs = np.unique([unit for unit, _ in pairs], return_counts=True)
    return int(np.count_nonzero(runs > 1))


def _sensor(
    lot: Lot, sensor_unit: str, named: list[Finding], bands: Mapping[str, CurveBands]
) -> dict[str, Any]:
    here = lot.where(lot["sensor_unit"] == sensor_unit)
    history = history_picture(lot, sensor_unit)
    curves = curves_picture(bands, sensor_unit, named)
    return {
        "name": SENSOR_NAMES[sensor_unit],
        "svg": distribution_picture(lot, sensor_unit, named).svg(),
        "curves": curves.svg() if curves is not None else "",
        "history": history.svg() if history is not None else "",
        "rows": [
            _row(here.of_axis(axis), axis, name, named)
            for axis in here.axes
            for name in MAIN_LETTERS
        ],
        "datasheet": _datasheet(here),
    }


def _row(lot: Lot, axis: str, name: str, named: list[Finding]) -> dict[str, str]:
    reading = COEFFICIENTS[lot["sensor_unit"][0], name][0]
    here = lot.detected(name)
    sigma = log_sigma(here[f"{name}_lower"], here[f"{name}_upper"])
    spread = spread_of(here[f"{name}_value"], sigma, here.units)
    belongs = ~np.isin(lot.units, units_named(named, axis, name))
    units = unit_estimates(lot.where(belongs), name)
    return {
        "axis": axis,
        "name": f"{name} ({symbols(reading.unit)})",
        "detected": f"{len(here)} of {len(lot)}",
        **_typical_cells(None if units is None else typical_of(units), reading),
        **_spread_cells(spread),
    }


def _typical_cells(typical: Typical | None, reading: Reading) -> dict[str, str]:
    if typical is None:
        return dict.fromkeys(("median", "range", "between"), "–")
    if math.isnan(typical.value):
        return {"median": reading.limit(typical.upper), "range": "–", "between": "–"}
    wide = math.exp(_NINETY_PERCENT * np.nan_to_num(typical.scatter))
    low, high = (number(reading.factor * x) for x in (typical.value / wide, typical.value * wide))
    return {
        "median": reading.interval(typical.value, typical.lower, typical.upper),
        "range": f"{low} to {high}" if math.isfinite(typical.scatter) else "–",
        "between": _percent(typical.scatter),
    }


def _spread_cells(spread: Spread | None) -> dict[str, str]:
    if spread is None:
        return dict.fromkeys(("alike", "within", "sampling"), "–")
    return {
        "alike": _probability(spread.p_alike),
        "within": _percent(spread.within),
        "sampling": _percent(spread.sampling),
    }


def _datasheet(lot: Lot) -> str:
    """Return how many runs keep to the datasheet's noise density."""
    verdicts = lot["datasheet_verdict"].tolist()
    counts = {name: verdicts.count(name) for name in ("better", "typical", "worse")}
    if not any(counts.values()):
        return "The datasheet's density could not be compared."
    told = ", ".join(f"{count} {name}" for name, count in counts.items())
    return f"Noise density against the datasheet, all axes and runs: {told}."


def _shared(one: SharedEffect, units: int) -> dict[str, str]:
    return {
        "kind": kind_name(one.kind),
        "frequency": _hertz(one.frequency_hz),
        "units": f"{len(one.units)} of {units}",
        "axes": ", ".join(one.axes),
        "whose": "the rack's" if one.of_rack else "",
    }


def _replicates(found: list[Replication]) -> dict[str, Any]:
    """Return what was held against other runs, first what was not found there again.

    An effect that shows on several axes of a unit in the same way has one row.
    """
    rows: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for one in sorted(found, key=lambda one: (one.replicated, one.agree is True)):
        kind, times = kind_name(one.kind), f"{one.found} of {one.runs} runs"
        rows[one.unit, kind, _hertz(one.frequency_hz), times, _again(one)].append(one.axis)
    return {
        "again": sum(one.replicated for one in found),
        "all": len(found),
        "rows": [
            {
                "unit": unit,
                "axes": ", ".join(axis for axis in AXES if axis in axes),
                "kind": kind,
                "frequency": frequency,
                "found": times,
                "verdict": verdict,
            }
            for (unit, kind, frequency, times, verdict), axes in list(rows.items())[:MOST_ROWS]
        ],
    }


def _again(one: Replication) -> str:
    if not one.replicated:
        return "not found again"
    return "replicated" if one.agree else "found again with another size"


def _drifts(lot: Lot) -> list[dict[str, Any]]:
    """Return a row for each axis and quantity, with its slopes over date and temperature."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for one in drifts_of(lot):
        row = rows.setdefault(
            (one.axis, one.quantity),
            {"axis": one.axis, "quantity": one.quantity, "runs": one.runs, "seen": []}
            | dict.fromkeys(("date", "temperature"), "–"),
        )
        row[one.on] = _slope(lot, one)
        if one.is_significant:
            row["seen"].append(one.on)
    return list(rows.values())


def _slope(lot: Lot, one: Drift) -> str:
    """Return a slope with its interval: of a coefficient in per cent, of a level in its unit."""
    factor, unit = 100.0, "%"
    if one.quantity == "level":
        reading = LEVEL[lot.of_axis(one.axis)["sensor_unit"][0]]
        factor, unit = reading.factor, symbols(reading.unit)
    slope, error = factor * one.slope, factor * one.error
    return f"{symbols(compact(slope, slope - error, slope + error))} {unit}"


def _limits(lot: Lot, one: AverageLimits) -> dict[str, Any]:
    sensor_unit = lot.of_axis(one.axis)["sensor_unit"][0]
    is_level = one.quantity == "level"
    reading = LEVEL[sensor_unit] if is_level else COEFFICIENTS[sensor_unit, one.quantity][0]
    cells = (number(reading.factor * x) for x in (one.lower, one.middle, one.upper))
    return {
        "axis": one.axis,
        "name": f"{one.quantity} ({symbols(reading.unit)})",
        "cells": list(cells),
        "units": str(one.units),
        "outside": ", ".join(one.outside[:8]) + (" …" if len(one.outside) > 8 else ""),
    }


ORDERS = ("unit", "runs", "lost samples", "N of gyros", "N of accelerometers", "outlier")
"""By what the table of units can be sorted. The page has no script: each row has its place in every
order, and a button chooses which one the browser lays the rows out by."""


def _units(lot: Lot, names: list[str], named: list[Finding]) -> list[dict[str, Any]]:
    """Return a row for each unit, those that stand out among them however many there are."""
    reasons = Counter(one.unit for one in named)
    kept = sorted(names, key=lambda name: -reasons[name])[:MOST_ROWS]
    order = np.argsort(lot.units, kind="stable")
    starts = (
        np.searchsorted(lot.units[order], kept),
        np.searchsorted(lot.units[order], kept, "right"),
    )
    usual = {axis: np.nanmedian(lot.of_axis(axis)["N_value"]) for axis in lot.axes}
    rows = [
        _unit(lot.where(order[first:stop]), name, reasons[name], usual)
        for name, first, stop in zip(kept, *starts, strict=True)
    ]
    rows.sort(key=lambda row: row["name"])
    for column in range(len(ORDERS)):
        ranked = sorted(rows, key=lambda row: row["keys"][column])
        for place, row in enumerate(ranked):
            row.setdefault("places", []).append(place)
    return rows


def _unit(here: Lot, name: str, reasons: int, usual: Mapping[str, float]) -> dict[str, Any]:
    _, first = np.unique(here["recording"].astype(np.str_), return_index=True)
    low, high = _nan_range(here["temperature_lowest"]), _nan_range(here["temperature_highest"])
    known = math.isfinite(low[0]) and math.isfinite(high[1])
    lost = float(np.sum(here["lost_samples"][first]))
    ratio = here["N_value"] / np.array([usual[axis] for axis in here["axis"]])
    noise = [_mean_ratio(ratio[here["sensor_unit"] == unit]) for unit in SENSOR_NAMES]
    return {
        "name": name,
        "cells": [
            str(len(first)),
            duration(float(np.sum(here["duration_s"][first]))),
            number(lost),
            number(float(np.nansum(here["damaged_places"][first]))),
            f"{low[0]:.1f} to {high[1]:.1f} °C" if known else "–",
            *(number(one, 3) if math.isfinite(one) else "–" for one in noise),
            str(reasons or ""),
        ],
        "keys": (
            *(name, -len(first), -lost),
            *(-np.nan_to_num(one) for one in noise),
            -reasons,
        ),
    }


def _mean_ratio(ratio: Any) -> float:
    """Return the geometric mean of the ratios that are known; NaN if none is."""
    known = ratio[np.isfinite(ratio) & (ratio > 0.0)]
    return float(np.exp(np.mean(np.log(known)))) if len(known) else math.nan


def _nan_range(values: Any) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else (math.nan, math.nan)


def _percent(share: float) -> str:
    return f"{number(100.0 * share, 2)} %" if math.isfinite(share) else "–"


def _probability(p: float) -> str:
    return "–" if math.isnan(p) else "< 0.001" if p < 1e-3 else number(p, 2)


def _hertz(frequency: float) -> str:
    return f"{number(frequency, 5)} Hz" if math.isfinite(frequency) else ""
