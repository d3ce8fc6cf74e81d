"""The figures of the report, one function each, all as SVG text.

Colours and order are the same in every figure. SVG text stays text, so that it can be searched,
and inherits the page's colour, so that one figure serves the light and the dark page.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from allanscope.allan.deviation import Deviation
from allanscope.analysis.result import AxisAnalysis, ModelCurve
from allanscope.history import Record
from allanscope.spectrum.density import Density

__all__ = [
    "compare_figure",
    "density_figure",
    "deviation_figure",
    "lag_figure",
    "ratio_figure",
    "residual_figure",
    "series_figure",
]

MEASURED, MODEL, BEFORE, COMPONENT, DATASHEET = (
    "#0072B2",
    "#D55E00",
    "#CC79A7",
    "#009E73",
    "#E69F00",
)
"""Okabe and Ito's palette, which the colour-blind can tell apart."""

CYCLE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7f7f7f")

INK = "#808080"
"""Grey that reads on white and on black; the page replaces it by its own ink."""

STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "allanscope",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": INK,
    "grid.alpha": 0.25,
    "axes.grid": True,
    "legend.frameon": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "path.simplify": True,
}


class Drawing:
    """One figure on its way to SVG."""

    def __init__(self, width: float, height: float) -> None:
        self.figure = Figure(figsize=(width, height), layout="constrained")
        self.svg = ""

    def axes(self, rows: int = 1, **options: Any) -> Any:
        """Return the axes of the figure, one below the other."""
        return self.figure.subplots(rows, 1, sharex=True, **options)


@contextmanager
def drawing(width: float = 7.0, height: float = 4.2) -> Iterator[Drawing]:
    """Open a figure in the report's style; its `svg` is there after the block."""
    with mpl.rc_context(STYLE):
        one = Drawing(width, height)
        yield one
        buffer = io.StringIO()
        # No date in the file: the same result gives the same bytes.
        one.figure.savefig(
            buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
        )
    text = buffer.getvalue()
    one.svg = text[text.index("<svg") :].replace(INK, "currentColor")


def deviation_figure(name: str, axis: AxisAnalysis, limit: float | None) -> str:
    """Draw one axis: curve, interval, model, its components, the datasheet's line.

    Parameters
    ----------
    name : str
        Axis.
    axis : AxisAnalysis
        What is known of it.
    limit : float or None
        Two-sided density that the datasheet allows, in the unit of the axis per sqrt(Hz).
    """
    curve = axis.curves["oadev"]
    with drawing() as one:
        ax = one.axes()
        _curve(ax, curve, MEASURED, f"{name} overlapping Allan deviation")
        if axis.model is not None:
            _model(ax, axis.model)
        if limit is not None:
            ax.plot(curve.tau, limit / np.sqrt(curve.tau), "-.", c=DATASHEET, lw=1.2)
            ax.plot([], [], "-.", c=DATASHEET, lw=1.2, label="datasheet density")
        _loglog(ax, "averaging time τ (s)", f"deviation σ ({axis.unit})")
        _frame(ax, curve)
        ax.legend(loc="best")
    return one.svg


def residual_figure(name: str, axis: AxisAnalysis) -> str:
    """Draw the closed loop: the curve with both models, and what each of them leaves."""
    curve = axis.curves["oadev"]
    with drawing(height=5.2) as one:
        top, bottom = one.axes(2, height_ratios=[2, 1])
        _curve(top, curve, MEASURED, f"{name} measured")
        for model, colour, label in (
            (axis.model_before, BEFORE, "model before"),
            (axis.model, MODEL, "model after"),
        ):
            if model is None:
                continue
            top.plot(model.x, model.total, c=colour, lw=1.3, label=label)
            ratio = curve.deviation / np.interp(curve.tau, model.x, model.total)
            bottom.plot(curve.tau, 100 * (ratio - 1), "o-", ms=2.5, lw=0.8, c=colour)
        spread = 100 * np.stack([curve.lower, curve.upper]) / curve.deviation - 100
        bottom.fill_between(curve.tau, spread[0], spread[1], color=MEASURED, alpha=0.15, lw=0)
        bottom.axhline(0.0, c=INK, lw=0.8)
        bottom.set_ylim(-60, 60)
        bottom.set_ylabel("measured / model − 1 (%)")
        top.set_xscale("log")
        top.set_yscale("log")
        top.set_ylabel(f"deviation σ ({axis.unit})")
        bottom.set_xlabel("averaging time τ (s)")
        _frame(top, curve)
        top.legend(loc="best")
    return one.svg


def density_figure(name: str, density: Density, model: ModelCurve | None, unit: str) -> str:
    """Draw the one-sided density with the model's."""
    with drawing() as one:
        ax = one.axes()
        ax.plot(density.frequency, np.sqrt(density.density), c=MEASURED, lw=0.9, label=name)
        if model is not None:
            ax.plot(model.x, np.sqrt(model.total), c=MODEL, lw=1.3, label="model")
        _loglog(ax, "frequency (Hz)", f"density ({unit}/√Hz, one-sided)")
        ax.legend(loc="best")
    return one.svg


def series_figure(record: Record, names: Sequence[str], unit: str) -> str:
    """Draw the time series of some axes, thinned to what a page can show."""
    with drawing(height=2.8) as one:
        ax = one.axes()
        for name, colour in zip(names, CYCLE, strict=False):
            column = record.values[:, record.axes.index(name)]
            time_s, low, mean, high = _thinned(record.start_s, column - column.mean(), 600)
            ax.fill_between(time_s, low, high, color=colour, alpha=0.25, lw=0)
            ax.plot(time_s, mean, c=colour, lw=0.8, label=name)
        ax.set_xlabel("time (s)")
        ax.set_ylabel(f"deviation from the mean ({unit})")
        ax.legend(loc="upper right", ncols=3)
    return one.svg


def lag_figure(record: Record, name: str, unit: str) -> str:
    """Draw DT0064's lag plot: each value against the one before it.

    A round cloud is white noise; one stretched along the diagonal has memory, one across it
    alternates; lattices, islands and arms are quantisation, telegraph noise and outliers.
    """
    column = record.values[:, record.axes.index(name)]
    first, last = record.segments[int(np.argmax(np.diff(record.segments, axis=1)))]
    part = column[first:last]
    with drawing(3.4, 3.4) as one:
        ax = one.axes()
        low, high = np.percentile(part, [0.01, 99.99])
        edges = np.linspace(low, high, 81)
        if edges[0] == edges[-1]:
            edges = np.linspace(edges[0] - 1, edges[0] + 1, 81)
        counts = np.histogram2d(part[:-1], part[1:], bins=[edges, edges])[0]
        image = np.ma.masked_equal(counts.T, 0)
        ax.pcolormesh(edges, edges, image, cmap="viridis", norm="log", rasterized=True)
        ax.set_xlabel(f"{name} at k ({unit})")
        ax.set_ylabel(f"{name} at k + 1 ({unit})")
        ax.set_aspect("equal")
    return one.svg


def ratio_figure(curves: Mapping[str, AxisAnalysis]) -> str:
    """Draw DT0064's ratio of the classical variance of averages to the Allan variance.

    It is 1 for white noise, because both then estimate the same thing, and grows where the noise
    has memory: there the classical variance no longer converges.
    """
    with drawing(height=3.0) as one:
        ax = one.axes()
        for (name, axis), colour in zip(curves.items(), CYCLE, strict=False):
            if "ostdev" not in axis.curves or "oadev" not in axis.curves:
                continue
            allan, classical = axis.curves["oadev"], axis.curves["ostdev"]
            common, here, there = np.intersect1d(allan.m, classical.m, return_indices=True)
            if len(common) == 0:
                continue
            ratio = (classical.deviation[there] / allan.deviation[here]) ** 2
            ax.plot(allan.tau[here], ratio, c=colour, lw=1.0, label=name)
        ax.axhline(1.0, c=INK, lw=0.8)
        _loglog(ax, "averaging time τ (s)", "variance / Allan variance")
        ax.legend(loc="upper left", ncols=2)
    return one.svg


def compare_figure(curves: Mapping[str, Deviation], unit: str) -> str:
    """Overlay the curves of one axis from several sessions."""
    with drawing() as one:
        ax = one.axes()
        for (name, curve), colour in zip(curves.items(), CYCLE * 4, strict=False):
            _curve(ax, curve, colour, name)
        _loglog(ax, "averaging time τ (s)", f"deviation σ ({unit})")
        ax.legend(loc="best")
    return one.svg


def _curve(ax: Axes, curve: Deviation, colour: str, label: str) -> None:
    ax.fill_between(curve.tau, curve.lower, curve.upper, color=colour, alpha=0.2, lw=0)
    trusted = curve.trusted
    ax.plot(
        curve.tau[trusted], curve.deviation[trusted], "o-", ms=2.5, lw=1.0, c=colour, label=label
    )
    if not trusted.all():
        # Beyond the trusted part of the run the curve goes on, hollow and dotted.
        beyond = np.flatnonzero(~trusted)
        tail = slice(max(int(beyond[0]) - 1, 0), None)
        ax.plot(curve.tau[tail], curve.deviation[tail], "o:", ms=2.5, lw=0.9, c=colour, mfc="none")


def _model(ax: Axes, model: ModelCurve) -> None:
    ax.plot(model.x, model.total, c=MODEL, lw=1.3, label="model")
    floor = ax.get_ylim()[0]
    for name, part in model.components.items():
        if not np.any(part > floor):
            continue
        ax.plot(model.x, part, "--", c=COMPONENT, lw=0.9)
        at = int(np.argmax(part / model.total))
        ax.annotate(name, (model.x[at], part[at]), color=COMPONENT, fontsize=9, fontweight="bold")


def _loglog(ax: Axes, xlabel: str, ylabel: str) -> None:
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)


def _frame(ax: Axes, curve: Deviation) -> None:
    """Show a decade around the curve, so that a component far below it cannot shrink it."""
    if len(curve.deviation):
        ax.set_ylim(curve.deviation.min() / 4, curve.deviation.max() * 4)


def _thinned(
    time_s: NDArray[np.float64], values: NDArray[np.float64], points: int
) -> tuple[NDArray[np.float64], ...]:
    """Return time, minimum, mean and maximum over at most `points` stretches of a series."""
    if len(values) <= points:
        return time_s, values, values, values
    starts = np.linspace(0, len(values), points, endpoint=False).astype(np.int64)
    sizes = np.diff(np.append(starts, len(values)))
    low = np.minimum.reduceat(values, starts)
    high = np.maximum.reduceat(values, starts)
    return time_s[starts], low, np.add.reduceat(values, starts) / sizes, high
