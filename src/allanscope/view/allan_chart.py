"""What a sigma-tau chart shows: curves and their intervals, the model, its parts, a datasheet."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.deviation import Deviation
from allanscope.analysis.result import ModelCurve
from allanscope.noise.coefficients import DatasheetVerdict
from allanscope.quantities import Reading, number, symbols
from allanscope.view.chart import HEIGHT, WIDTH, Chart, Points
from allanscope.view.drawing import Drawing
from allanscope.view.palette import EFFECT, MODEL, REFERENCE, Colour, muted

__all__ = ["draw_curve", "draw_datasheet", "draw_model", "draw_textbook"]

_HATCH = 8.0
_NOISE_TERMS = ("Q", "N", "B", "K", "R", "rounding")


def draw_curve(
    chart: Chart, curve: Deviation, reading: Reading, colour: Colour, named: bool = False
) -> Drawing:
    """Draw an estimate: band, whiskers, line and dots; what is not trusted is dashed and faint.

    Parameters
    ----------
    chart : Chart
        Where.
    curve : Deviation
        Of one axis.
    reading : Reading
        Unit of the chart.
    colour : Colour
        Of everything drawn.
    named : bool
        Write the estimator's name at the end of the curve.
    """
    drawing = Drawing()
    value, lower, upper = (
        reading.factor * np.asarray(part) for part in (curve.deviation, curve.lower, curve.upper)
    )
    drawing.line(chart.band(curve.tau, lower, upper, _HATCH), muted(colour), width=0.6)
    drawing.line(chart.whiskers(curve.tau, lower, upper), muted(colour), width=1.0)
    for trusted, run in _runs(curve.trusted):
        strips = chart.line(curve.tau[run], value[run])
        if trusted:
            drawing.line(strips, colour, width=1.6)
        else:
            drawing.dashes(strips, muted(colour), width=1.6)
    points = chart.points(curve.tau, value)
    shown = _on(points)
    texts = _texts(curve, value, lower, upper, symbols(reading.unit))
    for trusted, of_dots in ((True, colour), (False, muted(colour))):
        chosen = np.flatnonzero(shown & (curve.trusted == trusted))
        drawing.dot(points[chosen], [texts[i] for i in chosen], of_dots, size=3.6)
    if named:
        _name(drawing, points[shown & curve.trusted], curve.kind, colour)
    return drawing


def draw_model(chart: Chart, model: ModelCurve, reading: Reading) -> Drawing:
    """Draw the fitted total, and each part as a dashed line with its letter or name."""
    drawing = Drawing()
    for name, part in model.components.items():
        colour = MODEL if name in _NOISE_TERMS else EFFECT
        value = reading.factor * part
        drawing.dashes(chart.line(model.x, value), colour, width=1.4)
        at = _tag(chart, model.x, value, reading.factor * model.total, name in _NOISE_TERMS)
        if at is not None:
            drawing.word(at, name.replace("_", " "), colour)
    # Broad and pale, beneath the measured line: it shows beside the line wherever the two differ.
    drawing.line(chart.line(model.x, reading.factor * model.total), muted(MODEL), width=5.0)
    return drawing


def draw_textbook(chart: Chart, model: ModelCurve, reading: Reading) -> Drawing:
    """Draw the model before anything was found: what the textbook's coefficients alone say."""
    drawing = Drawing()
    drawing.dashes(chart.line(model.x, reading.factor * model.total), REFERENCE, width=1.8)
    return drawing


def draw_datasheet(chart: Chart, verdict: DatasheetVerdict, reading: Reading) -> Drawing:
    """Draw the white noise that the datasheet promises: sigma = (limit / sqrt(2)) / sqrt(tau).

    The datasheet's density is one-sided, N is two-sided: hence the root of two.
    """
    drawing = Drawing()
    if verdict.white_limit is None:
        return drawing
    tau = chart.x.read([0.0, 1.0])
    sigma = reading.factor * verdict.white_limit / np.sqrt(tau)
    strips = chart.line(tau, sigma)
    drawing.dashes(strips, REFERENCE, width=1.2)
    if strips:
        x, y = strips[0][0] + 0.16 * (strips[-1][-1] - strips[0][0])
        drawing.word((float(x) + 85.0, float(y) - 68.0), "datasheet", REFERENCE)
    return drawing


def _runs(trusted: NDArray[np.bool_]) -> list[tuple[bool, slice]]:
    """Return stretches of equal trust; each begins with the last point of the one before."""
    edges = [0, *(np.flatnonzero(np.diff(trusted)) + 1).tolist(), len(trusted)]
    return [
        (bool(trusted[start]), slice(max(start - 1, 0), stop))
        for start, stop in pairwise(edges)
        if stop > start
    ]


def _name(drawing: Drawing, points: Points, kind: str, colour: Colour) -> None:
    """Write the estimator's name above the last point that is trusted, clear of the interval."""
    if len(points):
        x, y = (float(value) for value in points[-1])
        drawing.word((min(x, WIDTH - 40.0), max(y - 95.0, 0.0)), kind.upper(), colour)


def _texts(
    curve: Deviation,
    value: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    unit: str,
) -> list[str]:
    return [
        f"{curve.kind.upper()}  τ = {number(t, 4)} s  σ = {number(s, 4)} {unit}  "
        f"[{number(low)}, {number(high)}]  {noise}{'' if ok else '  not trusted'}"
        for t, s, low, high, noise, ok in zip(
            curve.tau, value, lower, upper, curve.noise, curve.trusted, strict=True
        )
    ]


def _on(points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which points lie on the chart."""
    with np.errstate(invalid="ignore"):
        inside = (points >= 0.0) & (points <= np.array([WIDTH, HEIGHT]))
    return np.asarray(inside.all(axis=1))


def _tag(
    chart: Chart,
    x: NDArray[np.float64],
    part: NDArray[np.float64],
    total: NDArray[np.float64],
    is_noise: bool,
) -> tuple[float, float] | None:
    """Return where a part's name stands: noise terms farthest from the total, effects at a peak."""
    points = chart.points(x, part)
    shown = np.flatnonzero(_on(points))
    if not len(shown):
        return None
    share = part[shown] / total[shown]
    at = points[shown[np.argmin(share) if is_noise else np.argmax(part[shown])]]
    return (
        float(np.clip(at[0], 28.0, WIDTH - 28.0)),
        float(np.clip(at[1] - 24.0, 24.0, HEIGHT - 44.0)),
    )
