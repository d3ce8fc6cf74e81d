"""Pictures of curves: an axis with its model, the closed loop, several sessions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import ArrayLike, NDArray

from allanscope.allan import CurveChoices, Deviation, variance_name
from allanscope.analysis import AxisAnalysis, ModelCurve
from allanscope.labels import kind_name
from allanscope.quantities import DEVIATION, duration, interval, number, power_of_ten, symbols
from allanscope.report.picture import (
    BEFORE,
    COMPONENT,
    CYCLE,
    DATASHEET,
    FOUND,
    MEASURED,
    MODEL,
    Picture,
    ink,
)

__all__ = [
    "compare_picture",
    "deviation_picture",
    "estimators_picture",
    "overlay_picture",
    "residual_picture",
    "scale_loglog",
]

SHOWN = ("oadev", "mdev", "ohdev", "totdev")
"""Estimators that are drawn together by default."""

_NOISE_TERMS = ("N", "B", "K", "Q", "R", "rounding")
_PERCENT_SHOWN = 60.0
_NEAR_TOTAL = 0.6
_SHORT_DECADES = 1.5
_APART = 0.1
"""Least distance between names, as a share of the picture's sides."""


def deviation_picture(
    name: str, axis: AxisAnalysis, choices: CurveChoices | None = None
) -> Picture:
    """Draw one axis: curve, interval, model, its labelled components, the datasheet's line.

    With variances chosen everything is squared; the simple limits are dotted.
    """
    chosen = choices or CurveChoices()
    squared = chosen.variance

    def draw(figure: Figure) -> None:
        ax, curve, factor = figure.subplots(), axis.curves["oadev"], DEVIATION[axis.unit].factor
        model, sheet = axis.model, axis.datasheet.get("density")
        white = sheet.white_limit if sheet is not None else None
        simple = [*curve.simple_limits()] if chosen.simple_limits else []
        line = None if white is None else factor * white / np.sqrt(curve.tau)
        if squared:
            curve, factor, model = _squared(curve), factor**2, _squared_model(model)
            simple, line = [x**2 for x in simple], None if line is None else line**2
        what = "variance" if squared else "deviation"
        label = f"{name}, measured (overlapping Allan {what})"
        curve.plot(ax, factor=factor, color=MEASURED, label=label)
        _scale(ax, axis.unit, squared)
        _frame(ax, curve, factor)
        for i, limit in enumerate(simple):
            dotted = None if i else "± value / √terms (DT0064)"
            ax.plot(curve.tau, factor * limit, ":", c=BEFORE, lw=1.0, label=dotted)
        if model is not None:
            _model(ax, model, factor)
        if line is not None:
            ax.plot(curve.tau, line, "-.", c=DATASHEET, lw=1.3, label="datasheet")
        if not squared:
            _references(ax, {name: axis}, factor)
        ax.legend(loc="upper right")

    def readout() -> list[tuple[float, str]]:
        factor = DEVIATION[axis.unit].factor
        said = _overlay_readout({name: axis})
        if axis.model is None:
            return said
        model = factor * _at(axis.model, axis.curves["oadev"].tau)
        return [
            (tau, f"{text}\nmodel {number(value)}")
            for (tau, text), value in zip(said, model, strict=True)
        ]

    def columns() -> Mapping[str, ArrayLike]:
        return _columns(axis.curves["oadev"], {"model": axis.model})

    return Picture(draw, columns=columns, readout=None if squared else readout)


def overlay_picture(axes: Mapping[str, AxisAnalysis], unit: str) -> Picture:
    """Draw the curves of all axes of a sensor over each other, with the datasheet's line."""

    def draw(figure: Figure) -> None:
        ax, factor = figure.subplots(), DEVIATION[unit].factor
        for (name, axis), colour in zip(axes.items(), CYCLE, strict=False):
            lines, fills = len(ax.lines), len(ax.collections)
            axis.curves["oadev"].plot(ax, factor=factor, color=colour, label=name)
            for artist in (*ax.lines[lines:], *ax.collections[fills:]):
                artist.set_gid(f"series-{name}")
        first = next(iter(axes.values()))
        sheet = first.datasheet.get("density")
        if sheet is not None and sheet.white_limit is not None:
            tau = first.curves["oadev"].tau
            line = factor * sheet.white_limit / np.sqrt(tau)
            ax.plot(tau, line, "-.", c=DATASHEET, lw=1.3, label="datasheet")
        _references(ax, axes, factor)
        _scale(ax, unit)
        ax.legend(loc="upper right")

    def columns() -> Mapping[str, ArrayLike]:
        curves = {name: axis.curves["oadev"] for name, axis in axes.items()}
        longest = max((curve.tau for curve in curves.values()), key=len)
        return {"tau_s": longest} | {
            f"{name}_{unit}": np.interp(longest, one.tau, one.deviation, left=np.nan, right=np.nan)
            for name, one in curves.items()
        }

    return Picture(draw, 5.0, 3.6, columns=columns, readout=lambda: _overlay_readout(axes))


def _references(ax: Axes, axes: Mapping[str, AxisAnalysis], factor: float) -> None:
    """Draw what the axes are compared with: a mask of the whole sensor once, all named once."""
    drawn: list[tuple[float, ...]] = []
    for axis in axes.values():
        if axis.comparison is None:
            continue
        curve, other = axis.curves["oadev"], axis.comparison.reference
        shown = (other.tau >= curve.tau[0] / 2) & (other.tau <= curve.tau[-1] * 2)
        heights = factor * other.deviation[shown]
        if tuple(heights) not in drawn:
            label = None if drawn else _label(other.name)
            ax.plot(other.tau[shown], heights, "-", c=BEFORE, lw=1.3, label=label)
            drawn.append(tuple(heights))


def estimators_picture(name: str, axis: AxisAnalysis, choices: CurveChoices) -> Picture:
    """Draw the curves of several estimators of one axis over each other, as DT0064's figure 3."""
    kinds = [kind for kind in choices.kinds or SHOWN if kind in axis.curves]

    def draw(figure: Figure) -> None:
        ax, factor = figure.subplots(), DEVIATION[axis.unit].factor
        for kind, colour in zip(kinds, CYCLE * len(kinds), strict=False):
            curve = axis.curves[kind]
            if choices.variance:
                _squared(curve).plot(ax, factor=factor**2, color=colour, label=variance_name(kind))
            else:
                curve.plot(ax, factor=factor, color=colour, label=kind.upper())
        _scale(ax, axis.unit, choices.variance)
        ax.set_title(name, fontsize="medium")
        ax.legend(loc="best")

    return Picture(draw)


def _squared(curve: Deviation) -> Deviation:
    """Return a curve of variances."""
    return replace(curve, deviation=curve.deviation**2, lower=curve.lower**2, upper=curve.upper**2)


def _squared_model(model: ModelCurve | None) -> ModelCurve | None:
    if model is None:
        return None
    parts = {name: part**2 for name, part in model.components.items()}
    return ModelCurve(model.x, model.total**2, parts)


def residual_picture(name: str, axis: AxisAnalysis) -> Picture:
    """Draw the closed loop: the curve with both models, and what each of them leaves."""

    def draw(figure: Figure) -> None:
        curve, factor = axis.curves["oadev"], DEVIATION[axis.unit].factor
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
        curve.plot(top, factor=factor, color=MEASURED, label=f"{name}, measured")
        for model, colour, style, label in (
            (axis.model_before, BEFORE, "--", "model before"),
            (axis.model, MODEL, "-", "model after"),
        ):
            if model is not None:
                left = _percent_left(curve, model)
                for line in (
                    *top.plot(model.x, factor * model.total, style, c=colour, lw=1.5, label=label),
                    *bottom.plot(curve.tau, left, style, c=colour, lw=1.3, label=label),
                ):
                    line.set_gid(f"series-{label.partition(' ')[2]}")
        low, high = (
            100 * (part / np.where(curve.deviation > 0, curve.deviation, np.nan) - 1)
            for part in (curve.lower, curve.upper)
        )
        bottom.fill_between(curve.tau, low, high, color=MEASURED, alpha=0.18, lw=0)
        bottom.axhline(0.0, c=ink(), lw=0.8)
        bottom.set_ylim(-_PERCENT_SHOWN, _PERCENT_SHOWN)
        bottom.set_ylabel("measured / model − 1 (%)")
        _scale(top, axis.unit)
        top.set_xlabel("")
        bottom.set_xlabel("averaging time τ (s)")
        _frame(top, curve, factor)
        top.legend(loc="upper right")

    def columns() -> Mapping[str, ArrayLike]:
        models = {"model_before": axis.model_before, "model_after": axis.model}
        return _columns(axis.curves["oadev"], models)

    return Picture(draw, height=5.2, columns=columns)


def compare_picture(curves: Mapping[str, Deviation], unit: str) -> Picture:
    """Overlay the curves of one axis from several sessions."""

    def draw(figure: Figure) -> None:
        ax, factor = figure.subplots(), DEVIATION[unit].factor
        for (name, curve), colour in zip(curves.items(), CYCLE * len(curves), strict=False):
            curve.plot(ax, factor=factor, color=colour, label=_label(name))
        _scale(ax, unit)
        ax.legend(loc="best")

    return Picture(draw)


def scale_loglog(ax: Axes, xlabel: str, ylabel: str) -> None:
    """Make both scales logarithmic and name them; say so where there is nothing above zero."""
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    if not any(_is_drawable(line.get_ydata()) for line in ax.lines):
        ax.text(0.5, 0.5, "no noise: all values are the same", ha="center", transform=ax.transAxes)
        return
    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        # Plain text: typesetting powers of ten takes half of the time of drawing.
        axis.set_major_formatter(FuncFormatter(_major_label))
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(FuncFormatter(partial(_minor_label, axis)))


def _major_label(value: float, _: int | None) -> str:
    """Return the label of a decade, as a power of ten where the number would be long."""
    text = f"{value:g}"
    return power_of_ten(round(np.log10(value))) if "e" in text else text


def _minor_label(axis: Axis, value: float, _: int | None) -> str:
    """Return the label of a tick at 2 or 5 where hardly a decade is there to be labelled."""
    low, high = sorted(axis.get_view_interval())
    return f"{value:g}" if low > 0 and np.log10(high / low) < _SHORT_DECADES else ""


def _is_drawable(heights: ArrayLike) -> bool:
    """Return whether a logarithmic scale can show any of it; denormal numbers have no digits."""
    return bool(np.any(np.asarray(heights) > np.finfo(float).tiny))


def _model(ax: Axes, model: ModelCurve, factor: float) -> None:
    ax.plot(model.x, factor * model.total, c=MODEL, lw=1.6, alpha=0.9, label="model")
    places: list[tuple[float, float]] = []
    for name, part in model.components.items():
        colour = COMPONENT if name in _NOISE_TERMS else FOUND
        ax.plot(model.x, factor * part, "--", c=colour, lw=0.9)
        at = _place(ax, model, part, factor, name in _NOISE_TERMS, places)
        if at is not None:
            ax.annotate(
                kind_name(name),
                (model.x[at], factor * part[at]),
                (0, 3),
                textcoords="offset points",
                ha="center",
                color=colour,
                fontweight="bold",
            )


def _place(
    ax: Axes,
    model: ModelCurve,
    part: NDArray[np.float64],
    factor: float,
    is_noise: bool,
    taken: list[tuple[float, float]],
) -> int | None:
    """Return where a part is named, clear of the names there are, which it joins.

    Noise is named where it is least of the total, an effect near its peak but off the total.
    """
    low, high = np.log10(ax.get_ylim())
    with np.errstate(divide="ignore"):
        y = (np.log10(factor * part) - low) / (high - low)
    x = np.log10(model.x / model.x[0]) / np.log10(model.x[-1] / model.x[0])
    share = part / model.total
    rank = share if is_noise else np.where(share < _NEAR_TOTAL, -y, 1.0 + share)
    for at in np.argsort(rank):
        here = float(x[at]), float(y[at])
        inside = 0.04 < here[0] < 0.96 and 0.03 < here[1] < 0.95
        if inside and all(np.hypot(here[0] - a, here[1] - b) > _APART for a, b in taken):
            taken.append(here)
            return int(at)
    return None


def _overlay_readout(axes: Mapping[str, AxisAnalysis]) -> list[tuple[float, str]]:
    """Return for each averaging time what the curves of some axes of a sensor have there."""
    said: dict[float, list[str]] = {}
    for name, axis in axes.items():
        curve, factor = axis.curves["oadev"], DEVIATION[axis.unit].factor
        columns = zip(curve.tau, curve.deviation, curve.lower, curve.upper, strict=True)
        for tau, value, low, high in columns:
            text = interval(factor * value, factor * low, factor * high)
            said.setdefault(float(tau), []).append(f"{name} {text}")
    unit = symbols(DEVIATION[next(iter(axes.values())).unit].unit) if axes else ""
    return [(tau, "\n".join([f"τ {duration(tau)}, {unit}", *here])) for tau, here in said.items()]


def _columns(curve: Deviation, models: Mapping[str, ModelCurve | None]) -> Mapping[str, ArrayLike]:
    """Return a curve and models of it, in the unit of the result, as columns."""
    columns: dict[str, ArrayLike] = {"tau_s": curve.tau}
    columns |= {k: getattr(curve, k) for k in ("deviation", "lower", "upper", "trusted")}
    return columns | {k: _at(one, curve.tau) for k, one in models.items() if one is not None}


def _at(model: ModelCurve, tau: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a model's deviation at averaging times between those it was evaluated at."""
    return np.asarray(np.exp(np.interp(np.log(tau), np.log(model.x), np.log(model.total))))


def _percent_left(curve: Deviation, model: ModelCurve) -> NDArray[np.float64]:
    return np.asarray(100.0 * (curve.deviation / _at(model, curve.tau) - 1.0))


def _label(name: str) -> str:
    """Return a name from outside as a label: no mathematics, and never left out of the legend."""
    plain = name.replace("$", r"\$")
    return f"\N{ZERO WIDTH SPACE}{plain}" if plain.startswith("_") else plain


def _scale(ax: Axes, unit: str, squared: bool = False) -> None:
    name = symbols(DEVIATION[unit].unit)
    label = f"σ²(τ) (({name})²)" if squared else f"σ(τ) ({name})"
    scale_loglog(ax, "averaging time τ (s)", label)


def _frame(ax: Axes, curve: Deviation, factor: float) -> None:
    """Show the surroundings of the curve, so that a part far below it cannot shrink it."""
    positive = factor * curve.deviation[curve.deviation > 0]
    if _is_drawable(positive):
        ax.set_ylim(positive.min() / 5, positive.max() * 4)
