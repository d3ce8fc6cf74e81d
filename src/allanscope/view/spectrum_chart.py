"""What a spectrum chart shows: measured noise density, the model's, and the lines found in it."""

from __future__ import annotations

import numpy as np
from scipy import special

from allanscope.analysis.result import ModelCurve
from allanscope.explain.effect import AxisExplanation
from allanscope.noise.coefficients import DatasheetVerdict
from allanscope.quantities import Reading, number
from allanscope.spectrum.density import Density
from allanscope.view.chart import HEIGHT, WIDTH, Chart
from allanscope.view.drawing import Drawing
from allanscope.view.palette import EFFECT, MODEL, REFERENCE, Colour, muted

__all__ = ["draw_density", "draw_density_limit", "draw_density_model", "draw_found"]

_HATCH = 8.0


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


def draw_found(chart: Chart, explanation: AxisExplanation) -> Drawing:
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
            f"{effect.kind.replace('_', ' ')} {number(place.value, 4)} Hz",
            EFFECT,
        )
        height += 34.0
    return drawing
