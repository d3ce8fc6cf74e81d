"""The coefficients of an axis as table cells: the fit, and the values taken from the curve."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from allanscope.analysis import AxisAnalysis, Reading, wait_text
from allanscope.noise import Coefficient
from allanscope.quantities import (
    COEFFICIENT_NAMES,
    COEFFICIENTS,
    LETTERS,
    POWER_LAW_NAMES,
    count,
    duration,
    interval,
    limit,
    number,
    symbols,
)

__all__ = [
    "CoefficientRow",
    "coefficient_cell",
    "coefficient_rows",
    "power_law_rows",
    "reading_cell",
    "white_facts",
]


@dataclass(frozen=True, slots=True)
class CoefficientRow:
    """One row of the table of coefficients."""

    name: str
    meaning: str
    value: str
    reading: str
    other: str
    wait: str
    uncertainty: str


def coefficient_rows(axis: AxisAnalysis) -> list[CoefficientRow]:
    """Return the table of one axis' coefficients."""
    rows = []
    for name in LETTERS:
        one = axis.coefficients.get(name)
        if one is None:
            continue
        usual, other = COEFFICIENTS[axis.unit, name]
        unit = symbols(usual.unit)
        low, high = one.lower * usual.factor, one.upper * usual.factor
        if one.detected:
            value = f"{interval(one.value * usual.factor, low, high)} {unit}"
            second = f"{number(one.value * other.factor)} {symbols(other.unit)}"
        elif not math.isfinite(high):
            value, second = "no upper limit", "–"
        else:
            value = f"{limit(high)} {unit}"
            second = f"{limit(one.upper * other.factor)} {symbols(other.unit)}"
        known = one.uncertainty
        uncertainty = "–"
        if known is not None:
            expanded = number(known.expanded * usual.factor, 2)
            uncertainty = f"{expanded} {unit}, {_freedom(known.degrees_of_freedom)}"
        read = reading_cell(axis.readings.get(name), name, axis.unit)
        rows.append(
            CoefficientRow(
                name,
                COEFFICIENT_NAMES[name],
                value,
                read,
                second,
                wait_text(one),
                uncertainty,
            )
        )
    return rows


def power_law_rows(axis: AxisAnalysis) -> list[tuple[str, str, str, str]]:
    """Return letter, name, value and status of the power laws that were asked for."""
    return [
        (
            letter,
            POWER_LAW_NAMES[letter],
            f"{coefficient_cell(one, letter, axis.unit)} "
            f"{symbols(COEFFICIENTS[axis.unit, letter][0].unit)}",
            "detected" if one.detected else "upper limit",
        )
        for letter, one in axis.power_laws.items()
    ]


def reading_cell(one: Reading | None, name: str, unit: str) -> str:
    """Return the value taken from the curve, and where; empty where there is none."""
    if one is None:
        return ""
    factor = COEFFICIENTS[unit, name][0].factor
    if one.lower == 0.0:
        text = limit(one.upper * factor)
    else:
        text = interval(one.value * factor, one.lower * factor, one.upper * factor)
    if one.band_hz is not None:
        return f"{text}, {number(one.band_hz[0], 2)} to {number(one.band_hz[1], 2)} Hz"
    return f"{text}, at {duration(one.tau_s or 0.0)}"


def coefficient_cell(one: Coefficient | None, name: str, unit: str) -> str:
    """Return one coefficient as a table cell, with its interval."""
    if one is None:
        return "–"
    reading = COEFFICIENTS[unit, name][0]
    if not one.detected:
        return limit(one.upper * reading.factor)
    return interval(
        one.value * reading.factor, one.lower * reading.factor, one.upper * reading.factor
    )


def white_facts(axis: AxisAnalysis) -> Iterable[tuple[str, str]]:
    """Return the parts of N, and N as read from the deviation at 1 s."""
    usual = COEFFICIENTS[axis.unit, "N"][0]
    unit = symbols(usual.unit)
    known = axis.coefficients.get("N")
    parts = {}
    if known is not None:
        parts = {"white noise alone": known.white_alone, "without other axes": known.decoupled}
    told = []
    for name, part in parts.items():
        if part is not None:
            shown = usual.interval(part.value, part.lower, part.upper)
            told.append(f"{name} {shown if part.detected else usual.limit(part.upper)} {unit}")
    if told:
        yield ("parts of N", "; ".join(told))
    at_1s = axis.readings.get("N_1s")
    if at_1s is not None:
        text = usual.interval(at_1s.value, at_1s.lower, at_1s.upper)
        yield ("deviation at 1 s × √1 s", f"{text} {unit}")


def _freedom(degrees: float) -> str:
    """Return degrees of freedom in two digits, large ones in groups of three.

    >>> _freedom(8.31), _freedom(110713.0)
    ('8.3', '110 000')
    """
    text = number(degrees, 2)
    return count(int(text)) if text.isdecimal() else text
