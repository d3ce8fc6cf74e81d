"""The pictures of a lot: each run a dot, so that nothing hides in a mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator
from numpy.typing import NDArray

from allanscope.fleet.drift import LEAST, started_days
from allanscope.fleet.lot import TAUS, Lot
from allanscope.fleet.verdict import Finding, units_named
from allanscope.quantities import COEFFICIENTS, LEVEL, symbols
from allanscope.report import DATASHEET, MEASURED, MODEL, Picture, ink
from allanscope.samples import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["CurveBands", "curve_bands", "curves_picture", "distribution_picture", "history_picture"]

Floats = NDArray[np.float64]

MOST_DOTS = 1000
"""For each axis; the quantiles of a larger lot look the same."""

_BANDS = (0.05, 0.25, 0.5, 0.75, 0.95)
_LEAST_SHARE = 0.2
"""Averaging times that fewer runs reach are not drawn: the band would be of other units."""
_MOST_NAMED = 6
_HALF_WIDTH = 0.36
_FEW_UNITS = 40
"""So many have room for a line through the runs of each."""
_FEW_DECADES = 10.0


def distribution_picture(lot: Lot, sensor_unit: str, named: Sequence[Finding] = ()) -> Picture:
    """Return N, B and K of all axes of one sensor; a bar is the median, a line the datasheet.

    Units have the same place from left to right at every axis, so that repeats of one stand above
    each other: spread along a column is that of repeats, spread among columns that of units.
    """
    axes = [axis for axis in lot.axes if lot.of_axis(axis)["sensor_unit"][0] == sensor_unit]
    units = np.unique(lot.units)

    def draw(figure: Figure) -> None:
        for name, ax in zip("NBK", figure.subplots(1, 3), strict=True):
            reading = COEFFICIENTS[sensor_unit, name][0]
            for at, axis in enumerate(axes):
                here = lot.of_axis(axis).detected(name)
                values = here[f"{name}_value"] * reading.factor
                if len(values):
                    where = at + _places(here, units)
                    _dots(ax, at, where, values)
                    _names(ax, where, values, here, units_named(named, axis, name))
                limit = lot.of_axis(axis)["datasheet_limit"]
                if name == "N" and np.isfinite(limit).any():
                    two_sided = np.nanmedian(limit) / np.sqrt(2.0) * reading.factor
                    ax.plot([at - 0.45, at + 0.45], [two_sided] * 2, "-.", c=DATASHEET, lw=1.4)
            _scale(ax)
            ax.set_xticks(range(len(axes)), axes)
            ax.set_xlim(-0.6, len(axes) - 0.4)
            ax.grid(visible=False, axis="x")
            ax.set_title(f"{name} ({symbols(reading.unit)})", fontsize=9, color=ink())

    return Picture(draw, height=3.0, fixed=False)


@dataclass(frozen=True)
class CurveBands:
    """The Allan deviation of all runs of one axis.

    Attributes
    ----------
    curves : ndarray of float32, shape (runs, k)
        Of each run, where enough of them reach.
    units : ndarray of str, shape (runs,)
        That they are of.
    tau : ndarray, shape (k,)
        In s.
    bands : ndarray, shape (5, k)
        Quantiles of the runs.
    """

    curves: NDArray[np.float32]
    units: NDArray[np.str_]
    tau: Floats
    bands: Floats


def curve_bands(lot: Lot) -> dict[str, CurveBands]:
    """Return the curves of each axis that has any."""
    found = {}
    for axis in lot.axes:
        here = lot.of_axis(axis)
        curves = here["curve"]
        shown = np.isfinite(curves).sum(axis=0) >= max(_LEAST_SHARE * len(curves), 1)
        if shown.any():
            bands = np.nanquantile(curves[:, shown], _BANDS, axis=0)
            found[axis] = CurveBands(curves[:, shown], here.units, TAUS[shown], bands)
    return found


def curves_picture(
    bands: Mapping[str, CurveBands], sensor_unit: str, named: Sequence[Finding] = ()
) -> Picture | None:
    """Return the Allan deviation of all runs of one sensor, an axis a panel; None without curves.

    Bands hold 50 and 90 % of the runs at each averaging time, a line is their median. Units that
    stand out on an axis are drawn over it with their names.
    """
    axes = [axis for axis in bands if unit_of(axis) == sensor_unit]
    if not axes:
        return None
    factor = LEVEL[sensor_unit].factor

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, len(axes), sharey=True, squeeze=False)[0]
        for ax, axis in zip(panels, axes, strict=True):
            here, tau = bands[axis], bands[axis].tau
            curves = here.curves
            if len(tau):
                low, lower, middle, upper, high = factor * here.bands
                ax.fill_between(tau, low, high, color=MEASURED, alpha=0.2, lw=0)
                ax.fill_between(tau, lower, upper, color=MEASURED, alpha=0.3, lw=0)
                ax.plot(tau, middle, c=MEASURED, lw=1.4)
            far = list(dict.fromkeys(one.unit for one in named if one.axis == axis))[:_MOST_NAMED]
            for unit in far:
                own = factor * _median_of(curves[here.units == unit])
                known = np.flatnonzero(np.isfinite(own))
                if len(known):
                    ax.plot(tau, own, c=MODEL, lw=1.0)
                    end = (tau[known[-1]], own[known[-1]])
                    ax.annotate(unit, end, (-2, 4), textcoords="offset points", ha="right", size=7)
            ax.set(xscale="log", yscale="log", xlabel="averaging time (s)")
            ax.set_title(axis, fontsize=9, color=ink())
        panels[0].set_ylabel(f"Allan deviation ({symbols(LEVEL[sensor_unit].unit)})")

    return Picture(draw, height=2.8, fixed=False)


def _median_of(curves: NDArray[np.float32]) -> Floats:
    """Return the median at each averaging time; NaN where no run reaches."""
    known = np.isfinite(curves).any(axis=0)
    found = np.full(curves.shape[1], np.nan)
    found[known] = np.nanmedian(curves[:, known], axis=0)
    return found


def history_picture(lot: Lot, sensor_unit: str) -> Picture | None:
    """Return N of every run over date and temperature, against the mean of its unit.

    None where no unit has runs that are far enough apart in either.
    """
    here = lot.where(lot["sensor_unit"] == sensor_unit).detected("N")
    temperature = (here["temperature_lowest"] + here["temperature_highest"]) / 2.0
    days = started_days(here)
    over = {
        "days since the first run": (days - np.nanmin(days, initial=np.inf), LEAST["date"]),
        "temperature (°C)": (temperature, LEAST["temperature"]),
    }
    panels = {
        label: values
        for label, (values, least) in over.items()
        if np.isfinite(values).any() and np.nanmax(values) - np.nanmin(values) >= least
    }
    if not panels or len(np.unique(here.units)) == len(set(here["recording"].tolist())):
        return None
    change = {axis: 100.0 * np.expm1(_against_own(here.of_axis(axis))) for axis in here.axes}

    def draw(figure: Figure) -> None:
        plots = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
        for ax, (label, values) in zip(plots, panels.items(), strict=True):
            for axis in here.axes:
                percent = change[axis]
                shown = np.linspace(0, len(percent) - 1, min(len(percent), MOST_DOTS)).astype(int)
                where = values[here["axis"] == axis]
                ax.plot(where[shown], percent[shown], "o", ms=3, alpha=0.7, label=axis)
            ax.axhline(0.0, c=ink(), lw=0.8)
            ax.set_xlabel(label)
        plots[0].set_ylabel("N against its unit (%)")
        plots[0].legend(ncols=3)

    return Picture(draw, height=2.6, fixed=False)


def _against_own(lot: Lot) -> Floats:
    """Return the logarithm of N of each run less the mean of its unit."""
    logs = np.log(lot["N_value"])
    _, of, repeats = np.unique(lot.units, return_inverse=True, return_counts=True)
    return np.asarray(logs - (np.bincount(of, logs) / repeats)[of])


def _places(lot: Lot, units: NDArray[np.str_]) -> Floats:
    """Return where in the column of an axis each run stands, by the name of its unit."""
    order = np.searchsorted(units, lot.units)
    return np.asarray(_HALF_WIDTH * (2.0 * (order + 0.5) / len(units) - 1.0))


def _dots(ax: Axes, at: int, where: Floats, values: Floats) -> None:
    """Draw the runs; of very many those that tell their distribution."""
    columns = np.unique(where)
    if len(columns) <= _FEW_UNITS:
        lowest, highest = (
            [extreme(values[where == one]) for one in columns] for extreme in (np.min, np.max)
        )
        ax.vlines(columns, lowest, highest, colors=MEASURED, lw=1.0, alpha=0.4)
    ascending = np.argsort(values)
    shown = ascending[np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).astype(int)]
    ax.plot(where[shown], values[shown], "o", ms=2.5, alpha=0.6, c=MEASURED)
    ax.plot([at - 0.42, at + 0.42], [np.median(values)] * 2, c=MODEL, lw=1.6)


def _names(ax: Axes, where: Floats, values: Floats, lot: Lot, units: list[str]) -> None:
    """Write the names of units that stand out beside their dots."""
    for unit in units:
        own = lot.units == unit
        place = (float(where[own][0]), float(np.median(values[own])))
        ax.annotate(unit, place, (5, 0), textcoords="offset points", va="center", fontsize=7)


def _scale(ax: Axes) -> None:
    """Set a logarithmic scale whose numbers can be read."""
    if not ax.has_data():
        ax.set_yticks([])
        ax.text(0.5, 0.5, "not detected", ha="center", transform=ax.transAxes)
        return
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    if high < _FEW_DECADES * low:
        ax.yaxis.set_major_locator(MaxNLocator(5))
        ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))
