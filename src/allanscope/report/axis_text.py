"""The sentences and table cells of the report: the result of an axis in the words people use."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version

from allanscope.allan import CurveChoices, DynamicDeviation, variance_name
from allanscope.analysis import (
    UNEXPLAINED,
    Analysis,
    AxisAnalysis,
    Level,
    Rate,
    gaps_text,
    losses_text,
    parameter_text,
    recorded_text,
    shares_text,
    was_searched,
)
from allanscope.explain import AxisExplanation, Effect
from allanscope.labels import EXCESS, HELD_OUT, MODEL_ERRORS, kind_name
from allanscope.noise import DatasheetVerdict
from allanscope.quantities import (
    DEVIATION,
    LEVEL,
    between,
    count,
    counted,
    duration,
    interval,
    number,
    rate,
    size,
    symbols,
)
from allanscope.report.coefficient_table import white_facts

__all__ = [
    "CurveValues",
    "EffectText",
    "ErrorRow",
    "Fact",
    "SearchRow",
    "axis_facts",
    "conclusion",
    "conventions",
    "curve_values",
    "effect_words",
    "error_rows",
    "provenance",
    "quality",
    "search_rows",
    "sheet_cell",
    "subtitle",
    "zero_g",
]


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of a list of facts."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class EffectText:
    """One effect, in words."""

    kind: str
    parameters: str
    equivalent: str
    words: str


@dataclass(frozen=True, slots=True)
class SearchRow:
    """One hypothesis that the search tried."""

    move: str
    kind: str
    description: str
    gain: str
    penalty: str
    outcome: str


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """One kind of error, before and after."""

    name: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class CurveValues:
    """The curves of an axis in numbers: a column for each estimator, a row for each tau."""

    caption: str
    heads: list[str]
    rows: list[list[str]]


_IN_TABLE = ("oadev", "mdev", "ohdev")
"""Estimators of the table by default."""


def curve_values(axis: AxisAnalysis, choices: CurveChoices) -> CurveValues:
    """Return the curves that were chosen, else ADEV, MDEV and HDEV at powers of two."""
    kinds = [kind for kind in choices.kinds or _IN_TABLE if kind in axis.curves]
    reading, squared = DEVIATION[axis.unit], choices.variance
    power = 2 if squared else 1
    factor = reading.factor**power
    cells: dict[float, dict[str, str]] = {}
    for kind in kinds:
        curve = axis.curves[kind]
        columns = [curve.deviation, curve.lower, curve.upper]
        columns += curve.simple_limits() if choices.simple_limits else ()
        every = bool(choices.kinds or choices.taus)
        for i, (tau, m) in enumerate(zip(curve.tau.tolist(), curve.m.tolist(), strict=True)):
            if not every and m & (m - 1):
                continue
            value, lower, upper, *simple = (factor * float(x[i]) ** power for x in columns)
            text = f"{interval(value, lower, upper)} {curve.noise[i]}"
            if simple:
                text += f" ({number(simple[0])} to {number(simple[1])})"
            cells.setdefault(tau, {})[kind] = text
    name = symbols(reading.unit)
    unit = f"({name})²" if squared else name
    names = [variance_name(kind) if squared else kind.upper() for kind in kinds]
    caption = f"in {unit}, with 95 % interval and identified noise type"
    if choices.simple_limits:
        caption += "; in brackets value ∓ value / √terms (DT0064)"
    rows = [[number(tau, 4), *(cells[tau].get(k, "") for k in kinds)] for tau in sorted(cells)]
    return CurveValues(caption, ["τ, s", *names], rows)


def windows(dynamic: DynamicDeviation | None) -> str:
    """Return what a reader must know of the map of the Allan deviation over time."""
    if dynamic is None:
        return ""
    many, window = len(dynamic.start_s), duration(dynamic.window_s)
    return (
        f"Allan deviation of {many} windows of {window} each, over its median at each averaging "
        "time (dynamic Allan deviation). Red: more noise than usual, blue: less."
    )


def _rate_of(known: Rate) -> str:
    """Return the sample rate, the measured one where it is known."""
    nominal = f"{number(known.nominal_hz, 6)} Hz" if known.nominal_hz else ""
    if known.measured_hz is None:
        return nominal and f"{nominal} nominal"
    beside = f" ({known.nominal_hz:g} nominal)" if known.nominal_hz else ""
    return f"{number(known.measured_hz, 6)} Hz{beside}"


def subtitle(analysis: Analysis, operator: str) -> str:
    """Return what was measured, in one line: part, full scales, rate, length, when, by whom."""
    axes, known = len(analysis.axes), analysis.rate
    full_scales = analysis.input.get("full_scales", "")
    serial = analysis.input.get("serial") or analysis.input.get("serial_number", "")
    facts = (
        analysis.part,
        serial and f"serial number {serial}",
        full_scales and f"full scale {full_scales}",
        _rate_of(known),
        recorded_text(analysis),
        counted(axes, "axis", "axes"),
        _started(analysis.input.get("started", "")),
        operator and f"measured by {operator}",
    )
    return ", ".join(filter(None, facts))


def _started(text: str) -> str:
    """Return an ISO time to the second, as people write it."""
    moment, _, rest = text.partition(".")
    return f"{moment.replace('T', ' ')}{' UTC' if rest.endswith('+00:00') else ''}"


def sheet_cell(axis: AxisAnalysis) -> str:
    """Return the datasheet's verdicts on one axis, each with what it is about."""
    return "; ".join(f"{name}: {one.verdict}" for name, one in axis.datasheet.items()) or "–"


def axis_facts(axis: AxisAnalysis) -> list[Fact]:
    """Return level, best averaging and the datasheet's verdict of one axis."""
    reading = DEVIATION[axis.unit]
    facts = [Fact(name, text) for name, text in white_facts(axis)]
    if axis.level is not None:
        name = "zero-rate level" if axis.unit == "dps" else "mean acceleration"
        facts.append(Fact(name, _level(axis.level)))
    best = axis.best_averaging
    if best is not None:
        value = reading.interval(best.deviation, best.lower, best.upper)
        text = (
            f"{count(best.samples)} samples ({duration(best.tau)}) give the smallest deviation, "
            f"{value} {symbols(reading.unit)}"
            f"; the minimum lies {between(best.tau_lower, best.tau_upper)}"
        )
        if best.at_end:
            text += "; no clear rise beyond it: a longer recording may go lower"
        facts.append(Fact("best averaging", text))
    for name, found in axis.datasheet.items():
        words = symbols(found.explanation)
        text = f"{found.verdict}: {words}" if words else found.verdict
        facts.append(Fact(f"datasheet: {name}", text))
    if axis.comparison is not None:
        name = f"compared with {axis.comparison.reference.name}"
        facts.append(Fact(name, axis.comparison.words))
    return facts


def _level(level: Level) -> str:
    reading = LEVEL[level.unit]
    text = f"{number(level.mean * reading.factor, 4)} {symbols(reading.unit)}"
    if level.stability is None:
        return f"{text}; the run is too short to tell how stable"
    moved = f"{number(level.stability * reading.factor)} {symbols(reading.unit)}"
    return f"{text}; means over tenths of the run differ by {moved} (one standard deviation)"


def zero_g(analysis: Analysis) -> Fact | None:
    """Return how far the mean acceleration is from 1 g: all that one position can tell.

    The zero-g level of each axis needs six positions; at rest only the length of the vector is
    known, in which offsets and scale errors are together.
    """
    levels = [axis.level for axis in analysis.axes.values() if axis.unit == "g"]
    means = [level.mean for level in levels if level is not None]
    if len(means) < 3:
        return None
    away = 1e3 * (math.hypot(*means) - 1.0)
    text = (
        f"the mean vector is {number(abs(away))} mg {'longer' if away > 0 else 'shorter'} than "
        "1 g: offset and scale errors of the three axes together, which other positions separate"
    )
    return Fact("zero-g level", text)


def effect_words(effect: Effect) -> EffectText:
    """Return one effect in words, with the evidence."""
    # What has no name says in its own words where it is; its parameters say less.
    shown = {} if effect.kind == UNEXPLAINED and effect.evidence.get("words") else effect.parameters
    parameters = ", ".join(
        f"{name.replace('_', ' ')} {parameter_text(one)}" for name, one in shown.items()
    )
    kind = effect.kind if effect.kind == UNEXPLAINED else kind_name(effect.kind)
    if len(effect.axes) > 1:
        kind += f" (the same on {' '.join(effect.axes)})"
    equivalent = ", ".join(map(kind_name, effect.equivalent))
    return EffectText(kind, parameters, equivalent, _evidence(effect))


def _gain(nats: float) -> str:
    """Return a log-likelihood gain with one decimal, a large one in three digits.

    >>> _gain(251.04), _gain(1400534839.0), _gain(math.inf)
    ('251.0', '1.4e9', 'exact')
    """
    if not math.isfinite(nats):
        return "exact"
    return f"{nats:.1f}" if abs(nats) < 1e4 else number(nats)


def search_rows(loop: AxisExplanation) -> list[SearchRow]:
    """Return the path of the search: what was tried, what it gained, and which gate stopped it."""
    return [
        SearchRow(
            step.move,
            kind_name(step.kind),
            step.description,
            _gain(step.gain),
            f"{step.penalty:.1f}",
            step.outcome,
        )
        for step in loop.path
    ]


def _evidence(effect: Effect) -> str:
    """Return the sentence of an effect and the numbers behind it."""
    known = effect.evidence
    parts = [str(known["words"])] if known.get("words") else []
    if isinstance(known.get("p_value"), float):
        parts.append(f"false-alarm probability {_probability(known['p_value'])}")
    if known.get("held_out_design"):
        parts.append(f"held-out test: {known['held_out_design']}")
    if effect.given_detection is not None:
        corrected = parameter_text(effect.given_detection)
        parts.append(f"near the detection limit; size corrected for selection bias: {corrected}")
    # What the whole stream shows, as the clock's rate, is there all the time.
    match None if effect.traits.of_the_stream else known.get("replicated"):
        case True:
            parts.append("seen in independent parts of the recording")
        case False:
            parts.append("not seen in other parts of the recording")
        case "not replicated":
            parts.append("seen once; confirm with a second recording")
        case None:
            pass
        case other:
            parts.append(str(other))
    return symbols("; ".join(parts))


def _probability(p: float) -> str:
    return "below 1e-12" if p < 1e-12 else number(p, 2)


def error_rows(explanation: AxisExplanation) -> list[ErrorRow]:
    """Return the table of errors before and after."""
    before, after = explanation.before, explanation.after
    gained = f"{number(explanation.held_out_nats)} ± {number(explanation.held_out_nats_se, 2)}"
    rows = [
        ErrorRow(
            name,
            *(
                (_probability if field == "p_value" else number)(getattr(one, field))
                for one in (before, after)
            ),
        )
        for field, name in MODEL_ERRORS.items()
    ]
    rows.append(ErrorRow(HELD_OUT, "", gained))
    if shares := shares_text(explanation):
        rows.append(ErrorRow(EXCESS, "", shares))
    return rows


def conclusion(explanation: AxisExplanation) -> list[str]:
    """Return the outcome of the loop on one axis, and its remarks."""
    if not was_searched(explanation):
        return [f"Not searched: {symbols(remark)}." for remark in explanation.remarks]
    last = (
        "The residual is consistent with sampling error."
        if explanation.explained
        else "The residual is not consistent with sampling error: partly unexplained."
    )
    remarks = map(symbols, explanation.remarks)
    return [last, *(f"{remark[:1].upper()}{remark[1:]}." for remark in remarks)]


def quality(analysis: Analysis) -> list[Fact]:
    """Return what is known about losses, rate and temperature."""
    measured = analysis.rate.measured_hz
    nominal_hz = analysis.rate.nominal_hz
    if measured is None:
        rate_text = f"{number(nominal_hz, 6)} Hz nominal; not measured"
    else:
        rate_text = symbols(rate(measured, analysis.rate.uncertainty_ppm))
        if nominal_hz:
            rate_text += f"; {number(nominal_hz, 6)} Hz nominal"
            away = measured / nominal_hz - 1.0
            if abs(away) > 1e-6 * (analysis.rate.uncertainty_ppm or 0.0):
                rate_text += f", {number(100 * away)} % off"
    link = analysis.link
    facts = [
        Fact("duration", recorded_text(analysis)),
        Fact("samples", f"{count(analysis.samples)} per axis, {gaps_text(analysis.segments)}"),
        Fact("lost samples", losses_text(analysis)),
        Fact("rate", rate_text),
        *(Fact(kind_name(one.kind), effect_words(one).words) for one in analysis.effects),
    ]
    if link.bytes:
        facts.append(
            Fact(
                "link",
                f"{size(link.bytes)} in {count(link.frames)} frames, "
                f"{link.crc_errors} checksum errors, "
                f"{link.resyncs} resynchronisations, {link.suspect} suspect rows, "
                f"{analysis.reconnects} reconnections",
            )
        )
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


def provenance(analysis: Analysis, command: str) -> list[Fact]:
    """Return where the numbers come from and how to get them again."""
    facts = [
        Fact(name.replace("_", " "), text)
        for name, text in analysis.input.items()
        if text and name != "command"
    ]
    facts.append(Fact("part", analysis.part or "unknown"))
    levels = {curve.level for axis in analysis.axes.values() for curve in axis.curves.values()}
    if levels:
        facts.append(Fact("intervals", f"{number(100 * max(levels))} %"))
    kinds = dict.fromkeys(kind for axis in analysis.axes.values() for kind in axis.curves)
    facts.append(Fact("estimators", " ".join(kinds).upper()))
    facts += [Fact(name, text) for name, text in _choices(analysis.choices)]
    facts.append(Fact("allanscope", analysis.version))
    facts.append(Fact("computed with", _versions()))
    if command:
        facts.append(Fact("to reproduce", command))
    return facts


def _choices(chosen: CurveChoices) -> Iterable[tuple[str, str]]:
    """Yield what was chosen otherwise than usual, which the curves depend on."""
    if chosen.taus:
        listed = (
            " ".join(f"{tau:g}" for tau in chosen.taus) if chosen.taus != str(chosen.taus) else ""
        )
        yield "averaging times", f"{listed} s" if listed else str(chosen.taus)
    if chosen.hadamard == "dt0064":
        yield "Hadamard factor", "1/2 (DT0064): deviations are √3 times those of NIST SP 1065"
    if chosen.noise is not None:
        yield "noise type", f"{chosen.noise} at every τ, given and not identified"
    if chosen.bias_corrected is not True:
        which = "removed from TOTDEV and THEO1 too" if chosen.bias_corrected else "left in"
        yield "bias of the totals", which


def _versions() -> str:
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    return f"Python {platform.python_version()}, {packages}"


def conventions(analysis: Analysis) -> list[str]:
    """Return what must be known to compare the densities with anyone else's, with an example."""
    out = [
        "A datasheet's noise density is one-sided. N of IEEE 952 is two-sided, √2 smaller for the "
        "same noise, and is what the Allan deviation of white noise is at τ = 1 s. The verdict "
        "therefore compares √2 N with the datasheet."
    ]
    for name, axis in analysis.axes.items():
        found = axis.coefficients.get("N")
        if axis.unit == "dps" and found is not None and found.detected:
            out.append(_angle_example(name, found.value, axis.datasheet.get("density")))
            break
    return out


def _angle_example(name: str, N: float, sheet: DatasheetVerdict | None) -> str:
    arw = 60.0 * N
    angles = ", ".join(
        f"{number(arw * math.sqrt(hours))}° after {label}"
        for hours, label in ((1 / 60, "1 min"), (1.0, "1 h"), (8.0, "8 h"))
    )
    text = (
        f"Angle random walk of {name}: N = {number(1e3 * N)} mdps/√Hz is {number(arw)} °/√h. When "
        "the rate is integrated for a time t, its white noise alone leaves an angle with the "
        f"standard deviation ARW √t: {angles}."
    )
    if sheet is not None and sheet.limit is not None:
        text += (
            " ST's design tip DT0064 takes the density itself for the angle random walk: then "
            f"the datasheet's {number(1e3 * sheet.limit)} mdps/√Hz are "
            f"{number(60 * sheet.limit)} °/√h, and a final angle error of "
            f"{number(60 * sheet.limit)}° after an hour; read as one-sided, "
            f"{number(60 * sheet.limit / math.sqrt(2))}°."
        )
    return text
