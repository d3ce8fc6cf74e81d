"""Which decades each chart has: the same for the axes of one sensor, so that they can be compared.

A frame only ever grows, by whole decades, as a run gets longer; a chart that rescales at every
refresh cannot be read. The residual's is linear and follows what it has to show.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from allanscope.allan.deviation import Deviation
from allanscope.analysis.result import Analysis, AxisAnalysis
from allanscope.quantities import DENSITY, DEVIATION, Reading, symbols
from allanscope.view.chart import Chart
from allanscope.view.residual_chart import percent_of_model
from allanscope.view.scales import Linear, Log

__all__ = ["DEFAULT_ESTIMATOR", "TIME_DEVIATIONS", "Frames"]

DEFAULT_ESTIMATOR = "oadev"
"""The estimator that the model is fitted to, and that is shown until another one is chosen."""

TIME_DEVIATIONS = ("tdev", "ttotdev")
"""Estimators whose unit is that of the data times s; they get a chart of their own."""

_STEADY_AVERAGES = 4.0
"""A band of fewer ordinates may come out anywhere near zero, which is no reason to show decades."""

_STEPS = ((5.0, 2.5), (10.0, 5.0), (20.0, 10.0), (50.0, 25.0), (100.0, 50.0))


class Frames:
    """The charts of one run; `fit` them to a result, then take them by unit of the axis."""

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
