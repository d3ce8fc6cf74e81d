"""One session as one self-contained HTML page, and all pictures of it by name, also for files."""

from __future__ import annotations

import gc
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import jinja2

from allanscope import labels
from allanscope.allan import CurveChoices
from allanscope.analysis import (
    Analysis,
    AxisAnalysis,
    Finding,
    Undisturbed,
    cause_phrase,
    finding_phrase,
    measurements,
    share_text,
    verdict,
    was_searched,
)
from allanscope.parts import PARTS
from allanscope.quantities import COEFFICIENTS, MAIN_LETTERS, SENSOR_NAMES, count, duration, symbols
from allanscope.report import axis_text, coefficient_table
from allanscope.report.axis_text import Fact
from allanscope.report.chain import ChainStep, processing_chain
from allanscope.report.curve_pictures import (
    deviation_picture,
    estimators_picture,
    overlay_picture,
    residual_picture,
)
from allanscope.report.data_pictures import (
    density_picture,
    dynamic_picture,
    lag_picture,
    ratio_picture,
    series_picture,
)
from allanscope.report.method_pictures import transfer_picture
from allanscope.report.picture import Picture, draw_forked
from allanscope.report.stability_tables import stability_tables
from allanscope.samples import unit_of
from allanscope.sanitize import sanitize

__all__ = ["draw_ahead", "pictures", "render", "save_pictures", "template"]

_PAGE, _METHOD = "page.html.j2", "transfer"
"""The template, and the picture that is the same whatever was measured."""

_LOBES = 6.0
"""Of the transfer functions on the page: more are only black."""
_NEXT_SHOWN = 3
"""Next measurements that are shown unfolded."""


@dataclass(frozen=True, slots=True)
class _Axis:
    """Everything that the template shows of one axis; empty pictures are left out."""

    name: str
    sensor: str
    remarks: tuple[str, ...]
    coefficients: list[coefficient_table.CoefficientRow]
    power_laws: list[tuple[str, str, str, str]]
    facts: list[Fact]
    looked: bool
    effects: list[axis_text.EffectText]
    errors: list[axis_text.ErrorRow]
    conclusion: list[str]
    search: list[axis_text.SearchRow]
    deviation_svg: str
    estimators_svg: str
    curve_values: axis_text.CurveValues
    residual_svg: str
    density_svg: str
    lag_svg: str


@contextmanager
def _garbage_kept() -> Iterator[None]:
    """Collect garbage only afterwards: figures are full of cycles, and large while they last.

    Collections take a tenth of the time of drawing; the figures of six axes are 15 MB.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@_garbage_kept()
def render(
    analysis: Analysis,
    drawn: Mapping[str, Picture] | None = None,
    *,
    title: str = "",
    operator: str = "",
    full: bool = False,
    forked: bool = False,
) -> str:
    """Return the page of one session.

    Everything that came from a device or a file is escaped; the only markup let through is the SVG
    of our own pictures, in which matplotlib has escaped what stands there.

    Parameters
    ----------
    analysis : Analysis
        A full result.
    drawn : mapping, optional
        Its pictures, where somebody has them already.
    title, operator : str
        Title of the page, by default part and name; and name of the operator.
    full : bool
        Open what is folded otherwise, so that it is printed as well.
    forked : bool
        Draw half of the pictures in a copy of this process, which must have a single thread.
    """
    shown = {name: axis for name, axis in analysis.axes.items() if "oadev" in axis.curves}
    found = (drawn or pictures(analysis)).items()
    tasks = {name: partial(_embedded, name, one) for name, one in found}
    svgs = draw_forked(tasks) if forked else {name: task() for name, task in tasks.items()}
    name = analysis.input.get("name", "session")
    zero_g = axis_text.zero_g(analysis)
    return template(_PAGE).render(
        title=title or f"Noise of {analysis.part or 'a sensor'}: {name}",
        subtitle=axis_text.subtitle(analysis, operator),
        verdict=verdict(analysis),
        conventions=axis_text.conventions(analysis),
        found=len(analysis.findings),
        findings=[
            *(axis_text.Fact(" ".join(one.axes), _with_cause(one)) for one in analysis.findings),
            *(
                axis_text.Fact(" ".join(one.axes), f"common at {one.words}")
                for one in analysis.common
            ),
        ],
        next_first=_next(analysis)[:_NEXT_SHOWN],
        next_rest=_next(analysis)[_NEXT_SHOWN:],
        overlays=[
            {"name": sensor, "axes": names, "svg": svgs[f"{sensor}-overlay"]}
            for unit, sensor in SENSOR_NAMES.items()
            if f"{sensor}-overlay" in svgs
            for names in [[name for name, axis in shown.items() if axis.unit == unit]]
        ],
        full=full,
        summary=_summary(shown, analysis.undisturbed),
        levels=[zero_g] if zero_g is not None else [],
        axes=[_axis(name, axis, svgs, analysis.choices) for name, axis in shown.items()],
        series=[
            {"name": sensor, "svg": svgs[f"{sensor}-series"]}
            for sensor in SENSOR_NAMES.values()
            if f"{sensor}-series" in svgs
        ],
        dynamic_svg=svgs.get("dynamic", ""),
        dynamic_words=axis_text.windows(analysis.dynamic),
        ratio_svg=svgs.get("ratio", ""),
        stability=stability_tables(analysis),
        transfer_svg=svgs.get(_METHOD, ""),
        quality=axis_text.quality(analysis),
        uncertainty=analysis.uncertainty,
        marks=[f"{duration(time_s)}: {text}" for time_s, text in marked_moments(analysis)],
        chain=_chain(analysis),
        provenance=axis_text.provenance(analysis, _command(analysis)),
        footer=f"allanscope {analysis.version}",
    )


def marked_moments(analysis: Analysis) -> list[tuple[float, str]]:
    """Return the moments that are marked on axes of time: marks of the user, and events."""
    events = (
        (once.onset_s, event.words if number == 0 else f"again: {event.words}")
        for event in analysis.events
        for number, once in enumerate(event.occurrences)
    )
    return sorted([*analysis.marks, *events])


def _chain(analysis: Analysis) -> list[ChainStep]:
    """Return the way of this run's samples."""
    record, scales, history = analysis.record, "", "means of some samples"
    if record is not None:
        steps = {
            unit_of(axis): f"{1e3 * lsb:.3g} m{unit_of(axis)}"
            for axis, lsb in zip(record.axes, record.lsb, strict=True)
            if lsb > 0.0
        }
        scales = ", ".join(steps.values())
        rows = "samples" if record.stride == 1 else f"means of {record.stride} samples"
        history = f"{count(len(record.values))} {rows}"
    part = PARTS.get(analysis.part)
    rate_hz = analysis.rate.best_hz
    return processing_chain(part, rate_hz, scales or "whole counts", history, analysis.choices)


def _next(analysis: Analysis) -> list[axis_text.Fact]:
    """Return the next measurements, each with what it decides."""
    return [axis_text.Fact(one.action, one.decides) for one in measurements(analysis.experiments)]


def _with_cause(finding: Finding) -> str:
    """Return a finding with its share and where it comes from."""
    cause = cause_phrase(finding)
    return f"{finding_phrase(finding)}{share_text(finding)}{f'; {cause}' if cause else ''}"


def draw_ahead() -> None:
    """Compile and draw what every page has, before there is a result."""
    template(_PAGE)
    _embedded_method()


@cache
def template(name: str) -> jinja2.Template:
    """Return one of the room's templates, with everything escaped by default."""
    folder = Path(__file__).parent / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        finalize=_visible,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["svg"] = _as_markup
    environment.filters["symbols"] = symbols
    environment.globals["labels"] = labels
    return environment.get_template(name)


def _visible(value: Any) -> Any:
    """Return text without control characters and marks that turn what follows round."""
    if not isinstance(value, str) or hasattr(value, "__html__"):
        return value
    return sanitize(value, keep="\n")


def _as_markup(svg: str) -> Any:
    """Mark a picture of ours as safe; never used on text from outside."""
    from markupsafe import Markup

    return Markup(svg)


def _axis(name: str, axis: AxisAnalysis, svgs: Mapping[str, str], choices: CurveChoices) -> _Axis:
    loop = axis.explanation
    return _Axis(
        name=name,
        sensor=SENSOR_NAMES[axis.unit],
        remarks=axis.remarks,
        coefficients=coefficient_table.coefficient_rows(axis),
        power_laws=coefficient_table.power_law_rows(axis),
        facts=axis_text.axis_facts(axis),
        looked=loop is not None,
        effects=[axis_text.effect_words(effect) for effect in loop.own_effects] if loop else [],
        errors=axis_text.error_rows(loop) if loop and was_searched(loop) else [],
        conclusion=axis_text.conclusion(loop) if loop else [],
        search=axis_text.search_rows(loop) if loop else [],
        deviation_svg=svgs[f"{name}-deviation"],
        estimators_svg=svgs.get(f"{name}-estimators", ""),
        curve_values=axis_text.curve_values(axis, choices),
        residual_svg=svgs.get(f"{name}-residual", ""),
        density_svg=svgs.get(f"{name}-density", ""),
        lag_svg=svgs.get(f"{name}-lag", ""),
    )


def _summary(axes: Mapping[str, AxisAnalysis], quiet: Undisturbed | None) -> list[dict[str, Any]]:
    """Return a table for each sensor: N, B and K of its axes and what the datasheet says.

    Below each axis stands the longest undisturbed stretch of the run, where there is one.
    """
    tables = []
    for unit, sensor in SENSOR_NAMES.items():
        here = {name: axis for name, axis in axes.items() if axis.unit == unit}
        if here:
            heads = [f"{k}, {symbols(COEFFICIENTS[unit, k][0].unit)}" for k in MAIN_LETTERS]
            rows = [
                {
                    "name": name,
                    "quiet": _undisturbed_cells(name, unit, quiet),
                    "cells": [
                        *(
                            coefficient_table.coefficient_cell(a.coefficients.get(k), k, unit)
                            for k in MAIN_LETTERS
                        ),
                        axis_text.sheet_cell(a),
                    ],
                }
                for name, a in here.items()
            ]
            tables.append({"name": sensor, "heads": [*heads, labels.DATASHEET], "rows": rows})
    return tables


def _undisturbed_cells(name: str, unit: str, quiet: Undisturbed | None) -> list[str]:
    if quiet is None or name not in quiet.axes:
        return []
    known = quiet.axes[name]
    cells = (coefficient_table.coefficient_cell(known.get(k), k, unit) for k in MAIN_LETTERS)
    return [*cells, ""]  # of the datasheet


def _command(analysis: Analysis) -> str:
    path = analysis.input.get("path", "")
    plain = f"allanscope analyse {shlex.quote(path)}" if path else ""
    return analysis.input.get("command", plain)


def _embedded(name: str, one: Picture) -> str:
    """Return a picture as it stands on the page."""
    return _embedded_method() if one is _method() else one.svg() + one.link(name)


@cache
def _method() -> Picture:
    """Return the picture of the estimators."""
    return transfer_picture(_LOBES, 600)


@cache
def _embedded_method() -> str:
    """Return it as it stands on the page."""
    return _method().svg() + _method().link(_METHOD)


def pictures(analysis: Analysis) -> dict[str, Picture]:
    """Return what there is to draw: ``gx-deviation``, ``gyroscope-series``, ``ratio``, ..."""
    shown = {name: axis for name, axis in analysis.axes.items() if "oadev" in axis.curves}
    found: dict[str, Picture] = {}
    for name, axis in shown.items():
        found |= {f"{name}-{what}": one for what, one in _of_axis(name, axis, analysis).items()}
    record = analysis.record
    for unit, sensor in SENSOR_NAMES.items():
        here = {name: axis for name, axis in shown.items() if axis.unit == unit}
        names = list(here)
        if names:
            found[f"{sensor}-overlay"] = overlay_picture(here, unit)
        if record is not None and names:
            found[f"{sensor}-series"] = series_picture(
                record, names, unit, marked_moments(analysis)
            )
    if shown:
        found["ratio"] = ratio_picture(shown)
        found[_METHOD] = _method()
    columns = {name: i for i, name in enumerate(analysis.axes) if name in shown}
    if analysis.dynamic is not None and columns:
        found["dynamic"] = dynamic_picture(analysis.dynamic, columns, marked_moments(analysis))
    return found


def save_pictures(found: Mapping[str, Picture], folder: Path) -> list[Path]:
    """Write every picture into a folder, as SVG and as PNG; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    return [path for name, one in found.items() for path in one.save(folder / name)]


def _of_axis(name: str, axis: AxisAnalysis, analysis: Analysis) -> dict[str, Picture]:
    choices = analysis.choices
    found = {"deviation": deviation_picture(name, axis, choices)}
    if choices.kinds or choices.variance:
        found["estimators"] = estimators_picture(name, axis, choices)
    if axis.explanation is not None and was_searched(axis.explanation):
        found["residual"] = residual_picture(name, axis)
    if axis.density is not None:
        found["density"] = density_picture(name, axis)
    if analysis.record is not None and len(analysis.record.values):
        found["lag"] = lag_picture(analysis.record, name, axis.unit)
    return found
