"""Pictures of the data themselves: DT0064's series, density, lag plot and ratio of variances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator
from numpy.typing import NDArray

from allanscope.allan import DynamicDeviation
from allanscope.analysis import AxisAnalysis
from allanscope.history import Record
from allanscope.labels import kind_name
from allanscope.quantities import DENSITY, LEVEL, number, symbols
from allanscope.report.curve_pictures import scale_loglog
from allanscope.report.picture import CYCLE, DATASHEET, FOUND, MEASURED, MODEL, Picture, ink

__all__ = ["density_picture", "dynamic_picture", "lag_picture", "ratio_picture", "series_picture"]

_POINTS = 600
_CELLS = 80
_MAP_COLUMNS = 200


def density_picture(name: str, axis: AxisAnalysis) -> Picture:
    """Draw the one-sided density with the model's and the datasheet's, and the lines found."""

    def draw(figure: Figure) -> None:
        ax, density, factor = figure.subplots(), axis.density, DENSITY[axis.unit].factor
        assert density is not None
        root = factor * np.sqrt(density.density)
        ax.plot(density.frequency, root, c=MEASURED, lw=0.9, label=f"{name}, measured")
        if axis.density_model is not None:
            model = axis.density_model
            ax.plot(model.x, factor * np.sqrt(model.total), c=MODEL, lw=1.5, label="model")
        sheet = axis.datasheet.get("density")
        if sheet is not None and sheet.limit is not None:
            ax.axhline(factor * sheet.limit, c=DATASHEET, ls="-.", lw=1.3, label="datasheet")
        _found(ax, axis)
        unit = symbols(DENSITY[axis.unit].unit)
        scale_loglog(ax, "frequency (Hz)", f"one-sided density ({unit})")
        ax.legend(loc="best")

    return Picture(draw)


def series_picture(
    record: Record, names: Sequence[str], unit: str, marks: Sequence[tuple[float, str]] = ()
) -> Picture:
    """Draw the time series of some axes, thinned to what a page can show, with the user's marks."""

    def draw(figure: Figure) -> None:
        ax, reading = figure.subplots(), LEVEL[unit]
        for name, colour in zip(names, CYCLE, strict=False):
            column = reading.factor * record.values[:, record.axes.index(name)]
            time_s, low, mean, high = _thinned(record.start_s, column - column.mean(), _POINTS)
            ax.fill_between(time_s, low, high, color=colour, alpha=0.25, lw=0)
            ax.plot(time_s, mean, c=colour, lw=0.8, label=name)
        for number_of, (at_s, _) in enumerate(marks, 1):
            ax.axvline(at_s, c=FOUND, ls=":", lw=1.2)
            ax.annotate(
                str(number_of),
                (at_s, 1.0),
                (2, -9),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                color=FOUND,
                fontweight="bold",
            )
        ax.set_xlabel("time (s)")
        ax.set_ylabel(f"deviation from the mean ({symbols(reading.unit)})")
        ax.legend(loc="upper right", ncols=3)

    return Picture(draw, height=2.8)


def dynamic_picture(
    dynamic: DynamicDeviation, columns: Mapping[str, int], marks: Sequence[tuple[float, str]] = ()
) -> Picture:
    """Draw the Allan deviation over time, a map an axis: each cell over the median at its tau."""
    height = 3.4 if len(columns) > 3 else 2.2
    bottom, top = 0.48 / height, 1.0 - 0.25 / height

    def draw(figure: Figure) -> None:
        names = list(columns)
        rows = -(-len(names) // 3)
        places = {"left": 0.115, "right": 0.87, "bottom": bottom, "top": top}
        places |= {"hspace": 0.25, "wspace": 0.08}
        charts = figure.subplots(
            rows, min(len(names), 3), sharex=True, sharey=True, squeeze=False, gridspec_kw=places
        )
        windows = np.linspace(0, len(dynamic.start_s) - 1, min(len(dynamic.start_s), _MAP_COLUMNS))
        chosen = np.unique(windows.astype(np.int64))
        for ax in charts.flat[len(names) :]:
            ax.set_visible(False)
        for name, ax in zip(names, charts.flat, strict=False):
            ratio = np.ma.masked_invalid(dynamic.relative(columns[name])[chosen].T)
            mesh = ax.pcolormesh(
                dynamic.centre_s[chosen],
                dynamic.tau,
                np.ma.masked_less_equal(ratio, 0.0),
                cmap="RdYlBu_r",
                norm=LogNorm(0.25, 4.0),
                shading="nearest",
                rasterized=True,
            )
            ax.set_yscale("log")
            ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            ax.yaxis.set_minor_locator(NullLocator())
            ax.set_title(name, fontsize="medium")
            for at_s, _ in marks:
                ax.axvline(at_s, c=ink(), ls=":", lw=0.8)
        figure.supxlabel("time (s)", fontsize="medium")
        figure.supylabel("averaging time τ (s)", fontsize="medium", x=0.005)
        room = figure.add_axes((0.89, bottom, 0.015, top - bottom))
        bar = figure.colorbar(mesh, cax=room, label="σ(τ) / its median", ticks=[0.25, 0.5, 1, 2, 4])
        bar.ax.minorticks_off()
        bar.ax.set_yticklabels(["¼", "½", "1", "2", "4"])

    return Picture(draw, height=height)


def lag_picture(record: Record, name: str, unit: str) -> Picture:
    """Draw DT0064's lag plot: each value against the one before it.

    A round cloud is white noise; one stretched along the diagonal has memory, one across it
    alternates; lattices, islands and arms are quantisation, telegraph noise and outliers.
    """

    def draw(figure: Figure) -> None:
        ax, reading = figure.subplots(), LEVEL[unit]
        column = reading.factor * record.values[:, record.axes.index(name)]
        first, last = record.segments[int(np.argmax(np.diff(record.segments, axis=1)))]
        part = column[first:last] - column[first:last].mean()
        step = reading.factor * record.lsb[record.axes.index(name)] / record.stride
        edges = _edges(part, step)
        image = np.ma.masked_equal(_pairs(part, edges), 0)
        ax.pcolormesh(edges, edges, image, cmap="viridis", norm="log", rasterized=True)
        ax.set_xlabel(f"{name} at k ({symbols(reading.unit)})")
        ax.set_ylabel(f"{name} at k + 1 ({symbols(reading.unit)})")
        ax.set_aspect("equal")

    return Picture(draw, 3.4, 3.4)


def ratio_picture(axes: Mapping[str, AxisAnalysis]) -> Picture:
    """Draw DT0064's ratio of the classical variance of averages to the Allan variance.

    It is 1 for white noise, because both then estimate the same thing, and grows where the noise
    has memory: there the classical variance no longer converges.
    """

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for (name, axis), colour in zip(axes.items(), CYCLE, strict=False):
            if "ostdev" not in axis.curves or "oadev" not in axis.curves:
                continue
            allan, classical = axis.curves["oadev"], axis.curves["ostdev"]
            _, here, there = np.intersect1d(allan.m, classical.m, return_indices=True)
            own, other = allan.deviation[here], classical.deviation[there]
            noisy = own > 0
            if noisy.any():
                ratio = (other[noisy] / own[noisy]) ** 2
                ax.plot(allan.tau[here][noisy], ratio, c=colour, lw=1.0, label=name)
        ax.axhline(1.0, c=ink(), lw=0.8)
        scale_loglog(ax, "averaging time τ (s)", "variance / Allan variance")
        if ax.get_legend_handles_labels()[0]:
            ax.legend(loc="upper left", ncols=2)

    return Picture(draw, height=3.0)


def _found(ax: Axes, axis: AxisAnalysis) -> None:
    """Mark every effect that has a frequency, or a cutoff, where it sits."""
    for effect in axis.explanation.effects if axis.explanation else ():
        place = effect.parameters.get("frequency") or effect.parameters.get("cutoff")
        if place is None or isinstance(place.value, str):
            continue
        ax.axvline(place.value, c=FOUND, ls=":", lw=1.2)
        ax.annotate(
            f"{kind_name(effect.kind)} {number(place.value, 4)} Hz",
            (place.value, 0.02),
            (-3, 0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="right",
            rotation=90,
            color=FOUND,
            in_layout=False,
        )


def _edges(part: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the edges of cells a whole number of steps wide, else the raster makes a pattern."""
    low, high = np.percentile(part, [0.01, 99.99]) if len(part) else (0.0, 0.0)
    if high <= low:
        low, high = low - 1.0, high + 1.0
    width = (high - low) / _CELLS
    if step > 0.0:
        width = step * max(1, round(width / step))
    return np.asarray(low - width / 2 + width * np.arange(int((high - low) / width) + 2))


def _pairs(part: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return how often a value of each cell, a row, follows one of each cell, a column.

    Cells are equally wide, so that none has to be searched for.
    """
    cells = len(edges) - 1
    cell = np.floor((part - edges[0]) / (edges[1] - edges[0]))
    cell[(cell < 0) | (cell >= cells)] = np.nan
    pairs = cell[1:] * cells + cell[:-1]
    counts = np.bincount(pairs[np.isfinite(pairs)].astype(np.int64), minlength=cells**2)
    return counts.reshape(cells, cells)


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
