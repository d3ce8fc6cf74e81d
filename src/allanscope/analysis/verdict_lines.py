"""What an engineer wants to know first, in three lines.

Is the noise what the datasheet says, what else was found, and what to do next: the same lines head
the viewer, the terminal and the report. Whatever else must be known is behind them, as details.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from allanscope.analysis.datasheet import HIDDEN
from allanscope.analysis.experiments import measurements
from allanscope.analysis.finding_phrases import finding_sentence, share_text, source_text
from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.analysis.wording import (
    effect_brief,
    losses_text,
    simulation_notice,
    wait_text,
)
from allanscope.explain import AxisExplanation
from allanscope.noise import DatasheetVerdict
from allanscope.parts import PARTS
from allanscope.quantities import (
    DENSITY,
    DEVIATION,
    MAIN_LETTERS,
    SENSOR_NAMES,
    duration,
    number,
    rough,
    symbols,
)

__all__ = ["NOTICEABLE_LOSS", "Grade", "Verdict", "VerdictLine", "verdict", "was_searched"]

Grade = Literal["good", "bad", "note"]

_NAMED = 3
"""Findings that a verdict names: what else there is stands in the report."""
NOTICEABLE_LOSS = 1e-3
"""Share of the samples that may be missing before it counts against the run."""


@dataclass(frozen=True, slots=True)
class VerdictLine:
    """One line: subject and text."""

    grade: Grade
    head: str
    text: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """The whole of it.

    Attributes
    ----------
    grade : {'good', 'bad', 'note'}
        ``note`` while it is too early to tell, or when there is nothing to compare with.
    title : str
        One phrase.
    lines : tuple of VerdictLine
        Of a session: the noise, the effects, what to do next; before the last of them whether the
        curves pass the reference, if one was named.
    details : tuple of VerdictLine
        What else must be known, the most important first: assumptions, failures, losses, remarks.
    banner : str
        Notice above everything else, in red; empty for samples that a part measured.
    """

    grade: Grade
    title: str
    lines: tuple[VerdictLine, ...]
    details: tuple[VerdictLine, ...] = ()
    banner: str = ""


def verdict(analysis: Analysis) -> Verdict:
    """Return the verdict on a result, or on a result so far."""
    noise, effects = _noise_line(analysis), _whole(_effect_line(analysis), analysis.axes)
    losses = _loss_lines(analysis)
    failed = _failure_lines(analysis.axes)
    compared = _comparison_lines(analysis)
    details = (
        *(VerdictLine("note", "Assumed", text) for text in analysis.assumptions),
        *failed,
        *(one for one in losses if one.grade != "bad"),  # those are in what to do next
        *_undisturbed_lines(analysis),
        *_search_lines(analysis.axes),
        *_stream_lines(analysis),
        *_remark_lines(analysis),
    )
    title = [noise.head, *([effects.head] if effects.grade != "good" else [])]
    if any(line.grade == "bad" for line in losses):
        title.append("samples were lost")
    if failed:
        title.append("the analysis of an axis failed")
    if any(line.grade == "bad" for line in compared):
        title.append(f"higher than {analysis.reference}")
    bad = any(line.grade == "bad" for line in (noise, effects, *compared, *losses, *failed))
    simulated = simulation_notice(analysis.origin)
    return Verdict(
        grade="bad" if bad else noise.grade,
        title="; ".join(f"{one[:1].lower()}{one[1:]}" if i else one for i, one in enumerate(title)),
        lines=(noise, effects, *compared, _next_line(analysis, losses)),
        details=details,
        banner=": ".join(simulated) if simulated else "",
    )


def was_searched(explanation: AxisExplanation) -> bool:
    """Return whether the loop could look at the axis at all; its remarks say why not."""
    return math.isfinite(explanation.before.chi2_per_dof)


# --- the noise against the datasheet ----------------------------------------------------------


def _noise_line(analysis: Analysis) -> VerdictLine:
    """Say whether the noise is what the datasheet says, sensor by sensor."""
    told = [one for unit in SENSOR_NAMES if (one := _noise_of(analysis, unit))]
    grades = {grade for grade, _ in told}
    # A reason that both sensors share is told once.
    text = "; ".join(dict.fromkeys(text for _, text in told))
    if grades & {"good", "bad"}:
        text = f"density √2 N of {text}"
    if "bad" in grades:
        return VerdictLine("bad", "Noisier than the datasheet", text)
    if grades == {"good"}:
        return VerdictLine("good", "Noise matches the datasheet", text)
    if "good" in grades:
        return VerdictLine("good", "Noise matches the datasheet where it is known", text)
    return VerdictLine("note", "Noise not compared with a datasheet", text or "no samples yet")


def _noise_of(analysis: Analysis, unit: str) -> tuple[Grade, str] | None:
    """Return the grade and the words on one sensor; None where it has no axis."""
    axes = {name: axis for name, axis in analysis.axes.items() if axis.unit == unit}
    if not axes:
        return None
    sensor = SENSOR_NAMES[unit]
    sheets = {name: one for name, axis in axes.items() if (one := _sheet(axis)) is not None}
    known = {name: one for name, one in sheets.items() if one.measured is not None}
    constant = [name for name, axis in axes.items() if axis.is_constant]
    if not sheets:
        return "note", _why_no_sheet(analysis.part)
    if why := _why_no_noise(sensor, known, len(constant) == len(axes)):
        return "note", why
    first = next(iter(known.values()))
    worse = {name: known[name] for name in known if known[name].verdict == "worse"}
    if worse:
        span = ", ".join(f"{k} {_number(v.measured or 0.0, v)}" for k, v in worse.items())
    else:
        measured = [one.measured for one in known.values() if one.measured is not None]
        low, high = (_number(x, first) for x in (min(measured), max(measured)))
        span = low if low == high else f"{low} to {high}"
    limits = dict.fromkeys(_number(v.limit, v) for v in (worse or known).values() if v.limit)
    text = f"{sensor} {span} {_reading(first)[1]} (datasheet {' or '.join(limits)})"
    late = [name for name in axes if name not in known and name not in constant]
    for names, why in ((constant, "constant"), (late, "not determined yet")):
        if names:
            text += f", {' '.join(names)} {why}"
    return ("bad" if worse else "good"), text


def _why_no_noise(sensor: str, known: Mapping[str, DatasheetVerdict], is_constant: bool) -> str:
    """Return why the noise of a sensor is not compared; empty where it is."""
    if is_constant:
        return f"the {sensor} is constant: no noise to measure"
    if not known:
        return f"white noise of the {sensor} not determined yet"
    if any(one.limit is None for one in known.values()):
        return f"no noise value of the {sensor} in the datasheet"
    if all(one.verdict == HIDDEN for one in known.values()):
        return f"the noise of the {sensor} is hidden by the step of its values"
    return ""


def _why_no_sheet(part: str) -> str:
    if not part:
        return "the part is unknown (--part)"
    if part not in PARTS:
        return f"there is no datasheet entry for {part}"
    return "its noise in the datasheet depends on the full scale, which is unknown"


def _sheet(axis: AxisAnalysis) -> DatasheetVerdict | None:
    """Return the verdict that counts: on the density, for high-performance mode, the default."""
    return next(iter(axis.datasheet.values()), None)


def _number(value: float, of: DatasheetVerdict) -> str:
    return number(value * _reading(of)[0])


def _reading(of: DatasheetVerdict) -> tuple[float, str]:
    """Return factor and unit in which people read a value of a datasheet."""
    base, slash, _ = of.unit.partition("/")
    reading = (DENSITY if slash else DEVIATION)[base]
    return reading.factor, symbols(reading.unit)


# --- what is beyond the noise -------------------------------------------------------------------


def _failure_lines(axes: Mapping[str, AxisAnalysis]) -> list[VerdictLine]:
    """Return a line for each axis whose analysis went wrong; the others are whole."""
    return [
        VerdictLine(
            "bad", f"Analysis of {name} failed", f"{axis.failure}; the other axes are complete"
        )
        for name, axis in axes.items()
        if axis.failure
    ]


def _effect_line(analysis: Analysis) -> VerdictLine:
    """Say what was found beyond the noise model, at most three, and whether that explains it."""
    axes = analysis.axes
    looked = _searched_axes(axes)
    open_axes = {name: one for name, one in looked.items() if was_searched(one)}
    if not open_axes:
        reasons = dict.fromkeys(one.remarks[0] for one in looked.values() if one.remarks)
        text = "; ".join(reasons) or "too early"
        return VerdictLine("note", f"Effects not searched{'' if looked else ' yet'}", text)
    found = analysis.findings
    texts = [
        f"{finding_sentence(one, tuple(axes))}{source_text(one)}{share_text(one)}"
        for one in found[:_NAMED]
    ]
    if len(found) > _NAMED:
        texts.append(f"and {len(found) - _NAMED} more, see the report")
    text = "; ".join(texts)
    unexplained = [name for name, one in open_axes.items() if not one.explained]
    if unexplained:
        head = f"Partly unexplained on {_named(unexplained, axes)}"
        why = "residual inconsistent with sampling error"
        return VerdictLine("bad", head, f"{text}; {why}" if text else why)
    if found:
        return VerdictLine("note", "Additional effects found", text)
    return VerdictLine("good", "No additional effects", "residual consistent with sampling error")


def _whole(line: VerdictLine, axes: Mapping[str, AxisAnalysis]) -> VerdictLine:
    """Return the line on the effects, which is not good while the analysis of an axis failed."""
    failed = [name for name, axis in axes.items() if axis.failure]
    if not failed:
        return line
    text = f"the analysis of an axis failed: {_named(failed, axes)}"
    return replace(line, grade="bad", text=f"{line.text}; {text}")


def _searched_axes(axes: Mapping[str, AxisAnalysis]) -> dict[str, AxisExplanation]:
    return {
        name: axis.explanation
        for name, axis in axes.items()
        if axis.explanation is not None and not axis.failure
    }


def _comparison_lines(analysis: Analysis) -> list[VerdictLine]:
    """Return whether the curves pass an earlier session, or a mask; of none where none was named.

    Axes that are higher are named with the largest ratio and the averaging times; those that are
    higher in the same range share a phrase.
    """
    if not analysis.reference:
        return []
    axes = analysis.axes
    known = {name: axis.comparison for name, axis in axes.items() if axis.comparison}
    if not known:
        text = "no axis with a curve at the averaging times of the reference"
        return [VerdictLine("note", f"Not compared with {analysis.reference}", text)]
    higher: dict[str, dict[str, float]] = {}
    for name, one in known.items():
        if not one.passed:
            higher.setdefault(one.span, {})[name] = one.ratio
    passed = [name for name, one in known.items() if one.passed]
    late = [name for name, axis in axes.items() if name not in known and not axis.is_constant]
    texts = [
        f"{_named(ratios, axes)} up to {number(max(ratios.values()))} times higher at τ = {span}"
        for span, ratios in higher.items()
    ]
    if not higher:
        named = "no axis" if len(passed) == len(axes) else f"{_named(passed, axes)} not"
        texts.append(f"{named} higher at τ = {known[passed[0]].span}")
    elif passed:
        texts.append(f"{_named(passed, axes)} not higher")
    if late:
        texts.append(f"{_named(late, axes)} not compared")
    grade: Grade = "bad" if higher else "good"
    head = f"{'FAIL' if higher else 'PASS'} against {analysis.reference}"
    return [VerdictLine(grade, head, "; ".join(texts))]


def _search_lines(axes: Mapping[str, AxisAnalysis]) -> list[VerdictLine]:
    """Return why the loop could not look at some axes; of none, the verdict's own line says it."""
    reasons: dict[str, list[str]] = {}
    looked = _searched_axes(axes)
    for name, one in looked.items():
        if not was_searched(one) and not axes[name].is_constant:
            for remark in one.remarks[:1]:
                reasons.setdefault(remark, []).append(name)
    if sum(map(len, reasons.values())) == len(looked):
        return []
    return [
        VerdictLine("note", f"Effects not searched on {_named(names, axes)}", reason)
        for reason, names in reasons.items()
    ]


def _stream_lines(analysis: Analysis) -> list[VerdictLine]:
    """Return what was found of the stream as a whole: one line, however many axes it has."""
    briefs = [effect_brief(effect) for effect in analysis.effects]
    return [VerdictLine("note", "Clock", brief.removeprefix("clock ")) for brief in briefs]


def _named(names: Iterable[str], axes: Mapping[str, AxisAnalysis]) -> str:
    names = list(names)
    return "all axes" if len(names) == len(axes) > 1 else " ".join(names)


# --- what is missing ----------------------------------------------------------------------------


def _undisturbed_lines(analysis: Analysis) -> list[VerdictLine]:
    """Say which stretch of the run is undisturbed; its coefficients stand in the tables."""
    quiet = analysis.undisturbed
    if quiet is None:
        return []
    text = (
        f"{duration(quiet.begin_s)} to {duration(quiet.end_s)}, the longest stretch without shocks "
        "and other events; its coefficients stand in the row below each axis"
    )
    return [VerdictLine("note", "Undisturbed", text)]


def _loss_lines(analysis: Analysis) -> list[VerdictLine]:
    suspect = analysis.link.suspect
    doubt = (
        f"{suspect} excluded: one value is far from all neighbouring rows, and the link has errors"
    )
    suspects = [VerdictLine("note", "Suspect rows", doubt)] if suspect else []
    if not analysis.lost_samples and not analysis.unknown_losses:
        return suspects
    share = analysis.lost_samples / max(analysis.samples + analysis.lost_samples, 1)
    grade: Grade = "bad" if share > NOTICEABLE_LOSS else "note"
    text = losses_text(analysis)
    if analysis.lost_samples:
        text += f" ({number(100.0 * share, 2)} %)"
    return [VerdictLine(grade, "Lost samples", text), *suspects]


def _next_line(analysis: Analysis, losses: Iterable[VerdictLine]) -> VerdictLine:
    """Return what to do next: repair the link, keep recording, or nothing more."""
    line = _with_experiment(_recording_line(analysis.axes, analysis.duration_s), analysis)
    lost = next((one for one in losses if one.grade == "bad"), None)
    if lost is None:
        return line
    # A longer recording with such losses may be as useless.
    useless = not any(axis.coefficients for axis in analysis.axes.values())
    then = "" if useless else f"; {line.head[:1].lower()}{line.head[1:]}: {line.text}"
    return VerdictLine("bad", "Check the link", f"{lost.text} of the samples lost{then}")


def _with_experiment(line: VerdictLine, analysis: Analysis) -> VerdictLine:
    """Return the line with the measurement that settles most beyond N, B and K."""
    beyond = [one for one in analysis.experiments if not one.is_of_noise]
    if not beyond:
        return line
    first = measurements(beyond)[0]
    more = f" and {len(first.decided) - 1} more" if len(first.decided) > 1 else ""
    text = f"to decide {first.decided[0].question}{more}: {first.action}"
    return replace(line, text=f"{line.text}; {text}")


def _recording_line(axes: Mapping[str, AxisAnalysis], length_s: float) -> VerdictLine:
    """Say how much longer to record until the last axis is known, letter by letter; and in all."""
    waits = {}
    for letter in MAIN_LETTERS:
        here = [a.coefficients[letter] for a in axes.values() if letter in a.coefficients]
        late = [one for one in here if one.wait_s is not None]
        if late:
            waits[letter] = max(late, key=lambda one: one.wait_s or 0.0)
    if waits:
        times = [(letter, wait_text(one)) for letter, one in waits.items()]
        parts = ", ".join(f"{letter} to ±20 % in about {wait}" for letter, wait in times)
        in_all = rough(length_s + max(one.wait_s or 0.0 for one in waits.values()))
        return VerdictLine("note", "Keep recording", f"{parts} ({in_all} in all)")
    if axes and all(axis.is_constant for axis in axes.values()):
        return VerdictLine("bad", "Check the sensor", "every axis is constant")
    axes = {name: axis for name, axis in axes.items() if not axis.is_constant}
    if not axes or not all(a.coefficients for a in axes.values()):
        return VerdictLine("note", "Keep recording", "too short for N, B and K of every axis")
    limits = [
        f"{letter} of {name}"
        for letter in MAIN_LETTERS
        for name, axis in axes.items()
        if letter in axis.coefficients and not axis.coefficients[letter].detected
    ]
    only = f" (upper limit only: {', '.join(limits)})" if limits else ""
    return VerdictLine("good", "Recording is long enough", f"N, B and K are known{only}")


def _remark_lines(analysis: Analysis) -> list[VerdictLine]:
    remarks: dict[str, list[str]] = {}
    for name, axis in analysis.axes.items():
        for remark in axis.remarks[bool(axis.failure) :]:
            remarks.setdefault(remark, []).append(name)
    lines = [VerdictLine("note", "Recording", remark) for remark in analysis.remarks]
    return lines + [
        VerdictLine("note", _named(names, analysis.axes).capitalize(), remark)
        if len(names) == len(analysis.axes) > 1
        else VerdictLine("note", " ".join(names), remark)
        for remark, names in remarks.items()
    ]
