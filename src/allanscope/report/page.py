"""One session as one self-contained HTML page."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.history import Record
from allanscope.quantities import COEFFICIENTS, duration, symbols
from allanscope.report import figures, words

__all__ = ["render", "template"]


@dataclass(frozen=True, slots=True)
class _Axis:
    """Everything that the template shows of one axis."""

    name: str
    sensor: str
    remarks: tuple[str, ...]
    deviation_svg: str
    coefficients: list[words.CoefficientRow]
    facts: list[words.Fact]
    explanation: bool
    effects: list[words.EffectWords]
    errors: list[words.ErrorRow]
    conclusion: str
    residual_svg: str
    density_svg: str
    lag_svg: str


def render(analysis: Analysis) -> str:
    """Return the page of one session.

    Everything that came from a device or a file is escaped; the only markup let through is the SVG
    of our own figures.
    """
    shown = {name: axis for name, axis in analysis.axes.items() if "oadev" in axis.curves}
    name = analysis.input.get("name", "session")
    return template("page.html.j2").render(
        title=f"Noise of {analysis.part or 'a sensor'} — {name}",
        subtitle=f"{duration(analysis.duration_s)}, {len(analysis.axes)} axes",
        verdict=words.verdict(analysis),
        summary=_summary(shown),
        axes=[_axis(name, axis, analysis.record) for name, axis in shown.items()],
        series=_series(analysis.record, shown),
        ratio_svg=figures.ratio_figure(shown),
        quality=words.quality(analysis),
        marks=[f"{duration(time_s)}: {text}" for time_s, text in analysis.marks],
        provenance=words.provenance(analysis, _command(analysis)),
        footer=f"allanscope {analysis.version}",
    )


def template(name: str) -> jinja2.Template:
    """Return one of the room's templates, with everything escaped by default."""
    folder = Path(__file__).parent / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder), autoescape=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["svg"] = _as_markup
    return environment.get_template(name)


def _as_markup(svg: str) -> Any:
    """Mark a figure of ours as safe; never used on text from outside."""
    from markupsafe import Markup

    return Markup(svg)


def _axis(name: str, axis: AxisAnalysis, record: Record | None) -> _Axis:
    loop = axis.explanation
    searched = loop is not None and words.searched(loop)
    found = axis.datasheet.get("density")
    allowed = found.white_limit if found is not None else None
    return _Axis(
        name=name,
        sensor="gyroscope" if axis.unit == "dps" else "accelerometer",
        remarks=axis.remarks,
        deviation_svg=figures.deviation_figure(name, axis, allowed),
        coefficients=words.coefficient_rows(axis),
        facts=words.axis_facts(axis),
        explanation=loop is not None,
        effects=[words.effect_words(effect) for effect in loop.effects] if loop else [],
        errors=words.error_rows(loop) if loop and searched else [],
        conclusion=words.conclusion(loop) if loop else "",
        residual_svg=figures.residual_figure(name, axis) if searched else "",
        density_svg=(
            figures.density_figure(name, axis.density, axis.density_model, axis.unit)
            if axis.density is not None
            else ""
        ),
        lag_svg=figures.lag_figure(record, name, axis.unit) if record is not None else "",
    )


def _summary(axes: dict[str, AxisAnalysis]) -> dict[str, Any]:
    """Return the table of N, B and K of all axes."""
    names = ("N", "B", "K")
    heads = []
    for name in names:
        units = {symbols(COEFFICIENTS[axis.unit, name][0].unit) for axis in axes.values()}
        heads.append(f"{name} ({', '.join(sorted(units))})")
    rows = [
        {
            "name": axis_name,
            "cells": [
                words.coefficient_cell(axis.coefficients.get(name), name, axis.unit)
                for name in names
            ],
        }
        for axis_name, axis in axes.items()
    ]
    return {"heads": heads, "rows": rows}


def _series(record: Record | None, axes: dict[str, AxisAnalysis]) -> list[dict[str, str]]:
    if record is None:
        return []
    out = []
    for unit, sensor in (("dps", "Gyroscope"), ("g", "Accelerometer")):
        names = [name for name, axis in axes.items() if axis.unit == unit]
        if names:
            caption = f"{sensor}: mean, with the range of what is averaged into each point."
            out.append({"svg": figures.series_figure(record, names, unit), "caption": caption})
    return out


def _command(analysis: Analysis) -> str:
    path = analysis.input.get("path", "")
    return f"allanscope analyse {shlex.quote(path)}" if path else ""
