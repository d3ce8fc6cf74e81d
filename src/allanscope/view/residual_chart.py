"""What a residual chart shows: measured over model, before and after the loop was closed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.allan.deviation import Deviation
from allanscope.analysis.result import ModelCurve
from allanscope.view.chart import Chart
from allanscope.view.drawing import Drawing
from allanscope.view.palette import REFERENCE, Colour

__all__ = ["draw_residual", "percent_of_model"]

_HATCH = 8.0


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
