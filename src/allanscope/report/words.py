"""The sentences and table cells of the report: the result of an axis in the words people use."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.explain.effect import AxisExplanation, Effect, Parameter
from allanscope.noise.coefficients import Coefficient
from allanscope.quantities import (
    COEFFICIENT_NAMES,
    COEFFICIENTS,
    DENSITY,
    DEVIATION,
    between,
    count,
    duration,
    interval,
    limit,
    number,
    rate,
    size,
    symbols,
)

__all__ = [
    "CoefficientRow",
    "EffectWords",
    "ErrorRow",
    "Fact",
    "VerdictLine",
    "axis_facts",
    "coefficient_cell",
    "coefficient_rows",
    "conclusion",
    "effect_words",
    "error_rows",
    "provenance",
    "quality",
    "searched",
    "verdict",
]

ORDER = ("N", "B", "K", "Q", "R")


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of a list of facts."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class VerdictLine:
    """One line of the verdict; `grade` is good, bad or note."""

    grade: str
    head: str
    text: str


@dataclass(frozen=True, slots=True)
class CoefficientRow:
    """One row of the table of coefficients."""

    name: str
    meaning: str
    value: str
    interval: str
    other: str
    decision: str


@dataclass(frozen=True, slots=True)
class EffectWords:
    """One effect, in words."""

    kind: str
    parameters: str
    equivalent: str
    words: str


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """One kind of error, before and after."""

    name: str
    before: str
    after: str


def verdict(analysis: Analysis) -> list[VerdictLine]:
    """Return what an engineer wants to know first: good or not, what is wrong, what is missing."""
    lines = [_datasheet_line(name, axis) for name, axis in analysis.axes.items()]
    out = [line for line in lines if line is not None]
    for name, axis in analysis.axes.items():
        for remark in axis.remarks:
            out.append(VerdictLine("note", f"{name}:", remark))
        if axis.explanation is None:
            continue
        effects = axis.explanation.effects
        if effects:
            kinds = ", ".join(effect_words(effect).kind for effect in effects)
            out.append(VerdictLine("note", f"{name}:", f"beyond the textbook noise: {kinds}"))
        if searched(axis.explanation) and not axis.explanation.explained:
            out.append(VerdictLine("bad", f"{name}:", "the model does not explain all of the data"))
    out += [VerdictLine("note", "Run:", remark) for remark in analysis.remarks]
    if analysis.lost_samples or analysis.unknown_losses:
        out.append(VerdictLine("note", "Losses:", _losses(analysis)))
    return out


def _datasheet_line(name: str, axis: AxisAnalysis) -> VerdictLine | None:
    found = axis.datasheet.get("density")
    if found is None or found.measured is None:
        return None
    if found.limit is None:
        return VerdictLine("note", f"{name}:", found.explanation)
    grade = {"better": "good", "typical": "good", "worse": "bad"}.get(found.verdict, "note")
    reading = DENSITY[axis.unit]
    text = (
        f"density {number(found.measured * reading.factor)} {symbols(reading.unit)}, datasheet "
        f"{number(found.limit * reading.factor)}: {found.verdict}"
    )
    return VerdictLine(grade, f"{name}:", text)


def coefficient_rows(axis: AxisAnalysis) -> list[CoefficientRow]:
    """Return the table of one axis' coefficients."""
    rows = []
    for name in ORDER:
        one = axis.coefficients.get(name)
        if one is None:
            continue
        usual, other = COEFFICIENTS[axis.unit, name]
        unit = symbols(usual.unit)
        low, high = one.lower * usual.factor, one.upper * usual.factor
        if one.detected:
            value = f"{interval(one.value * usual.factor, low, high).split(' (')[0]} {unit}"
            second = f"{number(one.value * other.factor)} {symbols(other.unit)}"
            decision = "detected"
        else:
            value = f"{limit(high)} {unit}"
            second = f"{limit(one.upper * other.factor)} {symbols(other.unit)}"
            decision = "upper limit" if one.wait_s is None else f"known in {duration(one.wait_s)}"
        shown = f"{number(low)} … {number(high)}"
        rows.append(CoefficientRow(name, COEFFICIENT_NAMES[name], value, shown, second, decision))
    return rows


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


def axis_facts(axis: AxisAnalysis) -> list[Fact]:
    """Return level, best averaging and the datasheet's verdict of one axis."""
    reading = DEVIATION[axis.unit]
    unit = symbols(reading.unit)
    facts = []
    if axis.level is not None:
        text = f"{number(axis.level.mean * reading.factor, 4)} {unit}"
        if axis.level.stability is not None:
            text += f", tenths of the run differ by {number(axis.level.stability * reading.factor)}"
        name = "zero-rate level" if axis.unit == "dps" else "mean acceleration"
        facts.append(Fact(name, text))
    best = axis.best_averaging
    if best is not None:
        text = (
            f"{count(best.samples)} samples ({duration(best.tau)}) give the smallest deviation, "
            f"{interval(*(x * reading.factor for x in (best.deviation, best.lower, best.upper)))} "
            f"{unit}"
        )
        text += f"; the minimum lies {between(best.tau_lower, best.tau_upper)}"
        if best.at_end:
            text += "; the curve still falls at the end of the run, so a longer run may do better"
        facts.append(Fact("best averaging", text))
    for name, found in axis.datasheet.items():
        facts.append(Fact(f"datasheet: {name}", f"{found.verdict}. {found.explanation}".strip()))
    return facts


def effect_words(effect: Effect) -> EffectWords:
    """Return one effect in words."""
    parameters = ", ".join(
        f"{name.replace('_', ' ')} {_parameter(one)}" for name, one in effect.parameters.items()
    )
    kind = effect.kind.replace("_", " ")
    if len(effect.axes) > 1:
        kind += f" (the same on {', '.join(effect.axes)})"
    words = str(effect.evidence.get("words", ""))
    equivalent = ", ".join(one.replace("_", " ") for one in effect.equivalent)
    return EffectWords(kind, parameters, equivalent, words)


def _parameter(one: Parameter) -> str:
    if isinstance(one.value, str):
        return one.value
    return f"{interval(one.value, one.lower, one.upper)} {symbols(one.unit)}".rstrip()


def searched(explanation: AxisExplanation) -> bool:
    """Return whether the loop could look at the axis at all; its remarks say why not."""
    return math.isfinite(explanation.before.chi2_per_dof)


def error_rows(explanation: AxisExplanation) -> list[ErrorRow]:
    """Return the table of errors before and after."""
    before, after = explanation.before, explanation.after
    gained = f"{number(explanation.held_out_nats)} ± {number(explanation.held_out_nats_se, 2)}"
    pairs: Iterable[tuple[str, float, float]] = (
        ("χ² per degree of freedom (full covariance)", before.chi2_per_dof, after.chi2_per_dof),
        ("its probability", before.p_value, after.p_value),
        ("rms of measured / model − 1 (%)", before.rms_percent, after.rms_percent),
        (
            "… that sampling alone leaves (%)",
            before.expected_rms_percent,
            after.expected_rms_percent,
        ),
        (
            "worst band of the spectrum (standard deviations)",
            before.worst_band_z,
            after.worst_band_z,
        ),
    )
    rows = [ErrorRow(name, number(one), number(two)) for name, one, two in pairs]
    return [*rows, ErrorRow("held-out log-likelihood gained (nats)", "", gained)]


def conclusion(explanation: AxisExplanation) -> str:
    """Return the last word of the loop on one axis."""
    if not searched(explanation):
        return " ".join(explanation.remarks)
    last = (
        "What is left is what sampling error leaves."
        if explanation.explained
        else "Something is left that no effect explains."
    )
    return " ".join([last, *explanation.remarks])


def quality(analysis: Analysis) -> list[Fact]:
    """Return what is known about losses, rate and temperature."""
    measured = analysis.rate.measured_hz
    nominal_hz = analysis.rate.nominal_hz
    if measured is None:
        rate_text = f"{number(nominal_hz, 6)} Hz nominal; not measured"
    else:
        rate_text = rate(measured, analysis.rate.uncertainty_ppm)
        if nominal_hz:
            rate_text += (
                f"; {number(nominal_hz, 6)} Hz nominal, "
                f"{number(100 * (measured / nominal_hz - 1))} % off"
            )
    link = analysis.link
    facts = [
        Fact("duration", duration(analysis.duration_s)),
        Fact("samples", f"{count(analysis.samples)} on each axis, {analysis.segments} segments"),
        Fact("lost samples", _losses(analysis)),
        Fact("rate", rate_text),
        Fact(
            "link",
            f"{size(link.bytes)} in {count(link.frames)} frames, "
            f"{link.crc_errors} checksum errors, "
            f"{link.resyncs} resynchronisations, {analysis.reconnects} reconnections",
        ),
    ]
    if analysis.temperature:
        t = analysis.temperature
        facts.append(
            Fact(
                "temperature",
                f"{t['first']:.1f} °C at the start, {t['last']:.1f} °C at the end, between "
                f"{t['lowest']:.1f} and {t['highest']:.1f} °C",
            )
        )
    return facts


def _losses(analysis: Analysis) -> str:
    text = f"{count(analysis.lost_samples)} samples known to be missing"
    if analysis.unknown_losses:
        text += f", and {analysis.unknown_losses} gaps of unknown length"
    return text


def provenance(analysis: Analysis, command: str) -> list[Fact]:
    """Return where the numbers come from and how to get them again."""
    facts = [Fact(name.replace("_", " "), text) for name, text in analysis.input.items() if text]
    facts.append(Fact("part", analysis.part or "not named"))
    facts.append(Fact("allanscope", analysis.version))
    if command:
        facts.append(Fact("to reproduce", command))
    return facts
