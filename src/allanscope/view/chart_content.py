"""What is drawn on each chart: sigma-tau curves, spectra, the residual of the model.

A `Drawing` is strips, dots and words in world units, collected for one entity of the viewer. On the
sigma-tau chart stand curves and their intervals, the model, its parts and the datasheet; on the
spectrum the measured noise density, the model's, and the lines found in it; on the residual chart
measured over model, before and after the loop was closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import special

from allanscope.allan import Deviation, DynamicDeviation
from allanscope.analysis import ModelCurve, ReferenceCurve
from allanscope.explain import AxisExplanation
from allanscope.labels import kind_name
from allanscope.noise import DatasheetVerdict
from allanscope.quantities import Reading, number, symbols
from allanscope.spectrum import Density
from allanscope.view.chart import HEIGHT, WIDTH, Chart, Points, Strips, dashed
from allanscope.view.palette import (
    EFFECT,
    GRID,
    MODEL,
    REFERENCE,
    TEXT,
    Colour,
    muted,
    ratio_colours,
)

__all__ = [
    "Drawing",
    "draw_curve",
    "draw_datasheet",
    "draw_density",
    "draw_density_limit",
    "draw_density_model",
    "draw_effects",
    "draw_grid",
    "draw_map",
    "draw_model",
    "draw_noise_model",
    "draw_reference",
    "draw_residual",
    "percent_of_model",
]

_HATCH = 8.0
_MAP_COLUMNS, _MAP_ROWS = 300, 96
_MAP_REACH = 0.36
"""Log of how far a row of a map may be from the averaging time that it shows."""
_NOISE_TERMS = ("Q", "N", "B", "K", "R", "rounding")


@dataclass(slots=True)
class Drawing:
    """Strips and dots, each with its colour and radius, and words that are always shown.

    Radii follow the viewer: positive in world units, negative in points of the screen. An image,
    rows from above of red, green, blue and opacity, fills the chart and lies below everything.
    """

    strips: Strips = field(default_factory=list)
    strip_colours: list[Colour] = field(default_factory=list)
    strip_radii: list[float] = field(default_factory=list)
    dots: list[Points] = field(default_factory=list)
    dot_colours: list[Colour] = field(default_factory=list)
    dot_texts: list[str] = field(default_factory=list)
    words: list[tuple[tuple[float, float], str, Colour]] = field(default_factory=list)
    image: NDArray[np.uint8] | None = None

    def line(self, strips: Strips, colour: Colour, width: float = 2.0) -> None:
        """Add polylines `width` points of the screen wide."""
        self._add(strips, colour, -width / 2)

    def dashes(self, strips: Strips, colour: Colour, width: float = 1.4) -> None:
        """Add polylines as dashes."""
        self._add(dashed(strips), colour, -width / 2)

    def dot(
        self,
        points: Points,
        texts: Sequence[str],
        colour: Colour,
    ) -> None:
        """Add dots that say their text when pointed at."""
        self.dots += list(points)
        self.dot_colours += [colour] * len(points)
        self.dot_texts += texts

    def word(self, at: tuple[float, float], text: str, colour: Colour) -> None:
        """Add a word, centred."""
        self.words.append((at, text, colour))

    def _add(self, strips: Strips, colour: Colour, radius: float) -> None:
        self.strips += strips
        self.strip_colours += [colour] * len(strips)
        self.strip_radii += [radius] * len(strips)


def draw_grid(chart: Chart) -> Drawing:
    """Return the grid of a chart with its labels; grey that reads on either theme."""
    drawing = Drawing()
    major, minor = chart.grid()
    drawing.line([*minor, *major], GRID, width=0.5)
    for at, text in chart.labels():
        drawing.word(at, text, TEXT)
    return drawing


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
    for trusted, run in curve.trust_runs():
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
        drawing.dot(points[chosen], [texts[i] for i in chosen], of_dots)
    if named:
        certain = shown & curve.trusted
        _name(drawing, points[certain if certain.any() else shown], curve.kind, colour)
    return drawing


def draw_map(
    chart: Chart,
    dynamic: DynamicDeviation,
    axis: int,
    events_s: Sequence[float],
    others_s: Sequence[float] = (),
) -> Drawing:
    """Draw the Allan deviation over time as colours: each cell over the median at its tau.

    Parameters
    ----------
    chart : Chart
        Time, and averaging time upwards.
    dynamic : DynamicDeviation
        Of all axes.
    axis : int
        Which one.
    events_s : sequence of float
        Times at which something began on this axis or in the whole stream, drawn upright.
    others_s : sequence of float
        Those at which something began on other axes alone, drawn paler.
    """
    time_s = chart.x.read((np.arange(_MAP_COLUMNS) + 0.5) / _MAP_COLUMNS)
    tau = chart.y.read(1.0 - (np.arange(_MAP_ROWS) + 0.5) / _MAP_ROWS)
    near = np.log(dynamic.tau)[:, np.newaxis] - np.log(tau)
    row = np.argmin(np.abs(near), axis=0)
    window = np.argmin(np.abs(dynamic.centre_s[:, np.newaxis] - time_s), axis=0)
    ratio = dynamic.relative(axis)[np.ix_(window, row)].T
    outside = np.abs(near).min(axis=0) > _MAP_REACH
    ratio[outside] = np.nan
    spare = (time_s < dynamic.start_s[0]) | (time_s > dynamic.stop_s[-1])
    ratio[:, spare] = np.nan
    drawing = Drawing(image=ratio_colours(ratio))
    for times_s, colour in ((others_s, muted(EFFECT)), (events_s, EFFECT)):
        for at_s in times_s:
            x = float(WIDTH * chart.x.place(at_s))
            if 0.0 <= x <= WIDTH:
                drawing.line([np.array([[x, 0.0], [x, HEIGHT]], np.float32)], colour, width=1.0)
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
            drawing.word(at, kind_name(name), colour)
    # Broad and pale, beneath the measured line: it shows beside the line wherever the two differ.
    drawing.line(chart.line(model.x, reading.factor * model.total), muted(MODEL), width=5.0)
    return drawing


def draw_noise_model(chart: Chart, model: ModelCurve, reading: Reading) -> Drawing:
    """Draw the noise model alone, without the effects that were found."""
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


def draw_reference(chart: Chart, reference: ReferenceCurve, reading: Reading) -> Drawing:
    """Draw the curve of an earlier session, or a mask, with its name at the end."""
    drawing = Drawing()
    strips = chart.line(reference.tau, reading.factor * reference.deviation)
    drawing.line(strips, REFERENCE, width=1.6)
    if strips:
        x, y = (float(value) for value in strips[-1][-1])
        drawing.word((min(x, WIDTH - 80.0), max(y - 50.0, 0.0)), reference.name, TEXT)
    return drawing


def _name(drawing: Drawing, points: Points, kind: str, colour: Colour) -> None:
    """Write the estimator's name above the last of some points, clear of the interval."""
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


def draw_density(chart: Chart, density: Density, reading: Reading, colour: Colour) -> Drawing:
    """Draw the root of the one-sided density with its 95 % interval.

    With `averages` independent ordinates in a band, 2 averages S / E[S] is chi-square with
    2 averages degrees of freedom.
    """
    drawing = Drawing()
    dof = 2.0 * density.averages
    # chdtri(v, p) is the chi-square value that is exceeded with probability p
    lower, upper = (density.density * dof / special.chdtri(dof, p) for p in (0.025, 0.975))
    value, low, high = (reading.factor * np.sqrt(s) for s in (density.density, lower, upper))
    drawing.line(chart.band(density.frequency, low, high, _HATCH), muted(colour), width=0.6)
    drawing.line(chart.line(density.frequency, value), colour, width=1.6)
    return drawing


def draw_density_model(chart: Chart, model: ModelCurve, reading: Reading) -> Drawing:
    """Draw the density of the fitted model."""
    drawing = Drawing()
    total = reading.factor * np.sqrt(model.total)
    drawing.line(chart.line(model.x, total), muted(MODEL), width=5.0)
    return drawing


def draw_density_limit(chart: Chart, verdict: DatasheetVerdict, reading: Reading) -> Drawing:
    """Draw the datasheet's noise density, one-sided as it is."""
    drawing = Drawing()
    if verdict.limit is not None:
        level = reading.factor * verdict.limit
        strips = chart.line(chart.x.read([0.0, 1.0]), np.full(2, level))
        drawing.dashes(strips, REFERENCE, width=1.2)
        if strips:
            drawing.word((90.0, float(strips[0][0, 1]) - 22.0), "datasheet", REFERENCE)
    return drawing


def draw_effects(chart: Chart, explanation: AxisExplanation) -> Drawing:
    """Mark every effect that has a frequency (or a cutoff) where it sits."""
    drawing = Drawing()
    height = 26.0
    for effect in explanation.effects:
        place = effect.parameters.get("frequency") or effect.parameters.get("cutoff")
        if place is None or isinstance(place.value, str):
            continue
        x = float(WIDTH * chart.x.place(place.value))
        if not 0.0 <= x <= WIDTH:
            continue
        drawing.dashes([np.array([(x, 0.0), (x, HEIGHT)], np.float32)], EFFECT, width=1.2)
        drawing.word(
            (float(np.clip(x, 110.0, WIDTH - 110.0)), height),
            f"{kind_name(effect.kind)} {number(place.value, 4)} Hz",
            EFFECT,
        )
        height += 34.0
    return drawing


def draw_residual(
    chart: Chart,
    curve: Deviation,
    before: ModelCurve | None,
    after: ModelCurve | None,
    colour: Colour,
) -> Drawing:
    """Draw measured / model - 1 in per cent: dashed grey before, the axis' colour after.

    The band is the interval of the estimate about zero: what sampling error alone explains.
    """
    drawing = Drawing()
    low, high = (100.0 * (limit / curve.deviation - 1.0) for limit in (curve.lower, curve.upper))
    drawing.line(chart.band(curve.tau, low, high, _HATCH), REFERENCE, width=0.6)
    drawing.line(chart.line(chart.x.read([0.0, 1.0]), np.zeros(2)), REFERENCE, width=1.2)
    if before is not None:
        drawing.dashes(chart.line(curve.tau, percent_of_model(curve, before)), REFERENCE, 2.0)
    if after is not None:
        drawing.line(chart.line(curve.tau, percent_of_model(curve, after)), colour, 2.0)
    return drawing


def percent_of_model(curve: Deviation, model: ModelCurve) -> NDArray[np.float64]:
    """Return 100 (measured / model - 1) at the taus of the curve; NaN beyond the model's."""
    if not len(model.x):
        return np.full(len(curve.tau), np.nan)
    total = np.exp(np.interp(np.log(curve.tau), np.log(model.x), np.log(model.total)))
    inside = (curve.tau >= model.x[0] * (1 - 1e-9)) & (curve.tau <= model.x[-1] * (1 + 1e-9))
    return np.asarray(np.where(inside, 100.0 * (curve.deviation / total - 1.0), np.nan))
