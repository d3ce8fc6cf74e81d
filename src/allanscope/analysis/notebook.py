"""A result in a notebook: as text, as HTML, as a table, and drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from allanscope.allan import data_frame
from allanscope.analysis.result import Analysis
from allanscope.analysis.verdict_lines import VerdictLine, verdict
from allanscope.analysis.wording import (
    coefficient_text,
    coefficient_unit,
    losses_phrase,
    rate_text,
)
from allanscope.colours import CYCLE, hexadecimal
from allanscope.quantities import (
    DEVIATION,
    MAIN_LETTERS,
    SENSOR_NAMES,
    count,
    duration,
    symbols,
)
from allanscope.sanitize import one_line, sanitize

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["coefficients_frame", "html", "overlay", "summary_text"]

_GRADES = {"good": "#116329", "bad": "#a40e26", "note": "#7d4e00"}


def summary_text(analysis: Analysis) -> str:
    """Return the verdict, N, B and K of each axis, and the details, as plain lines."""
    known = verdict(analysis)
    lines = [_facts(analysis), *([known.banner] if known.banner else [])]
    lines += _plain(known.lines)
    for head, rows in _tables(analysis):
        table = [head, *rows]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        cells = (zip(row, widths, strict=True) for row in table)
        lines += ["", *("  ".join(c.ljust(w) for c, w in row).rstrip() for row in cells)]
    details = _plain(known.details)
    return "\n".join([*lines, *([""] if details else []), *details])


def html(analysis: Analysis) -> str:
    """Return the same as HTML, without any script or style sheet."""
    known = verdict(analysis)
    parts = [f"<p><b>{_escaped(_facts(analysis))}</b></p>"]
    if known.banner:
        parts.append(f'<p style="color: {_GRADES["bad"]}"><b>{_escaped(known.banner)}</b></p>')
    parts += [
        f'<p style="margin: 0"><b style="color: {_GRADES[line.grade]}">{_escaped(line.head)}:</b> '
        f"{_escaped(line.text)}</p>"
        for line in known.lines
    ]
    for head, rows in _tables(analysis):
        heads = "".join(f"<th>{_escaped(cell)}</th>" for cell in head)
        body = "".join(
            f"<tr>{''.join(f'<td>{_escaped(cell)}</td>' for cell in row)}</tr>" for row in rows
        )
        parts.append(f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>")
    if known.details:
        rest = "<br>".join(_escaped(line) for line in _plain(known.details))
        parts.append(f"<details><summary>Details</summary>{rest}</details>")
    return "".join(parts)


def coefficients_frame(analysis: Analysis) -> Any:
    """Return a row for each coefficient of each axis, as a table of pandas or polars."""
    found = [
        (name, letter, one)
        for name, axis in analysis.axes.items()
        for letter, one in axis.coefficients.items()
    ]
    columns: dict[str, list[Any]] = {
        "axis": [name for name, _, _ in found],
        "coefficient": [letter for _, letter, _ in found],
    }
    for field in ("value", "lower", "upper", "unit", "detected"):
        columns[field] = [getattr(one, field) for _, _, one in found]
    columns["wait_s"] = [np.nan if one.wait_s is None else one.wait_s for _, _, one in found]
    return data_frame(columns)


def overlay(analysis: Analysis, kind: str, axes: Sequence[str] | None) -> Figure:
    """Draw the curves of one estimator: one chart a sensor, its axes over each other.

    Raises
    ------
    ValueError
        When no axis has such a curve.
    """
    from matplotlib import pyplot

    chosen = {k: axis for k, axis in analysis.axes.items() if axes is None or k in axes}
    chosen = {k: axis for k, axis in chosen.items() if kind in axis.curves}
    units = [unit for unit in SENSOR_NAMES if any(one.unit == unit for one in chosen.values())]
    if not units:
        kinds = dict.fromkeys(k for axis in analysis.axes.values() for k in axis.curves)
        there = f"axes {' '.join(analysis.axes)}, estimators {' '.join(kinds)}"
        raise ValueError(f"no curve {kind!r} of these axes; there are {there}")
    figure, charts = pyplot.subplots(
        1, len(units), figsize=(6.0 * len(units), 4.2), squeeze=False, layout="constrained"
    )
    for unit, ax in zip(units, charts[0], strict=True):
        reading = DEVIATION[unit]
        here = {name: axis for name, axis in chosen.items() if axis.unit == unit}
        for (name, axis), colour in zip(here.items(), map(hexadecimal, CYCLE), strict=False):
            axis.curves[kind].plot(
                ax, factor=reading.factor, unit=symbols(reading.unit), label=name, color=colour
            )
            if axis.model is not None and kind == "oadev":
                ax.plot(axis.model.x, reading.factor * axis.model.total, "--", lw=0.9, c=colour)
        ax.set_title(f"{SENSOR_NAMES[unit].capitalize()}, {kind.upper()}")
        ax.legend()
    return figure


def _facts(analysis: Analysis) -> str:
    known = (
        analysis.part or "part not known",
        duration(analysis.duration_s),
        f"{count(analysis.samples)} samples",
        losses_phrase(analysis),
        rate_text(analysis.rate),
    )
    return ", ".join(one_line(fact) for fact in known)


def _plain(lines: Iterable[VerdictLine]) -> list[str]:
    return [f"{sanitize(line.head)}: {sanitize(line.text)}" for line in lines]


def _tables(analysis: Analysis) -> Iterable[tuple[list[str], list[list[str]]]]:
    """Return the head and the rows of each sensor's table."""
    for unit in SENSOR_NAMES:
        axes = {name: axis for name, axis in analysis.axes.items() if axis.unit == unit}
        if axes:
            heads = [f"{letter}, {coefficient_unit(unit, letter)}" for letter in MAIN_LETTERS]
            rows = [
                [
                    name,
                    *(
                        coefficient_text(unit, letter, axis.coefficients.get(letter))
                        for letter in MAIN_LETTERS
                    ),
                ]
                for name, axis in axes.items()
            ]
            yield ["axis", *heads], rows


def _escaped(text: str) -> str:
    return escape(one_line(text))
