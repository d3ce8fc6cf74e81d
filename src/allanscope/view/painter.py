"""From a result to drawings: which entity shows what. Nothing here knows of Rerun.

::

    /gx/allan/grid  oadev  mdev  ...  model  textbook  datasheet
    /gx/time/grid   tdev  ...
    /gx/spectrum/grid  measured  model  found  datasheet
    /gx/residual/grid  oadev

Each estimator is an entity of its own, so that the viewer can show or hide it by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.quantities import DENSITY, DEVIATION, Reading
from allanscope.view.allan_chart import draw_curve, draw_datasheet, draw_model, draw_textbook
from allanscope.view.chart import Chart
from allanscope.view.drawing import Drawing, draw_grid
from allanscope.view.frames import DEFAULT_ESTIMATOR, TIME_DEVIATIONS, Frames
from allanscope.view.palette import AXIS, ESTIMATOR, REFERENCE, Colour
from allanscope.view.residual_chart import draw_residual
from allanscope.view.spectrum_chart import (
    draw_density,
    draw_density_limit,
    draw_density_model,
    draw_found,
)

__all__ = ["Painter"]


@dataclass(slots=True)
class Painter:
    """Draws results, one after the other.

    Attributes
    ----------
    log : callable
        Takes the path of an entity and its drawing.
    frames : Frames
        The decades of every chart so far.
    """

    log: Callable[[str, Drawing], None]
    frames: Frames = field(default_factory=Frames)
    _grids: dict[str, Chart] = field(default_factory=dict)

    def paint(self, analysis: Analysis, everything: bool = True) -> None:
        """Draw a result.

        Parameters
        ----------
        analysis : Analysis
            The result so far.
        everything : bool
            Also what rarely changes or is rarely looked at: grids, and the estimators other than
            the default one. They are drawn on demand to keep the recording small.
        """
        self.frames.fit(analysis)
        if everything:
            self._grids.clear()
        for name, axis in analysis.axes.items():
            self._allan(name, axis, everything)
            self._spectrum(name, axis)
            self._residual(name, axis)

    def _allan(self, name: str, axis: AxisAnalysis, everything: bool) -> None:
        reading = DEVIATION[axis.unit]
        rates, times = self.frames.allan(axis.unit), self.frames.time(axis.unit)
        grown = self._grid(f"/{name}/allan", rates) | self._grid(f"/{name}/time", times)
        for kind, curve in axis.curves.items():
            is_time = kind in TIME_DEVIATIONS
            chart = times if is_time else rates
            if chart is not None and (everything or grown or kind == DEFAULT_ESTIMATOR):
                path = f"/{name}/{'time' if is_time else 'allan'}/{kind}"
                colour, named = _curve_colour(name, kind), kind != DEFAULT_ESTIMATOR
                self.log(path, draw_curve(chart, curve, reading, colour, named))
        if rates is not None:
            self._models(f"/{name}/allan", axis, rates, reading, everything or grown)

    def _models(
        self, base: str, axis: AxisAnalysis, chart: Chart, reading: Reading, everything: bool
    ) -> None:
        if axis.model is not None:
            self.log(f"{base}/model", draw_model(chart, axis.model, reading))
        if axis.model_before is not None:
            self.log(f"{base}/textbook", draw_textbook(chart, axis.model_before, reading))
        if everything and "density" in axis.datasheet:
            self.log(f"{base}/datasheet", draw_datasheet(chart, axis.datasheet["density"], reading))

    def _spectrum(self, name: str, axis: AxisAnalysis) -> None:
        base = f"/{name}/spectrum"
        chart = self.frames.spectrum(axis.unit)
        if chart is None or axis.density is None:
            return
        grown = self._grid(base, chart)
        reading = DENSITY[axis.unit]
        self.log(f"{base}/measured", draw_density(chart, axis.density, reading, AXIS[name]))
        if axis.density_model is not None:
            self.log(f"{base}/model", draw_density_model(chart, axis.density_model, reading))
        if axis.explanation is not None:
            self.log(f"{base}/found", draw_found(chart, axis.explanation))
        if grown and "density" in axis.datasheet:
            limit = draw_density_limit(chart, axis.datasheet["density"], reading)
            self.log(f"{base}/datasheet", limit)

    def _residual(self, name: str, axis: AxisAnalysis) -> None:
        chart = self.frames.residual(axis.unit)
        curve = axis.curves.get(DEFAULT_ESTIMATOR)
        if chart is None or curve is None:
            return
        self._grid(f"/{name}/residual", chart)
        drawing = draw_residual(chart, curve, axis.model_before, axis.model, AXIS[name])
        self.log(f"/{name}/residual/{DEFAULT_ESTIMATOR}", drawing)

    def _grid(self, base: str, chart: Chart | None) -> bool:
        """Draw the grid of a chart if it is not the one that stands; tell whether it was drawn."""
        if chart is None or self._grids.get(base) == chart:
            return False
        self._grids[base] = chart
        self.log(f"{base}/grid", draw_grid(chart))
        return True


def _curve_colour(axis: str, kind: str) -> Colour:
    return AXIS[axis] if kind == DEFAULT_ESTIMATOR else ESTIMATOR.get(kind, REFERENCE)
