"""The tables of the viewer, in Markdown: coefficients, findings, the closed loop, the run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from allanscope.analysis import (
    UNEXPLAINED,
    Analysis,
    AxisAnalysis,
    Undisturbed,
    as_of_text,
    best_text,
    cause_phrase,
    coefficient_text,
    coefficient_unit,
    density_verdict,
    effect_brief,
    effect_text,
    finding_phrase,
    gaps_text,
    losses_text,
    measurements,
    rate_text,
    recorded_text,
    shares_text,
    verdict,
    wait_text,
)
from allanscope.explain import AxisExplanation
from allanscope.labels import (
    DATASHEET,
    EXCESS,
    HELD_OUT,
    MINIMUM,
    MODEL_ERRORS,
    OTHER_UNITS,
    WAIT,
)
from allanscope.quantities import (
    COEFFICIENT_NAMES,
    COEFFICIENTS,
    DEVIATION,
    LETTERS,
    LEVEL,
    MAIN_LETTERS,
    SENSOR_NAMES,
    between,
    count,
    counted,
    duration,
    number,
    size,
    symbols,
)
from allanscope.sanitize import markdown, one_line

__all__ = [
    "axis_table",
    "coefficients_table",
    "findings_table",
    "loop_table",
    "run_table",
    "verdict_text",
]

_KEY = (
    "*Line: measured. Hatch: 95 % interval. Dashed end: too few terms. Broad line: model; dashed, "
    "with letters: its components. Grey: datasheet.*"
)
_DETAILS_SHOWN = 4
_NEXT_SHOWN = 3


def verdict_text(analysis: Analysis) -> str:
    """Return the three lines of the verdict, and the first details below."""
    known = verdict(analysis)
    lines = [f"**{markdown(known.banner)}**"] if known.banner else []
    lines += [f"**{markdown(line.head)}:** {markdown(line.text)}" for line in known.lines]
    if known.details:
        behind = [f"*{markdown(one.head)}:* {markdown(one.text)}" for one in known.details]
        more = len(behind) - _DETAILS_SHOWN
        tail = [f"*{more} more: see the findings*"] if more > 0 else []
        lines.append(" · ".join((*behind[:_DETAILS_SHOWN], *tail)))
    return "  \n".join(lines)  # a hard break: paragraphs would take twice the height


def coefficients_table(analysis: Analysis) -> str:
    """Return N, B and K of all axes, with what averaging and the datasheet say."""
    moments = as_of_text(analysis.axes) or f"After {duration(analysis.duration_s)}"
    parts = [f"*{moments}; 95 % intervals; < is an upper limit*"]
    for unit, sensor in SENSOR_NAMES.items():
        axes = {name: axis for name, axis in analysis.axes.items() if axis.unit == unit}
        if axes:
            parts += [f"### {sensor.capitalize()}", _sensor_table(unit, axes, analysis.undisturbed)]
    return "\n\n".join(parts)


def axis_table(name: str, axis: AxisAnalysis) -> str:
    """Return everything that is a number about one axis."""
    rows = []
    for letter in LETTERS:
        coefficient = axis.coefficients.get(letter)
        if coefficient is None:
            continue
        usual, other = COEFFICIENTS[axis.unit, letter]
        shown = coefficient.value if coefficient.detected else coefficient.upper
        second = f"{'' if coefficient.detected else '< '}{number(shown * other.factor)}"
        rows.append(
            (
                f"**{letter}** {COEFFICIENT_NAMES[letter]}",
                f"{coefficient_text(axis.unit, letter, coefficient)} {symbols(usual.unit)}",
                f"{second} {symbols(other.unit)}",
                wait_text(coefficient),
            )
        )
    head = ("coefficient", "value [95 % interval]", OTHER_UNITS, WAIT)
    parts = [f"### {name}", _table(head, rows) if rows else "*no fit yet*"]
    parts += [
        f"- {line}"
        for line in (*_facts(axis), *(markdown(symbols(remark)) for remark in axis.remarks))
    ]
    if axis.explanation is not None:
        parts += [
            f"- found: {_mark(effect_text(effect))}" for effect in axis.explanation.own_effects
        ]
        parts += [f"- {markdown(symbols(remark))}" for remark in axis.explanation.remarks]
    return "\n\n".join([*parts[:2], "\n".join(parts[2:]), _KEY])


def findings_table(analysis: Analysis) -> str:
    """Return what the noise model lacks: each disturbance with its axes, and its effects."""
    lines = [f"- {markdown(effect_brief(effect))}" for effect in analysis.effects]
    for finding in analysis.findings:
        first = finding.members[0]
        if len(finding.members) == 1:
            lines.append(f"- **{first.axis}** {_mark(effect_text(first.effect))}")
        else:
            lines.append(f"- **{' '.join(finding.axes)}** {markdown(finding_phrase(finding))}")
            lines += [
                f"    - **{one.axis}** {_mark(effect_text(one.effect))}" for one in finding.members
            ]
        words = first.effect.evidence.get("words")
        if words and first.effect.kind != UNEXPLAINED:
            lines.append(f"    - {markdown(symbols(words))}")
        if cause := cause_phrase(finding):
            lines.append(f"    - {markdown(cause)}")
    lines += [
        f"- **{' '.join(one.axes)}** common at {markdown(one.words)}" for one in analysis.common
    ]
    lines += _next(analysis)
    events = "\n".join(f"- {markdown(event.words)}" for event in analysis.events)
    events = f"### Events\n\n{events}\n\n### Effects\n\n" if events else ""
    found = (
        events + "\n".join(lines) if lines else events + "*no effects found beyond the noise model*"
    )
    remarks = "\n".join(f"- {markdown(symbols(remark))}" for remark in _remarks(analysis))
    return f"{found}\n\n### Remarks\n\n{remarks}" if remarks else found


def loop_table(analysis: Analysis, unit: str) -> str:
    """Return the error of each axis of a sensor before and after the loop was closed."""
    rows = [
        (name, *_loop_row(axis.explanation))
        for name, axis in analysis.axes.items()
        if axis.explanation is not None and axis.unit == unit
    ]
    head = (
        "axis",
        MODEL_ERRORS["chi2_per_dof"],
        MODEL_ERRORS["p_value"],
        f"{MODEL_ERRORS['rms_percent']} (expected)",
        MODEL_ERRORS["worst_band_z"],
        HELD_OUT,
        EXCESS,
        "",
    )
    return _table(head, rows) if rows else "*not searched yet*"


def run_table(analysis: Analysis, session: Mapping[str, object]) -> str:
    """Return what was measured, how long, at which rate and over what link."""
    link = analysis.link
    rows = [
        ("device", markdown(one_line(analysis.input.get("name", "")))),
        ("part", markdown(one_line(analysis.part or "unknown"))),
        ("duration", recorded_text(analysis)),
        ("samples", f"{count(analysis.samples)}, {gaps_text(analysis.segments)}"),
        ("lost samples", losses_text(analysis)),
        ("rate", f"{rate_text(analysis.rate)} (nominal {analysis.rate.nominal_hz:g} Hz)"),
        ("received", f"{size(link.bytes)} in {count(link.frames)} frames"),
        (
            "link errors",
            f"{link.crc_errors} checksums, {link.resyncs} resyncs, {link.suspect} suspect rows, "
            f"{analysis.reconnects} reconnections",
        ),
    ]
    if analysis.temperature:
        low, high = analysis.temperature["lowest"], analysis.temperature["highest"]
        rows.append(("temperature", f"{low:.1f} to {high:.1f} °C"))
    known = {"name", "part"}
    rows += [
        (markdown(one_line(key.replace("_", " "))), markdown(one_line(value)))
        for key, value in {**session, **analysis.input}.items()
        if key not in known and value
    ]
    return _table(("", "this run"), rows)


def _next(analysis: Analysis) -> list[str]:
    """Return the measurements that would decide most."""
    known = measurements(analysis.experiments)
    more = len(known) - _NEXT_SHOWN
    return [
        *(f"- next: **{markdown(m.action)}**: {markdown(m.decides)}" for m in known[:_NEXT_SHOWN]),
        *([f"- {counted(more, 'more measurement')}: see the report"] if more > 0 else []),
    ]


def _remarks(analysis: Analysis) -> Iterable[str]:
    """Yield the remarks, each once, after the axes of which it is made."""
    yield from (f"assumed: {remark}" for remark in analysis.assumptions)
    yield from analysis.remarks
    axes: dict[str, list[str]] = {}
    for name, axis in analysis.axes.items():
        beyond = axis.explanation.remarks if axis.explanation is not None else ()
        for remark in (*axis.remarks, *beyond):
            axes.setdefault(remark, []).append(name)
    yield from (f"{' '.join(names)}: {remark}" for remark, names in axes.items())


def _sensor_table(unit: str, axes: Mapping[str, AxisAnalysis], quiet: Undisturbed | None) -> str:
    head = [
        "axis",
        *(f"{letter}, {coefficient_unit(unit, letter)}" for letter in MAIN_LETTERS),
        f"{MINIMUM}, {symbols(DEVIATION[unit].unit)}",
        DATASHEET,
    ]
    rows = []
    for name, axis in axes.items():
        cells = [coefficient_text(unit, k, axis.coefficients.get(k)) for k in MAIN_LETTERS]
        rows.append((name, *cells, best_text(axis), density_verdict(axis)))
        if quiet is not None and name in quiet.axes:
            known = quiet.axes[name]
            cells = [coefficient_text(unit, k, known.get(k)) for k in MAIN_LETTERS]
            when = f"{duration(quiet.begin_s)} to {duration(quiet.end_s)}"
            rows.append((f"{name} undisturbed, {when}", *cells, "", ""))
    return _table(head, rows)


def _facts(axis: AxisAnalysis) -> Iterable[str]:
    if axis.level is not None:
        level = LEVEL[axis.unit]
        text = f"level {number(axis.level.mean * level.factor)} {symbols(level.unit)}"
        if axis.level.stability is not None:
            moved = number(axis.level.stability * level.factor, 2)
            text += f"; means over tenths of the run scatter by {moved} {symbols(level.unit)}"
        yield text
    if axis.best_averaging is not None:
        yield (
            f"{MINIMUM}, {symbols(DEVIATION[axis.unit].unit)}: {best_text(axis)} "
            f"({count(axis.best_averaging.samples)} samples averaged); it lies "
            f"{between(axis.best_averaging.tau_lower, axis.best_averaging.tau_upper)}"
        )
    for name, sheet in axis.datasheet.items():
        yield f"{DATASHEET}, {name}: {sheet.verdict} ({markdown(symbols(sheet.explanation))})"


def _loop_row(explanation: AxisExplanation) -> Sequence[str]:
    before, after = explanation.before, explanation.after

    def pair(name: str) -> str:
        return f"{number(getattr(before, name))} → **{number(getattr(after, name))}**"

    sampling = number(after.expected_rms_percent)
    gain = f"{number(explanation.held_out_nats)} ± {number(explanation.held_out_nats_se, 2)}"
    verdict = "explained" if explanation.explained else "**partly unexplained**"
    return (
        pair("chi2_per_dof"),
        pair("p_value"),
        f"{pair('rms_percent')} ({sampling})",
        pair("worst_band_z"),
        gain,
        shares_text(explanation) or "none",
        verdict,
    )


def _mark(text: str) -> str:
    """Return a line with its first word in bold, and nothing else that means anything."""
    head, colon, rest = text.partition(":")
    return f"**{markdown(head)}**{colon}{markdown(rest)}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, [":--"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
