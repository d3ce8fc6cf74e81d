"""What the field computes beside deviations, of the axes of a run: the tables of one fold.

MTIE and TIE rms of the integrals, the codeviation of axes, coefficients by slope regression, and
what theory says of the sampling error of OADEV. Each says in its caption what it is and what it is
for; a three-cornered hat needs three units (`allanscope together`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import LETTERS, Deviation, alpha_named, avlr, gcodev, mtie, tierms
from allanscope.analysis import Analysis, AxisAnalysis
from allanscope.history import Record
from allanscope.noise import deviation_covariance, model_of
from allanscope.quantities import (
    COEFFICIENTS,
    DEVIATION,
    GRAVITY,
    SENSOR_NAMES,
    Reading,
    interval,
    number,
    symbols,
)
from allanscope.report.coefficient_table import coefficient_cell

__all__ = ["StabilityTable", "stability_tables"]

Floats = NDArray[np.float64]

_STEP = 4
"""From one averaging time to the next."""
_MOST_PHASES = 1 << 16
"""A longer phase is thinned, which leaves windows of whole steps what they are."""
_LEAST_TERMS = 10
"""Windows of the longest averaging time in the record, as everywhere else."""
_LEAST_POINTS = 3
"""Of a line of known slope."""
_INTEGRALS: Mapping[str, tuple[str, Reading]] = {
    "dps": ("angle", Reading(1.0, "deg")),
    "g": ("velocity", Reading(GRAVITY, "m/s")),
}
_LINES = "QNBK"


@dataclass(frozen=True, slots=True)
class StabilityTable:
    """One table: its caption, the heads of its columns, its cells."""

    caption: str
    heads: list[str]
    rows: list[list[str]]


def stability_tables(analysis: Analysis) -> list[StabilityTable]:
    """Return the tables that the record has enough samples for."""
    found: list[StabilityTable] = []
    for unit, sensor in SENSOR_NAMES.items():
        axes = {k: axis for k, axis in analysis.axes.items() if axis.unit == unit and axis.curves}
        if not axes:
            continue
        name = sensor.capitalize()
        if analysis.record is not None:
            rates, hz = _longest(analysis.record, list(axes))
            found += _time_errors(name, unit, list(axes), rates, hz)
            found += _codeviations(name, unit, list(axes), rates, hz)
        found += _slopes(name, unit, axes)
        found += _sampling(name, axes, analysis.rate.best_hz, analysis.samples)
    return found


def _longest(record: Record, axes: list[str]) -> tuple[Floats, float]:
    """Return the longest stretch of rows without a gap, shape (axes, rows), and their rate."""
    first, last = max(record.segments.tolist(), key=lambda s: s[1] - s[0], default=(0, 0))
    columns = [record.axes.index(axis) for axis in axes if axis in record.axes]
    return record.values[first:last, columns].T, record.rate_hz


def _factors(rows: int) -> list[int]:
    """Return averaging factors in powers of `_STEP`, up to a tenth of the rows."""
    found = [1]
    while found[-1] * _STEP * _LEAST_TERMS <= rows:
        found.append(found[-1] * _STEP)
    return found if rows > _LEAST_TERMS else []


def _time_errors(
    sensor: str, unit: str, axes: list[str], rates: Floats, hz: float
) -> Iterable[StabilityTable]:
    step = max(1, -(-rates.shape[1] // _MOST_PHASES))
    m = _factors(rates.shape[1] // step)
    if not m:
        return
    what, reading = _INTEGRALS[unit]
    cells = []
    for rate in rates:
        phase = reading.factor / hz * np.append(0.0, np.cumsum(rate - rate.mean()))[::step]
        pairs = zip(mtie(phase, m), tierms(phase, m), strict=True)
        cells.append([f"{number(largest)}, {number(rms)}" for largest, rms in pairs])
    yield StabilityTable(
        f"{sensor}: change of the {what} within τ, in {symbols(reading.unit)}, without the mean "
        "rate: the largest (MTIE) and the rms (TIE rms).",
        ["τ, s", *axes],
        [[number(k * step / hz), *row] for k, *row in zip(m, *cells, strict=True)],
    )


def _codeviations(
    sensor: str, unit: str, axes: list[str], rates: Floats, hz: float
) -> Iterable[StabilityTable]:
    m = _factors(rates.shape[1])
    pairs = list(combinations(range(len(axes)), 2))
    if not m or not pairs:
        return
    reading = DEVIATION[unit]
    cells = [
        [number(reading.factor * v) for v in gcodev(rates[i], rates[j], hz, m)] for i, j in pairs
    ]
    yield StabilityTable(
        f"{sensor}: Groslambert codeviation of two axes, in {symbols(reading.unit)}: the Allan "
        "deviation of what they share. Where they share nothing it is small and of either sign.",
        ["τ, s", *(f"{axes[i]} {axes[j]}" for i, j in pairs)],
        [[number(k / hz), *row] for k, *row in zip(m, *cells, strict=True)],
    )


def _slopes(sensor: str, unit: str, axes: Mapping[str, AxisAnalysis]) -> Iterable[StabilityTable]:
    rows = []
    for name, axis in axes.items():
        for letter, low, high in _stretches(axis.curves.get("oadev")):
            fit, reading = (
                avlr(axis.curves["oadev"], letter, low, high),
                COEFFICIENTS[unit, letter][0],
            )
            factor = reading.factor
            value = interval(factor * fit.value, factor * fit.lower, factor * fit.upper)
            likelihood = coefficient_cell(axis.coefficients.get(letter), letter, unit)
            span = f"{number(low, 2)} to {number(high, 2)} s"
            unit_text = symbols(reading.unit)
            rows.append([f"{name} {letter}", span, f"{value} {unit_text}", likelihood])
    if rows:
        yield StabilityTable(
            f"{sensor}: AVLR, one line of known slope through the points of OADEV with one noise "
            "type, beside the fit to the whole spectrum. A line takes in whatever else is "
            "there.",
            ["coefficient", "τ", "by AVLR", "by the fit"],
            rows,
        )


def _stretches(curve: Deviation | None) -> Iterable[tuple[str, float, float]]:
    """Yield letter and range of tau of the longest row of trusted points with each noise type."""
    if curve is None:
        return
    longest: dict[str, list[int]] = {}
    points = np.flatnonzero(curve.trusted & (curve.deviation > 0)).tolist()
    for label, group in groupby(points, key=lambda i: str(curve.noise[i])):
        here = list(group)
        if label and len(here) > len(longest.get(label, [])):
            longest[label] = here
    for label, here in longest.items():
        letter = LETTERS[alpha_named(label)]
        if letter in _LINES and len(here) >= _LEAST_POINTS:
            yield letter, float(curve.tau[here[0]]), float(curve.tau[here[-1]])


def _sampling(
    sensor: str, axes: Mapping[str, AxisAnalysis], hz: float, samples: int
) -> Iterable[StabilityTable]:
    m = np.array(_factors(samples))
    columns: dict[str, list[str]] = {}
    for name, axis in axes.items():
        known = {k: c.value for k, c in axis.coefficients.items() if k in _LINES and c.detected}
        if m.size and known and hz > 0.0:
            model = model_of(",".join(f"{k}={v!r}" for k, v in known.items()), 1.0 / hz)
            covariance = deviation_covariance(model, "oadev", m, samples)
            sd = np.sqrt(np.diag(covariance))
            relative = 50.0 * sd / model.variance("oadev", m)
            with_next = np.diag(covariance, 1) / (sd[1:] * sd[:-1])
            cells = [f"{number(error, 2)} %" for error in relative]
            both = (f"{a}, {number(r, 2)}" for a, r in zip(cells, with_next, strict=False))
            columns[name] = [*both, cells[-1]]
    if columns:
        yield StabilityTable(
            f"{sensor}: sampling error of OADEV (one standard deviation) and its correlation with "
            "that of the next row, by the theoretical covariance of AVAR under the detected "
            "coefficients.",
            ["τ, s", *columns],
            [[number(k / hz), *row] for k, *row in zip(m.tolist(), *columns.values(), strict=True)],
        )
