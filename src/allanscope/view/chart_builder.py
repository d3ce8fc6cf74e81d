"""From a result to drawings: which entity shows what, on which decades. It knows nothing of Rerun.

::

    /gx/allan/grid  oadev  mdev  ...  model  noise_model  datasheet  reference
    /gx/time/grid   tdev  ...
    /gx/spectrum/grid  measured  model  effects  datasheet
    /gx/residual/grid  oadev
    /gx/dynamic/grid  map

Each estimator is an entity of its own, so that the viewer can show or hide it by itself.

The decades of a chart are the same for the axes of one sensor, so that they can be compared. They
only ever grow, by whole decades, as a run gets longer; a chart that rescales at every refresh
cannot be read. The residual's scale is linear and follows what it has to show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from allanscope.allan import Deviation, DynamicDeviation
from allanscope.analysis import Analysis, AxisAnalysis
from allanscope.quantities import DENSITY, DEVIATION, Reading, symbols
from allanscope.view.chart import Chart, InUnits, Linear, Log
from allanscope.view.chart_content import (
    Drawing,
    draw_curve,
    draw_datasheet,
    draw_density,
    draw_density_limit,
    draw_density_model,
    draw_effects,
    draw_grid,
    draw_map,
    draw_model,
    draw_noise_model,
    draw_reference,
    draw_residual,
    percent_of_model,
)
from allanscope.view.palette import AXIS, ESTIMATOR, REFERENCE, Colour

__all__ = ["DEFAULT_ESTIMATOR", "TIME_DEVIATIONS", "ChartBuilder", "SharedScales"]

DEFAULT_ESTIMATOR = "oadev"
"""The estimator that the model is fitted to, and that is shown until another one is chosen."""

TIME_DEVIATIONS = ("tdev", "ttotdev")
"""Estimators whose unit is that of the data times s; they get a chart of their own."""

_STEADY_AVERAGES = 4.0
"""A band of fewer ordinates may come out anywhere near zero, which is no reason to show decades."""

_TIME_UNITS = (("d", 86_400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))
_TIME_STEPS = tuple(factor * 10.0**power for power in range(-2, 6) for factor in (1.0, 2.0, 5.0))

_STEPS = ((5.0, 2.5), (10.0, 5.0), (20.0, 10.0), (50.0, 25.0), (100.0, 50.0))


class SharedScales:
    """Scales of the charts of a run, shared by the axes of a sensor: `fit`, then take by unit."""

    def __init__(self) -> None:
        self._scales: dict[tuple[str, str], tuple[Log, Log]] = {}
        self._percent: dict[str, Linear] = {}

    def fit(self, analysis: Analysis) -> None:
        """Grow every frame until it holds what is known now."""
        for unit in DEVIATION:
            axes = [axis for axis in analysis.axes.values() if axis.unit == unit]
            if axes:
                self._fit(unit, axes)

    def allan(self, unit: str) -> Chart | None:
        """Return the sigma-tau chart, None before there is a curve."""
        return self._chart("allan", unit, "s", f"σ(τ), {symbols(DEVIATION[unit].unit)}")

    def time(self, unit: str) -> Chart | None:
        """Return the chart of the time deviations."""
        return self._chart("time", unit, "s", f"σx(τ), {symbols(DEVIATION[unit].unit)}·s")

    def spectrum(self, unit: str) -> Chart | None:
        """Return the chart of the noise density."""
        return self._chart("spectrum", unit, "Hz", f"density, {symbols(DENSITY[unit].unit)}")

    def residual(self, unit: str) -> Chart | None:
        """Return the chart of measured over model."""
        allan = self._scales.get(("allan", unit))
        percent = self._percent.get(unit)
        if allan is None or percent is None:
            return None
        return Chart(allan[0], percent, "s", "")

    def _chart(self, kind: str, unit: str, x_unit: str, title: str) -> Chart | None:
        scales = self._scales.get((kind, unit))
        return None if scales is None else Chart(*scales, x_unit, title)

    def _fit(self, unit: str, axes: list[AxisAnalysis]) -> None:
        curves = [curve for axis in axes for curve in axis.curves.values() if len(curve.tau)]
        times = [curve for curve in curves if curve.kind in TIME_DEVIATIONS]
        rates = [curve for curve in curves if curve.kind not in TIME_DEVIATIONS]
        self._fit_curves("allan", unit, rates)
        self._fit_curves("time", unit, times)
        self._fit_spectrum(unit, axes)
        self._fit_percent(unit, axes)

    def _fit_curves(self, kind: str, unit: str, curves: list[Deviation]) -> None:
        """Hold all taus, and the deviations that are trusted: the last few may be anywhere."""
        if not curves:
            return
        tau = np.concatenate([curve.tau for curve in curves])
        sigma = np.concatenate([DEVIATION[unit].factor * curve.deviation for curve in curves])
        trusted = np.concatenate([curve.trusted for curve in curves])
        if trusted.any():
            sigma = sigma[trusted]
        self._grow(kind, unit, Log.around(tau, least=3), Log.around(sigma, least=2))

    def _fit_spectrum(self, unit: str, axes: Iterable[AxisAnalysis]) -> None:
        reading: Reading = DENSITY[unit]
        known = [axis.density for axis in axes if axis.density is not None]
        if not any(len(density.frequency) for density in known):
            return
        frequency = np.concatenate([density.frequency for density in known])
        root = np.concatenate([reading.factor * np.sqrt(d.density) for d in known])
        steady = np.concatenate([density.averages for density in known]) >= _STEADY_AVERAGES
        if steady.any():
            root = root[steady]
        self._grow("spectrum", unit, Log.around(frequency, least=2), Log.around(root, least=2))

    def _fit_percent(self, unit: str, axes: Iterable[AxisAnalysis]) -> None:
        largest = 0.0
        for axis in axes:
            curve = axis.curves.get(DEFAULT_ESTIMATOR)
            for model in (axis.model_before, axis.model):
                if curve is not None and model is not None:
                    trusted = percent_of_model(curve, model)[curve.trusted]
                    known = np.abs(trusted[np.isfinite(trusted)])
                    largest = max(largest, float(known.max(initial=0.0)))
                    self._percent[unit] = _symmetric(largest)

    def _grow(self, kind: str, unit: str, x: Log, y: Log) -> None:
        before = self._scales.get((kind, unit))
        self._scales[kind, unit] = (x.union(before[0]), y.union(before[1])) if before else (x, y)


def _symmetric(largest: float) -> Linear:
    """Return the smallest scale of a few fixed ones that holds +-largest; at most +-100 %."""
    high, step = next((pair for pair in _STEPS if largest <= pair[0]), _STEPS[-1])
    return Linear(-high, high, step, "%")


@dataclass(slots=True)
class ChartBuilder:
    """Draws results, one after the other.

    Attributes
    ----------
    log : callable
        Takes the path of an entity and its drawing.
    scales : SharedScales
        The decades of every chart so far.
    """

    log: Callable[[str, Drawing], None]
    scales: SharedScales = field(default_factory=SharedScales)
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
        self.scales.fit(analysis)
        if everything:
            self._grids.clear()
        for name, axis in analysis.axes.items():
            self._allan(name, axis, everything)
            self._spectrum(name, axis)
            self._residual(name, axis)
        if everything and analysis.dynamic is not None:
            self._dynamic(analysis, analysis.dynamic)

    def _dynamic(self, analysis: Analysis, dynamic: DynamicDeviation) -> None:
        chart = _time_chart(dynamic)
        for number, (name, axis) in enumerate(analysis.axes.items()):
            if not axis.curves:
                continue
            self._grid(f"/{name}/dynamic", chart)
            own_s, others_s = _onsets(analysis, name)
            drawing = draw_map(chart, dynamic, number, own_s, others_s)
            self.log(f"/{name}/dynamic/map", drawing)

    def _allan(self, name: str, axis: AxisAnalysis, everything: bool) -> None:
        reading = DEVIATION[axis.unit]
        rates, times = self.scales.allan(axis.unit), self.scales.time(axis.unit)
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
            self.log(f"{base}/noise_model", draw_noise_model(chart, axis.model_before, reading))
        if everything and axis.comparison is not None:
            self.log(f"{base}/reference", draw_reference(chart, axis.comparison.reference, reading))
        if everything and "density" in axis.datasheet:
            self.log(f"{base}/datasheet", draw_datasheet(chart, axis.datasheet["density"], reading))

    def _spectrum(self, name: str, axis: AxisAnalysis) -> None:
        base = f"/{name}/spectrum"
        chart = self.scales.spectrum(axis.unit)
        if chart is None or axis.density is None:
            return
        grown = self._grid(base, chart)
        reading = DENSITY[axis.unit]
        self.log(f"{base}/measured", draw_density(chart, axis.density, reading, AXIS[name]))
        if axis.density_model is not None:
            self.log(f"{base}/model", draw_density_model(chart, axis.density_model, reading))
        if axis.explanation is not None:
            self.log(f"{base}/effects", draw_effects(chart, axis.explanation))
        if grown and "density" in axis.datasheet:
            limit = draw_density_limit(chart, axis.datasheet["density"], reading)
            self.log(f"{base}/datasheet", limit)

    def _residual(self, name: str, axis: AxisAnalysis) -> None:
        chart = self.scales.residual(axis.unit)
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


def _onsets(analysis: Analysis, axis: str) -> tuple[list[float], list[float]]:
    """Return when events began on an axis or in the whole stream, and when on other axes alone."""
    own_s: list[float] = []
    others_s: list[float] = []
    for event in analysis.events:
        times_s = own_s if axis in event.axes or not event.axes else others_s
        times_s += [once.onset_s for once in event.occurrences]
    return own_s, others_s


def _time_chart(dynamic: DynamicDeviation) -> Chart:
    """Return the chart of the deviation over time; its length is a few round steps."""
    end_s = float(dynamic.stop_s[-1])
    unit, unit_s = next(((u, s) for u, s in _TIME_UNITS if end_s > 2.0 * s), _TIME_UNITS[-1])
    step = next(s for s in _TIME_STEPS if end_s / unit_s <= 6.0 * s)
    high = step * np.ceil(end_s / unit_s / step)
    return Chart(
        InUnits(Linear(0.0, float(high), step), unit_s),
        Log.around(dynamic.tau, least=2),
        unit,
        "τ, s",
    )


def _curve_colour(axis: str, kind: str) -> Colour:
    return AXIS[axis] if kind == DEFAULT_ESTIMATOR else ESTIMATOR.get(kind, REFERENCE)
