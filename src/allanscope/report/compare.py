"""Several sessions on one page: overlaid curves, a table, and the spread between them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from allanscope.analysis.result import Analysis
from allanscope.quantities import COEFFICIENTS, duration, number, symbols
from allanscope.report import figures, words
from allanscope.report.page import template

__all__ = ["render_comparison"]

NAMES = ("N", "B", "K")


def render_comparison(sessions: Mapping[str, Analysis]) -> str:
    """Return the page that compares sessions.

    Parameters
    ----------
    sessions : mapping
        Name of each session, as it is to be shown, to its result.
    """
    axes = list(dict.fromkeys(name for one in sessions.values() for name in one.axes))
    return template("compare.html.j2").render(
        title=f"{len(sessions)} sessions compared",
        subtitle=", ".join(
            f"{name}: {duration(one.duration_s)} of {one.part or 'a sensor'}"
            for name, one in sessions.items()
        ),
        verdict=_verdict(sessions),
        heads=NAMES,
        axes=[_axis(name, sessions) for name in axes],
        footer=f"allanscope {next(iter(sessions.values())).version}",
    )


def _axis(name: str, sessions: Mapping[str, Analysis]) -> dict[str, Any]:
    here = {label: one.axes[name] for label, one in sessions.items() if name in one.axes}
    unit = next(iter(here.values())).unit
    curves = {label: axis.curves["oadev"] for label, axis in here.items() if "oadev" in axis.curves}
    units = ", ".join(f"{n} in {symbols(COEFFICIENTS[unit, n][0].unit)}" for n in NAMES)
    return {
        "name": f"{name} ({units})",
        "svg": figures.compare_figure(curves, unit),
        "rows": [
            {
                "name": label,
                "cells": [words.coefficient_cell(axis.coefficients.get(n), n, unit) for n in NAMES],
            }
            for label, axis in here.items()
        ],
        "spread": [
            _spread([a.coefficients[n].value for a in here.values() if _known(a, n)]) for n in NAMES
        ],
    }


def _known(axis: Any, name: str) -> bool:
    return name in axis.coefficients and axis.coefficients[name].detected


def _spread(values: Sequence[float]) -> str:
    """Return the standard deviation over the mean of what was detected, in per cent."""
    if len(values) < 2:
        return "–"
    mean = math.fsum(values) / len(values)
    variance = math.fsum((v - mean) ** 2 for v in values) / (len(values) - 1)
    return f"{number(100 * math.sqrt(variance) / mean, 2)} %"


def _verdict(sessions: Mapping[str, Analysis]) -> list[words.VerdictLine]:
    """Lead with what goes wrong in each session."""
    lines = []
    for label, one in sessions.items():
        bad = [line for line in words.verdict(one) if line.grade == "bad"]
        grade = "bad" if bad else "good"
        text = "; ".join(f"{line.head} {line.text}" for line in bad) or "nothing stands out"
        lines.append(words.VerdictLine(grade, f"{label}:", text))
    return lines
