"""What an engineer wants to know first: is the sensor good, what is wrong, how long to wait.

The same few lines head the viewer, the terminal and the report.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from allanscope.analysis.finding_phrases import finding_sentence
from allanscope.analysis.findings import findings_of
from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.analysis.wording import (
    effect_brief,
    losses_text,
    not_measured,
    wait_text,
)
from allanscope.explain import AxisExplanation
from allanscope.noise import DatasheetVerdict
from allanscope.parts import PARTS
from allanscope.quantities import DENSITY, DEVIATION, MAIN_LETTERS, SENSOR_NAMES, number, symbols

__all__ = ["ASSUMED", "KEEP_RECORDING", "Grade", "Verdict", "VerdictLine", "searched", "verdict"]

Grade = Literal["good", "bad", "note"]

ASSUMED = "Assumed"
"""Head of the lines on what the input did not say: they come first."""

KEEP_RECORDING = "Keep recording"
"""Head of the line that says how much longer."""

_FOUND = "Found"
_NAMED = 3
"""Findings that a verdict names: what else there is stands in the report."""
_NOTICEABLE_LOSS = 1e-3
"""Share of the samples that may be missing before it counts against the run."""


@dataclass(frozen=True, slots=True)
class VerdictLine:
    """One line: what it speaks of, and what is to be said."""

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
        What is behind it, the most important first.
    banner : str
        What must stand above everything else, in red; empty for samples that a part measured.
    """

    grade: Grade
    title: str
    lines: tuple[VerdictLine, ...]
    banner: str = ""


def verdict(analysis: Analysis) -> Verdict:
    """Return the verdict on a result, or on a result so far."""
    noise = [line for unit in SENSOR_NAMES for line in _noise_lines(analysis, unit)]
    found = [*_effect_lines(analysis.axes), *_stream_lines(analysis)]
    losses = _loss_lines(analysis)
    assumed = [VerdictLine("note", ASSUMED, text) for text in analysis.assumptions]
    failed = _failure_lines(analysis.axes)
    first = (*assumed, *failed, *noise, *found, *losses)
    lines = (*first, *_wait_lines(analysis.axes), *_remark_lines(analysis))
    grades = [line.grade for line in (*failed, *noise, *found, *losses)]
    if "bad" in grades:
        grade: Grade = "bad"
    else:
        grade = "good" if any(line.grade == "good" for line in noise) else "note"
    title = _title(analysis.axes, noise, found, losses)
    title = f"{title}; the analysis of an axis failed" if failed else title
    simulated = not_measured(analysis.origin)
    if simulated is not None:
        lines = (VerdictLine("bad", *simulated), *lines)
        title = f"{simulated[0]}: {title[:1].lower()}{title[1:]}"
    return Verdict(grade, title, lines, simulated[0] if simulated else "")


def searched(explanation: AxisExplanation) -> bool:
    """Return whether the loop could look at the axis at all; its remarks say why not."""
    return math.isfinite(explanation.before.chi2_per_dof)


def _title(
    axes: Mapping[str, AxisAnalysis],
    noise: Iterable[VerdictLine],
    found: Iterable[VerdictLine],
    losses: Iterable[VerdictLine],
) -> str:
    grades = {line.grade for line in noise}
    if "bad" in grades:
        first = f"Noisier than the datasheet: {' '.join(_worse(axes))}"
    elif grades == {"good"}:
        first = "Noise matches the datasheet"
    elif "good" in grades:
        first = "Noise matches the datasheet where it is known"
    else:
        first = "Not compared with a datasheet"
    parts = [first]
    if any(line.grade == "bad" for line in found):
        parts.append("partly unexplained")
    elif any(line.head == _FOUND for line in found):
        parts.append("additional effects found")
    if any(line.grade == "bad" for line in losses):
        parts.append("samples were lost")
    return "; ".join(parts)


# --- the noise against the datasheet ----------------------------------------------------------


def _noise_lines(analysis: Analysis, unit: str) -> list[VerdictLine]:
    axes = {name: axis for name, axis in analysis.axes.items() if axis.unit == unit}
    if not axes:
        return []
    sensor = SENSOR_NAMES[unit].capitalize()
    sheets = {name: _sheet(axis) for name, axis in axes.items()}
    known = {k: v for k, v in sheets.items() if v is not None and v.measured is not None}
    if not any(sheets.values()):
        return [VerdictLine("note", sensor, _why_no_sheet(analysis.part))]
    if not known:
        return [VerdictLine("note", sensor, "the white noise is not determined yet")]
    if any(one.limit is None for one in known.values()):
        return [VerdictLine("note", sensor, "the datasheet gives no noise value")]
    worse = {name: known[name] for name in _worse(axes)}
    if worse:
        named = ", ".join(f"{k} {_shown(v)}" for k, v in worse.items())
        text = f"noise above the datasheet's {_limit(worse)}: {named}"
        return [VerdictLine("bad", sensor, text)]
    measured = [one.measured for one in known.values() if one.measured is not None]
    low, high = (_number(x, next(iter(known.values()))) for x in (min(measured), max(measured)))
    span = low if low == high else f"{low} to {high}"
    better = all(one.verdict == "better" for one in known.values())
    compared = "is below" if better else "matches"
    text = f"noise {span} {compared} the datasheet's {_limit(known)}"
    late = [name for name in axes if name not in known]
    if late:
        text += f" on {' '.join(known)}; {' '.join(late)} not determined yet"
    return [VerdictLine("good", sensor, text)]


def _why_no_sheet(part: str) -> str:
    if not part:
        return "the part is not known; name it with --part"
    if part not in PARTS:
        return f"there is no datasheet entry for {part}"
    return "not compared: the datasheet's noise depends on the full scale, which is not known"


def _worse(axes: Mapping[str, AxisAnalysis]) -> list[str]:
    """Return the axes that are noisier than their datasheet."""
    return [
        name
        for name, axis in axes.items()
        if (sheet := _sheet(axis)) is not None and sheet.verdict == "worse"
    ]


def _sheet(axis: AxisAnalysis) -> DatasheetVerdict | None:
    """Return the verdict that counts: on the density, for high-performance mode, the default."""
    return next(iter(axis.datasheet.values()), None)


def _number(value: float, of: DatasheetVerdict) -> str:
    return number(value * _reading(of)[0])


def _shown(of: DatasheetVerdict) -> str:
    return "-" if of.measured is None else _number(of.measured, of)


def _limit(verdicts: Mapping[str, DatasheetVerdict]) -> str:
    one = next(iter(verdicts.values()))
    limits = dict.fromkeys(_number(v.limit, v) for v in verdicts.values() if v.limit is not None)
    return f"{' or '.join(limits)} {_reading(one)[1]}"


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


def _effect_lines(axes: Mapping[str, AxisAnalysis]) -> list[VerdictLine]:
    sound = {name: axis for name, axis in axes.items() if not axis.failure}
    looked = {n: a.explanation for n, a in sound.items() if a.explanation is not None}
    open_axes = {name: one for name, one in looked.items() if searched(one)}
    if sound and not looked:
        return [VerdictLine("note", "Effects", "not searched yet")]
    found = findings_of({name: one.own_effects for name, one in open_axes.items()})
    lines = [
        VerdictLine("note", _FOUND, finding_sentence(one, tuple(axes))) for one in found[:_NAMED]
    ]
    if len(found) > _NAMED:
        lines.append(VerdictLine("note", f"And {len(found) - _NAMED} more", "see the report"))
    unexplained = [name for name, one in open_axes.items() if not one.explained]
    if unexplained:
        text = "the residual is inconsistent with sampling error, and no known effect explains it"
        head = f"Partly unexplained on {_named(unexplained, axes)}"
        lines.insert(0, VerdictLine("bad", head, text))
    elif open_axes and not lines:
        lines.append(VerdictLine("good", "Effects", "none found beyond the noise model"))
    reasons: dict[str, list[str]] = {}
    for name, one in looked.items():
        if name not in open_axes:
            for remark in one.remarks[:1]:
                reasons.setdefault(remark, []).append(name)
    lines += [
        VerdictLine("note", f"Effects not searched on {_named(names, axes)}", reason)
        for reason, names in reasons.items()
    ]
    return lines


def _stream_lines(analysis: Analysis) -> list[VerdictLine]:
    """Return what was found of the stream as a whole: one line, however many axes it has."""
    briefs = [effect_brief(effect) for effect in analysis.effects]
    return [VerdictLine("note", "Clock", brief.removeprefix("clock ")) for brief in briefs]


def _named(names: Iterable[str], axes: Mapping[str, AxisAnalysis]) -> str:
    names = list(names)
    return "all axes" if len(names) == len(axes) > 1 else " ".join(names)


# --- what is missing ----------------------------------------------------------------------------


def _loss_lines(analysis: Analysis) -> list[VerdictLine]:
    suspect = analysis.link.suspect
    doubt = f"{suspect} left out: one value is far from all rows around it, and the link has errors"
    suspects = [VerdictLine("note", "Suspect rows", doubt)] if suspect else []
    if not analysis.lost_samples and not analysis.unknown_losses:
        return suspects
    share = analysis.lost_samples / max(analysis.samples + analysis.lost_samples, 1)
    grade: Grade = "bad" if share > _NOTICEABLE_LOSS else "note"
    text = f"{losses_text(analysis)} ({number(100.0 * share, 2)} %)"
    return [VerdictLine(grade, "Lost samples", text), *suspects]


def _wait_lines(axes: Mapping[str, AxisAnalysis]) -> list[VerdictLine]:
    """Say how much longer to record until the last axis is known, letter by letter."""
    waits = {}
    for letter in MAIN_LETTERS:
        here = [a.coefficients[letter] for a in axes.values() if letter in a.coefficients]
        late = [one for one in here if one.wait_s is not None]
        if late:
            waits[letter] = max(late, key=lambda one: one.wait_s or 0.0)
    if waits:
        times = [(letter, wait_text(one)) for letter, one in waits.items()]
        parts = ", ".join(f"{letter} to ±20 % in about {wait}" for letter, wait in times)
        return [VerdictLine("note", KEEP_RECORDING, parts)]
    if axes and all(a.coefficients for a in axes.values()):
        limits = [
            f"{letter} of {name}"
            for letter in MAIN_LETTERS
            for name, axis in axes.items()
            if letter in axis.coefficients and not axis.coefficients[letter].detected
        ]
        text = "N, B and K are known" + (
            f" (upper limit only: {', '.join(limits)})" if limits else ""
        )
        return [VerdictLine("good", "Recording", f"long enough; {text}")]
    return []


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
